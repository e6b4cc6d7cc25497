r"""A structured primal-dual interior-point method for sector-form matrix inequalities.

    maximise t   subject to   Z = -sum_k y_k F_k - t N >= 0,   P(y) >= 0,   y_k >= 0 (multipliers),   c'y = 1      (D)
    minimise m   subject to   x_k = <F_k, X> - <E_k, U> + m c_k >= 0 (= 0 for entries of P),  X, U >= 0,  <N, X> = 1 (P)

Where the sign of t is asked, N is the inverse of a matrix X0 > 0 with <F_k, X0> > 0 wherever c_k = 0, such as the mean
of z z' over points of the sector cone. Where X0 is the identity the cone is round, and the start X = I / order is
nearly central.

Every unknown enters through *pairs* of rows of one matrix D:  F_k = sum over its pairs of  d_p d_q' + d_q d_p'.  So
with Y = D X D' and V = D Z^-1 D' the Schur complement of the HKM direction is made of elementwise products of blocks,

    tr(F_k X F_l Z^-1) = Y[q,r] V[p,s] + Y[q,s] V[p,r] + Y[p,r] V[q,s] + Y[p,s] V[q,r]      for k = (p, q), l = (r, s),

and no F_k is ever formed (`pairs`). Strictly feasible starts exist on both sides, hence no phase 1: at every iterate t
is a lower and m an upper bound of the optimal margin, and the sign of the margin is known as soon as t > 0 or m < 0.

When unknowns join, the method goes on where it is: y stays strictly feasible with a little of each new unknown. Where
the price of a new one is negative, the equality of its x_k is met in the steps that follow; until then m is no bound.
A `Fence` keeps the prices of unknowns outside the problem from becoming negative, so that m bounds those, too.
References: Helmberg, Rendl, Vanderbei & Wolkowicz (1996), SIAM J. Optim. 6(2); Mehrotra (1992), SIAM J. Optim. 2(4).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse

from persid.lyapunov.arrays import Array
from persid.lyapunov.iterate import Iterate, Step, first_iterate, resumed, step
from persid.lyapunov.pairs import Problem, congruent

ITERATIONS = 80
NOISE = 1e-12  # of the first distance of the bounds: a margin below it is not told from zero


class Status(Enum):
    """Why the method stopped, as a full sentence."""

    FEASIBLE = "A strictly feasible point was found."
    INFEASIBLE = "A dual matrix shows that no feasible point exists in this family."
    STALLED = "The bounds met, or steps became too short, before the sign of the margin was decided."
    BLOCKED = "A fence shortened the last step: unknowns outside the problem have to join it."
    ROUGH = "The bounds came as near to each other as was asked, and the sign of the margin is still open."
    TIME = "The time limit was reached."
    INTERRUPTED = "The run was interrupted; the best point so far is kept."


@runtime_checkable
class Fence(Protocol):
    """Unknowns outside a problem whose prices are to stay positive; X is in the coordinates of the problem given."""

    def bound(self, X: Float[Array, "N N"]) -> float:
        """Return the least m for which no price at X is negative."""
        ...

    def share(self, here: tuple[Float[Array, "N N"], float], there: tuple[Float[Array, "N N"], float]) -> float:
        """Return the share of a step between two (X, m) that may be taken; 1 where nothing blocks it."""
        ...


@dataclass(frozen=True, eq=False)
class Solution:
    """Why the method stopped, the last iterate in coordinates z = C w, and a `log` of one line per iterate.

    `step` is the one that led to the last iterate, None where there was none.
    """

    status: Status
    last: Iterate
    step: Step | None
    C: sparse.csr_array
    first: float  # the distance of the bounds at the start
    log: tuple[str, ...]

    @property
    def y(self) -> Float[ndarray, " J"]:
        """The unknowns."""
        return self.last.problem.arrays.get(self.last.y)

    @property
    def lower(self) -> float:
        """A lower bound of the optimal margin, t."""
        return self.last.t

    @property
    def upper(self) -> float:
        """An upper bound of the optimal margin: m, and infinity before the dual iterate is feasible."""
        return self.last.m if self.last.is_dual_feasible else np.inf

    @property
    def steps(self) -> int:
        """The number of steps taken."""
        return len(self.log) - 1

    @cached_property
    def X(self) -> Float[ndarray, "N N"]:
        """The dual matrix, in the coordinates of the problem given."""
        return self.last.problem.arrays.get(self.here[0])

    @property
    def here(self) -> tuple[Float[Array, "N N"], float]:
        """The dual matrix, in these coordinates and where the arrays live, and m."""
        return congruent(self.last.problem.arrays, self.C, self.last.X), self.last.m

    @property
    def aim(self) -> tuple[Float[Array, "N N"], float]:
        """The same where the last step would have gone without a fence."""
        X, m = (self.last.X, self.last.m) if self.step is None else self.step.end
        return congruent(self.last.problem.arrays, self.C, X), m


def solve(
    problem: Problem,
    *,
    start: tuple[Solution, Int[ndarray, " J"]] | None = None,
    fence: Fence | None = None,
    time_limit: float = np.inf,
    quality: float = 0.05,
    gap: float = 1e-13,
    fall: float = 0.0,
    iterations: int = ITERATIONS,
) -> Solution:
    """Decide the sign of the optimal margin, with a bound that is some way from zero: t > quality m, or m < quality t.

    `start` is the solution of a problem with fewer unknowns, and the place there of every unknown here (-1: it is new).
    The run is ROUGH when the bounds are within `gap` of their first distance, or mu has fallen to `fall` of its start;
    it is BLOCKED after a step that `fence` shortened.
    """
    if start is None:
        least = 0.0 if fence is None else fence.bound(problem.arrays.put(problem.X / problem.order))
        state = first_iterate(problem.whitened(), least)
        first = state.m - state.t
    else:
        first, state = start[0].first, resumed(problem.whitened(), start[0].last, start[1])
    log, status, taken = [], Status.STALLED, None
    started, goal = time.perf_counter(), fall * state.mu
    try:
        for count in range(iterations):
            log.append(f"{count:3d}  t = {state.t: .3e}  m = {state.m: .3e}  mu = {state.mu:.1e}")
            late = time.perf_counter() - started > time_limit
            ended = _decided(state, first, quality) or _near(state, first, gap, goal) or _cut_short(taken, late)
            following = None if ended else step(state, None if fence is None else _limit(fence, state, problem.C))
            if following is None:
                status = ended or Status.STALLED
                break
            taken, state = following, following.state
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    state.problem.release()  # what follows may be a larger problem, and this solution is kept meanwhile
    if state.t > 0 and status not in (Status.BLOCKED, Status.FEASIBLE) and state.is_interior:
        status = Status.FEASIBLE
    return Solution(status, state, taken, problem.C, first, tuple(log))


def _decided(state: Iterate, first: float, quality: float) -> Status | None:
    """Whether the sign of the margin is known, by a bound that is some way from zero."""
    if state.m < min(quality * state.t, -NOISE * first) and state.is_dual_feasible:
        return Status.INFEASIBLE
    if state.t > max(quality * state.m, 0.0):
        return Status.FEASIBLE if state.is_interior else Status.STALLED
    return None


def _near(state: Iterate, first: float, gap: float, goal: float) -> Status | None:
    """Whether the bounds are as near to each other as was asked, or as arithmetic allows."""
    if state.gap < NOISE * first:
        return Status.STALLED
    return Status.ROUGH if state.gap < gap * first or state.mu < goal else None


def _cut_short(taken: Step | None, late: bool) -> Status | None:
    if late:
        return Status.TIME
    return Status.BLOCKED if taken is not None and taken.share < 1 else None


def maximise(
    state: Iterate, *, close: float, fall: float, left: Callable[[], float], iterations: int = ITERATIONS
) -> tuple[Iterate, int]:
    """Raise t from a feasible iterate; return where that ends, and after how many steps.

    It ends where t is within the share `close` of its bound, mu or that distance has fallen to the share `fall` of its
    start, the steps become too short, or without time.
    """
    goal, near, steps = fall * state.mu, max(close, fall * state.gap / abs(state.t)), 0
    while steps < iterations and state.gap >= near * abs(state.t) and state.mu >= goal and left() > 0:
        following = step(state)
        if following is None:
            break
        state, steps = following.state, steps + 1
    return state, steps


def _limit(fence: Fence, state: Iterate, C: sparse.csr_array) -> Callable[[Array, float], float]:
    """Return the fence as a step sees it, in the coordinates of the iterates."""
    of = state.problem.arrays
    here = congruent(of, C, state.X), state.m
    return lambda X, m: fence.share(here, (congruent(of, C, X), m))
