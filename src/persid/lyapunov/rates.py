"""Rates and gains: the best kappa by bisection, then the smallest gain at a chosen share of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov.deviations import Deviation
from persid.lyapunov.interior_point import Status
from persid.lyapunov.multipliers import choose
from persid.lyapunov.search import Outcome, search
from persid.lyapunov.sectors import Curve
from persid.lyapunov.system import System, Target

STEPS = 8  # bisections of the rate, and of the gain

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Question:
    """A system with its pools and the constants of its forms, and the shape in which V is bounded from below."""

    system: System
    pools: Mapping[Curve, Float[ndarray, "K d"]]
    upper: Mapping[Curve, Float[ndarray, " K"]]
    lower: Mapping[Curve, Float[ndarray, " K"]]
    full: bool  # a full P, else a diagonal one
    shape: Float[ndarray, " n"] | None = None
    deviations: tuple[Deviation, ...] = ()  # of the plants that are meant, none: the model alone

    def ask(
        self, kappa: float, ratio: float | None, start: Outcome | None, left: Callable[[], float]
    ) -> Outcome | None:
        """Return a feasible outcome for a rate and a ratio gamma / p, or None."""
        target = Target(kappa, ratio, self.shape, self.upper if kappa else {}, self.lower, self.deviations)
        families = None if start is None else start.assembly.unknowns.families
        found = search(self.system, self.pools, full_P=self.full, target=target, families=families, time_limit=left())
        if found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        return found if found.status is Status.FEASIBLE else None


def kappa(outcome: Outcome) -> float:
    """Return the rate of decay of V, in 1/s, that an outcome shows."""
    return outcome.assembly.unknowns.target.kappa


def best_rate(question: Question, fastest: float, left: Callable[[], float]) -> Outcome | None:
    """Return an outcome whose kappa is within a few percent of the largest that the pools certify.

    `fastest` bounds kappa from above: twice the decay rate of the linearisation.
    """
    return largest_rate(
        lambda trial, best: question.ask(trial, None, best, left), fastest, left, first=0.9, fall=0.3, near=1.05
    )


def largest_rate(
    ask: Callable[[float, T | None], T | None],
    fastest: float,
    left: Callable[[], float],
    *,
    first: float,
    fall: float,
    near: float,
) -> T | None:
    """Return what `ask` finds at the largest rate below `fastest` at which it finds anything, by bisection.

    It is asked at the share `first` of that, then at the share `fall` of what was too fast until something is found,
    and no more where what is too fast is `near` times what is not. `ask` takes the rate, and what was found last.
    """
    best, low, high, trial = None, 0.0, fastest, first * fastest
    for _ in range(STEPS):
        if left() <= 0:
            break
        found = ask(trial, best)
        if found is None:
            high = trial
        else:
            best, low = found, trial
        trial = 0.5 * (low + high) if low else fall * high
        if low and high < near * low:
            break
    return best


def smallest_gain(
    question: Question, kappa: float, start: Outcome, left: Callable[[], float], steps: int = STEPS + 4
) -> Outcome | None:
    """Return an outcome of rate kappa whose ratio gamma / p is within 2 % of the smallest, so its gain within 1 %.

    With fewer `steps` it is as near to it as these lead.
    """
    best, low, high = None, 0.0, _ratio(question, kappa, start, left)
    for step in range(steps):
        if left() <= 0 or not np.isfinite(high) or high < 1.02 * low:
            break
        trial = high if step == 0 else float(np.sqrt(low * high)) if low else 0.1 * high
        found = question.ask(kappa, trial, best or start, left)
        if found is None:
            low = trial
            if step == 0:
                high *= 16
        else:
            best, high = found, trial
    return best


def _ratio(question: Question, kappa: float, start: Outcome, left: Callable[[], float]) -> float:
    """Return a ratio gamma / p that some Lyapunov function of this rate attains."""
    found = question.ask(kappa, None, start, left)
    if found is None:
        return np.inf
    lyapunov = choose(found.assembly, found.solution.y, [question.lower[g.curve] for g in question.system.groups])
    weight = np.ones(question.system.n) if question.shape is None else question.shape
    scaled = lyapunov.below / np.sqrt(weight) / np.sqrt(weight)[:, None]
    return 1.1 * lyapunov.gamma / float(np.linalg.eigvalsh(scaled)[0])
