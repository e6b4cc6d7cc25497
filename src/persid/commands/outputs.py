"""What `persid run --outputs` does: a certified model of a system of which only inputs and outputs are measured."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from persid._files import Json
from persid.commands.console import Talk
from persid.commands.exit_codes import EXIT, kept, time_unit, uninterrupted, verdict_rows

if TYPE_CHECKING:
    from persid.reports.output_runs import OutputScores


@dataclass(frozen=True)
class Asked:
    """What a command asks for: files to fit, files kept from the fit, how to read both, and how to fit."""

    files: tuple[Path, ...]
    test: tuple[Path, ...]
    reading: Json
    options: Json
    command: str


def run_outputs(asked: Asked, folder: Path, talk: Talk) -> int:
    """Fit, certify and report; return the exit code of the verdict."""
    from persid.certified_fits.outputs import OutputIdentifier
    from persid.measurements.opening import files_of
    from persid.measurements.readers import read_measurements
    from persid.reports import layout
    from persid.reports.folder import write_folder
    from persid.reports.output_runs import OutputScores, output_doubts, output_runs, run_scores
    from persid.reports.record import Record, sources, versions
    from persid.reports.results import Results
    from persid.verdicts.summary import summarize

    options = {name: value for name, value in asked.options.items() if name != "foh"}
    options["hold"] = "foh" if asked.options.get("foh") else "zoh"
    with talk.progress() as progress, kept(folder) as keep:
        progress("reading the measurements")
        found = files_of(list(asked.files))
        unfitted = files_of(list(asked.test)) if asked.test else []
        measured = read_measurements(found, **asked.reading)
        unseen = read_measurements(unfitted, **asked.reading) if unfitted else None
        fit = OutputIdentifier(**options).fit(measured, progress=progress)
        keep(fit.model_)
        verdict = uninterrupted(fit.verdict_)
        report = fit.report_
        notes = [*report.remarks, *(["The search was interrupted; this is the best so far."] * report.interrupted)]
        compared = {"candidates": [asdict(one) for one in report.candidates], "notes": notes, "unseen": bool(unfitted)}
        progress("drawing the report")
        seen = sources(unfitted or found)
        record = Record(
            command=asked.command,
            sources=seen,
            reading=asked.reading,
            fit=None,
            attempts=verdict.attempts,
            versions=versions(),
            comparison=compared,
        )
        record = replace(record, time_unit=time_unit())
        proof = write_folder(folder, Results(fit.model_, verdict, unseen or measured, record))
    brief = summarize(verdict)
    paths = {
        "model": folder / layout.MODEL,
        "report": folder / layout.REPORT,
        proof.removesuffix(".json"): folder / proof,
    }
    named = {name: str(path) for name, path in paths.items()}
    one = report.chosen
    size = f"order {one.order}, {one.neurons} neurons, {len(report.candidates)} candidates"
    rows = [("data", f"{len(measured)} runs, {measured.samples:,} samples"), ("fit", size)]
    rows += [
        ("free run", f"error {report.held_out:.4g} of the outputs' spread, held out (linear model {report.linear:.4g})")
    ]
    shown = output_runs(fit.model_, unseen or measured)
    scores = None if unseen is None else OutputScores.of(shown, fit.model_.outputs)
    foretold = run_scores(shown, fit.model_, bool(unfitted))
    doubts = output_doubts(foretold, bool(unfitted), report.held_out) if brief.verdict == "certified" else ()
    rows += [] if scores is None else [("unseen", _told(scores, len(unfitted)))]
    rows += [*(("note", text) for text in notes), *verdict_rows(verdict), *(("but", doubt) for doubt in doubts)]
    rows += [*list(named.items())[1:]]
    told = None if scores is None else scores.to_dict()
    held_out = {"error": report.held_out, "linear": report.linear, "unseen": told}
    talk.result(
        brief.to_dict() | {"caution": "; ".join(doubts) or None, "held_out": held_out, "notes": notes, "files": named},
        rows,
    )
    return EXIT[brief.verdict]


def _told(scores: "OutputScores", files: int) -> str:
    lines = [f"{files} file{'' if files == 1 else 's'} kept from the fit"]
    return "\n".join([*lines, *(f"{name}: {text}" for name, text in scores.rows())])
