"""Search for the multipliers of a system: grow the families of forms until the sign of the margin is decided.

A group's pool holds dozens of forms and hundreds of products, of which a certificate uses a few. So the interior-point
method begins with a few of them. Each time that mu has fallen tenfold its dual matrix X prices the others (a product
l_k l_l may help if and only if l_k'N X N'l_l < 0), the most promising join, and the method goes on from where it is:
the whole search takes hardly more iterations than one problem. When none is left to join and m < 0, X proves that the
whole pool has no certificate.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.interior_point import Solution, Status, solve
from persid.lmi import Assembly, Catalogue
from persid.sector import Curve, Group
from persid.system import Family, System, Target

FIRST_FORMS = 4  # forms of a pool that the search begins with
JOINING = 4  # products, and half as many densities, that may join a group in one round
FALL = 0.1  # share to which mu falls in a round
ROUNDS = 48
RESTARTS = 2  # of runs that stalled after unknowns had joined them


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a search ended: the last problem and its solution; in how many rounds, and all steps."""

    assembly: Assembly
    solution: Solution
    rounds: int
    steps: int

    @property
    def status(self) -> Status:
        """Why the search stopped."""
        return self.solution.status


def search(
    system: System,
    pools: Mapping[Curve, Float[ndarray, "K d"]],
    *,
    full_P: bool = False,
    target: Target | None = None,
    families: tuple[Family, ...] | None = None,
    time_limit: float = np.inf,
    progress: Callable[[str], None] | None = None,
) -> Outcome:
    """Find multipliers with positive margin, or a dual matrix against every form and product of the pools.

    `families` is the choice to begin with, such as that of an earlier outcome for the same pools.
    """
    started, target = time.perf_counter(), target or Target()
    if target.kappa and len(system.states) < system.n:
        raise ValueError("claims E and R keep every state; this system has dropped one, and its forms with it")
    if families is None:
        families = tuple(_first(system, group, pools[group.curve], target) for group in system.groups)
    whole = catalogue(system, families, full_P, target)
    assembly, start, straight, restarts, steps = whole.assembly(families), None, True, 0, 0
    for count in range(1, ROUNDS + 1):
        left = time_limit - (time.perf_counter() - started)
        solution = solve(assembly.problem, start=start, time_limit=left, fall=FALL if count < ROUNDS else 0.0)
        steps += solution.steps
        if progress is not None:
            size = len(assembly.problem.cost)
            progress(f"round {count}: {size} unknowns, {solution.steps} iterations, {solution.status.name}")
        if solution.status not in (Status.INFEASIBLE, Status.ROUGH, Status.STALLED):
            break
        grown = tuple(map(join, assembly.families, whole.prices(solution.X), repeat(solution.last.m)))
        settled = all(_contains(old, new) for old, new in zip(assembly.families, grown, strict=True))
        stalled = solution.status is Status.STALLED
        decided = settled and (solution.status is Status.INFEASIBLE or (stalled and straight))
        if decided or (stalled and restarts == RESTARTS) or count == ROUNDS:
            break
        before, assembly = assembly, assembly if settled else whole.assembly(grown)
        # a run that unknowns joined on its way and that stalled is made again from the beginning
        start = None if stalled else (solution, assembly.places_in(before))
        straight, restarts = stalled or (straight and settled), restarts + stalled
    return Outcome(assembly, solution, count, steps)


def catalogue(system: System, families: Sequence[Family], full_P: bool, target: Target) -> Catalogue:
    """Return all that pools allow: every form with the constant c that a rate needs may stand in V."""
    allowed = [
        Family(family.forms, _rated(group, family.forms, target), ())
        for group, family in zip(system.groups, families, strict=True)
    ]
    return Catalogue(system, allowed, full_P=full_P, target=target)


def _rated(group: Group, forms: ndarray, target: Target) -> tuple[int, ...]:
    if not target.kappa:
        return tuple(range(len(forms)))
    return tuple(int(k) for k in np.flatnonzero(np.isfinite(target.upper[group.curve][: len(forms)])))


def _first(system: System, group: Group, pool: Float[ndarray, "K d"], target: Target) -> Family:
    """Return the first choice from a pool; where a state that the group reads is dropped, forms with y drop too."""
    touched = set(np.flatnonzero(group.row)) - set(system.states)
    usable = pool[pool[:, 0] == 0] if touched else pool
    usable = usable if group.channels else usable[:0]
    first = Family.full(usable[:FIRST_FORMS]).within(usable)
    return Family(usable, _rated(group, usable, target)[:FIRST_FORMS], first.products)


def _contains(old: Family, new: Family) -> bool:
    """Whether nothing has joined a family."""
    return set(new.products) <= set(old.products) and set(new.densities) <= set(old.densities)


def join(family: Family, prices: tuple[Float[ndarray, "K K"], Float[ndarray, " K"]], bound: float) -> Family:
    """Return a family with the products and densities of its pool that the dual matrix prices lowest.

    A price is divided by the lengths sqrt(l'N X N'l) of its rows: a correlation, which no choice of units can change.
    """
    price, worth = prices
    length = np.sqrt(0.5 * np.diag(price))
    price, worth = price / np.outer(length, length), np.nan_to_num((worth + bound) / length, nan=np.inf)
    price[np.tril_indices(len(price))] = np.inf
    price[tuple(np.array(family.products, int).reshape(-1, 2).T)] = np.inf
    worth[list(family.densities)] = np.inf
    k, j = np.unravel_index(np.argsort(price, axis=None)[:JOINING], price.shape)
    products = [(int(a), int(b)) for a, b in zip(k, j, strict=True) if price[a, b] < 0]
    densities = [int(k) for k in np.argsort(worth)[: JOINING // 2] if worth[k] < 0]
    return Family(family.forms, (*family.densities, *densities), (*family.products, *products))
