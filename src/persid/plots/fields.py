"""Figures of a model: where it moves to, what its terms add, and which of them the data cannot tell apart."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from numpy import ndarray

from persid.identification.diagnostics import COLLINEAR
from persid.lyapunov.operating_points import residual
from persid.measurements.trajectory import Trajectory
from persid.models.formulas import left_side, term_names
from persid.models.model import PersidskiiModel
from persid.plots.style import FIELD, FORM, MEASURED, MODEL, short, thin_path, tidy

ARROWS = 17
MOST_TERMS = 16  # drawn of one equation
MOST_COLUMNS = 20  # drawn of a matrix of correlations


def vector_field(
    ax: Axes, model: PersidskiiModel, box: object = None, states: Sequence[int] = (0, 1), centre: Any = None
) -> Axes:
    """Draw the direction of x', or of x+ - x, for u = u_ref over two states, the others at `centre` (x_ref)."""
    X, Y, points = mesh(box_of(model, box), states, ARROWS, model.x_ref if centre is None else centre, 0.5 / ARROWS)
    with np.errstate(all="ignore"):
        dot = np.nan_to_num(residual(model, points)[:, list(states)], nan=0.0, posinf=1e150, neginf=-1e150)
    size = np.linalg.norm(np.clip(dot, -1e150, 1e150), axis=1)
    arrow = np.clip(dot, -1e150, 1e150) / np.where(size > 0, size, 1.0)[:, None]
    ax.quiver(X, Y, arrow[:, 0].reshape(X.shape), arrow[:, 1].reshape(X.shape), color=FIELD, angles="xy", pivot="mid",
              scale=1.5 * ARROWS, width=0.0022, zorder=1)  # fmt: skip
    return tidy(ax)


def phase_portrait(
    ax: Axes,
    model: PersidskiiModel,
    box: object = None,
    states: Sequence[int] = (0, 1),
    runs: Sequence[Trajectory] = (),
    centre: object = None,
) -> Axes:
    """Draw the vector field over two states with runs as measured; `box` is one (lo, hi) per state."""
    i, j = states
    box = box_of(model, box)
    vector_field(ax, model, box, states, centre)
    for k, run in enumerate(runs):
        x, y = thin_path(run.x[:, i], run.x[:, j])
        ax.plot(x, y, color=MEASURED, lw=1.4, zorder=3, label=None if k else "measured")
    ax.set_xlim(*box[i])
    ax.set_ylim(*box[j])
    ax.set_xlabel(short(model.states[i]))
    ax.set_ylabel(short(model.states[j]))
    return ax


def contributions(
    ax: Axes, model: PersidskiiModel, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"], state: int
) -> Axes:
    """Draw how much each term adds to x' of one state: its root mean square over samples, in state units per s."""
    names, sizes = terms(model, x, u, state)
    keep = np.argsort(-sizes)[:MOST_TERMS]
    keep = keep[sizes[keep] > 0][::-1]
    ax.barh(np.arange(len(keep)), sizes[keep], color=MODEL, height=0.62)
    ax.set_yticks(np.arange(len(keep)), [short(names[k]) for k in keep])
    ax.set_title(left_side(model.field, short(model.states[state])), fontsize="medium")
    ax.set_xlabel("root mean square")
    tidy(ax).grid(axis="y", visible=False)
    return ax


def correlations(ax: Axes, model: PersidskiiModel, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"]) -> Axes:
    """Draw how alike the terms are on samples: a disk for every pair, its area the size of the correlation.

    Blue is positive, red negative; pairs above 0.99 wear a ring: the data determine only their sum. Columns that never
    vary are left out; of many, the first 20 are drawn.
    """
    names, R = correlation_matrix(model, x, u)
    i, j = np.tril_indices(len(names), -1)
    r = R[i, j]
    area = 160 * (8 / max(len(names), 8)) ** 2
    for sign, color in ((1, MEASURED), (-1, MODEL)):
        mine = np.sign(r) == sign
        ax.scatter(j[mine], -i[mine], s=area * np.abs(r[mine]), color=color, lw=0, alpha=0.8)
    close = np.abs(r) > COLLINEAR
    ax.scatter(j[close], -i[close], s=2.2 * area, facecolors="none", edgecolors=FORM, lw=2)
    shown = [short(name, 20) for name in names]
    ax.set_xticks(range(max(len(names) - 1, 0)), shown[:-1], rotation=60, ha="right", rotation_mode="anchor")
    ax.set_yticks([-k for k in range(1, len(names))], shown[1:])
    ax.set_xlim(-0.6, len(names) - 1.4)
    ax.set_ylim(-len(names) + 0.4, -0.4)
    ax.set_aspect("equal")
    return tidy(ax)


def correlation_matrix(
    model: PersidskiiModel, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"]
) -> tuple[list[str], Float[ndarray, "k k"]]:
    """Return the names of the first 20 terms that vary over samples, and the matrix of their correlations."""
    columns = _columns(model, x, u)
    moving = [k for k, c in enumerate(columns.T) if np.ptp(c) > 1e-12 * np.abs(c).max(initial=0.0)][:MOST_COLUMNS]
    names = term_names(model.field)
    return [names[k] for k in moving], np.atleast_2d(np.corrcoef(columns[:, moving], rowvar=False))


def terms(
    model: PersidskiiModel, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"], state: int
) -> tuple[list[str], Float[ndarray, " k"]]:
    """Return the names of the terms of one equation, and the root mean square of each over samples."""
    model = model.dense()
    channels = model.channels
    weights = np.concatenate([channels.A0[state], channels.columns[state], model.B[state], model.field.b[[state]]])
    return term_names(model.field), np.abs(weights) * np.sqrt((_columns(model, x, u) ** 2).mean(axis=0))


def _columns(model: PersidskiiModel, x: ndarray, u: ndarray) -> ndarray:
    """The values of states, channels, inputs and the constant at samples, without their coefficients."""
    model, dx = model.dense(), x - model.x_ref
    with np.errstate(all="ignore"):
        pairs = zip(model.channels.functions, model.channels.rows, strict=True)
        return np.column_stack([dx, *(f.value(dx @ row) for f, row in pairs), u - model.u_ref, np.ones(len(x))])


def box_of(model: PersidskiiModel, box: object, point: Any = None) -> Float[ndarray, "n 2"]:
    """Return the box given, or the domain of the data with the operating point, a quarter wider on each side."""
    if box is not None:
        return np.asarray(box, float)
    centre = model.x_ref if point is None else point
    domain = np.column_stack([centre - 1, centre + 1]) if model.domain is None else model.domain
    low, high = np.minimum(domain[:, 0], centre), np.maximum(domain[:, 1], centre)
    margin = 0.25 * np.maximum(high - low, 1e-9)
    return np.column_stack([low - margin, high + margin])


def mesh(
    box: Float[ndarray, "n 2"], states: Sequence[int], count: int, centre: Float[ndarray, " n"], inset: float = 0.0
) -> tuple[ndarray, ndarray, ndarray]:
    """Return a grid over two states as X, Y, and as points (count^2, n) whose other states are those of the centre."""
    i, j = states
    axes = [np.linspace(lo + inset * (hi - lo), hi - inset * (hi - lo), count) for lo, hi in (box[i], box[j])]
    X, Y = np.meshgrid(*axes)
    points = np.tile(np.asarray(centre, float), (X.size, 1))
    points[:, i], points[:, j] = X.ravel(), Y.ravel()
    return X, Y, points
