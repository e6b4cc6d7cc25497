"""The best number that an inequality allows, the least gamma / p or the largest deviation, on one way through the cone.

Both numbers stand beside one unknown alone. With that unknown fixed, p = 1 or s = 1, they enter linearly,

    maximise t   subject to   Z = -sum_k y_k F_k - t N >= 0,   y = 1 for that unknown,

t = -gamma / p with N = I at the inputs, or t = delta^2 with N = C'C. A Lyapunov function that is at hand is a strictly
feasible start. Unknowns join as in `search`, where the dual matrix prices them below zero.
"""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import repeat

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov.inequality import Assembly, Catalogue
from persid.lyapunov.interior_point import Solution, Status, maximise
from persid.lyapunov.iterate import central_iterate, resumed
from persid.lyapunov.pairs import Problem, congruent
from persid.lyapunov.search import JOINING, Outcome, contains, join
from persid.lyapunov.sectors import Form
from persid.lyapunov.system import Family, Multipliers
from persid.lyapunov.unknowns import Label

CLOSE = 0.003  # distance of t from its bound, relative, at which the unknowns that take part have done what they can
SMALL, PATIENCE = 0.003, 3  # relative rise of t between two such places that is small; after so many it ends,
WIDE, WIDELY = 40, 2  # and of wider inequalities, whose rounds are dear and the last of which win .02 %, after so many
FALL = 0.3  # share to which mu falls before unknowns join
BACK = 0.1  # relative fall of t with which the way goes on when unknowns join there
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
    assembly = whole.assembly(families)
    place = assembly.unknowns.labels.index(fixed)
    y = assembly.unknowns.values(numbers)
    try:
        state = central_iterate(_towards(assembly, fixed, N), assembly.problem.arrays.put(y / y[place]), t)
    except sla.LinAlgError:
        return None
    curves = [group.curve for group in whole.system.groups]
    known = [None if forms is None else [k for of, k in forms if of == curve] for curve in curves]
    steps, rounds, idle, reached, best = 0, 0, 0, -np.inf, (assembly, state)
    patience = PATIENCE if whole.width <= WIDE else WIDELY
    while rounds < ROUNDS:
        state, taken = maximise(state, close=CLOSE, fall=FALL, left=left)
        steps, rounds = steps + taken, rounds + 1
        settled = not taken or state.gap < CLOSE * abs(state.t)
        best = (assembly, state) if state.t > best[1].t else best
        idle += settled and state.t - reached <= SMALL * abs(state.t)
        if left() <= 0 or idle == patience:
            break
        reached = max(reached, state.t) if settled else reached
        X = congruent(assembly.problem.arrays, assembly.problem.C, state.X)
        grown = tuple(map(join, assembly.unknowns.families, whole.prices(X), repeat(0.0), repeat(JOINING), known))
        if all(map(contains, assembly.unknowns.families, grown)):
            if settled:
                break
            continue
        larger = whole.assembly(grown)
        places = larger.unknowns.places_in(assembly.unknowns)
        try:
            state = resumed(_towards(larger, fixed, N), state, places)
            if settled:  # near the boundary steps are short: some way back, and central again
                state = central_iterate(state.problem, state.y, state.t - BACK * abs(state.t))
            assembly = larger
        except sla.LinAlgError:
            break
    assembly, state = best
    solution = Solution(Status.FEASIBLE, state, None, assembly.problem.C, 0.0, ("",) * (steps + 1))
    return Extreme(state.t, Outcome(assembly, solution, rounds, steps))


def _towards(assembly: Assembly, fixed: Label, N: ndarray) -> Problem:
    """Return the problem with one unknown fixed, whose t goes with N."""
    cost = np.array([float(label == fixed) for label in assembly.unknowns.labels])
    return replace(assembly.problem, cost=cost, N=N).whitened()
