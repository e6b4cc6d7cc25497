"""What the parts of several studies keep, as JSON holds it: verdicts and errors of free runs."""

from typing import TypedDict

from persid.identification.free_runs import Score

Rows = list[list[float]]  # an array of two dimensions, a row a sample


class VerdictCell(TypedDict):
    """A verdict in brief: `why` is the kind of its proof or the reason for none, `files` hold model and proof.

    `rate` is in 1/s, `gain` in units of states over units of inputs, `seconds` are those of the whole search.
    """

    verdict: str
    scope: str | None
    reason: str | None
    why: str | None
    rate: float | None
    gain: float | None
    seconds: float
    files: list[str]


class ScoreCell(TypedDict):
    """Errors of free runs over all states together; numbers only where no run blew up."""

    rmse: float
    r2: float
    r2_mean: float
    blow_ups: int


class Refused(TypedDict):
    """Why there is no model."""

    refused: str


def errors(score: Score) -> ScoreCell:
    """Return what a study keeps of a score."""
    return {"rmse": score.rmse, "r2": score.r2, "r2_mean": score.r2_mean, "blow_ups": score.blow_ups}
