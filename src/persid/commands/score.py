"""The command that scores: how a saved model foretells other files."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack

import click

from persid.commands.console import Talk
from persid.commands.exit_codes import DONE, read_model
from persid.commands.options import FILE, MEASUREMENTS, Chosen, appending, columns, talking
from persid.measurements.options import Reading, ReadingOf

if TYPE_CHECKING:
    from persid.identification.scores import Scores
    from persid.measurements.trajectories import Trajectories
    from persid.models.model import PersidskiiModel
    from persid.models.outputs import OutputModel
    from persid.reports.output_runs import OutputScores


@click.command()
@click.argument("model", type=FILE, metavar="MODEL.json")
@MEASUREMENTS
@columns
@appending
@talking
def score(model: Path, data: tuple[Path, ...], as_json: bool, quiet: bool, **how: Any) -> int:
    """Score a saved model on other files: free runs of several lengths, restarted along every run, state by state.

    The columns of the files are those of the model's states and inputs. R2 is against the spread of the files; errors
    stand in the unit of each state and in % of its range. A star marks the horizon over which the record forgets.
    A model of inputs and outputs runs freely over every file, from a state that its first samples tell.

    \b
    Example:
      persid score model.json examples/traffic.csv
    """
    from persid.models.outputs import OutputModel
    from persid.reports.comparison import facts, scored

    talk, subject = Talk(as_json, quiet), read_model(model)
    if isinstance(subject, OutputModel):
        return _score_outputs(model, subject, data, talk, how)
    with talk.progress() as progress:
        progress("scoring")
        found = unseen_scores(subject, _measured(subject, data, **how), other_files(data))
    rows = [("model", str(model)), ("foretells", f"{scored(found)}, on {found.basis}"), *_table(found)]
    rows += [("but", text) for text in found.doubts]
    talk.result({"model": str(model), "scores": facts(found), "doubts": list(found.doubts)}, rows)
    return DONE


def other_files(files: Sequence[Path]) -> str:
    """Return what scores on other files are on."""
    return f"{len(files)} other file{'' if len(files) == 1 else 's'}"


def _score_outputs(path: Path, model: "OutputModel", data: Sequence[Path], talk: Talk, how: Chosen) -> int:
    """Print how free runs, each from a state that its first samples tell, follow the outputs of the files."""
    if any([how.pop("derivatives"), how.pop("delays")]):
        raise click.UsageError("--derivatives and --delays go with models of states; an output model has its own")
    with talk.progress() as progress:
        progress("scoring")
        found = unseen_output_scores(model, data, **how)
    basis = f"free runs over {other_files(data)}, from their first samples"
    said = {"model": str(path), "scores": {"basis": basis, "outputs": found.to_dict()}}
    talk.result(said, [("model", str(path)), ("foretells", basis), *found.rows()])
    return DONE


def unseen_output_scores(model: "OutputModel", files: Sequence[Path], **how: Unpack[Reading]) -> "OutputScores":
    """Return the scores of an output model on files that its fit has not seen; columns are those of the model."""
    from persid.measurements.opening import files_of
    from persid.measurements.readers import read_measurements
    from persid.reports.output_runs import OutputScores, output_runs

    asked: ReadingOf = {**how, "states": list(model.outputs), "inputs": list(model.dynamics.inputs)}
    return OutputScores.of(output_runs(model, read_measurements(files_of(list(files)), **asked)), model.outputs)


def unseen_scores(model: "PersidskiiModel", measured: "Trajectories", basis: str, hold: str = "zoh") -> "Scores":
    """Return the scores of a model on measurements that its fit has not seen."""
    from persid.identification.scores import Record, held_out_scores
    from persid.measurements.strides import at_steps

    measured = measured if model.dt is None else at_steps(measured, model.dt)
    return held_out_scores(model, measured, Record.of(measured), hold=hold, basis=basis)


def _measured(
    model: "PersidskiiModel", files: Sequence[Path], derivatives: int, delays: int, **how: Unpack[Reading]
) -> "Trajectories":
    """Read the columns of a model's states and inputs; states that a fit has appended are appended again.

    Raises:
        DataError: a column is missing, or the appended states are not those of the model.
    """
    from persid.errors import DataError
    from persid.identification.derivatives import embedded
    from persid.measurements.opening import files_of
    from persid.measurements.readers import read_measurements

    base = list(model.states[: model.n // (1 + derivatives + delays)])
    asked: ReadingOf = {**how, "states": base, "inputs": list(model.inputs)}
    found = read_measurements(files_of(list(files)), **asked)
    found = embedded(found, derivatives, delays)
    if found.states != model.states:
        given = f"derivatives={derivatives} and delays={delays}"
        raise DataError(
            f"the states of the model are {', '.join(model.states)}, with {given} they would be "
            f"{', '.join(found.states)}; give the options with which the model was fitted"
        )
    return found


def _table(scores: "Scores") -> list[tuple[str, str]]:
    lines = []
    for row in scores.rows:
        each = zip(scores.states, row.rmse, row.percent, row.r2, strict=True)
        said = ", ".join(f"{name} {rmse:.3g} ({percent:.2g} %, R2 {r2:.3f})" for name, rmse, percent, r2 in each)
        lines.append((f"{'*' if row is scores.headline else ' '} {row.length}", said))
    return lines
