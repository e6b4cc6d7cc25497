"""The best number that an inequality allows, the least gamma / p or the largest deviation, on one way through the cone.

Both numbers stand beside one unknown alone. With that unknown fixed, p = 1 or s = 1, they enter linearly,

    maximise t   subject to   Z = -sum_k y_k F_k - t N >= 0,   y = 1 for that unknown,

t = -gamma / p with N = I at the inputs, or t = delta^2 with N = C'C. A Lyapunov function that is at hand is a strictly
feasible start. Unknowns join as in `search`, where the dual matrix prices them below zero. Near the boundary steps are
short: what joins there joins at a place of the way that was still central, and the method goes on from that.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import repeat

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov.arrays import Array
from persid.lyapunov.inequality import Assembly, Catalogue
from persid.lyapunov.interior_point import Solution, Status, maximise
from persid.lyapunov.iterate import Iterate, central_iterate, resumed
from persid.lyapunov.pairs import Problem, congruent
from persid.lyapunov.search import JOINING, Outcome, contains, join
from persid.lyapunov.sectors import Form
from persid.lyapunov.system import Family, Multipliers
from persid.lyapunov.unknowns import Label

CLOSE = 0.003  # distance of t from its bound, relative, at which the unknowns that take part have done what they can
SMALL, PATIENCE = 0.003, 2  # relative rise of t between two such places that is small; after so many it ends
FALL = 0.3  # share to which mu falls before unknowns join
CENTRAL = 0.1  # distance of t from its bound, relative, beyond which a place is central
ROUNDS = 40


@dataclass(frozen=True, eq=False)
class Extreme:
    """The largest t that was found, and the outcome that attains it."""

    t: float
    outcome: Outcome


def largest(
    whole: Catalogue,
    families: Sequence[Family],
    *,
    fixed: Label,
    N: Float[ndarray, "N N"],
    numbers: Multipliers,
    t: float,
    left: Callable[[], float],
    forms: Collection[Form] | None = None,
) -> Extreme | None:
    """Return the largest t, from multipliers at which the inequality holds strictly with t; None where it does not.

    `fixed` is the unknown that is fixed, `families` are those of the multipliers. Others than these `forms` join only
    where much depends on them.
    """
    inequality = _Inequality(whole, fixed, N, forms)
    try:
        way = _Way(inequality.start(families, numbers, t))
    except sla.LinAlgError:
        return None
    steps = rounds = 0
    goes_on = True
    while goes_on and rounds < ROUNDS:
        way.here, taken = way.here.risen(left)
        steps, rounds = steps + taken, rounds + 1
        ends = way.ends(settled=not taken or way.here.is_close)
        goes_on = not ends and left() > 0 and _widened(way, inequality)
    assembly, state = way.best.assembly, way.best.state
    solution = Solution(Status.FEASIBLE, state, None, assembly.problem.C, 0.0, ("",) * (steps + 1))
    return Extreme(state.t, Outcome(assembly, solution, rounds, steps))


@dataclass(frozen=True, eq=False)
class _Place:
    """An iterate of the problem of an assembly, with one unknown fixed."""

    assembly: Assembly
    state: Iterate

    @property
    def families(self) -> tuple[Family, ...]:
        return self.assembly.unknowns.families

    @property
    def X(self) -> Array:
        """The dual matrix in the coordinates of the assembly."""
        return congruent(self.state.problem.arrays, self.assembly.problem.C, self.state.X)

    @property
    def is_close(self) -> bool:
        return self.state.gap < CLOSE * abs(self.state.t)

    @property
    def is_central(self) -> bool:
        return self.state.gap > CENTRAL * abs(self.state.t)

    def risen(self, left: Callable[[], float]) -> tuple["_Place", int]:
        """Return where t has risen with these unknowns, and after how many steps."""
        state, taken = maximise(self.state, close=CLOSE, fall=FALL, left=left)
        return replace(self, state=state), taken


@dataclass(eq=False)
class _Way:
    """Where the way has come; its best place, its last central one, and what t had reached where it settled."""

    here: _Place
    best: _Place = field(init=False)
    central: _Place = field(init=False)
    settled: bool = False
    reached: float = -np.inf
    idle: int = 0

    def __post_init__(self) -> None:
        self.best = self.central = self.here

    def ends(self, *, settled: bool) -> bool:
        """Take note of this place, settled where its unknowns have done what they can; whether more win little."""
        here, t = self.here, self.here.state.t
        self.best = here if t > self.best.state.t else self.best
        self.central = here if here.is_central else self.central
        self.settled = settled
        if settled:
            self.idle += t - self.reached <= SMALL * abs(t)
            self.reached = max(self.reached, t)
        return self.idle == PATIENCE


def _widened(way: _Way, inequality: "_Inequality") -> bool:
    """Let unknowns join, from the last central place where this one is settled; whether there is a way on."""
    families = inequality.grown(way.here)
    if all(map(contains, way.here.families, families)):
        return not way.settled
    try:
        way.here = inequality.resumed(way.central if way.settled else way.here, families)
    except sla.LinAlgError:
        return False
    return True


@dataclass(frozen=True, eq=False)
class _Inequality:
    """All that may take part, the unknown that is fixed, what t goes with, and forms that join easily (None: all)."""

    whole: Catalogue
    fixed: Label
    N: Float[ndarray, "N N"]
    forms: Collection[Form] | None

    def start(self, families: Sequence[Family], numbers: Multipliers, t: float) -> _Place:
        """Return a central place at these multipliers and t; LinAlgError where they are not strictly feasible."""
        assembly = self.whole.assembly(families)
        y = assembly.unknowns.values(numbers)
        y = y / y[assembly.unknowns.labels.index(self.fixed)]
        return _Place(assembly, central_iterate(self._problem(assembly), assembly.problem.arrays.put(y), t))

    def grown(self, place: _Place) -> tuple[Family, ...]:
        """Return the families with what the dual matrix prices lowest."""
        return tuple(map(join, place.families, self.whole.prices(place.X), repeat(0.0), repeat(JOINING), self._known))

    def resumed(self, place: _Place, families: Sequence[Family]) -> _Place:
        """Return a place with more unknowns."""
        assembly = self.whole.assembly(families)
        places = assembly.unknowns.places_in(place.assembly.unknowns)
        return _Place(assembly, resumed(self._problem(assembly), place.state, places))

    @cached_property
    def _known(self) -> list[list[int] | None]:
        """The places of the forms that join easily in the pool of each group."""
        curves = [group.curve for group in self.whole.system.groups]
        return [None if self.forms is None else [k for of, k in self.forms if of == curve] for curve in curves]

    def _problem(self, assembly: Assembly) -> Problem:
        cost = np.array([float(label == self.fixed) for label in assembly.unknowns.labels])
        return replace(assembly.problem, cost=cost, N=self.N).whitened()
