"""The verdict on a model: certified, refuted, or undecided with its reason."""

from dataclasses import dataclass
from enum import Enum
from typing import NoReturn


class Reason(Enum):
    """Why a model stays undecided, as a full sentence."""

    INFEASIBLE = "It is proved that no certificate exists in the family of Lyapunov functions that was searched."
    NOT_FOUND = "No Lyapunov function was found in the families that were searched."
    ROUNDING = "A Lyapunov function was found in floating point, but its margin was lost in exact arithmetic."
    FORM = "A property of the functions that the proof needs could not be proved."
    STALLED = "The solver stalled before the sign of the margin was decided."
    TIME = "The time limit was reached."
    INTERRUPTED = "The search was interrupted."
    OUTSIDE = "The model is outside the theory."


@dataclass(frozen=True)
class Attempt:
    """One attempt at a verdict: what was tried, how it ended, and the seconds it took."""

    what: str
    outcome: str
    seconds: float


class _Verdict:
    attempts: tuple[Attempt, ...]

    def __bool__(self) -> NoReturn:
        raise TypeError("a verdict is not a truth value (a refuted model would count as true); ask .is_certified")

    @property
    def is_certified(self) -> bool:
        """Whether the verdict is Certified."""
        return isinstance(self, Certified)

    @property
    def seconds(self) -> float:
        """Time spent on all attempts, in s."""
        return sum(attempt.seconds for attempt in self.attempts)
