"""The log of a decision: attempts with their times, as they happen, and what an interruption leaves."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from math import isfinite

from persid.certificates.certificate import Certificate
from persid.lyapunov.multipliers import Lyapunov, Used
from persid.verdicts.failures import Failure
from persid.verdicts.verdict import Attempt

Progress = Callable[[str], None]
ALL_STATES = 0.25  # of the time for a region goes to the question whether it is all of R^n


@dataclass
class Log:
    """Collects attempts with their times, and reports them as they happen."""

    limit: float  # in s
    progress: Progress
    attempts: list[Attempt] = field(default_factory=list)
    best: Callable[[], Certificate | Failure] | None = None  # proves what an interruption leaves
    fastest: Callable[[], Lyapunov] | None = None  # returns that of the best rate that was found
    used: set[Used] = field(default_factory=set)  # the forms and products of the proofs so far
    began: float = field(default_factory=lambda: time.perf_counter())

    def left(self) -> float:
        """Seconds until the time limit."""
        return self.began + self.limit - time.perf_counter()

    @contextmanager
    def share(self, part: float) -> Iterator[None]:
        """Leave a part of the time that is left to what is asked first."""
        whole = self.limit
        self.limit -= (1 - part) * self.left() if isfinite(whole) else 0.0
        try:
            yield
        finally:
            self.limit = whole

    @contextmanager
    def attempt(self, what: str) -> Iterator[list[str]]:
        """Time an attempt; its outcome is what the caller appends to the list."""
        outcome: list[str] = []
        started = time.perf_counter()
        try:
            self.progress(what)
            yield outcome
        finally:
            self.attempts.append(Attempt(what, outcome[0] if outcome else "interrupted", time.perf_counter() - started))
