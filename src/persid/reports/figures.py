"""The figures of the report: what is drawn of a result, how much of it, and what each figure says in words."""

import io
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup, escape
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy import ndarray

from persid import plots
from persid._files import Json
from persid.identification.diagnostics import FitReport
from persid.identification.free_runs import one_step, score
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.formulas import term_names
from persid.models.model import PersidskiiModel
from persid.verdicts.verdict import Verdict

RUNS, STATES, SAMPLES = 3, 8, 5000  # at most so many are drawn, and said so
LANES, BARS, MOST_ATTEMPTS, MOST_CANDIDATES = 24, 6, 20, 24
STYLE: dict[Any, Any] = {"font.family": "sans-serif", "font.size": 10, "svg.fonttype": "none", "axes.linewidth": 0.8}
# Colours of the figures become variables of the page, so that they suit a light and a dark screen.
THEME = {
    "#000000": "currentColor",
    plots.INK: "currentColor",
    "#ffffff": "var(--card)",
    plots.MEASURED: "var(--measured)",
    plots.MODEL: "var(--model)",
    plots.LEVEL: "var(--level)",
    plots.FIELD: "var(--field)",
    plots.FORM: "var(--form)",
}


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure with the name of its file, what it shows to those who cannot see it, and its caption.

    On the screen an inch is at least `least` rem wide; where that is more than there is room for, it can be moved.
    """

    name: str
    figure: Figure
    alt: str
    caption: str
    least: float = 4.6

    @property
    def svg(self) -> Markup:
        """The figure as SVG to stand in the page, ids made unique there, colours as variables of the page."""
        buffer = io.StringIO()
        with mpl.rc_context({"svg.hashsalt": self.name}):
            self.figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
        text = buffer.getvalue()
        text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
        text = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text)  # 0.01 pt do
        text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{self.name}-", text)
        text = re.sub(r"(?<=: )#[0-9a-f]{6}\b", lambda found: THEME.get(found[0], found[0]), text)
        width = self.figure.get_figwidth()  # in inches; letters stay readable between these widths on the screen
        size = f"--least: {self.least * width:.3g}rem; --most: {6 * width:.3g}rem"
        head = f'<svg role="img" aria-label="{escape(self.alt)}" style="{size}" '
        return Markup(text.replace("<svg ", head, 1))

    @property
    def png(self) -> bytes:
        """The figure as a PNG file on white."""
        buffer = io.BytesIO()
        self.figure.savefig(buffer, format="png", dpi=144, facecolor="white", metadata={"Software": None})
        return buffer.getvalue()


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A measured run, the model's run from its first sample, and how far the two agree."""

    number: int
    measured: Trajectory
    found: Trajectory
    rmse: float
    r2: float


@contextmanager
def style() -> Iterator[None]:
    """Draw in the look of the report, and leave matplotlib's settings as they were."""
    with mpl.rc_context(STYLE):
        yield


def free_runs(model: PersidskiiModel, data: Trajectories | None) -> list[FreeRun]:
    """Simulate the first runs from their first samples."""
    found = []
    for k, run in enumerate((data or ())[:RUNS]):
        measured = run[:SAMPLES]
        free = model.simulate(measured.x[0], measured.t, measured.u)[0]
        guess = np.vstack([free.x, np.repeat(free.x[-1:], len(measured) - len(free), axis=0)])
        fit = score(measured.x, guess)
        found.append(FreeRun(k + 1, measured, free, fit.rmse, fit.r2_mean))
    return found


def number(value: float, digits: int = 4) -> str:
    """Return a number as words of a caption need it."""
    return f"{value:.{digits}g}"


def overview(data: Trajectories) -> Drawing:
    """Draw the measurements, lane by lane."""
    names = [*data.states, *data.inputs]
    states, inputs = len(data.states), len(data.inputs)
    columns = list(range(states + inputs))
    if len(columns) > LANES:
        columns = [*range(min(states, LANES - min(inputs, 4))), *range(states, states + min(inputs, 4))]
    figure, axes = side_by_side(1, 0.42 * len(columns) + 0.75, 7.6)
    plots.overview(axes[0], data, columns)
    most = f" (the first {plots.MOST_RUNS} runs)" if len(data) > plots.MOST_RUNS else ""
    some = f"; drawn are {len(columns)} of {len(names)} columns" if len(columns) < len(names) else ""
    count = len(plots.gaps(data[: plots.MOST_RUNS]))
    gaps = f" {_count(count, 'gap')}, where nothing was measured: shaded." if count else ""
    caption = (
        f"The measurements{most}: states (blue) and held inputs (black), each scaled to its range, which stands at the "
        f"right{some}.{gaps}"
    )
    alt = f"{_count(len(data), 'run')} with {_count(data.samples, 'sample')} of {', '.join(names[c] for c in columns)}."
    return Drawing("overview", figure, f"{alt} {caption}", caption)


def _count(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"


def free_run(model: PersidskiiModel, run: FreeRun, beside: FreeRun | None = None) -> Drawing:
    """Draw the states of a run as measured and as simulated, and as the free fit has them where it is another model."""
    shown = model.states[:STATES]
    figure, axes = _stack(len(shown), 1.6)
    for i, (ax, name) in enumerate(zip(axes, shown, strict=True)):
        plots.free_run(ax, run.measured, run.found, i, name, beside.found if beside else None)
        ax.set_xlabel("t in s" if i == len(shown) - 1 else "")
    legend(figure, axes[:1], 3 if beside else 2)
    gone = run.found.diverged_at
    end = f"It blows up at t = {gone:.4g} s (marked)." if gone is not None else "It does not blow up."
    rows = f" (the first {SAMPLES} samples)" if len(run.measured) == SAMPLES else ""
    scores = f"RMSE {number(run.rmse)}, R² {number(run.r2)} (mean over states)."
    knows = f"{curves_of('the model')} only the first sample and the inputs."
    caption = f"Run {run.number}{rows}: {knows} {end} {scores}{_other(beside)}"
    far = np.abs(run.measured.x[: len(run.found)] - run.found.x)
    apart = "; ".join(f"{name}: at most {number(far[:, i].max(), 2)} apart" for i, name in enumerate(shown))
    alt = f"Curves over time of {', '.join(shown)}, measured and simulated, run {run.number}. {apart}. {end}"
    return Drawing(f"free-run-{run.number}", figure, alt, caption)


def curves_of(model: str) -> str:
    """Return in half a sentence what the two curves of a free run are."""
    return f"measured (blue, solid), and the free run of {model} (orange, dashed), which knows"


def _other(beside: FreeRun | None) -> str:
    if beside is None:
        return ""
    gone = beside.found.diverged_at
    end = f"blows up at t = {gone:.4g} s" if gone is not None else f"has RMSE {number(beside.rmse)}"
    return f" The free fit, which has no certificate (dotted), {end}."


def residuals(model: PersidskiiModel, run: FreeRun) -> Drawing:
    """Draw what one-step predictions of a run leave over."""
    left = run.measured.x[1:] - one_step(model, run.measured, "zoh")[:-1]
    shown = model.states[:STATES]
    figure, axes = _stack(len(shown), 1.1)
    for i, (ax, name) in enumerate(zip(axes, shown, strict=True)):
        plots.residuals(ax, run.measured.t[1:], left[:, i], name)
        ax.set_xlabel("t in s" if i == len(shown) - 1 else "")
    sizes = ", ".join(f"{name}: {number(float(np.std(left[:, i])))}" for i, name in enumerate(shown))
    caption = f"What one-step predictions leave over, run {run.number}; standard deviations: {sizes}."
    return Drawing("residuals", figure, f"One-step residuals over time. Standard deviations: {sizes}.", caption)


def validation(fit: FitReport) -> list[Drawing]:
    """Draw the choice of the ridge, where there was one."""
    curve = fit.curve
    if curve is None:
        return []
    figure, axes = side_by_side(1, 3.0)
    plots.validation_curve(axes[0], curve, fit.ridge)
    best = int(np.argmin(curve.errors))
    caption = (
        f"Error of free runs on blocks that the fit had not seen, for every strength of the ridge. The strongest ridge "
        f"within 5 % of the smallest error is {number(curve.best, 3)}; used: {number(fit.ridge, 3)}."
    )
    alt = (
        f"Validation curve over ridge {curve.strengths[0]:.0e} to {curve.strengths[-1]:.0e}: the error is "
        f"{number(curve.errors[0], 2)} at the weakest, {number(curve.errors[best], 2)} at best (ridge "
        f"{number(curve.strengths[best], 2)}), {number(curve.errors[-1], 2)} at the strongest; runs blow up at "
        f"{sum(share > 0 for share in curve.blow_ups)} of {len(curve.strengths)} strengths."
    )
    return [Drawing("validation", figure, alt, caption)]


def spectrum(fit: FitReport) -> list[Drawing]:
    """Draw the eigenvalues of the Koopman matrix, where the method has one."""
    if fit.spectrum is None:
        return []
    figure, axes = side_by_side(1, 3.9, 5.8)
    plots.koopman_spectrum(axes[0], fit.spectrum)
    values = np.array([complex(*pair) for pair in fit.spectrum.values])
    turn = float(np.abs(np.angle(values)).max())
    fastest = fit.spectrum.limit / (2 * np.pi * fit.spectrum.dt)
    caption = (
        f"Eigenvalues of the Koopman matrix at a step of {number(fit.spectrum.dt)} s. Inside the unit circle a mode "
        f"decays. In the shaded sector, beyond {number(fastest, 3)} Hz, a mode cannot be told from its alias and the "
        f"logarithm is refused; the fastest mode here turns {number(turn / (2 * np.pi * fit.spectrum.dt), 3)} Hz."
    )
    alt = (
        f"{len(values)} eigenvalues in the complex plane, of modulus {number(np.abs(values).min(), 3)} to "
        f"{number(np.abs(values).max(), 3)}. {caption}"
    )
    return [Drawing("spectrum", figure, alt, caption)]


def contributions(model: PersidskiiModel, x: ndarray, u: ndarray) -> Drawing:
    """Draw what each term adds to the derivative of the first states."""
    shown = min(model.n, BARS)
    names, sizes = plots.terms(model, x, u, 0)
    bars = max(min(int((plots.terms(model, x, u, i)[1] > 0).sum()), 16) for i in range(shown))
    figure, axes = side_by_side(shown, 0.19 * max(bars, 3) + 0.85)
    for i, ax in enumerate(axes):
        plots.contributions(ax, model, x, u, i)
    some = f"; the first {shown} of {model.n} states" if shown < model.n else ""
    caption = f"How much each term adds to the derivative of each state on the data (root mean square, per s){some}."
    first = [names[k] for k in np.argsort(-sizes)[:3]]
    alt = f"Bars, one a term. In d({model.states[0]})/dt the largest terms are {', '.join(first)}. {caption}"
    return Drawing("contributions", figure, alt, caption)


def characteristics(model: PersidskiiModel, x: ndarray) -> list[Drawing]:
    """Draw what tables, learned or given, say of each state's effect, over the density of the data."""
    pairs = plots.tabulated(model)
    if not pairs:
        return []
    shown = pairs[:BARS]
    figure, axes = side_by_side(len(shown), 2.6)
    values = {(i, j): plots.effect(model, i, j, np.linspace(x[:, j].min(), x[:, j].max(), 400))[0] for i, j in shown}
    for ax, (i, j) in zip(axes, shown, strict=True):
        together = np.concatenate([found for (k, _), found in values.items() if k == i])  # of one equation, one scale
        plots.characteristic(ax, model, i, j, x[:, j], (float(together.min()), float(together.max())))
    some = f" (the first {len(shown)} of {len(pairs)})" if len(shown) < len(pairs) else ""
    caption = (
        f"What a state adds to the derivative of a state, its linear part and its functions together{some}: orange, "
        "dots at the knots of tables, the curves of one equation on one scale. The blue area is the density of the "
        "data: where it is low, little is known."
    )
    names = "; ".join(f"{model.states[j]} in d({model.states[i]})/dt" for i, j in shown)
    return [Drawing("characteristics", figure, f"Piecewise linear curves: {names}. {caption}", caption)]


def correlations(model: PersidskiiModel, x: ndarray, u: ndarray) -> list[Drawing]:
    """Draw which terms the data cannot tell apart."""
    names, R = plots.correlation_matrix(model, x, u)
    if len(names) < 2:
        return []
    figure, axes = side_by_side(1, 2.0 + 0.2 * len(names), 2.6 + 0.21 * len(names))
    plots.correlations(axes[0], model, x, u)
    alike = np.abs(R[np.tril_indices(len(names), -1)])
    close = int((alike > plots.COLLINEAR).sum())
    found = f"{close or 'No'} pair{'' if close == 1 else 's'}"
    some = f" (the first {len(names)} terms)" if len(names) < len(term_names(model.field)) - 1 else ""
    caption = (
        f"How alike two terms are on the data{some}: the area of a disk is the size of their correlation, positive "
        f"(blue) or negative (orange). {found} above 0.99 (ringed): of such a pair the data determine the sum only."
    )
    return [Drawing("correlations", figure, f"Matrix of disks for {', '.join(names)}. {caption}", caption)]


def fits(record: Json | None, states: Sequence[str]) -> list[Drawing]:
    """Draw the free fit beside the one under the certificate, where there are both."""
    found = [fit for fit in (record or {}).get("fits", ()) if all(np.isfinite(fit["r2"]))]
    if len(found) < 2:
        return []
    shown = states[: 2 * STATES]
    figure, axes = side_by_side(1, 0.3 * len(shown) + 1.0)
    plots.fits(axes[0], {fit["name"]: fit["r2"] for fit in found}, shown)
    words = "; ".join(f"{fit['name']}: {', '.join(number(r, 3) for r in fit['r2'][: len(shown)])}" for fit in found)
    below = " Values below 0 are drawn at 0." if min(min(fit["r2"]) for fit in found) < 0 else ""
    caption = f"R² of the free runs of each state, free fit and fit under the certificate.{below}"
    return [Drawing("fits", figure, f"{caption} {words}.", caption)]


def candidates(record: Json | None) -> list[Drawing]:
    """Draw the candidates among which a search has chosen."""
    rows = (record or {}).get("candidates") or ()
    shown = [row for row in rows if isinstance(row.get("error"), float) and np.isfinite(row["error"])]
    shown = sorted(shown, key=lambda row: row["error"])[:MOST_CANDIDATES]
    if len(shown) < 2:
        return []
    names = [", ".join(row["functions"]) for row in shown]
    if len(set(names)) < len(names):
        names = [f"{name}; ridge {row.get('ridge', 0):.1e}" for name, row in zip(names, shown, strict=True)]
    certified = [bool(row.get("certified", row.get("feasible"))) for row in shown]
    figure, axes = side_by_side(1, 0.24 * len(shown) + 0.8, 7.6)
    plots.candidates(axes[0], names, [row["error"] for row in shown], certified)
    caption = (
        f"Error of {len(shown)} of {len(rows)} candidate fits on samples that they had not seen; filled: the checker "
        f"has accepted a proof, hollow: no proof was found, or none was made. The least error has {names[0]}."
    )
    return [Drawing("candidates", figure, caption, caption)]


def attempts(verdict: Verdict) -> list[Drawing]:
    """Draw how long each attempt took, where there were several."""
    shown = verdict.attempts[:MOST_ATTEMPTS]
    if len(shown) < 2:
        return []
    figure, axes = side_by_side(1, 0.26 * len(shown) + 0.7, 7.6)
    plots.attempts(axes[0], [one.what for one in shown], [one.seconds for one in shown])
    slowest = max(shown, key=lambda one: one.seconds)
    caption = f"Time of each attempt; the longest was “{slowest.what}” with {number(slowest.seconds, 3)} s."
    return [Drawing("attempts", figure, caption, caption)]


def _stack(count: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(7.6, height * count + 0.45), layout="constrained")
    return figure, list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])


def side_by_side(count: int, height: float, width: float = 5.4) -> tuple[Figure, list[Axes]]:
    """Return a figure of `count` Axes, one of the given width in inches or two or three in a row."""
    columns = min(count, 2) if count != 3 else 3
    rows = -(-count // columns)
    figure = Figure(figsize=(7.6 if columns > 1 else width, height * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for ax in axes[count:]:
        ax.set_axis_off()
    return figure, axes[:count]


def legend(figure: Figure, axes: Sequence[Axes], columns: int) -> None:
    """Put one legend for some Axes above the whole figure."""
    entries: dict[str, Artist] = {}
    for ax in axes:
        handles, labels = ax.get_legend_handles_labels()
        entries |= dict(zip(labels, handles, strict=True))
    figure.legend(list(entries.values()), list(entries), loc="outside upper right", ncols=columns, frameon=False)
