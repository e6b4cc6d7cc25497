"""What `persid run --algebraic` does: a model with equations beside derivatives, identified and certified."""

from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from persid._files import Json
from persid.commands.console import Talk
from persid.commands.exit_codes import EXIT, kept, time_unit, uninterrupted, verdict_rows
from persid.commands.options import DISCRETE
from persid.commands.outputs import Asked
from persid.errors import DataError

if TYPE_CHECKING:
    from persid.verdicts.options import AskedAtRate

TAKEN = ("functions", "ridge", "x_ref", "scale", "pattern", "constant", "hold")  # of the options of a fit
REFUSED = ("method", "refine", "select", "price", "margin", "stride", "derivatives", "delays", "window",
           "instruments", "velocities", "shared", "one_curve", "allow_underdetermined", "outputs")  # fmt: skip
RIDGE = 1e-8  # where none is given, as of DescriptorIdentifier


def refuse_others() -> None:
    """Refuse options of a fit that one with equations does not have.

    Raises:
        click.UsageError: one was given.
    """
    context = click.get_current_context()
    given = [name for name in REFUSED if context.get_parameter_source(name) is ParameterSource.COMMANDLINE]
    if given:
        raise click.UsageError(f"--{given[0].replace('_', '-')} does not go with --algebraic")


def equation_options(chosen: Json) -> Json:
    """Return what DescriptorIdentifier takes of the options of a fit.

    Raises:
        click.UsageError: discrete time was asked for.
    """
    if chosen["time"] == DISCRETE:
        raise click.UsageError("--time discrete does not go with --algebraic")
    taken = {name: chosen[name] for name in TAKEN}
    return taken | {"ridge": RIDGE if taken["ridge"] == "auto" else taken["ridge"]}


def run_equations(asked: Asked, question: "AskedAtRate", folder: Path, talk: Talk) -> int:
    """Fit, certify and report; return the exit code of the verdict. `reading` names the algebraic variables, too."""
    from persid.identification.descriptors import DescriptorIdentifier, free_runs_of
    from persid.measurements.opening import files_of
    from persid.measurements.readers import read_measurements
    from persid.models.equations import equations
    from persid.reports import layout
    from persid.reports.folder import write_folder
    from persid.reports.record import Record, sources, versions
    from persid.reports.results import Results
    from persid.verdicts.certify import certify
    from persid.verdicts.summary import summarize

    reading = dict(asked.reading)
    algebraic = list(reading.pop("algebraic"))
    reading["states"] = [*reading["states"], *algebraic]
    if len(set(reading["states"])) < len(reading["states"]):
        raise DataError("--states and --algebraic name a column twice; give the states in one, the others in the other")
    with talk.progress() as progress, kept(folder) as keep:
        progress("reading the measurements")
        found = files_of(list(asked.files))
        measured = read_measurements(found, **reading)
        others = files_of(list(asked.test)) if asked.test else []
        progress("identifying the model")
        options = {**asked.options, **({"holdout": 0.0} if others else {})}
        fit = DescriptorIdentifier(algebraic, **options).fit(measured)
        keep(fit.model_)
        held = read_measurements(others, **reading).with_inputs(measured.inputs) if others else fit.held_
        runs = free_runs_of(fit.model_, held)
        verdict = uninterrupted(certify(fit.model_, progress=progress, **question))
        compared = {"errors": runs.errors, "r2": runs.r2, "algebraic": algebraic, "test": bool(others)}
        progress("drawing the report")
        record = Record(
            command=asked.command, sources=sources(found), reading=reading, fit=None, attempts=verdict.attempts,
            versions=versions(), comparison=compared, test=sources(others), time_unit=time_unit(),
        )  # fmt: skip
        proof = write_folder(folder, Results(fit.model_, verdict, measured, record, held))
    brief = summarize(verdict)
    paths = {"model": layout.MODEL, "report": layout.REPORT, proof.removesuffix(".json"): proof}
    named = {name: str(folder / path) for name, path in paths.items()}
    unseen = f"{len(others)} files kept from the fit" if others else "the last part of each run, kept from the fit"
    told = "\n".join([unseen, *(f"{name}: RMSE {error:.3g}" for name, error in runs.errors.items())])
    rows = [("data", f"{len(measured)} runs, {measured.samples:,} samples"), ("equations", equations(fit.model_))]
    rows += [("free run", told), *verdict_rows(verdict), *list(named.items())[1:]]
    talk.result(brief.to_dict() | {"held_out": compared, "files": named}, rows)
    return EXIT[brief.verdict]
