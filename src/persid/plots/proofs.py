"""Figures of a certificate: its Lyapunov function, its bound, and the sector forms it relies on."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.certificates.claims import Part
from persid.measurements.trajectory import Trajectory
from persid.networks.certificate import NetworkCertificate
from persid.plants.residuals import Measured
from persid.plots.fields import box_of, mesh, phase_portrait
from persid.plots.style import DASHES, FIELD, FORM, INK, LEVEL, MEASURED, MODEL, thin, tidy

GRID, FINE_GRID = 81, 101  # points a side on which V is evaluated; the finer one up to so many states:
FINE_STATES = 6
MOST_LEVELS = 16
BOUND_POINTS = 80

Proof = Certificate | NetworkCertificate


def level_sets(
    ax: Axes, certificate: Proof, box: object = None, states: Sequence[int] = (0, 1), runs: Sequence[Trajectory] = ()
) -> Axes:
    """Draw level sets of V over two states, the others at the operating point, on the phase portrait.

    `box` is one (lo, hi) per state, by default a frame about the certified region of a regional claim (which is
    shaded), or else the model's domain with the operating point, widened.
    """
    model, point, (i, j) = certificate.model, certificate.operating_point, states
    level = certificate.level if isinstance(certificate, Certificate) else None
    if box is None and isinstance(certificate, Certificate) and level is not None:
        box = _frame(certificate, level, states)
    box = box_of(model, box, point)
    phase_portrait(ax, model, box, states, runs, point)
    X, Y, points = mesh(box, states, FINE_GRID if model.n <= FINE_STATES else GRID, point)
    with np.errstate(all="ignore"):
        V = np.nan_to_num(certificate.V(points), nan=0.0, posinf=1e300).reshape(X.shape)
    ax.contour(X, Y, V, levels=_levels(V), colors=LEVEL, linewidths=1.1 if level is None else 0.8, zorder=2)
    if level is not None:
        ax.contour(X, Y, V, levels=[level], colors=LEVEL, linewidths=3, zorder=2)
        ax.contourf(X, Y, V, levels=[V.min() - 1, level], colors=LEVEL, alpha=0.12, zorder=0)
    ax.plot(point[i], point[j], marker="o", ms=6, color=INK, ls="none", zorder=4, label="operating point")
    return ax


def _frame(certificate: Certificate, level: float, states: Sequence[int]) -> ndarray:
    """The box of a regional claim, in the plane of two states cut down to the region with a margin about it."""
    box = sides(certificate)
    _, _, points = mesh(box, states, 2 * GRID, certificate.operating_point)
    inside = points[certificate.V(points) <= level]
    for k in states if len(inside) else ():
        low, high = float(inside[:, k].min()), float(inside[:, k].max())
        margin = 0.3 * (high - low)
        box[k] = max(box[k, 0], low - margin), min(box[k, 1], high + margin)
    return box


def _levels(V: ndarray) -> ndarray:
    """Levels whose sets grow by equal steps: five within the largest set that the box holds, and more until V's top."""
    inside, top = np.sqrt(np.maximum([min(V[0].min(), V[-1].min(), V[:, 0].min(), V[:, -1].min()), V.max()], 1e-300))
    step = max(inside / 5, top / MOST_LEVELS)
    return np.asarray((step * np.arange(1, int(top / step) + 1)) ** 2)


def largest_input(certificate: Proof, run: Trajectory) -> float:
    """Return the largest |u - u*| of a run, about the nominal input u* of the certificate."""
    u = certificate.input if isinstance(certificate, Certificate) else certificate.model.u_ref
    return float(np.linalg.norm(run.u - u, axis=1).max(initial=0.0))


def bound(
    ax: Axes,
    certificate: Proof,
    run: Trajectory,
    others: Sequence[Trajectory] = (),
    measured: Trajectory | None = None,
) -> Axes:
    """Draw the distance of a run of the model from the operating point, and the bound that the certificate proves.

    `others` are further runs of the model to which the same bound applies: from starts of no larger V, with inputs
    that are no larger. `measured` is what the run foretells; the legend is then left to the figure that it is part of.

    Raises:
        PersidError: the claim has no rate, or the run starts outside the certified region or has too large inputs.
    """
    t = np.linspace(0, run.t[-1] - run.t[0], BOUND_POINTS)
    proved = certificate.bound(run.x[0], largest_input(certificate, run), t)
    for k, other in enumerate(others):
        ax.plot(*thin(other.t - other.t[0], _distance(certificate, other)), color=FIELD, lw=0.8,
                label=None if k else "simulations")  # fmt: skip
    ax.plot(t, proved, color=LEVEL, lw=2, label="proved bound")
    if measured is not None:
        ax.plot(*thin(measured.t - measured.t[0], _distance(certificate, measured)), color=MEASURED, lw=1.6,
                label="measured")  # fmt: skip
    ax.plot(*thin(run.t - run.t[0], _distance(certificate, run)), color=MODEL, lw=1.4, ls=DASHES,
            label="model, free run")  # fmt: skip
    ax.set_ylim(bottom=0)
    ax.set_xlabel("t in s from the start")
    ax.set_ylabel("|x - x*|")
    if measured is None:
        ax.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3)
    return tidy(ax)


def _distance(certificate: Proof, run: Trajectory) -> ndarray:
    return np.asarray(np.linalg.norm(run.x - certificate.operating_point, axis=1))


def residual_margin(ax: Axes, measured: Measured, delta: float, epsilon: float) -> Axes:
    """Draw the residual of each window of the measurements against its distance from x*, and the margin delta |x - x*|.

    Dashed is the margin with a constant part epsilon. What lies below a line is allowed by it. Units are those of the
    margin: half widths of the data, and of the data a second.
    """
    within = measured.size <= delta * measured.distance
    for chosen, color, label in ((within, MEASURED, "windows inside"), (~within, MODEL, "windows outside")):
        ax.plot(measured.distance[chosen], measured.size[chosen], ".", ms=3, color=color, alpha=0.6, label=label)
    reach = np.array([0.0, float(measured.distance.max(initial=1e-300))])
    ax.plot(reach, delta * reach, color=LEVEL, lw=2, label="residual margin")
    ax.plot(reach, delta * reach + epsilon, color=LEVEL, lw=1.2, ls=DASHES, label="with a constant part")
    ax.set_xlim(left=0)
    ax.set_ylim(bottom=0)
    ax.set_xlabel("distance from x*")
    ax.set_ylabel("|g|, 1/s")
    ax.legend(frameon=False, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    return tidy(ax)


def sector_forms(ax: Axes, certificate: Certificate, group: int) -> Axes:
    """Draw the functions of one group, and the sector forms that the proof uses on them, against y.

    Each form l'phi(y) has the sign of y: its curve stays in the shaded quadrants, which is what the proof relies on.
    The forms that make up V are solid, those that serve as multipliers only are dashed. The range of y is the region of
    a regional claim, or else that of the model's domain.
    """
    part = certificate.stated.parts[group]
    low, high, phi, y = _curve(certificate, part)
    for k, curve in enumerate(phi[1:]):
        ax.plot(y, curve / _top(curve), color=MEASURED, lw=3.2, alpha=0.45, label=None if k else "functions")
    forms = np.array(part.forms, float).reshape(-1, len(phi)) @ phi
    in_V = [mu > 0 for mu in part.mu]
    for style, mine, label in (("-", True, "sector forms in V"), (DASHES, False, "other sector forms")):
        for k, curve in enumerate(form for form, used in zip(forms, in_V, strict=True) if used is mine):
            ax.plot(y, curve / _top(curve), color=FORM, lw=1.0, ls=style, label=None if k else label)
    ax.fill_between(y, 0, np.sign(y) * 1.08, color=LEVEL, alpha=0.1, lw=0)
    ax.set_xlim(low, high)
    ax.set_ylim(-1.08, 1.08)
    ax.locator_params(axis="x", nbins=5)
    ax.set_xlabel("y")
    ax.set_ylabel("each scaled to 1")
    return tidy(ax)


def sides(certificate: Certificate) -> Float[ndarray, "n 2"]:
    """Return the box in which a region lies: that of the strips along a state, else the model's."""
    point, box = certificate.operating_point, np.full((certificate.model.n, 2), [-np.inf, np.inf])
    for row, lo, hi in certificate.stated.strips:
        for i, r in row.items() if len(row) == 1 else ():
            low, high = sorted((float(lo / r), float(hi / r)))
            box[i] = max(box[i, 0], point[i] + low), min(box[i, 1], point[i] + high)
    return np.where(np.isfinite(box), box, box_of(certificate.model, None, point))


def _curve(certificate: Certificate, part: Part) -> tuple[float, float, ndarray, ndarray]:
    """Return a range of y, phi(y) of one part about the operating point, one row an entry, and y."""
    model = certificate.model
    weights, places = np.array([float(v) for v in part.row.values()]), list(part.row)
    at = float(weights @ (certificate.operating_point - model.x_ref)[places])
    box = sides(certificate)
    ends = weights[:, None] * (box - certificate.operating_point[:, None])[places]
    low, high = float(ends.min(axis=1).sum()), float(ends.max(axis=1).sum())
    y = np.linspace(low, high, 241)
    with np.errstate(all="ignore"):
        values = [
            model.channels.functions[c].value(float(a) * (at + y)) - model.channels.functions[c].value(float(a) * at)
            for c, a in part.members
        ]
    return low, high, np.stack([y, *values]), y


def _top(curve: ndarray) -> float:
    size = float(np.nanmax(np.abs(curve[np.isfinite(curve)]), initial=0.0))
    return size or 1.0
