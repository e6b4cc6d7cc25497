"""The report: one self-contained page that a person can read, print and send on; and its figures as PNG files."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy import ndarray

from persid._files import write_atomically
from persid.measurements.trajectories import Trajectories
from persid.models import mathml
from persid.models.descriptor import DescriptorModel
from persid.models.equations import equations
from persid.models.formulas import term_names
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.plots.style import timed_in
from persid.reports import figures as drawings
from persid.reports import proof_figures as portraits
from persid.reports.comparison import both_fits
from persid.reports.equations_page import write_equations_report
from persid.reports.figures import Drawing, FreeRun
from persid.reports.front import front, picture
from persid.reports.layout import CERTIFICATE, FIGURES, INFEASIBLE, MODEL, MODELS, PLANTS, REPORT, WITNESS
from persid.reports.output_page import write_output_report
from persid.reports.results import Results
from persid.reports.templating import environment
from persid.verdicts.summary import limits, plants, summarize
from persid.verdicts.verdict import Certified, Refuted, Verdict

CELLS, COLUMNS = 4000, 20  # a larger table of coefficients is left to model.json
TERMS = 400  # of a model with more terms only the first equations are set
MOST_ROWS = 40  # of a table of runs, columns or eigenvalues
MOST_SAMPLES = 20_000  # on which terms are compared


@dataclass(frozen=True, eq=False)
class Equations:
    """What the page shows of the equations: left sides and terms as MathML, and all of them to copy."""

    lines: tuple[tuple[Markup, tuple[Markup, ...]], ...]
    total: int
    text: str
    latex: str


def write_report(results: Results, folder: Path) -> None:
    """Write report.html and figures/*.png into an existing folder.

    Raises:
        ModelError: a sparse model is too large for a page.
    """
    if isinstance(results.model, OutputModel):
        write_output_report(results, folder)
        return
    if isinstance(results.model, DescriptorModel):
        write_equations_report(results, results.model, folder)
        return
    (folder / FIGURES).mkdir(exist_ok=True)
    with drawings.style():
        runs = drawings.free_runs(results.dynamics, results.data)
        drawn = _drawings(results, runs)
        write_atomically(folder / REPORT, _page(results, runs, drawn))
        for drawing in (one for part in drawn.values() for one in part):
            write_atomically(folder / FIGURES / f"{drawing.name}.png", drawing.png)


def render(results: Results) -> str:
    """Return the page as text, figures inside; it loads nothing from anywhere. Raises as `write_report` does."""
    with drawings.style():
        runs = drawings.free_runs(results.dynamics, results.data)
        return _page(results, runs, _drawings(results, runs))


def _drawings(results: Results, runs: Sequence[FreeRun]) -> dict[str, list[Drawing]]:
    model, data = results.dynamics.dense(), results.data
    fit = results.record.fit if results.record else None
    compared = results.record.comparison if results.record else None
    free = (compared or {}).get("free_model")
    others = drawings.free_runs(PersidskiiModel.from_dict(free), data) if free else [None] * len(runs)
    x, u = _samples(data) if data else (np.zeros((0, model.n)), np.zeros((0, model.m)))
    drawn = {
        "front": picture(results),
        "overview": [drawings.overview(data)] if data else [],
        "free_run": [drawings.free_run(model, *pair) for pair in zip(runs, others, strict=True)],
        "residuals": [drawings.residuals(model, run) for run in runs[:1]],
        "validation": drawings.validation(fit) if fit else [],
        "spectrum": drawings.spectrum(fit) if fit else [],
        "contributions": [drawings.contributions(model, x, u)] if data else [],
        "characteristics": drawings.characteristics(model, x) if data else [],
        "correlations": drawings.correlations(model, x, u) if data else [],
        "fits": drawings.fits(compared, model.states),
        "candidates": drawings.candidates(compared),
        "proof": portraits.of_verdict(results.verdict, model, runs),
        "plants": portraits.plants(results.verdict, data, results.hold),
        "attempts": drawings.attempts(results.verdict),
    }
    for drawing in (one for part in drawn.values() for one in part):
        timed_in(drawing.figure, results.time_unit)
    return drawn


def _samples(data: Trajectories) -> tuple[ndarray, ndarray]:
    """Return states and inputs of all runs one below the other, every k-th of many."""
    step = -(-data.samples // MOST_SAMPLES)
    parts = [(run.x[::step], run.u[::step]) for run in data]
    return np.concatenate([x for x, _ in parts]), np.concatenate([u for _, u in parts])


def _page(results: Results, runs: Sequence[FreeRun], drawn: Mapping[str, list[Drawing]]) -> str:
    template = environment().get_template("report.html.jinja")
    model, verdict = results.dynamics.dense(), results.verdict
    proof, claim, name = _proven(verdict)
    diagnosis = results.record.diagnosis if results.record else None
    compared = results.record.comparison if results.record else None
    return template.render(
        model=model,
        model_sha256=results.model.sha256,
        verdict=verdict,
        brief=summarize(verdict),
        unit=results.time_unit,
        headline=verdict.headline,
        front=front(results),
        limits=limits(verdict, model),
        plants=plants(verdict.margin) if isinstance(verdict, Certified) and verdict.margin else (),
        plants_file=PLANTS,
        allowed=results.plant if results.plant is not None and results.plant.models is not None else None,
        models_file=MODELS,
        certificate=verdict.certificate if isinstance(verdict, Certified) else None,
        gains=_gains(verdict, model),
        evidence=getattr(verdict, "evidence", None),
        proof=proof,
        claim=claim,
        proof_sha256=hashlib.sha256(proof.data).hexdigest() if proof else None,
        files={"model": MODEL, "proof": name},
        equations=_equations(model),
        coefficients=_coefficients(model),
        data=results.data,
        overview=_overview(results.data) if results.data else [],
        record=results.record,
        diagnosis=diagnosis,
        advice=(*diagnosis.remedies, *diagnosis.findings) if diagnosis else (),
        fit=results.record.fit if results.record else None,
        both_fits=both_fits(compared) if compared else "",
        spectrum=_spectrum(results),
        candidates=_candidates(results),
        runs=runs,
        drawings=drawn,
        most_runs=drawings.RUNS,
        most_states=drawings.STATES,
        most_rows=MOST_ROWS,
        seed=portraits.SEED,
    )


def _proven(verdict: Verdict) -> tuple[Any, str, str]:
    """Return what the checker has accepted (or None), its claim, and the name of its file."""
    if isinstance(verdict, Certified):
        return verdict.certificate, verdict.certificate.claim, CERTIFICATE
    if isinstance(verdict, Refuted):
        return verdict.witness, "refuted", WITNESS
    return verdict.obstruction, "infeasible", INFEASIBLE


def _gains(verdict: Verdict, model: PersidskiiModel) -> list[tuple[str, float]]:
    """Return the gain of each input, where the certificate tells them apart."""
    gains = (
        verdict.certificate.gains
        if isinstance(verdict, Certified) and verdict.certificate.claim in ("rate-and-gain", "region")
        else None
    )
    if gains is None or len(gains) < 2 or np.ptp(gains) == 0:
        return []
    return list(zip(model.inputs, [float(gain) for gain in gains], strict=True))


def _equations(model: PersidskiiModel) -> Equations:
    """Set the equations: all of them, or of a large model the first ones."""
    count = max(1, int(np.searchsorted(np.cumsum(mathml.counts(model)), TERMS, side="right")))
    set_ = [mathml.equation(model, i) for i in range(count)]
    lines = tuple((Markup(left), tuple(Markup(term) for term in terms)) for left, terms in set_)
    text, latex = ("\n".join(equations(model, form).split("\n")[:count]) for form in ("text", "latex"))
    return Equations(lines, model.n, text, latex)


def _coefficients(model: PersidskiiModel) -> list[tuple[str, list[float]]] | None:
    """Return the table of coefficients, one row a term; None where it would be too large to read."""
    channels = model.channels
    table = np.hstack([channels.A0, channels.columns, model.B, model.b[:, None]])
    names = term_names(model.field)
    if table.size > CELLS or model.n > COLUMNS:
        return None
    return [(name, row) for name, row in zip(names, table.T.tolist(), strict=True)]


def _overview(data: Trajectories) -> list[tuple[str, str, list[float]]]:
    """Return name, kind, smallest, largest, mean and standard deviation of every state and input."""
    found = []
    for kind, names, columns in (("state", data.states, "x"), ("input", data.inputs, "u")):
        values = np.concatenate([getattr(run, columns) for run in data])
        for name, v in zip(names, values.T, strict=True):
            found.append((name, kind, [float(s) for s in (v.min(), v.max(), v.mean(), v.std())]))
    return found


def _spectrum(results: Results) -> list[tuple[str, float, float, float | None]]:
    """Return each mode of the Koopman matrix: eigenvalue, modulus, frequency in Hz, time of decay in s."""
    spectrum = results.record.fit.spectrum if results.record and results.record.fit else None
    if spectrum is None:
        return []
    rows = []
    for re, im in spectrum.values:
        if im >= 0:
            size, turn = math.hypot(re, im), abs(math.atan2(im, re))
            name = f"{re:.4g} ± {im:.4g} i" if im else f"{re:.4g}"
            decay = -spectrum.dt / math.log(size) if 0 < size < 1 - 1e-12 else None
            rows.append((name, size, turn / (2 * math.pi * spectrum.dt), decay))
    return rows


LABELS = {"r2": "R²", "seconds": "time, s", "rmse": "RMSE"}


def _candidates(results: Results) -> tuple[list[str], list[list[object]]]:
    """Return the columns and rows of the table of candidate fits, whatever was recorded of them."""
    compared = results.record.comparison if results.record else None
    rows = list((compared or {}).get("candidates") or ())
    names = list(dict.fromkeys(name for row in rows for name in row))
    return [LABELS.get(name, name) for name in names], [[row.get(name) for name in names] for row in rows]
