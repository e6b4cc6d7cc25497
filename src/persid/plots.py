"""Figures: one function a figure, which draws on the Axes it is given and returns it. Nothing global is touched.

    import matplotlib.pyplot as plt, persid as ps
    fig, ax = plt.subplots()
    ps.plots.level_sets(ax, certificate)

Blue and solid is measured, red and dashed is the model; the colours are told apart by colour-blind readers and in grey.
"""

import re
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from numpy import ndarray

from persid.certificate import Certificate, value
from persid.model import PersidskiiModel
from persid.trajectories import Trajectory
from persid.validation import Curve
from persid_check import groups

MEASURED, MODEL, LEVEL, FIELD, FORM = "#0072b2", "#d55e00", "#009e73", "#888888", "#cc79a7"
POINTS = 700  # a longer curve is drawn by its extremes in so many intervals
GRID = 81  # points a side on which V is evaluated
ARROWS = 17
MOST_LEVELS = 16
BOUND_POINTS = 80
DASHES = (0, (4, 2))


def free_run(ax: Axes, measured: Trajectory, found: Trajectory, state: int, name: str = "x") -> Axes:
    """Draw one state as measured and as the model predicts it from the first sample and the inputs; mark a blow-up."""
    ax.plot(*_thin(measured.t, measured.x[:, state]), color=MEASURED, lw=1.4, label="measured")
    low, high = _span(measured.x[:, state], 0.6)
    inside = np.clip(found.x[:, state], low - (high - low), high + (high - low))
    ax.plot(*_thin(found.t, inside), color=MODEL, lw=1.4, ls=DASHES, label="model, free run")
    ax.set_ylim(*_limits(measured.x[:, state], found.x[:, state]))
    if found.diverged_at is not None:
        blow_up(ax, found.diverged_at)
    ax.set_xlabel("t in s")
    ax.set_ylabel(plain(name))
    return _tidy(ax)


def blow_up(ax: Axes, time: float) -> Axes:
    """Mark the time at which a free run diverges."""
    ax.axvline(time, color=MODEL, lw=0.8)
    ax.plot([time], [0.93], marker="X", ms=8, color=MODEL, transform=ax.get_xaxis_transform(), clip_on=False)
    ax.annotate(f"blows up at {time:.4g} s", (time, 0.93), xycoords=ax.get_xaxis_transform(), xytext=(7, -3),
                textcoords="offset points", color=MODEL)  # fmt: skip
    return ax


def residuals(ax: Axes, t: Float[ndarray, " N"], residual: Float[ndarray, " N"], name: str = "x") -> Axes:
    """Draw what is left of one state after predicting it one step ahead, over time in s."""
    ax.axhline(0, color=FIELD, lw=0.8)
    ax.plot(*_thin(t, residual), color=MEASURED, lw=0.8)
    ax.set_ylim(*_limits(residual))
    ax.set_xlabel("t in s")
    ax.set_ylabel(plain(name))
    return _tidy(ax)


def validation_curve(ax: Axes, curve: Curve, chosen: float | None = None) -> Axes:
    """Draw the free-run error on left-out blocks against the ridge; crosses mark strengths at which runs blow up."""
    strengths, errors, blown = (np.array(part) for part in (curve.strengths, curve.errors, curve.blow_ups))
    ax.loglog(strengths, errors, color=MODEL, marker="o", ms=4, lw=1.4, label="error of free runs")
    if (blown > 0).any():
        ax.loglog(strengths[blown > 0], errors[blown > 0], "X", ms=9, color=FORM, ls="none", label="some runs blow up")
    if chosen:
        ax.axvline(chosen, color=FIELD, lw=1, ls=":", label=f"used: {chosen:.3g}")
    ax.set_xlabel("ridge (relative to scaled columns)")
    ax.set_ylabel("RMSE in widths of the data")
    ax.legend(frameon=False)
    return _tidy(ax)


def vector_field(ax: Axes, model: PersidskiiModel, box: Any = None, states: Sequence[int] = (0, 1)) -> Axes:
    """Draw the direction of x' for u = u_ref over two states, the others at x_ref; colour does not tell its size."""
    X, Y, points = _mesh(_box(model, box), states, ARROWS, model.x_ref, inset=0.5 / ARROWS)
    with np.errstate(all="ignore"):
        dot = np.nan_to_num(model.rhs(points)[:, list(states)], nan=0.0, posinf=1e150, neginf=-1e150)
    size = np.linalg.norm(np.clip(dot, -1e150, 1e150), axis=1)
    arrow = np.clip(dot, -1e150, 1e150) / np.where(size > 0, size, 1.0)[:, None]
    ax.quiver(X, Y, arrow[:, 0].reshape(X.shape), arrow[:, 1].reshape(X.shape), color=FIELD, angles="xy", pivot="mid",
              scale=1.5 * ARROWS, width=0.0022, zorder=1)  # fmt: skip
    return _tidy(ax)


def phase_portrait(
    ax: Axes, model: PersidskiiModel, box: Any = None, states: Sequence[int] = (0, 1), runs: Sequence[Trajectory] = ()
) -> Axes:
    """Draw the vector field over two states with runs as measured; `box` is one (lo, hi) per state."""
    i, j = states
    box = _box(model, box)
    vector_field(ax, model, box, states)
    for k, run in enumerate(runs):
        x, y = _thin_path(run.x[:, i], run.x[:, j])
        ax.plot(x, y, color=MEASURED, lw=1.4, zorder=3, label=None if k else "measured")
    ax.set_xlim(*box[i])
    ax.set_ylim(*box[j])
    ax.set_xlabel(plain(model.states[i]))
    ax.set_ylabel(plain(model.states[j]))
    return ax


def level_sets(
    ax: Axes, certificate: Certificate, box: Any = None, states: Sequence[int] = (0, 1), runs: Sequence[Trajectory] = ()
) -> Axes:
    """Draw level sets of V over two states, the others at the operating point, on the phase portrait.

    `box` is one (lo, hi) per state, by default that of a regional claim (whose certified region is shaded), or else the
    model's domain with the operating point, widened.
    """
    model, point, (i, j) = certificate.model, certificate.operating_point, states
    region = certificate.content if certificate.claim == "R" else {}
    certified = np.array([[value(lo), value(hi)] for lo, hi in region.get("box", [])]).reshape(-1, 2)
    box = _box(model, certified if box is None and region else box, point)
    phase_portrait(ax, model, box, states, runs)
    X, Y, points = _mesh(box, states, GRID, point)
    with np.errstate(all="ignore"):
        V = np.nan_to_num(certificate.V(points), nan=0.0, posinf=1e300).reshape(X.shape)
    ax.contour(X, Y, V, levels=_levels(V), colors=LEVEL, linewidths=0.8 if region else 1.1, zorder=2)
    if region:
        ax.contour(X, Y, V, levels=[value(region["level"])], colors=LEVEL, linewidths=3, zorder=2)
        ax.contourf(X, Y, V, levels=[V.min() - 1, value(region["level"])], colors=LEVEL, alpha=0.12, zorder=0)
    ax.plot(point[i], point[j], marker="o", ms=6, color="#000000", ls="none", zorder=4, label="operating point")
    return ax


def bound(ax: Axes, certificate: Certificate, run: Trajectory) -> Axes:
    """Draw the distance of a run of the model from the operating point, and the bound that the certificate proves.

    Raises:
        PersidError: the claim has no rate, or the run starts outside the certified region or has too large inputs.
    """
    point = certificate.content["operating_point"]
    u = certificate.model.u_ref if point is None else np.array([value(pair) for pair in point["u"]])
    largest = float(np.linalg.norm(run.u - u, axis=1).max(initial=0.0))
    t = np.linspace(run.t[0], run.t[-1], BOUND_POINTS)
    ax.plot(t, certificate.bound(run.x[0], largest, t - t[0]), color=LEVEL, lw=1.6, label="proved bound")
    distance = np.linalg.norm(run.x - certificate.operating_point, axis=1)
    ax.plot(*_thin(run.t, distance), color=MODEL, lw=1.4, ls=DASHES, label="model, free run")
    ax.set_ylim(bottom=0)
    ax.set_xlabel("t in s")
    ax.set_ylabel("|x - x*|")
    ax.legend(frameon=False)
    return _tidy(ax)


def sector_forms(ax: Axes, certificate: Certificate, group: int) -> Axes:
    """Draw the functions of one group, and the sector forms that the proof uses on them, against y.

    Each form l'phi(y) has the sign of y: its curve stays in the shaded quadrants, which is what the proof relies on.
    The range of y is the region of a regional claim, or else that of the model's domain.
    """
    low, high, phi, y = _curve(certificate, group)
    for k, curve in enumerate(phi[1:]):
        ax.plot(y, curve / _top(curve), color=MEASURED, lw=3.2, alpha=0.45, label=None if k else "functions")
    forms = np.array([[value(c) for c in form] for form in certificate.content["groups"][group]["forms"]])
    for k, curve in enumerate(forms.reshape(-1, len(phi)) @ phi):
        ax.plot(y, curve / _top(curve), color=FORM, lw=1.0, ls=DASHES, label=None if k else "sector forms")
    ax.fill_between(y, 0, np.sign(y) * 1.08, color=LEVEL, alpha=0.1, lw=0)
    ax.set_xlim(low, high)
    ax.set_ylim(-1.08, 1.08)
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel("y")
    ax.set_ylabel("each scaled to 1")
    ax.legend(frameon=False, loc="upper left", fontsize="small")
    return _tidy(ax)


def _curve(certificate: Certificate, group: int) -> tuple[float, float, ndarray, ndarray]:
    """Return a range of y, phi(y) of one group about the operating point, one row an entry, and y."""
    model, part = certificate.model, groups(certificate.model.to_dict())[group]
    weights, places = np.array([float(v) for v in part.row.values()]), list(part.row)
    at = float(weights @ (certificate.operating_point - model.x_ref)[places])
    if certificate.claim == "R":
        box = np.array([[value(lo), value(hi)] for lo, hi in certificate.content["box"]])
    else:
        box = _box(model, None, certificate.operating_point)
    ends = weights[:, None] * (box - certificate.operating_point[:, None])[places]
    low, high = float(ends.min(axis=1).sum()), float(ends.max(axis=1).sum())
    y = np.linspace(low, high, 241)
    with np.errstate(all="ignore"):
        values = [
            model.channels.functions[c].value(float(a) * (at + y)) - model.channels.functions[c].value(float(a) * at)
            for c, a in part.members
        ]
    return low, high, np.stack([y, *values]), y


def contributions(
    ax: Axes, model: PersidskiiModel, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"], state: int
) -> Axes:
    """Draw how much each term adds to x' of one state: its root mean square over samples, in state units per s."""
    names, sizes = terms(model, x, u, state)
    keep = np.argsort(-sizes)[:16]
    keep = keep[sizes[keep] > 0][::-1]
    ax.barh(np.arange(len(keep)), sizes[keep], color=MODEL, height=0.62)
    ax.set_yticks(np.arange(len(keep)), [plain(names[k]) for k in keep])
    ax.set_xlabel(f"root mean square in d({plain(model.states[state])})/dt")
    _tidy(ax).grid(axis="y", visible=False)
    return ax


def terms(
    model: PersidskiiModel, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"], state: int
) -> tuple[list[str], Float[ndarray, " k"]]:
    """Return the names of the terms of one equation, and the root mean square of each over samples."""
    channels, dx = model.channels, x - model.x_ref
    with np.errstate(all="ignore"):
        values = [f.value(dx @ row) for f, row in zip(channels.functions, channels.rows, strict=True)]
    columns = np.column_stack([dx, *values, u - model.u_ref, np.ones(len(x))])
    weights = np.concatenate([channels.A0[state], channels.columns[state], model.B[state], model.b[[state]]])
    return term_names(model), np.abs(weights) * np.sqrt((columns**2).mean(axis=0))


def term_names(model: PersidskiiModel) -> list[str]:
    """Return the names of the terms that every equation may hold: states, channels, inputs, the constant."""
    channels = [_channel_name(model, c) for c in range(len(model.channels.functions))]
    return [*model.states, *channels, *model.inputs, "constant"]


def _channel_name(model: PersidskiiModel, c: int) -> str:
    """The function with its argument written out, such as tanh(x1/2) or ((x1 - 3)/4)^3."""
    row, text = model.channels.rows[c], model.channels.functions[c].text
    parts = [_scaled(float(row[k]), model.states[k], float(model.x_ref[k])) for k in np.flatnonzero(row)]
    inside = " + ".join(parts) or "0"
    alone = inside.isidentifier() or re.fullmatch(r"\w+\(x\)", text)
    return re.sub(r"\bx\b", lambda _: inside if alone else f"({inside})", text).replace("**", "^")


def _scaled(weight: float, name: str, reference: float) -> str:
    body = f"({name} {'-' if reference > 0 else '+'} {abs(reference):.4g})" if reference else name
    if weight == 1:
        return body
    return f"{body}/{1 / weight:.4g}" if (1 / weight).is_integer() else f"{weight:.4g} {body}"


def plain(name: str) -> str:
    """Return a user's name so that matplotlib does not read it as mathematics."""
    return name.replace("$", r"\$")


def _tidy(ax: Axes) -> Axes:
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.grid(True, color=FIELD, alpha=0.22, lw=0.6)
    ax.set_axisbelow(True)
    return ax


def _thin(t: ndarray, x: ndarray) -> tuple[ndarray, ndarray]:
    """Keep the smallest and the largest value of each of many intervals: the eye sees no difference."""
    if len(t) <= 2 * POINTS:
        return t, x
    edges = np.linspace(0, len(t), POINTS + 1).astype(int)
    picks = [a + np.sort([x[a:b].argmin(), x[a:b].argmax()]) for a, b in pairwise(edges.tolist())]
    keep = np.unique(np.concatenate([[0], *picks, [len(t) - 1]]))
    return t[keep], x[keep]


def _thin_path(x: ndarray, y: ndarray) -> tuple[ndarray, ndarray]:
    keep = np.unique(np.linspace(0, len(x) - 1, min(len(x), 2 * POINTS)).astype(int))
    return x[keep], y[keep]


def _span(x: ndarray, extra: float) -> tuple[float, float]:
    width = max(float(x.max() - x.min()), 1e-9 * max(1.0, float(np.abs(x).max())))
    return float(x.min()) - extra * width, float(x.max()) + extra * width


def _limits(shown: ndarray, other: ndarray | None = None) -> tuple[float, float]:
    """Limits that hold the data, and of the model as much as half a width of the data beyond them."""
    low, high = _span(shown, 0.06)
    if other is not None and len(other):
        wide = _span(shown, 0.5)
        low, high = max(wide[0], min(low, float(other.min()))), min(wide[1], max(high, float(other.max())))
    return low, high


def _box(model: PersidskiiModel, box: Any, point: Any = None) -> Float[ndarray, "n 2"]:
    """The box given, or the domain of the data with the operating point, a quarter wider on each side."""
    if box is not None:
        return np.asarray(box, float)
    centre = model.x_ref if point is None else point
    domain = np.column_stack([centre - 1, centre + 1]) if model.domain is None else model.domain
    low, high = np.minimum(domain[:, 0], centre), np.maximum(domain[:, 1], centre)
    margin = 0.25 * np.maximum(high - low, 1e-9)
    return np.column_stack([low - margin, high + margin])


def _mesh(
    box: ndarray, states: Sequence[int], count: int, centre: ndarray, inset: float = 0.0
) -> tuple[ndarray, ndarray, ndarray]:
    """Return a grid over two states as X, Y, and as points (count^2, n) whose other states are those of the centre."""
    i, j = states
    axes = [np.linspace(lo + inset * (hi - lo), hi - inset * (hi - lo), count) for lo, hi in (box[i], box[j])]
    X, Y = np.meshgrid(*axes)
    points = np.tile(np.asarray(centre, float), (X.size, 1))
    points[:, i], points[:, j] = X.ravel(), Y.ravel()
    return X, Y, points


def _levels(V: ndarray) -> ndarray:
    """Levels whose sets grow by equal steps: five within the largest set that the box holds, and more until V's top."""
    inside, top = np.sqrt(np.maximum([min(V[0].min(), V[-1].min(), V[:, 0].min(), V[:, -1].min()), V.max()], 1e-300))
    step = max(inside / 5, top / MOST_LEVELS)
    return (step * np.arange(1, int(top / step) + 1)) ** 2


def _top(curve: ndarray) -> float:
    size = float(np.nanmax(np.abs(curve[np.isfinite(curve)]), initial=0.0))
    return size or 1.0
