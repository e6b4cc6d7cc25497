"""The command that scores: how a saved model foretells other files."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from persid.commands.console import Talk
from persid.commands.exit_codes import DONE, read_model
from persid.commands.options import FILE, MEASUREMENTS, columns, talking

if TYPE_CHECKING:
    from persid.identification.scores import Scores


@click.command()
@click.argument("model", type=FILE, metavar="MODEL.json")
@MEASUREMENTS
@columns
@talking
def score(model: Path, data: tuple[Path, ...], as_json: bool, quiet: bool, **how: Any) -> int:
    """Score a saved model on other files: free runs of several lengths, restarted along every run, state by state.

    The columns of the files are those of the model's states and inputs. R2 is against the spread of the files; errors
    stand in the unit of each state and in % of its range. A star marks the horizon over which the record forgets.

    \b
    Example:
      persid score model.json examples/traffic.csv
    """
    from persid.models.model import PersidskiiModel
    from persid.reports.comparison import facts, scored

    talk, subject = Talk(as_json, quiet), read_model(model)
    if not isinstance(subject, PersidskiiModel):
        raise click.UsageError("an output model is scored by persid run --outputs … --test FILE")
    with talk.progress() as progress:
        progress("scoring")
        found = unseen_scores(subject, data, **how)
    rows = [("model", str(model)), ("foretells", f"{scored(found)}, on {found.basis}"), *_table(found)]
    rows += [("but", text) for text in found.doubts]
    talk.result({"model": str(model), "scores": facts(found), "doubts": list(found.doubts)}, rows)
    return DONE


def unseen_scores(model: Any, files: Sequence[Path], hold: str = "zoh", **how: Any) -> "Scores":
    """Return the scores of a model on files that its fit has not seen; columns are those of the model."""
    from persid.identification.scores import Record, held_out_scores
    from persid.measurements.opening import files_of
    from persid.measurements.readers import read_measurements

    how |= {"states": list(model.states), "inputs": list(model.inputs)}
    measured = read_measurements(files_of(list(files)), **how)
    basis = f"{len(files)} other file{'' if len(files) == 1 else 's'}"
    return held_out_scores(model, measured, Record.of(measured), hold, basis)


def _table(scores: "Scores") -> list[tuple[str, str]]:
    lines = []
    for row in scores.rows:
        each = zip(scores.states, row.rmse, row.percent, row.r2, strict=True)
        said = ", ".join(f"{name} {rmse:.3g} ({percent:.2g} %, R2 {r2:.3f})" for name, rmse, percent, r2 in each)
        lines.append((f"{'*' if row is scores.headline else ' '} {row.length}", said))
    return lines
