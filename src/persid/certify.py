"""The verdict on a model: certified, refuted, or undecided with its reason, by the attempts that cost least first."""

import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Enum
from typing import NoReturn

import numpy as np
from numpy import ndarray

from persid.certificate import Certificate, RoundingError
from persid.interior_point import Status
from persid.lmi import system
from persid.model import PersidskiiModel
from persid.proof import Chosen, choose, write
from persid.search import search
from persid.sector import Curve, Group, groups, pool

FULL_P_STATES = 50  # a full P is tried up to this many states

Progress = Callable[[str], None]


class Reason(Enum):
    """Why a model stays undecided, as a full sentence."""

    INFEASIBLE = "The search showed that the Lyapunov functions of this family have no positive margin."
    ROUNDING = "A Lyapunov function was found in floating point, but its margin was lost in exact arithmetic."
    FORM = "A property of the functions that a proof needs could not be proved."
    STALLED = "The solver stalled before the sign of the margin was decided."
    TIME = "The time limit was reached before the sign of the margin was decided."
    INTERRUPTED = "The search was interrupted."
    OUTSIDE = "The model is outside the theory."


@dataclass(frozen=True)
class Attempt:
    """One attempt at a verdict: what was tried, how it ended, and the seconds it took."""

    what: str
    outcome: str
    seconds: float


class _Verdict:
    """What the three verdicts share; a verdict is no truth value, since a refuted model would count as true."""

    attempts: tuple[Attempt, ...]

    def __bool__(self) -> NoReturn:
        raise TypeError("a verdict is not true or false; ask verdict.is_certified, or match its class")

    @property
    def is_certified(self) -> bool:
        """Whether the model is certified."""
        return isinstance(self, Certified)

    @property
    def seconds(self) -> float:
        """Time spent on all attempts, in s."""
        return sum(attempt.seconds for attempt in self.attempts)


@dataclass(frozen=True, eq=False)
class Certified(_Verdict):
    """The model is input-to-state stable: `certificate` is a proof that `persid_check` has accepted."""

    certificate: Certificate
    attempts: tuple[Attempt, ...] = ()

    def __str__(self) -> str:
        return f"Certified: {self.certificate.statement}"


@dataclass(frozen=True, eq=False)
class Undecided(_Verdict):
    """Neither a proof nor a witness was found; `reason` is a full sentence, `detail` what it was about and what to try."""

    reason: Reason
    detail: str = ""
    attempts: tuple[Attempt, ...] = ()

    def __str__(self) -> str:
        return f"Undecided: {self.reason.value} {self.detail}".rstrip()


Verdict = Certified | Undecided


@dataclass
class _Log:
    """Collects attempts with their times, and reports them as they happen."""

    deadline: float
    progress: Progress
    attempts: list[Attempt] = field(default_factory=list)

    @property
    def left(self) -> float:
        return self.deadline - time.perf_counter()

    @contextmanager
    def attempt(self, what: str) -> Iterator[list[str]]:
        """Time an attempt; its outcome is what the caller appends to the list."""
        outcome: list[str] = []
        started = time.perf_counter()
        self.progress(what)
        try:
            yield outcome
        finally:
            self.attempts.append(Attempt(what, *(outcome or ["interrupted"]), time.perf_counter() - started))


def certify(model: PersidskiiModel, *, time_limit: float = 60.0, progress: Progress | None = None) -> Verdict:
    """Decide whether a model is input-to-state stable about (x_ref, u_ref), the constant b counted as one more input.

    Args:
        model: the model; the verdict is about it, not about the plant.
        time_limit: seconds after which the search stops with what it has.
        progress: is called with a line of text at each step.

    Returns:
        Certified with a certificate that `persid_check` has accepted, or Undecided with its reason.
    """
    log = _Log(time.perf_counter() + time_limit, progress or (lambda line: None))
    try:
        return _by_lyapunov(model, log)
    except KeyboardInterrupt:
        return Undecided(Reason.INTERRUPTED, "Run it again with more time.", tuple(log.attempts))


def _by_lyapunov(model: PersidskiiModel, log: _Log) -> Verdict:
    """Try a diagonal P, then a full P where the size allows it."""
    pools = {group.curve: np.array(pool(group.curve)).reshape(-1, group.curve.size) for group in groups(model.channels)}
    kinds = ("diagonal", "full") if 1 < model.n <= FULL_P_STATES else ("diagonal",)
    for kind in kinds:
        with log.attempt(f"global Lyapunov function with {kind} P") as outcome:
            answer = _in_family(model, pools, kind == "full", log)
            outcome.append("certified" if isinstance(answer, Certificate) else answer[0].name.lower())
        if isinstance(answer, Certificate):
            return Certified(answer, tuple(log.attempts))
    return Undecided(*answer, tuple(log.attempts))


def _in_family(
    model: PersidskiiModel, pools: dict[Curve, ndarray], full_P: bool, log: _Log
) -> Certificate | tuple[Reason, str]:
    """Search, prove the forms that the solution uses, write and check; forms that cannot be proved leave the pool."""
    while True:
        found = search(system(model, pools), pools, full_P=full_P, time_limit=log.left, progress=log.progress)
        if found.status is not Status.FEASIBLE:
            return _REASONS[found.status]
        try:
            P, chosen = choose(found.assembly, found.solution.y)
            log.progress("proving the sector forms")
            doubtful = _unproved(found.assembly.system.groups, chosen)
            if not doubtful:
                log.progress("checking in exact arithmetic")
                return Certificate.accept(write(model, found.assembly.system, P, chosen))
        except RoundingError as error:
            return Reason.ROUNDING, str(error)
        for curve, form in doubtful:
            pools[curve] = pools[curve][(pools[curve] != form).any(axis=1)]
            log.progress(f"not proved and dropped: {_form_text(curve, form)}")


def _unproved(found: Sequence[Group], chosen: Sequence[Chosen]) -> list[tuple[Curve, ndarray]]:
    """Return the forms in use that the checker's prover does not establish."""
    used = {(group.curve, tuple(form)) for group, part in zip(found, chosen, strict=True) for form in part.forms}
    return [(curve, np.array(form)) for curve, form in sorted(used, key=repr) if not curve.proves(form)]


def _form_text(curve: Curve, form: ndarray) -> str:
    names = ("x", *curve.functions)
    return " ".join(f"{c:+.4g} {name}" for c, name in zip(form, names, strict=True) if c)


_REASONS = {
    Status.INFEASIBLE: (Reason.INFEASIBLE, "Fit with more ridge or fewer functions, or ask for a regional claim."),
    Status.STALLED: (Reason.STALLED, "The margin is close to zero: a little more ridge usually decides it."),
    Status.TIME: (Reason.TIME, "Give more time (time_limit)."),
    Status.INTERRUPTED: (Reason.INTERRUPTED, "Run it again with more time."),
}
