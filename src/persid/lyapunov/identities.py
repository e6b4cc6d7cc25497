"""Identities of a model: forms of states and values of polynomials that are zero for every x, in fractions.

With s_c polynomials of x, sum 2 sigma_ij zeta_i zeta_j = 0 is one linear equation in sigma for each monomial of x.
Pairs (i, j) that share a monomial belong together; of each such family the null space has a basis, made integers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from itertools import combinations_with_replacement
from math import gcd, lcm
from typing import Literal

from flint import fmpq, fmpq_mat

from persid.lyapunov.frame import Frame
from persid.lyapunov.operating_points import OperatingPoint
from persid_check.ledger.identities import Monomial, Polynomial, Terms, add_product, polynomial, without_zeros
from persid_check.results import NotProvedError

PAIRS = 4000  # of entries at most
MOST = 1300  # identities: twelve modes, each product of two in every equation, have 1,220
Place = tuple[int, int]
Pairs = Literal["states", "degree", "all"]
Identity = tuple[tuple[int, int, Fraction], ...]  # (i, j, sigma), i >= j


def with_identities(frame: Frame, point: OperatingPoint | None, pairs: Pairs) -> Frame:
    """Return the frame with a basis of its identities, of `pairs` of entries.

    "states": of a state with a state or a function; "degree": of two functions, too, if their degree is no larger than
    that of these; "all". What has a larger degree helps where functions have sector forms, on strips.
    It has none where the point is known in a ball alone, or where the functions are no polynomials.
    """
    if frame.model.algebraic or frame.model.is_discrete or (point is not None and point.radius):
        return frame
    values = _values(frame, None if point is None else [Fraction(float(v)) for v in point.x])
    highest = max((_degree(value) for value in values.values()), default=0)
    limit = {"states": 0, "degree": 1 + highest, "all": 2 * highest}[pairs]
    places = [
        (max(i, j), min(i, j)) for i, j in combinations_with_replacement(values, 2)
        if min(i, j) < frame.n or _degree(values[i]) + _degree(values[j]) <= limit
    ]  # fmt: skip
    if not highest > 1 or len(places) > PAIRS:
        return frame
    found = [each for family in _families(places, values) for each in _null_space(family)]
    return replace(frame, identities=tuple(found)) if len(found) <= MOST else frame


def _values(frame: Frame, point: Sequence[Fraction] | None) -> dict[int, Polynomial]:
    """Return the entries of (x, s) that are polynomials."""
    found: dict[int, Polynomial] = {i: {(i,): fmpq(1)} for i in range(frame.n)}
    for c, at in frame.places.items():
        try:
            found[at] = polynomial(frame.model, frame.model.channels[c], point)
        except NotProvedError:
            continue
    return found


def _degree(value: Polynomial) -> int:
    return max(map(len, value), default=0)


def _families(pairs: Sequence[Place], values: Mapping[int, Polynomial]) -> list[dict[Place, Polynomial]]:
    """Return the products of pairs, those together that share a monomial, directly or by others."""
    family: dict[Monomial, int] = {}
    members: dict[int, dict[Place, Polynomial]] = {}
    for number, (i, j) in enumerate(pairs):
        product = _product(values[i], values[j])
        joined = {family[monomial] for monomial in product if monomial in family}
        members[number] = {(i, j): product}
        for other in joined:
            members[number] |= members.pop(other)
        family |= {monomial: number for each in members[number].values() for monomial in each}
    return list(members.values())


def _product(a: Polynomial, b: Polynomial) -> Polynomial:
    total: Terms = {}
    add_product(total, a, b)
    return without_zeros(total)


def _null_space(family: Mapping[Place, Polynomial]) -> list[Identity]:
    """Return a basis of all sigma of a family with sum 2 sigma_ij zeta_i zeta_j = 0: one for each free pair."""
    places = sorted(family)
    monomials = sorted({monomial for product in family.values() for monomial in product})
    A = fmpq_mat(len(monomials), len(places), [family[at].get(m, fmpq(0)) for m in monomials for at in places])
    R, rank = A.rref()
    pivots = [next(k for k in range(len(places)) if R[i, k]) for i in range(rank)]
    found = []
    for k in sorted(set(range(len(places))) - set(pivots)):
        row = {places[k]: Fraction(1)} | {places[at]: -_fraction(R[i, k]) for i, at in enumerate(pivots) if R[i, k]}
        found.append(_integers(row))
    return found


def _fraction(value: fmpq) -> Fraction:
    return Fraction(int(value.p), int(value.q))


def _integers(row: Mapping[Place, Fraction]) -> Identity:
    scale = Fraction(lcm(*(v.denominator for v in row.values())), gcd(*(v.numerator for v in row.values())))
    return tuple((i, j, v * scale) for (i, j), v in sorted(row.items()))
