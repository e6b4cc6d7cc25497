"""The report: one self-contained page that a person can read, print and send on; and its figures as PNG files."""

import hashlib
import io
import math
import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape
from matplotlib.figure import Figure
from numpy import ndarray

from persid import plots
from persid.certificate import Certificate
from persid.certify import Certified, Refuted
from persid.equations import equations
from persid.errors import PersidError
from persid.files import write_atomically
from persid.folder import CERTIFICATE, FIGURES, INFEASIBLE, MODEL, REPORT, WITNESS, Results
from persid.freerun import one_step, score
from persid.model import PersidskiiModel
from persid.summary import above, below, headline, limits, summarize
from persid.trajectories import Trajectories, Trajectory
from persid_check import groups

RUNS, STATES, SAMPLES = 3, 8, 5000  # at most so many are drawn, and said so
PAIRS, GROUPS, BARS = 3, 6, 6
CELLS = 4000  # a larger table of coefficients is left to model.json
STYLE: dict[Any, Any] = {"font.family": "sans-serif", "font.size": 10, "svg.fonttype": "none", "axes.linewidth": 0.8}
# Colours of the figures become variables of the page, so that they suit a light and a dark screen.
THEME = {
    "#000000": "currentColor",
    "#ffffff": "var(--card)",
    plots.MEASURED: "var(--measured)",
    plots.MODEL: "var(--model)",
    plots.LEVEL: "var(--level)",
    plots.FIELD: "var(--field)",
    plots.FORM: "var(--form)",
}


@dataclass(frozen=True, eq=False)
class Drawing:
    """A figure with the name of its file, what it shows to those who cannot see it, and its caption."""

    name: str
    figure: Figure
    alt: str
    caption: str

    @property
    def svg(self) -> Markup:
        """The figure as SVG to stand in the page."""
        return Markup(_svg(self))


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A measured run, the model's run from its first sample, and how far the two agree."""

    number: int
    measured: Trajectory
    found: Trajectory
    rmse: float
    r2: float


def write_report(results: Results, folder: Path) -> None:
    """Write report.html and figures/*.png into an existing folder."""
    (folder / FIGURES).mkdir(exist_ok=True)
    with _style():
        runs = _free_runs(results)
        drawings = _drawings(results, runs)
        write_atomically(folder / REPORT, _page(results, runs, drawings))
        for drawing in (one for part in drawings.values() for one in part):
            write_atomically(folder / FIGURES / f"{drawing.name}.png", _png(drawing))


def render(results: Results) -> str:
    """Return the page as text, figures inside; it loads nothing from anywhere."""
    with _style():
        runs = _free_runs(results)
        return _page(results, runs, _drawings(results, runs))


@contextmanager
def _style() -> Iterator[None]:
    with mpl.rc_context(STYLE):
        yield


def _page(results: Results, runs: Sequence[FreeRun], drawings: dict[str, list[Drawing]]) -> str:
    template = _environment().get_template("report.html.jinja")
    model, verdict = results.model, results.verdict
    certificate = verdict.certificate if isinstance(verdict, Certified) else None
    proof, claim, name = _proven(verdict)
    return template.render(
        model=model,
        verdict=verdict,
        brief=summarize(verdict),
        headline=headline(verdict, model),
        limits=limits(verdict, model),
        certificate=certificate,
        proof=proof,
        claim=claim,
        proof_sha256=hashlib.sha256(proof.data).hexdigest() if proof else None,
        files={"model": MODEL, "proof": name},
        equations=_equations(model),
        coefficients=_coefficients(model),
        data=results.data,
        overview=_overview(results.data) if results.data else [],
        record=results.record,
        fit=results.record.fit if results.record else None,
        runs=runs,
        drawings=drawings,
        most_runs=RUNS,
        most_states=STATES,
    )


def _proven(verdict: Any) -> tuple[Any, str, str]:
    """Return what the checker has accepted (or None), its claim, and the name of its file."""
    if isinstance(verdict, Certified):
        return verdict.certificate, verdict.certificate.claim, CERTIFICATE
    if isinstance(verdict, Refuted):
        return verdict.witness, "refuted", WITNESS
    return verdict.obstruction, "infeasible", INFEASIBLE


def _environment() -> Environment:
    environment = Environment(
        loader=PackageLoader("persid"), autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters |= {
        "below": below,
        "above": above,
        "figure": _number,
        "step": _median_step,
        "basename": lambda path: Path(path).name,
    }
    return environment


def _number(number: float | None, digits: int = 4) -> str:
    if number is None:
        return "–"
    return f"{number:.{digits}g}" if math.isfinite(number) else ("not a number" if math.isnan(number) else "infinite")


def _equations(model: PersidskiiModel) -> list[tuple[str, list[Markup]]]:
    """Return each equation as its left side and its terms, with powers raised."""
    lines = []
    for state, line in zip(model.states, equations(model).split("\n"), strict=True):
        left = f"d({state})/dt"
        lines.append((left, [_raised(term) for term in _terms(line.removeprefix(f"{left} = "))]))
    return lines


def _terms(text: str) -> list[str]:
    """Cut a sum before every sign that stands outside parentheses."""
    cuts, depth = [0], 0
    for k, letter in enumerate(text):
        depth += (letter == "(") - (letter == ")")
        if depth == 0 and text[k : k + 3] in (" + ", " - "):
            cuts.append(k + 1)
    return [text[a:b].strip() for a, b in zip(cuts, [*cuts[1:], len(text)], strict=True)]


def _raised(text: str) -> Markup:
    return Markup(re.sub(r"\*\*\(?(-?[\d./]+)\)?", r"<sup>\1</sup>", str(escape(text)))).replace("*", " ")


def _coefficients(model: PersidskiiModel) -> list[tuple[str, list[float]]] | None:
    """Return the table of coefficients, one row a term; None where it would be too large to read."""
    channels = model.channels
    table = np.hstack([channels.A0, channels.columns, model.B, model.b[:, None]])
    names = plots.term_names(model)
    return None if table.size > CELLS else [(name, row) for name, row in zip(names, table.T.tolist(), strict=True)]


def _overview(data: Trajectories) -> list[tuple[str, str, list[float]]]:
    """Return name, kind, smallest, largest, mean and standard deviation of every state and input."""
    found = []
    for kind, names, columns in (("state", data.states, "x"), ("input", data.inputs, "u")):
        values = np.concatenate([getattr(run, columns) for run in data])
        for name, v in zip(names, values.T, strict=True):
            found.append((name, kind, [float(s) for s in (v.min(), v.max(), v.mean(), v.std())]))
    return found


def _free_runs(results: Results) -> list[FreeRun]:
    """Simulate the first runs from their first samples."""
    found = []
    for k, run in enumerate(results.data or ()):
        if k < RUNS:
            measured = run[:SAMPLES]
            free = results.model.simulate(measured.x[0], measured.t, measured.u)[0]
            guess = np.vstack([free.x, np.repeat(free.x[-1:], len(measured) - len(free), axis=0)])
            fit = score(measured.x, guess)
            found.append(FreeRun(k + 1, measured, free, fit.rmse, fit.r2_mean))
    return found


def _drawings(results: Results, runs: Sequence[FreeRun]) -> dict[str, list[Drawing]]:
    model, verdict = results.model, results.verdict
    fit = results.record.fit if results.record else None
    measured = [run.measured for run in runs]
    proof = _proof(verdict.certificate, runs) if isinstance(verdict, Certified) else []
    return {
        "free_run": [_free_run(model, run) for run in runs],
        "residuals": [_residuals(model, run) for run in runs[:1]],
        "validation": [_validation(fit)] if fit and fit.curve else [],
        "contributions": [_contributions(model, results.data)] if results.data and model.n <= BARS else [],
        "proof": proof or _portraits(model, measured),
    }


def _stack(count: int, height: float) -> tuple[Figure, list[Any]]:
    figure = Figure(figsize=(7.6, height * count + 0.35), layout="constrained")
    return figure, list(figure.subplots(count, 1, sharex=True, squeeze=False)[:, 0])


def _side_by_side(count: int, height: float) -> tuple[Figure, list[Any]]:
    columns = min(count, 2) if count != 3 else 3
    rows = -(-count // columns)
    figure = Figure(figsize=(7.6 if columns > 1 else 5.4, height * rows), layout="constrained")
    axes = list(figure.subplots(rows, columns, squeeze=False).ravel())
    for ax in axes[count:]:
        ax.set_axis_off()
    return figure, axes[:count]


def _free_run(model: PersidskiiModel, run: FreeRun) -> Drawing:
    shown = model.states[:STATES]
    figure, axes = _stack(len(shown), 1.75)
    for i, (ax, name) in enumerate(zip(axes, shown, strict=True)):
        plots.free_run(ax, run.measured, run.found, i, name)
        ax.set_xlabel("t in s" if i == len(shown) - 1 else "")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper right", ncols=2, frameon=False)
    gone = run.found.diverged_at
    end = f"It blows up at t = {gone:.4g} s (marked)." if gone is not None else "It does not blow up."
    rows = f" (the first {SAMPLES} samples)" if len(run.measured) == SAMPLES else ""
    caption = (
        f"Run {run.number}{rows}: measured (blue, solid) and the model's free run (red, dashed), which knows only the "
        f"first sample and the inputs. {end} RMSE {_number(run.rmse)}, R² {_number(run.r2)} (mean over states)."
    )
    alt = f"Curves over time of {len(shown)} states, measured and simulated, run {run.number}. {end}"
    return Drawing(f"free-run-{run.number}", figure, alt, caption)


def _residuals(model: PersidskiiModel, run: FreeRun) -> Drawing:
    left = run.measured.x[1:] - one_step(model.rhs, run.measured, "zoh")[:-1]
    shown = model.states[:STATES]
    figure, axes = _stack(len(shown), 1.25)
    for i, (ax, name) in enumerate(zip(axes, shown, strict=True)):
        plots.residuals(ax, run.measured.t[1:], left[:, i], name)
        ax.set_xlabel("t in s" if i == len(shown) - 1 else "")
    sizes = ", ".join(f"{name}: {_number(float(np.std(left[:, i])))}" for i, name in enumerate(shown))
    caption = f"What one-step predictions leave over, run {run.number}; standard deviations: {sizes}."
    return Drawing("residuals", figure, f"One-step residuals over time. Standard deviations: {sizes}.", caption)


def _validation(fit: Any) -> Drawing:
    figure, axes = _side_by_side(1, 3.2)
    plots.validation_curve(axes[0], fit.curve, fit.ridge)
    caption = (
        f"Error of free runs on blocks that the fit had not seen, for every strength of the ridge; best by this "
        f"measure: {_number(fit.curve.best, 3)}, used: {_number(fit.ridge, 3)}."
    )
    return Drawing("validation", figure, f"Curve of validation error against ridge. {caption}", caption)


def _contributions(model: PersidskiiModel, data: Trajectories) -> Drawing:
    x, u = (np.concatenate([getattr(run, name) for run in data]) for name in ("x", "u"))
    figure, axes = _side_by_side(model.n, 3.1)
    for i, ax in enumerate(axes):
        plots.contributions(ax, model, x, u, i)
    caption = "How much each term adds to the derivative of each state on the data (root mean square, units per s)."
    return Drawing("contributions", figure, f"Bars, one a term. {caption}", caption)


def _pairs(n: int) -> list[tuple[int, int]]:
    return [(k, k + 1) for k in range(0, n - 1, 2)][:PAIRS]


def _portraits(model: PersidskiiModel, measured: Sequence[Trajectory]) -> list[Drawing]:
    drawings = []
    for i, j in _pairs(model.n):
        figure, axes = _side_by_side(1, 4.6)
        plots.phase_portrait(axes[0], model, None, (i, j), measured)
        caption = (
            f"Direction of motion of the model for u = u_ref (grey arrows) and the measured runs (blue){_rest(model)}."
        )
        drawings.append(_pair_drawing("phase-portrait", figure, model, (i, j), caption))
    return drawings


def _rest(model: PersidskiiModel) -> str:
    return "" if model.n == 2 else "; the other states are at x_ref"


def _pair_drawing(kind: str, figure: Figure, model: PersidskiiModel, pair: tuple[int, int], caption: str) -> Drawing:
    names = " and ".join(model.states[k] for k in pair)
    return Drawing(f"{kind}-{pair[0] + 1}-{pair[1] + 1}", figure, f"Plane of {names}. {caption}", caption)


def _proof(certificate: Certificate, runs: Sequence[FreeRun]) -> list[Drawing]:
    """Draw the bound, level sets of V and the sector forms of the first groups."""
    model, drawings = certificate.model, _bound(certificate, runs)
    measured = [run.measured for run in runs]
    for i, j in _pairs(model.n):
        figure, axes = _side_by_side(1, 4.6)
        plots.level_sets(axes[0], certificate, None, (i, j), measured)
        region = ", the certified region (shaded)" if certificate.claim == "R" else ""
        caption = (
            f"Level sets of the Lyapunov function V (green){region}, the direction of motion for u = u_ref (grey "
            f"arrows), {'the measured runs (blue), ' if measured else ''}and the operating point (dot){_rest(model)}."
        )
        drawings.append(_pair_drawing("level-sets", figure, model, (i, j), caption))
    count = min(len(certificate.content["groups"]), GROUPS)
    return [*drawings, _sectors(certificate, count)] if count else drawings


def _bound(certificate: Certificate, runs: Sequence[FreeRun]) -> list[Drawing]:
    """Draw the proved bound over the first run to which it applies."""
    for run in runs:
        figure, axes = _side_by_side(1, 2.9)
        try:
            plots.bound(axes[0], certificate, run.found)
        except PersidError:  # no rate is claimed, or the run lies outside the certified region
            continue
        caption = (
            f"Distance of the model's free run {run.number} from the operating point (red, dashed), and the bound that "
            "the certificate proves for every input as large as this one (green)."
        )
        return [Drawing("bound", figure, caption, caption)]
    return []


def _sectors(certificate: Certificate, count: int) -> Drawing:
    model = certificate.model
    figure, axes = _side_by_side(count, 2.6)
    for g, (ax, group) in enumerate(zip(axes, groups(model.to_dict()), strict=False)):
        plots.sector_forms(ax, certificate, g)
        ax.set_title(f"y along {', '.join(plots.plain(model.states[k]) for k in group.row)}", fontsize=10)
    where = "on the region" if certificate.claim == "R" else "for all y, also beyond what is drawn"
    caption = (
        "The functions of each group (blue) and the sector forms the proof relies on (dashed): each has the sign of y, "
        f"so it stays in the shaded quadrants; the checker has proved this {where}."
    )
    return Drawing("sector-forms", figure, caption, caption)


def _png(drawing: Drawing) -> bytes:
    buffer = io.BytesIO()
    drawing.figure.savefig(buffer, format="png", dpi=144, facecolor="white", metadata={"Software": None})
    return buffer.getvalue()


def _svg(drawing: Drawing) -> str:
    """Return SVG without header and metadata, ids made unique in the page, colours as variables of the page."""
    buffer = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": drawing.name}):
        drawing.figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    text = re.sub(r"<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r' d="[^"]*"', lambda path: re.sub(r"(\.\d\d)\d+", r"\1", path[0]), text)  # hundredths of a point do
    text = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{drawing.name}-", text)
    text = re.sub(r"(?<=: )#[0-9a-f]{6}\b", lambda found: THEME.get(found[0], found[0]), text)
    width = 6 * drawing.figure.get_figwidth()
    head = f'<svg role="img" aria-label="{escape(drawing.alt)}" style="max-width: {width:.3g}rem" '
    return text.replace("<svg ", head, 1)


def _median_step(run: Trajectory) -> float:
    steps: ndarray = np.diff(run.t)
    return float(np.median(steps))
