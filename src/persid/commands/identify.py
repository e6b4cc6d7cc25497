"""The commands that measure: run, identify and bootstrap."""

import json
import shlex
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import click
from click.core import ParameterSource

from persid._files import Json
from persid.commands.advice import advice_facts, advice_rows, after
from persid.commands.console import Talk, complain
from persid.commands.equations import equation_options, refuse_others, run_equations
from persid.commands.exit_codes import (
    DONE,
    EXIT,
    INTERRUPTED,
    kept,
    question,
    refuse_unwritable,
    time_unit,
    uninterrupted,
    verdict_rows,
)
from persid.commands.options import (
    DISCRETE,
    MEASUREMENTS,
    NEW_FILE,
    NEW_FOLDER,
    batching,
    fit_options,
    fitting,
    measuring,
    output_options,
    proving,
    reading,
    refining,
    resampling,
    talking,
    where,
)
from persid.commands.outputs import Asked, run_outputs
from persid.commands.words import as_given
from persid.measurements.options import ReadingOf

if TYPE_CHECKING:
    from persid.identification.diagnostics import FitReport
    from persid.identification.identifier import PersidskiiIdentifier
    from persid.measurements.readers.sources import Content
    from persid.measurements.recordings import Measurements


@click.command()
@MEASUREMENTS
@measuring
@fitting
@refining
@proving
@click.option("--select", type=click.Choice(["auto"]), help="Search for functions and scales that certify.")
@click.option(
    "--price",
    type=click.FloatRange(1.0),
    default=2.0,
    show_default=True,
    help="Times the free fit's error on held-out data that a certified fit may have to replace it.",
)
@click.option(
    "--margin",
    type=click.FloatRange(min=0, min_open=True),
    help="Residual margin in 1/s: plants that differ so much from the model have to be certified with it.",
)
@click.option("-o", "--output", type=NEW_FOLDER, required=True, help="Folder for the results.")
@talking
def run(
    *, data: tuple[Path, ...], functions: object, ridge: object, method: str, refine: bool, operating_point: object,
    u_op: object, domain: str, time_limit: float, rate: float | None, select: str | None, price: float,
    margin: float | None, test: tuple[Path, ...], output: Path, as_json: bool, quiet: bool, **how: Any,
) -> int:  # fmt: skip
    """Identify, certify and report: from measurements to a verdict in one go.

    Several files are several trajectories of one system. Where the free fit is not certified for all states, it is
    fitted again under the condition that a certificate exists (not with --domain data, --operating-point or --u-op).
    That fit is delivered where it foretells held-out data about as well (--price); otherwise the free model is, with
    its own verdict, and the certified one is kept in alternative/. The folder receives model.json, certificate.json
    (or witness.json, or obstruction.json: why undecided), report.html, figures/ and run.json; older results there are
    removed. The exit code is that of the verdict.
    With --outputs in place of --states the state counts as unmeasured: order and neurons are chosen by free runs, the
    model is stable by construction, and every output is bounded in its own unit. Ctrl-C then keeps the best so far.
    With --algebraic beside --states some measured variables have equations in place of derivatives: each equation says
    what its variable is. --domain auto and --domain data then ask for a region.

    \b
    Example:
      persid run examples/traffic.csv --states x1,x2 --inputs u -o out
    """
    from persid.certified_fits.delivery import Delivery, deliver, trial
    from persid.commands.score import other_files, unseen_scores
    from persid.identification.advice import advise
    from persid.identification.derivatives import embedded, refuse_constant
    from persid.measurements.opening import files_of
    from persid.measurements.readers import read_measurements
    from persid.measurements.recordings import without_still_inputs
    from persid.measurements.strides import strided
    from persid.reports import layout
    from persid.reports.comparison import (
        alternative_rows,
        cautions,
        comparison_rows,
        measured_margin,
        score_facts,
        score_rows,
        without_margin,
    )
    from persid.reports.folder import write_folder
    from persid.reports.record import Record, sources, versions
    from persid.reports.results import Results, held_out
    from persid.verdicts.certify import certify
    from persid.verdicts.summary import summarize

    talk = Talk(as_json, quiet)
    refuse_unwritable(output)
    outputs, unmeasured = how.pop("outputs"), output_options(how)
    if (outputs is None) == (how["states"] is None):
        raise click.UsageError("give --states, or --outputs where the state was not measured")
    if (algebraic := how.pop("algebraic")) is not None:
        refuse_others()
        fit = equation_options({"functions": functions, "ridge": ridge, **fit_options(how)})
        wanted = Asked(data, tuple(test), {**how, "algebraic": algebraic}, fit, _command())
        return run_equations(wanted, question(operating_point, u_op, domain, time_limit, rate), output, talk)
    if outputs is not None:
        chosen = fit_options(how)
        if chosen["time"] == DISCRETE:
            raise click.UsageError("--time discrete goes with --states")
        if rate is not None:
            raise click.UsageError("--rate goes with --states; with --outputs give --min-rate")
        chosen_by_hand = click.get_current_context().get_parameter_source("functions") != ParameterSource.DEFAULT
        named = {"functions": functions} if chosen_by_hand else {}
        fitting = {**unmeasured, **named, "one_curve": chosen["one_curve"], "time_limit": time_limit}
        wanted = Asked(data, tuple(test), {**how, "states": outputs}, fitting, _command())
        return run_outputs(wanted, output, talk)
    if unmeasured:
        raise click.UsageError(f"--{next(iter(unmeasured)).replace('_', '-')} goes with --outputs")
    usual = domain == "global" and operating_point is None and u_op is None
    if select and not usual:
        raise click.UsageError("--select goes with global questions, without --domain, --operating-point and --u-op")
    if margin and not usual:
        raise click.UsageError("--margin goes with global questions, without --domain, --operating-point and --u-op")
    chosen = fit_options(how)
    with talk.progress() as progress, kept(output) as keep:
        progress("reading the measurements")
        found = files_of(list(data))
        states = {name: chosen[name] for name in ("derivatives", "delays")}
        read = read_measurements(found, **how)
        refuse_constant(read, _name(found))
        given = without_still_inputs(read)
        measured = appended = embedded(given, **states)
        progress("identifying the model")
        fit = _identify(given, functions=functions, ridge=ridge, method=method, refine=refine, **chosen)
        keep(fit.model_)
        measured, usual = strided(measured, fit.stride_), usual and not fit.model_.is_discrete
        asked = question(operating_point, u_op, domain, time_limit, rate)
        verdict = uninterrupted(certify(fit.model_, progress=progress, **asked))
        shared: Json = {"time_limit": time_limit, "progress": progress, "rate": rate}
        made = (
            deliver(fit, verdict, given, select=select, price=price, residual_margin=margin, **shared)
            if usual
            else Delivery(fit.model_, verdict, scores=trial(fit, None, given).free)
        )
        if test:
            others = read_measurements(files_of(list(test)), **how).with_inputs(measured.inputs)
            kept_out, basis = embedded(others, **states), other_files(test)
            mine = unseen_scores(made.model, kept_out, basis, fit.hold)
            other = mine if made.model is fit.model_ else unseen_scores(fit.model_, kept_out, basis, fit.hold)
            made = replace(made, scores=mine, free_scores=other)
        judged = others if test else None
        diagnosis = after(advise(fit, given, made.free_scores or made.scores, progress, judged), how["delay"])
        verdict, facts = made.verdict, (made.verdict.attempts, versions(), made.comparison, made.scores)
        tested = sources(files_of(list(test))) if test else ()
        reading = {**how, **states, "stride": fit.stride_}
        shown = (tested, diagnosis, time_unit())
        record = Record(_command(), sources(found), reading, fit.report_, *facts, *shown)
        progress("drawing the report")
        held = kept_out if test else held_out(measured, made.scores)
        results = Results(made.model, verdict, measured, record, held, time_limit)
        proof = write_folder(output, results, made.alternative)
    brief = summarize(verdict)
    paths = {"model": output / layout.MODEL, "report": output / layout.REPORT, _kind(proof): output / proof}
    files = {name: str(path) for name, path in paths.items()}
    report = fit.report_
    rows = [*_data_rows(found, appended), *_fit_rows(report)[:1], *score_rows(made), *comparison_rows(made.comparison)]
    within = measured_margin(verdict, measured, fit.hold)
    beside = cautions(verdict, made.scores, measured, made.model, fit.hold)
    beside = (*beside, *without_margin(verdict, margin))
    rows += [*_remarks(report), *advice_rows(diagnosis), *verdict_rows(verdict, rate)]
    rows += [*([("of the data", within[1])] if within else []), *(("but", doubt) for doubt in beside)]
    rows += [*alternative_rows(made), *list(files.items())[1:]]
    said = {
        "caution": "; ".join(beside) or None,
        "residuals_within": None if within is None else within[0],
        "plant": None if results.plant is None else results.plant.to_dict(),
        "fits": (made.comparison or {}).get("fits"),
        "files": files,
        **score_facts(made),
        **advice_facts(diagnosis),
    }
    talk.result(brief.to_dict() | said | {"notes": list(report.notes), "warnings": list(report.warnings)}, rows)
    return EXIT[brief.verdict]


@click.command()
@MEASUREMENTS
@reading
@fitting
@refining
@where
@click.option("-o", "--output", type=NEW_FILE, required=True, help="The model file to write.")
@talking
def identify(
    *, data: tuple[Path, ...], functions: object, ridge: object, method: str, refine: bool, output: Path,
    as_json: bool, quiet: bool, **how: Any,
) -> int:  # fmt: skip
    """Identify a generalized Persidskii model from measurements.

    DATA are CSV or Parquet files, folders of them, or patterns in quotes such as "data/*.parquet"; every file is a
    trajectory of its own, or several. With --engine chunks or dask they are read chunk by chunk, so that they may be
    larger than the memory.

    \b
    Example:
      persid identify examples/traffic.csv --states x1,x2 --inputs u -o model.json
    """
    from persid.identification.advice import advise
    from persid.models.equations import equations

    talk = Talk(as_json, quiet, output)
    refuse_unwritable(output)
    chosen = fit_options(how)
    with talk.progress() as progress:
        progress("reading the measurements")
        measured = _measurements(data, progress=progress, **how)
        progress("identifying the model")
        options = {"functions": functions, "ridge": ridge, "method": method, "refine": refine}
        fit = _identify(measured, **options, **chosen)
        diagnosis = after(advise(fit, measured, progress=progress), how["delay"])
    output.parent.mkdir(parents=True, exist_ok=True)
    fit.model_.save(output)
    text = equations(fit.model_)
    rows = [*_data_rows(data, measured), *_fit_rows(fit.report_), ("equations", text), *advice_rows(diagnosis)]
    rows += [("model", str(output))]
    report = fit.report_
    scores = {"ridge": report.ridge, "condition": _number(report.condition_scaled)} | _scores(report)
    talk.result(
        {"model": str(output), "sha256": fit.model_.sha256, "equations": text.splitlines()}
        | scores
        | advice_facts(diagnosis),
        rows,
    )
    return DONE


@click.command()
@MEASUREMENTS
@reading
@fitting
@resampling
@proving
@batching
@click.option("-o", "--output", type=NEW_FILE, required=True, help="The JSON file to write.")
@talking
def bootstrap(
    *, data: tuple[Path, ...], functions: object, ridge: object, method: str, count: int, seed: int,
    operating_point: object, u_op: object, domain: str, time_limit: float, rate: float | None, jobs: int, engine: str,
    scheduler: str | None, output: Path, as_json: bool, quiet: bool, **how: Any,
) -> int:  # fmt: skip
    """Refit to resampled measurements: the share of refits that is certified, and the spread of rates and gains.

    What is drawn are blocks of consecutive samples, or whole files where there are many. The share speaks of the
    sampling alone, not of functions that are missing. After Ctrl-C the refits that were decided are written.

    \b
    Example:
      persid bootstrap examples/traffic.csv --states x1,x2 --inputs u --count 50 --jobs 2 -o bootstrap.json
    """
    from persid._files import write_atomically
    from persid.certified_fits import bootstrap as batches

    talk = Talk(as_json, quiet, output)
    refuse_unwritable(output)
    chosen = fit_options(how)
    with talk.progress() as progress:
        progress("reading the measurements")
        measured = _measurements(data, "memory", None, progress, **how)
        progress("identifying the model")
        fit = _identify(measured, functions=functions, ridge=ridge, method=method, **chosen)
        where: Json = {"engine": None if engine == "processes" and jobs == 1 else engine, "jobs": jobs}
        asked = question(operating_point, u_op, domain, time_limit, rate)
        found = batches.bootstrap(fit, count, seed=seed, scheduler=scheduler, progress=progress, **where, **asked)
    content = batches.figures(found, fit)
    output.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(output, json.dumps(content, indent=1, allow_nan=False) + "\n")
    rows = [*_data_rows(data, measured), *_fit_rows(fit.report_), ("refits", str(found)), ("file", str(output))]
    talk.result({**content, "file": str(output)}, rows)
    if len(found.verdicts) == count:
        return DONE
    complain(f"interrupted; {len(found.verdicts)} of {count} refits were decided and are written", INTERRUPTED, False)
    return INTERRUPTED


def _measurements(
    data: Sequence[Path], engine: str, scheduler: str | None, progress: Callable[[str], None], **how: Unpack[ReadingOf]
) -> "Measurements":
    """Read measurements into memory, or look through them where they are."""
    from persid.measurements.opening import files_of, open_recordings
    from persid.measurements.readers import read_measurements

    files = files_of(list(data))
    if engine == "memory":
        if scheduler:
            raise click.UsageError("--scheduler goes with --engine dask")
        return read_measurements(files, **how)
    chosen = "dask" if engine == "dask" else None
    if scheduler and not chosen:
        raise click.UsageError("--scheduler goes with --engine dask")
    return open_recordings(files, engine=chosen, scheduler=scheduler, progress=progress, **how)


def _identify(measured: "Measurements", **how: Any) -> "PersidskiiIdentifier":
    from persid.identification.identifier import PersidskiiIdentifier

    return PersidskiiIdentifier(**how).fit(measured)


def _command() -> str:
    return "persid " + shlex.join(as_given())


def _kind(name: str) -> str:
    return name.removesuffix(".json")


def _number(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


def _count(count: int, what: str) -> str:
    return f"{count:,} {what}{'' if count == 1 else 's'}"


def _name(paths: "Sequence[Path | Content]") -> str:
    return str(paths[0]) if len(paths) == 1 else f"{len(paths)} files"


def _data_rows(paths: "Sequence[Path | Content]", data: "Measurements") -> list[tuple[str, str]]:
    counts = [_count(len(data), "run"), _count(data.samples, "sample")]
    counts += [_count(len(data.states), "state"), _count(len(data.inputs), "input")]
    return [("data", f"{_name(paths)}: {', '.join(counts)}")]


def _fit_rows(report: "FitReport") -> list[tuple[str, str]]:
    rows = [("fit", f"{report.method} form, {report.columns} columns, ridge {report.ridge:.3g}")]
    if report.free_run is not None:
        score = report.free_run
        blown = f", {_count(score.blow_ups, 'blow-up')}" if score.blow_ups else ""
        rows += [("free run", f"R2 {score.r2_mean:.4f}, RMSE {score.rmse:.4g} on the held-out tail{blown}")]
    return [*rows, *_remarks(report)]


def _remarks(report: "FitReport") -> list[tuple[str, str]]:
    return [*(("note", text) for text in report.notes), *(("warning", text) for text in report.warnings)]


def _scores(report: "FitReport") -> Json:
    pairs = (("free_run", report.free_run), ("one_step", report.one_step))
    scores = {name: {"rmse": _number(s.rmse), "r2": _number(s.r2_mean)} for name, s in pairs if s is not None}
    return {**scores, "notes": list(report.notes), "warnings": list(report.warnings)}
