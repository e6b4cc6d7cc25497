"""The report of an output model: what is proved, and how it foretells what was measured, on the first screen."""

import hashlib
from pathlib import Path

from matplotlib.figure import Figure

from persid._files import Json, write_atomically
from persid._text import above, below
from persid.models.equations import equations
from persid.models.outputs import OutputModel
from persid.plots.outputs import output_run
from persid.plots.style import short, timed_in
from persid.reports import figures as drawings
from persid.reports.figures import Drawing
from persid.reports.front import UNSCORED, Front, capital, foretelling
from persid.reports.layout import CERTIFICATE, FIGURES, MODEL, REPORT
from persid.reports.output_runs import OutputRun, output_doubts, output_runs, run_scores
from persid.reports.results import Results
from persid.reports.templating import environment
from persid.verdicts.summary import limits, summarize
from persid.verdicts.verdict import Certified

RUNS, OUTPUTS = 4, 6  # that are drawn


def write_output_report(results: Results, folder: Path) -> None:
    """Write report.html and figures/*.png into an existing folder."""
    model = results.model
    if not isinstance(model, OutputModel):
        raise TypeError("not an output model")
    (folder / FIGURES).mkdir(exist_ok=True)
    with drawings.style():
        runs = output_runs(model, results.data, results.verdict) if results.data is not None else []
        drawn = [
            _drawing(model, run, k, i) for k, run in enumerate(runs[:RUNS]) for i in range(len(model.outputs[:OUTPUTS]))
        ]
        for drawing in drawn:
            timed_in(drawing.figure, results.time_unit)
        write_atomically(folder / REPORT, _page(results, model, runs, drawn))
        for drawing in drawn:
            write_atomically(folder / FIGURES / f"{drawing.name}.png", drawing.png)


def _drawing(model: OutputModel, run: OutputRun, k: int, i: int) -> Drawing:
    name, bound = model.outputs[i], None
    said = ""
    if run.bound is not None and run.rest is not None:
        bound = (float(run.rest[i]), run.bound[:, i])
        said = (
            f" Whatever the input of this size, {name} stays within {above(float(run.bound[:, i].max()))} of"
            f" {run.rest[i]:.4g} by proof, in the long run within {above(float(run.bound[:, i].min()))}."
        )
    figure = Figure(figsize=(8.0, 3.2), layout="constrained")
    ax = output_run(figure.subplots(), run.measured, run.simulated, i, bound, starts=run.starts)
    ax.set_ylabel(short(name))
    caption = (
        f"{name}, record {k + 1}: the model runs freely from a start that the first {run.starts} samples give;"
        f" R² {run.r2[i]:.4f}, RMSE {run.rmse[i]:.4g} on the others.{said}"
    )
    return Drawing(f"output_{k + 1}_{i + 1}", figure, f"{name} as measured and as the model runs freely", caption)


def output_front(results: Results, model: OutputModel, runs: list[OutputRun]) -> Front:
    """Return status and sentence: green only where the proof holds and the model foretells the outputs."""
    verdict, compared = results.verdict, (results.record.comparison if results.record else None) or {}
    unseen = bool(compared.get("unseen"))
    scores = run_scores(runs, model, unseen) if runs else None
    told = "" if scores is None else f"; {foretelling(scores, results.time_unit)}"
    if not isinstance(verdict, Certified):
        return Front(summarize(verdict).verdict, "?", "Undecided", f"{verdict.headline.rstrip('.')}{told}.", ())
    held_out = next((row.get("held_out") for row in compared.get("candidates") or ()), None)
    found = (UNSCORED,) if scores is None else output_doubts(scores, unseen, held_out)
    doubts = tuple(map(capital, found))
    sentence = f"{verdict.headline.rstrip('.').removeprefix('Certified: ')}{told}."
    if doubts:
        return Front("certified doubtful", "!", "Proved stable, but doubtful", capital(sentence), doubts)
    return Front("certified", "✓", "Proved stable, and it foretells", capital(sentence), ())


def _page(results: Results, model: OutputModel, runs: list[OutputRun], drawn: list[Drawing]) -> str:
    verdict = results.verdict
    certificate = verdict.certificate if isinstance(verdict, Certified) else None
    compared: Json = (results.record.comparison if results.record else None) or {}
    return (
        environment()
        .get_template("output_report.html.jinja")
        .render(
            model=model, brief=summarize(verdict), unit=results.time_unit, front=output_front(results, model, runs),
            limits=limits(verdict, model.dynamics), certificate=certificate, below=below, above=above, runs=runs,
            drawings=drawn, record=results.record, equations=equations(model),
            candidates=compared.get("candidates") or [], notes=compared.get("notes") or [],
            unseen=bool(compared.get("unseen")), files={"model": MODEL, "proof": CERTIFICATE},
            proof_sha256=hashlib.sha256(certificate.data).hexdigest() if certificate else None,
        )
    )  # fmt: skip
