"""Search for the multipliers of a system: grow the families of forms until the sign of the margin is decided.

A group's pool holds dozens of forms and hundreds of products, of which a certificate uses a few. So the interior-point
method begins with a few of them, and its dual matrix X prices the others: a product l_k l_l may help if and only if
l_k'N X N'l_l < 0. The most promising join, and the method goes on from where it is. That is done in two ways.

Free rounds: price each time that mu has fallen tenfold. A certificate with some room is found in hardly more
iterations than one problem takes. But an unknown that joins with a negative price puts X outside the cone, and near an
optimum of about zero hundreds of short steps would follow.
Fenced steps: from the beginning, with what has joined so far, X never leaves the cone of the whole pool; what stands in
its way joins, at a positive price. So m bounds the margin of the whole pool at every step, and m < 0 proves that it has
no certificate.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov.arrays import Array
from persid.lyapunov.inequality import Assembly, Catalogue
from persid.lyapunov.interior_point import ITERATIONS, Solution, Status, solve
from persid.lyapunov.sectors import Curve, Group
from persid.lyapunov.system import Family, System, Target, is_broad

FIRST_FORMS = 4  # forms of a pool that the search begins with
MORE_FORMS = 10  # where that stalls: another start is another path, and few stall twice
JOINING = 4  # products, and half as many densities, that may join a group in one round
FEW_FORMS, FEW = 3, 1  # of a broad system each begins so, and FEW join: time grows with their cube
STRANGE = 1.6  # a price below -this, twice a cosine, at which forms join that no proof has used
HEAVY = 0.3  # of the mean share of X: of many groups those with less do not decide the margin, and nothing joins them
FALL = 0.1  # share to which mu falls in a free round,
FEW_FALL = 0.3  # and where few join: the nearer mu is to zero, the shorter are the steps after unknowns have joined
FREE_STEPS = 60  # of all free rounds
ROUNDS = 400
INSIDE = 0.9  # of the way to the fence that a step goes
FREE = Status.ROUGH, Status.INFEASIBLE, Status.STALLED  # that may change with more unknowns: without a fence,
FENCED = (Status.BLOCKED,)  # and with one


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a search ended: the last problem and its solution; in how many rounds, and all steps."""

    assembly: Assembly
    solution: Solution
    rounds: int
    steps: int

    @property
    def families(self) -> tuple[Family, ...]:
        """The forms that have joined, of each group."""
        return self.assembly.unknowns.families

    @property
    def status(self) -> Status:
        """Why the search stopped; a search that is still blocked after its last round has stalled."""
        return Status.STALLED if self.solution.status is Status.BLOCKED else self.solution.status


def search(
    system: System,
    pools: Mapping[Curve, Float[ndarray, "K d"]],
    *,
    full_P: bool = False,
    target: Target | None = None,
    families: Sequence[Family] | None = None,
    first: int | None = None,
    time_limit: float = np.inf,
    progress: Callable[[str], None] | None = None,
) -> Outcome:
    """Find multipliers with positive margin, or a dual matrix against every form and product of the pools.

    `families` is the choice to begin with, such as that of an earlier outcome for the same pools, of which those in V
    stay that the rate allows; without it the search begins with the `first` forms of every pool: by default four, or
    three of many groups where no rate is asked for.
    """
    started, target = time.perf_counter(), target or Target()
    if target.kappa and len(system.states) < system.n:
        raise ValueError("a rate keeps every state; this system has dropped one, and its forms with it")
    few = is_broad(system, target) and first is None and families is None
    begin, joining, share = (FEW_FORMS, FEW, FEW_FALL) if few else (FIRST_FORMS, JOINING, FALL)
    if families is None:
        families = tuple(_first(system, group, pools[group.curve], target, first or begin) for group in system.groups)
    families = tuple(_allowed(*each, target) for each in zip(system.groups, families, strict=True))
    whole = catalogue(system, families, full_P, target)
    assembly, start, fence, steps = whole.assembly(families), None, None, 0
    for count in range(1, ROUNDS + 1):
        left = time_limit - (time.perf_counter() - started)
        fall, allowed = (share, max(1, FREE_STEPS - steps)) if fence is None else (0.0, ITERATIONS)
        solution = solve(assembly.problem, start=start, fence=fence, fall=fall, iterations=allowed, time_limit=left)
        steps += solution.steps
        if progress is not None:
            size = len(assembly.problem.cost)
            progress(f"round {count}: {size} unknowns, {solution.steps} iterations, {solution.status.name}")
        if solution.status not in (FREE if fence is None else FENCED):
            break
        X, m = solution.here if fence is None else solution.aim
        prices = whole.prices(X)
        grown = tuple(map(join, assembly.unknowns.families, prices, repeat(m), repeat(joining)))
        if few and fence is None:
            grown = _where_it_counts(assembly.unknowns.families, grown, whole.shares(solution.last))
        settled = all(contains(old, new) for old, new in zip(assembly.unknowns.families, grown, strict=True))
        if settled and solution.status is Status.INFEASIBLE:
            break
        before, assembly = assembly, assembly if settled else whole.assembly(grown)
        if fence is None and solution.status is not Status.ROUGH:
            start, fence = None, PoolFence(whole)
        else:
            start = solution, assembly.unknowns.places_in(before.unknowns)
    return Outcome(assembly, solution, count, steps)


@dataclass(frozen=True, eq=False)
class PoolFence:
    """The cone of all products and densities of the pools."""

    whole: Catalogue

    def bound(self, X: Float[Array, "N N"]) -> float:
        """Return the least m for which no price at X is negative."""
        return max((-float(np.nanmin(worth, initial=0.0)) for _, worth in self.whole.prices(X)), default=0.0)

    def share(self, here: tuple[Float[Array, "N N"], float], there: tuple[Float[Array, "N N"], float]) -> float:
        """Return the share of a step between two (X, m) that stays well inside the cone."""
        share = 1.0
        for old, new in zip(self.whole.prices(here[0]), self.whole.prices(there[0]), strict=True):
            for at, to in ((old[0], new[0]), (old[1] + here[1], new[1] + there[1])):
                leaving = (to < 0) & (at > 0)
                share = min(share, INSIDE * float((at[leaving] / (at - to)[leaving]).min(initial=np.inf)))
        return share


def catalogue(system: System, families: Sequence[Family], full_P: bool, target: Target) -> Catalogue:
    """Return all that pools allow: every form with the constant c that a rate needs may stand in V."""
    allowed = [
        Family(family.forms, () if system.discrete else _rated(group, family.forms, target), ())
        for group, family in zip(system.groups, families, strict=True)
    ]
    return Catalogue(system, allowed, full_P=full_P, target=target)


def _allowed(group: Group, family: Family, target: Target) -> Family:
    rated = _rated(group, family.forms, target)
    return Family(family.forms, tuple(k for k in family.densities if k in rated), family.products)


def _rated(group: Group, forms: ndarray, target: Target) -> tuple[int, ...]:
    if not target.kappa:
        return tuple(range(len(forms)))
    return tuple(int(k) for k in np.flatnonzero(np.isfinite(target.upper[group.curve][: len(forms)])))


def _first(system: System, group: Group, pool: Float[ndarray, "K d"], target: Target, count: int) -> Family:
    """Return the first choice from a pool; where a state that the group reads is dropped, forms with y drop too."""
    touched = set(np.flatnonzero(group.row)) - set(system.states)
    usable = pool[pool[:, 0] == 0] if touched else pool
    usable = usable if group.channels else usable[:0]
    first = Family.full(usable[:count]).within(usable)
    densities = () if system.discrete else _rated(group, usable, target)[:count]
    return Family(usable, densities, first.products)


def _where_it_counts(
    families: Sequence[Family], grown: Sequence[Family], shares: Float[ndarray, " g"]
) -> tuple[Family, ...]:
    """Return families grown where X has its weight; grown everywhere if nothing joins there."""
    heavy = shares >= HEAVY * shares.mean()
    found = tuple(new if counts else old for old, new, counts in zip(families, grown, heavy, strict=True))
    return tuple(grown) if all(map(contains, families, found)) else found


def contains(old: Family, new: Family) -> bool:
    """Whether nothing has joined a family."""
    return set(new.products) <= set(old.products) and set(new.densities) <= set(old.densities)


def join(
    family: Family, prices: tuple[Float[ndarray, "K K"], Float[ndarray, " K"]], bound: float, most: int = JOINING,
    known: Collection[int] | None = None,
) -> Family:  # fmt: skip
    """Return a family with the products, at most `most`, and half as many densities that the dual matrix prices lowest.

    A price is divided by the lengths sqrt(l'N X N'l) of its rows: a correlation, which no choice of units can change.
    Where forms are `known`, others join only at a price far below zero.
    """
    price, worth = prices
    length = np.sqrt(0.5 * np.diag(price))
    price, worth = price / np.outer(length, length), (worth + bound) / length
    if known is not None:
        others = np.isin(np.arange(len(worth)), list(known), invert=True)
        price += STRANGE * (others | others[:, None])
        worth += STRANGE * others
    helps = np.triu(price < 0, 1)
    helps[tuple(np.array(family.products, int).reshape(-1, 2).T)] = False
    k, j = np.nonzero(helps)
    least = np.argsort(price[k, j])[:most]
    products = zip(k[least].tolist(), j[least].tolist(), strict=True)
    worth[list(family.densities)] = np.inf
    (k,) = np.nonzero(worth < 0)  # where there is no price there is no form of V
    densities = k[np.argsort(worth[k])[: (most + 1) // 2]].tolist()
    return Family(family.forms, (*family.densities, *densities), (*family.products, *products))
