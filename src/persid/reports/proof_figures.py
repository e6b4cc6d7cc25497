"""The report's figures of motion and proof: Lyapunov functions, bounds, sector forms, and what speaks against them."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure
from numpy import ndarray

from persid import plots
from persid._dyadics import value
from persid.certificates.certificate import Certificate
from persid.errors import PersidError
from persid.measurements.recordings import Measurements
from persid.measurements.trajectory import Trajectory
from persid.models.model import PersidskiiModel
from persid.networks.certificate import NetworkCertificate
from persid.plants.residuals import inside, measured_residuals
from persid.reports.figures import Drawing, FreeRun, legend, number, side_by_side
from persid.verdicts.verdict import Certified, Verdict

PAIRS, GROUPS = 3, 6  # at most so many planes and groups are drawn
CHALLENGERS, SEED = 8, 0  # simulations from other starts that are set against a bound
MOST_STATES = 20  # up to which they are made
MOST_STEPS = 2000  # of a model in discrete time, in one run
STEPS = 400


def of_verdict(verdict: Verdict, model: PersidskiiModel, runs: Sequence[FreeRun]) -> list[Drawing]:
    """Draw what a certificate claims; without one, how the model moves, with the equilibria of a witness."""
    measured = [run.measured for run in runs]
    if not isinstance(verdict, Certified):
        marks, gone = _equilibria(verdict), _escape(verdict, model)
        return [_portrait(model, pair, measured, marks, gone) for pair in _pairs(model.n)]
    certificate = verdict.certificate
    if not isinstance(certificate, Certificate):  # a claim about V = sum of w |x|: no level sets to speak of
        return [_portrait(model, pair, measured, certificate.operating_point[None]) for pair in _pairs(model.n)]
    levels = [_level_sets(certificate, pair, measured) for pair in _pairs(model.n)]
    return [*_bound(certificate, runs), *levels, *_sectors(certificate)]


def plants(verdict: Verdict, data: Measurements | None, hold: str) -> list[Drawing]:
    """Draw the measured residuals against the residual margin, where there is one."""
    margin = verdict.margin if isinstance(verdict, Certified) else None
    if margin is None or data is None:
        return []
    measured = measured_residuals(margin.certificate.model, margin, data, hold)
    if not len(measured.size):
        return []
    figure, axes = side_by_side(1, 3.4)
    plots.residual_margin(axes[0], measured, margin.delta, measured.epsilon(margin.delta))
    caption = (
        f"What the plant did beyond the model, window by window, against its distance from x* (both in "
        f"half widths of the data): {inside(measured, margin)} (dashed)."
    )
    return [Drawing("plants", figure, caption, caption)]


def _pairs(n: int) -> list[tuple[int, int]]:
    return [(k, k + 1) for k in range(0, n - 1, 2)][:PAIRS]


def _rest(model: PersidskiiModel, where: str) -> str:
    return "" if model.n == 2 else f"; the other states are at {where}"


def _named(kind: str, figure: Figure, model: PersidskiiModel, pair: tuple[int, int], caption: str) -> Drawing:
    names = " and ".join(model.states[k] for k in pair)
    return Drawing(f"{kind}-{pair[0] + 1}-{pair[1] + 1}", figure, f"Plane of {names}. {caption}", caption)


def _equilibria(verdict: Verdict) -> ndarray | None:
    """Return the proved equilibria that a witness speaks of."""
    witness = getattr(verdict, "witness", None)
    fields = witness.content["witness"] if witness else {}
    points = fields.get("points") or ([fields["point"]] if fields.get("point") else [])
    return np.array([[value(pair) for pair in point["x"]] for point in points]) if points else None


def _escape(verdict: Verdict, model: PersidskiiModel) -> Trajectory | None:
    """Return the run that diverges in the simulations beside an undecided verdict."""
    evidence = getattr(verdict, "evidence", None)
    if evidence is None or not evidence.time or model.n > MOST_STATES:
        return None
    return model.simulate(evidence.x0, times(model, 0.0, evidence.time))[0]


def _portrait(
    model: PersidskiiModel,
    pair: tuple[int, int],
    measured: Sequence[Trajectory],
    marks: ndarray | None = None,
    gone: Trajectory | None = None,
) -> Drawing:
    figure, axes = side_by_side(1, 4.6)
    centre = model.x_ref if marks is None else marks[0]
    box = plots.box_of(model, None, model.x_ref)
    held = [part for part in (marks, None if gone is None else gone.x[:1]) if part is not None]
    if held:
        points = np.concatenate(held)
        low, high = np.minimum(box[:, 0], points.min(axis=0)), np.maximum(box[:, 1], points.max(axis=0))
        grown = (low < box[:, 0]) | (high > box[:, 1])
        margin = np.where(grown, 0.1, 0.0) * (high - low)
        box = np.column_stack([low - margin, high + margin])
    plots.phase_portrait(axes[0], model, box, pair, measured, centre)
    seen = ["Direction of motion of the model for u = u_ref (grey arrows)"]
    seen += ["the measured runs (blue)"] if measured else []
    if marks is not None:
        axes[0].plot(*marks[:, list(pair)].T, "o", ms=7, mew=1.6, mfc="#ffffff", color=plots.INK, zorder=4)
        where = " and ".join(f"({', '.join(number(v) for v in point[list(pair)])})" for point in marks)
        seen += [f"the proved equilibri{'a' if len(marks) > 1 else 'um'} at {where} (circles)"]
    if gone is not None:
        x, y = gone.x[:, list(pair)].T
        axes[0].plot(x, y, color=plots.MODEL, lw=1.4, ls="--", zorder=3)
        axes[0].plot(x[:1], y[:1], "X", ms=8, color=plots.MODEL, zorder=4)
        seen += ["a simulated run that diverges (orange, dashed, from the cross)"]
    text = " and ".join([", ".join(seen[:-1]), seen[-1]] if len(seen) > 1 else seen)
    return _named("phase-portrait", figure, model, pair, f"{text}{_rest(model, 'x_ref' if marks is None else 'it')}.")


def _level_sets(certificate: Certificate, pair: tuple[int, int], measured: Sequence[Trajectory]) -> Drawing:
    model = certificate.model
    figure, axes = side_by_side(1, 4.6)
    plots.level_sets(axes[0], certificate, None, pair, measured)
    region = ", the certified region (shaded)" if certificate.scope == "regional" else ""
    point = ", ".join(number(certificate.operating_point[k]) for k in pair)
    caption = (
        f"Level sets of the Lyapunov function V (green){region}, the direction of motion for u = u_ref (grey arrows), "
        f"{'the measured runs (blue), ' if measured else ''}and the operating point (dot) at ({point})"
        f"{_rest(model, 'the operating point')}."
    )
    return _named("level-sets", figure, model, pair, caption)


def _bound(certificate: Certificate, runs: Sequence[FreeRun]) -> list[Drawing]:
    """Draw the proved bound over the first run to which it applies, against simulations that try to break it."""
    for run in runs or _kick(certificate):
        if run.found.diverged_at is not None:
            continue
        others = list(challengers(certificate, run.found))
        figure, axes = side_by_side(1, 3.1, 7.6)
        try:
            plots.bound(axes[0], certificate, run.found, others)
        except PersidError:  # no rate is claimed, or the run lies outside the certified region
            continue
        against = (
            f" and {len(others)} simulations from starts of the same V with switching inputs of the same size (grey)"
            if others
            else ""
        )
        caption = (
            f"Distance of the model’s free run{f' {run.number}' if runs else ''} from the operating point (orange, "
            f"dashed){against}; none may exceed the bound that the certificate proves (green)."
        )
        lines = [np.asarray(line.get_ydata(), float) for line in axes[0].lines]
        most = max(float(line.max()) for k, line in enumerate(lines) if k != len(others))
        first, last = lines[len(others)][[0, -1]]
        alt = f"The bound falls from {number(first, 3)} to {number(last, 3)}; the runs reach {number(most, 3)}. "
        return [Drawing("bound", figure, alt + caption, caption)]
    return []


def _kick(certificate: Certificate) -> list[FreeRun]:
    """Return a run without input from a start near the operating point, where nothing was measured."""
    if certificate.rate is None or certificate.model.n > MOST_STATES:
        return []
    model, point = certificate.model, certificate.operating_point
    for size in 0.5 ** np.arange(8):
        start = point + size * np.where(np.arange(model.n) % 2, -1.0, 1.0)
        try:
            certificate.bound(start, 0.0, [0.0])
        except PersidError:  # outside the certified region
            continue
        t = times(model, 0.0, min(3 / certificate.rate, 1e6))
        u = np.tile(nominal_input(certificate), (len(t), 1))
        run = model.simulate(start, t, u)[0]
        return [FreeRun(1, run, run, 0.0, 1.0)]
    return []


def times(model: PersidskiiModel, start: float, stop: float) -> ndarray:
    """Return times in s to simulate at: STEPS of them, or at most MOST_STEPS steps of a model in discrete time."""
    if model.dt is None:
        return np.linspace(start, stop, STEPS)
    count = int(np.clip(round((stop - start) / model.dt), 1, MOST_STEPS))
    return np.asarray(start + model.dt * np.arange(count + 1))


def nominal_input(certificate: Certificate | NetworkCertificate) -> ndarray:
    """Return the constant input u* of a certificate."""
    return certificate.input if isinstance(certificate, Certificate) else certificate.model.u_ref


def challengers(certificate: Certificate, run: Trajectory) -> Iterator[Trajectory]:
    """Simulate from starts of no larger V than the run's, with inputs that switch between +- its largest |u - u*|."""
    model, rng = certificate.model, np.random.default_rng(SEED)
    if model.n > MOST_STATES or certificate.rate is None:
        return
    size, t = plots.largest_input(certificate, run), times(model, float(run.t[0]), float(run.t[-1]))
    for k in range(CHALLENGERS):
        start = _on_level(certificate, run.x[0], rng.normal(size=model.n))
        push = rng.normal(size=model.m)
        push *= size * (1 - 1e-9) / max(float(np.linalg.norm(push)), 1e-300)
        switches = np.where(np.arange(len(t)) * (k + 1) // len(t) % 2, -1.0, 1.0)
        try:
            certificate.bound(start, size, [0.0])
        except PersidError:  # outside the certified region
            continue
        yield model.simulate(start, t, nominal_input(certificate) + switches[:, None] * push)[0]


def _on_level(certificate: Certificate, start: ndarray, direction: ndarray) -> ndarray:
    """Return a state in a direction from the operating point where V is as large as at `start`, or a little smaller."""
    point, level = certificate.operating_point, float(certificate.V(start[None])[0])
    scale = np.abs(start - point) + 0.1 * float(np.abs(start - point).max(initial=0.0))
    sizes = np.geomspace(1e-3, 1e2, 600)
    with np.errstate(all="ignore"):
        V = certificate.V(point + sizes[:, None] * (scale * direction))
    outside = np.flatnonzero(~(level * (1 - 1e-9) >= V))  # V may overflow far out
    last = int(outside[0]) - 1 if len(outside) else len(sizes) - 1
    return np.asarray(point + (sizes[last] if last >= 0 else 0.0) * scale * direction)


def _sectors(certificate: Certificate) -> list[Drawing]:
    """Draw the functions and sector forms of the first groups."""
    model, parts = certificate.model, certificate.stated.parts
    count = min(len(parts), GROUPS)
    if not count:
        return []
    figure, axes = side_by_side(count, 2.6)
    words = []
    for g, (ax, part) in enumerate(zip(axes, parts, strict=False)):
        plots.sector_forms(ax, certificate, g)
        along = ", ".join(model.states[k] for k in part.row)
        ax.set_title(f"y along {plots.short(along, 30)}", fontsize=10)
        size, forms = 1 + len(part.members), len(part.forms)
        words.append(f"along {along}: {size} functions with y itself, {forms} forms")
    legend(figure, axes, 3)
    where = "on the region" if certificate.scope == "regional" else "for all y, also beyond what is drawn"
    some = f" Drawn are {count} of {len(parts)} groups." if count < len(parts) else ""
    caption = (
        "The functions of each group (blue) and the sector forms that the proof relies on (thin): each has the sign of "
        f"y, so it stays in the shaded quadrants; the checker has proved this {where}.{some}"
    )
    return [Drawing("sector-forms", figure, f"{caption} {'; '.join(words)}.", caption)]
