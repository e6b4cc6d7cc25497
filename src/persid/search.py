"""Search for the multipliers of a system: grow the families of forms until the sign of the margin is decided.

A group's pool holds dozens of forms and hundreds of products, of which a certificate uses a few. So the problem is
solved with a few of them; while it is infeasible, its dual matrix X prices the others (a product l_k l_l may help if
and only if l_k'N X N'l_l < 0), the most promising join, and it is solved again. When none is left to join, X proves
that the whole pool has no certificate.
"""

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.interior_point import Solution, Status, solve
from persid.lmi import Assembly, assemble
from persid.sector import Curve, Group
from persid.system import Family, System, Target

FIRST_FORMS = 6  # forms of a pool that the search begins with
JOINING = 6  # products, and half as many densities, that may join a group in one round
KEPT = 8  # products, and half as many densities, of the first choice that stay after the first round
ROUNDS = 16
GAP = 1e-3  # share of the first gap at which the first round stops, tightened tenfold from round to round


@dataclass(frozen=True, eq=False)
class Outcome:
    """How a search ended: the last problem and its solution, and how often it was solved."""

    assembly: Assembly
    solution: Solution
    rounds: int

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
    if families is None:
        families = tuple(_first(system, group, pools[group.curve], target) for group in system.groups)
    gap = GAP
    for count in range(1, ROUNDS + 1):
        assembly = assemble(system, families, full_P=full_P, target=target)
        left = time_limit - (time.perf_counter() - started)
        solution = solve(assembly.problem, time_limit=left, gap=gap if count < ROUNDS else 0.0)
        if progress is not None:
            size, steps = len(assembly.problem.cost), len(solution.log)
            progress(f"round {count}: {size} unknowns, {steps} iterations, {solution.status.name}")
        if solution.status not in (Status.INFEASIBLE, Status.ROUGH, Status.STALLED):
            break
        grown = tuple(join(assembly, g, solution, drop=count == 1) for g in range(len(families)))
        settled = all(_contains(old, new) for old, new in zip(families, grown, strict=True))
        if settled and solution.status is not Status.ROUGH:
            break
        families, gap = (families, 0.0) if settled else (grown, 0.1 * gap)
    return Outcome(assembly, solution, count)


def _first(system: System, group: Group, pool: Float[ndarray, "K d"], target: Target) -> Family:
    """Return the first choice from a pool; where a state that the group reads is dropped, forms with y drop too."""
    touched = set(np.flatnonzero(group.row)) - set(system.states)
    usable = pool[pool[:, 0] == 0] if touched else pool
    usable = usable if group.channels else usable[:0]
    first = Family.full(usable[:FIRST_FORMS]).within(usable)
    if not target.kappa:
        return first
    rated = np.flatnonzero(np.isfinite(target.upper[group.curve][: len(usable)]))
    return Family(usable, tuple(int(k) for k in rated[:FIRST_FORMS]), first.products)


def _contains(old: Family, new: Family) -> bool:
    """Whether nothing has joined a family."""
    return set(new.products) <= set(old.products) and set(new.densities) <= set(old.densities)


def join(assembly: Assembly, g: int, solution: Solution, *, drop: bool = False) -> Family:
    """Return group g's family with the products and densities of its pool that the dual matrix prices lowest.

    A price is divided by the lengths sqrt(l'N X N'l) of its rows: a correlation, which no choice of units can change.
    With `drop` only the best priced of the old ones stay.
    """
    family = assembly.families[g]
    price, worth = assembly.prices(g, solution.X)
    length = np.sqrt(0.5 * np.diag(price))
    price, worth = price / np.outer(length, length), np.nan_to_num((worth + solution.upper) / length, nan=np.inf)
    old = sorted(family.products, key=lambda pair: price[pair])[: KEPT if drop else None]
    densities = sorted(family.densities, key=lambda k: worth[k])[: KEPT // 2 if drop else None]
    price[np.tril_indices(len(price))] = np.inf
    price[tuple(np.array(family.products, int).reshape(-1, 2).T)] = np.inf
    worth[list(family.densities)] = np.inf
    k, j = np.unravel_index(np.argsort(price, axis=None)[:JOINING], price.shape)
    old += [(int(a), int(b)) for a, b in zip(k, j, strict=True) if price[a, b] < 0]
    densities += [int(k) for k in np.argsort(worth)[: JOINING // 2] if worth[k] < 0]
    return Family(family.forms, tuple(densities), tuple(old))
