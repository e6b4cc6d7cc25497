"""The report of a model with algebraic variables: what is proved, and how it foretells what the fit has not seen."""

import hashlib
from pathlib import Path

from matplotlib.figure import Figure

from persid._files import Json, write_atomically
from persid.identification.descriptors import FreeRuns, free_runs_of
from persid.models.descriptor import DescriptorModel
from persid.models.equations import equations
from persid.plots.outputs import output_run
from persid.plots.style import short, timed_in
from persid.reports import figures as drawings
from persid.reports.figures import Drawing
from persid.reports.front import UNSCORED, Front, capital, refuted_front
from persid.reports.layout import CERTIFICATE, FIGURES, MODEL, REPORT, WITNESS
from persid.reports.results import Results
from persid.reports.templating import environment
from persid.verdicts.summary import limits, summarize
from persid.verdicts.verdict import Certified, Refuted

RUNS, VARIABLES = 2, 6  # that are drawn
POOR = 0.5  # R^2 of a free run below which the model does not foretell
BRANCH = "Of solutions of the equations outside the strips that the checker names it says nothing."


def write_equations_report(results: Results, model: DescriptorModel, folder: Path) -> None:
    """Write report.html and figures/*.png into an existing folder."""
    (folder / FIGURES).mkdir(exist_ok=True)
    with drawings.style():
        runs = None if results.held is None else free_runs_of(model, results.held)
        drawn = [] if runs is None else _drawings(model, runs)
        for drawing in drawn:
            timed_in(drawing.figure, results.time_unit)
        write_atomically(folder / REPORT, _page(results, model, runs, drawn))
        for drawing in drawn:
            write_atomically(folder / FIGURES / f"{drawing.name}.png", drawing.png)


def _drawings(model: DescriptorModel, runs: FreeRuns) -> list[Drawing]:
    found = []
    for k, (measured, free) in enumerate(runs.pairs[:RUNS]):
        for i, name in enumerate(model.variables[:VARIABLES]):
            figure = Figure(figsize=(8.0, 2.8), layout="constrained")
            ax = output_run(figure.subplots(), measured, free, i)
            ax.set_ylabel(short(name))
            kind = "algebraic variable" if name in model.algebraic else "state"
            caption = f"{name} ({kind}), record {k + 1}: the model runs freely from the first sample's states."
            alt = f"{name} as measured and as the model runs freely"
            found.append(Drawing(f"variable_{k + 1}_{i + 1}", figure, alt, caption))
    return found


def equations_front(results: Results, model: DescriptorModel, runs: FreeRuns | None) -> Front:
    """Return status and sentence: green only where the proof holds and the model foretells every variable."""
    verdict = results.verdict
    if isinstance(verdict, Refuted):
        return refuted_front(verdict)
    sentence = f"{verdict.headline.rstrip('.').removeprefix('Certified: ')}."
    if not isinstance(verdict, Certified):
        return Front(summarize(verdict).verdict, "?", "Undecided", sentence, ())
    poor = [] if runs is None else [name for name in model.variables if not runs.r2[name] >= POOR]
    doubts = [f"The free run misses {', '.join(poor)}: R² below {POOR}"] if poor else []
    doubts += [capital(UNSCORED)] if runs is None else []
    proved = "Proved stable in a region" if verdict.certificate.scope == "regional" else "Proved stable"
    if doubts:
        return Front("certified doubtful", "!", f"{proved}, but doubtful", capital(sentence), tuple(doubts))
    return Front("certified", "✓", f"{proved}, and it foretells", capital(sentence), ())


def _page(results: Results, model: DescriptorModel, runs: FreeRuns | None, drawn: list[Drawing]) -> str:
    verdict = results.verdict
    certificate = verdict.certificate if isinstance(verdict, Certified) else None
    proof = verdict.witness if isinstance(verdict, Refuted) else certificate
    compared: Json = (results.record.comparison if results.record else None) or {}
    said = limits(verdict, model.rows)
    regional = certificate is not None and certificate.scope == "regional"
    return (
        environment()
        .get_template("equations_report.html.jinja")
        .render(
            model=model, brief=summarize(verdict), unit=results.time_unit, runs=runs, drawings=drawn,
            front=equations_front(results, model, runs), limits=(*said, BRANCH) if regional else said,
            certificate=certificate, record=results.record, equations=equations(model), unseen=compared.get("test"),
            detail=getattr(verdict, "detail", ""), proof=proof,
            files={"model": MODEL, "proof": CERTIFICATE if certificate else WITNESS},
            proof_sha256=hashlib.sha256(proof.data).hexdigest() if proof else None,
        )
    )  # fmt: skip
