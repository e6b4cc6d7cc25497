"""Rates and gains: the best kappa by bisection, then the smallest gain at a chosen share of it."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov.deviations import Deviation
from persid.lyapunov.extremes import largest
from persid.lyapunov.interior_point import Status
from persid.lyapunov.multipliers import lyapunov_function
from persid.lyapunov.search import Outcome, catalogue, search
from persid.lyapunov.sectors import Curve, Form
from persid.lyapunov.system import Family, System, Target

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
        self, kappa: float, ratio: float | None, families: Sequence[Family] | None, left: Callable[[], float]
    ) -> Outcome | None:
        """Return a feasible outcome for a rate and a ratio gamma / p, or None; the search begins with `families`."""
        target = Target(kappa, ratio, self.shape, self.upper if kappa else {}, self.lower, self.deviations)
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

    def ask(trial: float, best: Outcome | None) -> Outcome | None:
        return question.ask(trial, None, best.families if best else None, left)

    return largest_rate(ask, fastest, left, first=0.9, fall=0.3, near=1.05)


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
    question: Question,
    rate: float,
    start: Outcome,
    left: Callable[[], float],
    forms: Collection[Form] | None = None,
) -> Outcome | None:
    """Return an outcome of a rate (kappa, 1/s) whose ratio gamma / p is within 2 % of the smallest, its gain in 1 %.

    The search for any gain at this rate begins with the forms of `start`; without time that is what is returned.
    Others than these `forms` join only where much depends on them.
    """
    any_gain = start if kappa(start) == rate else question.ask(rate, None, start.families, left)
    if any_gain is None or not question.system.B.shape[1]:  # without inputs no gain
        return any_gain
    ratio, p = attained(question, any_gain)
    families = any_gain.assembly.unknowns.families
    target = Target(rate, 0.0, question.shape, question.upper, question.lower, question.deviations)
    whole = catalogue(question.system, families, question.full, target)
    inputs = slice(question.system.entries, whole.inside)
    N = np.zeros((whole.width, whole.width))
    N[inputs, inputs] = np.diag(whole.weights[inputs] ** 2 / whole.size("p"))
    numbers = replace(any_gain.assembly.unknowns.multipliers(any_gain.solution.y), p=0.5 * p)
    if not np.isfinite(ratio):
        return any_gain
    found = largest(whole, families, fixed=("p",), N=N, numbers=numbers, t=-4 * ratio, left=left, forms=forms)
    if found is None:
        return any_gain
    unknowns = found.outcome.assembly.unknowns
    rated = replace(unknowns, target=replace(unknowns.target, ratio=-found.t))
    return replace(found.outcome, assembly=replace(found.outcome.assembly, unknowns=rated))


def attained(question: Question, found: Outcome) -> tuple[float, float]:
    """Return the ratio gamma / p that the Lyapunov function of an outcome attains, and its p."""
    unknowns = found.assembly.unknowns
    lower = [question.lower[g.curve] for g in question.system.groups]
    lyapunov = lyapunov_function(unknowns, found.solution.y, unknowns.system, lower)
    if not lyapunov.is_sound:
        return np.inf, 0.0
    weight = np.ones(question.system.n) if question.shape is None else question.shape
    scaled = lyapunov.below / np.sqrt(weight) / np.sqrt(weight)[:, None]
    p = float(np.linalg.eigvalsh(scaled)[0])
    return lyapunov.gamma / p, p
