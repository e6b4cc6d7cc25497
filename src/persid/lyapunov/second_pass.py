"""A second pass over what a search has found: the forms that are not needed leave, so that a proof is short.

A search ends with all that has ever joined, in the middle of what is feasible, and hardly an unknown is zero there.
With a little room in what is asked, many forms are not needed. They are tried without those whose multipliers are the
smallest, half of all at first; where that fails without half as many, down to one.
"""

from collections.abc import Callable, Collection
from dataclasses import replace

import numpy as np

from persid.lyapunov.inequality import Catalogue
from persid.lyapunov.interior_point import Status, solve
from persid.lyapunov.search import Outcome, catalogue
from persid.lyapunov.sectors import Curve, Form
from persid.lyapunov.system import Family, Target

RATE = 1 - 1 / 256  # share of kappa that is asked for with fewer forms
RATIO = 1 + 1 / 128  # times gamma / p: less than half a percent of the gain


def loosened(target: Target, slowest: float = 0.0) -> Target:
    """Return what is asked for with fewer forms: a little more gain, else a little less of the rate than is possible.

    The rate stays at least `slowest`.
    """
    if target.ratio is not None:
        return replace(target, ratio=target.ratio * RATIO)
    return replace(target, kappa=min(target.kappa, max(target.kappa * RATE, slowest)))


def with_fewer_forms(
    outcome: Outcome, target: Target, left: Callable[[], float], known: Collection[Form] = ()
) -> Outcome:
    """Return a feasible outcome for a target with some of the forms of another; that one where none can go.

    Forms that are `known`, those of another proof, stay: they need no new one.
    """
    unknowns = outcome.assembly.unknowns
    whole = catalogue(unknowns.system, unknowns.families, unknowns.symmetric > 0, target)
    forms = _spared(outcome, known)
    count, failed = len(forms) if known else (len(forms) + 1) // 2, list[set[Form]]()
    while count and left() > 0:
        kept = {*forms[count:], *known}
        found = None if any(map(kept.issubset, failed)) else _solved(whole, outcome, kept, left)
        if found is None:
            count, failed = count // 2, [*failed, kept]
        else:
            outcome, forms = found, _spared(found, known)
            count = min(count, (len(forms) + 1) // 2)
    return outcome


def _spared(outcome: Outcome, known: Collection[Form]) -> list[Form]:
    return [form for form in in_use(outcome) if form not in known]


def in_use(outcome: Outcome) -> list[Form]:
    """Return the forms of an outcome, those of the smallest multipliers first: as unknowns these have no units."""
    unknowns, weight = outcome.assembly.unknowns, dict[tuple[int, int], float]()
    curves = [group.curve for group in unknowns.system.groups]
    first = [curves.index(curve) for curve in curves]
    for label, y in zip(unknowns.labels, np.abs(outcome.solution.y).tolist(), strict=True):
        if label[0] in ("mu", "tau"):
            for k in label[2:]:
                at = first[label[1]], k
                weight[at] = weight.get(at, 0.0) + y
    return [(curves[g], k) for g, k in sorted(weight, key=weight.__getitem__)]


def _solved(whole: Catalogue, outcome: Outcome, forms: Collection[Form], left: Callable[[], float]) -> Outcome | None:
    unknowns, kept = outcome.assembly.unknowns, dict[Curve, set[int]]()
    for curve, k in forms:
        kept.setdefault(curve, set()).add(k)
    groups = zip(unknowns.system.groups, unknowns.families, strict=True)
    assembly = whole.assembly([_without(family, kept.get(group.curve, set())) for group, family in groups])
    if not assembly.problem.cost.any():  # no V is left
        return None
    solution = solve(assembly.problem, time_limit=left())
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    found = Outcome(assembly, solution, outcome.rounds, outcome.steps + solution.steps)
    return found if solution.status is Status.FEASIBLE else None


def _without(family: Family, kept: Collection[int]) -> Family:
    """Return the densities and products of a family that read kept forms alone."""
    densities = tuple(k for k in family.densities if k in kept)
    products = tuple((k, j) for k, j in family.products if k in kept and j in kept)
    return Family(family.forms, densities, products)
