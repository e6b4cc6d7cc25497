"""How far the arguments of functions go that read algebraic variables: in the set V <= c, for inputs up to u.

    alpha x'Pt x + beta |v|^2 - (r'z)^2 - 2 sum (n_i'zeta)(H_i'zeta) - 2 sum tau (l_k'Phi)(l_l'Phi) > 0

over the states, the algebraic variables, and the channels and inputs that stand in equations, gives
(r'z)^2 <= alpha c + beta u^2 (docs/ledger.md, section 11). All is linear in alpha, beta, the rows n_i and tau >= 0.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import combinations, product

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import rounded
from persid.lyapunov.barrier import Centre, Region, as_near_as, definite, minimise
from persid.lyapunov.frame import Frame, Unknown, paired
from persid.lyapunov.pairs import combine
from persid.lyapunov.points import Row
from persid.lyapunov.proposals import ROOM, Left, Proposal, system_of
from persid.lyapunov.solvability import Values
from persid.lyapunov.system import scaling

START = 0.1  # of the multipliers with which a margin is sought
CLOSE = 0.01  # of the smallest reach: how near to it a proof comes
SLACK = 2.0**-10  # of alpha and beta, for what is lost when numbers become short
_ONE, _HALF = Fraction(1), Fraction(1, 2)


def bounded(frame: Frame) -> list[Row]:
    """Return the rows of strips that read algebraic variables."""
    return [dict(row) for row, *_ in frame.sides if any(i >= frame.order for i in row)]


def with_reaches(proposal: Proposal, left: Left) -> Proposal | None:
    """Return a proposal with how far each such row goes, by its numbers for V; None where that is not found."""
    frame, weight = proposal.frame, float(proposal.kappa) / max(proposal.gamma, 1e-300)
    values = dict(proposal.values)
    for k, row in enumerate(bounded(frame)):
        found = reaching(frame, k, row, _lower(proposal), weight, left)
        if found is None:
            return None
        values |= found
    return replace(proposal, values=values)


def _lower(proposal: Proposal) -> Float[ndarray, "n n"]:
    """Return Pt, V >= x'Pt x."""
    n = proposal.frame.order
    half = np.zeros((n, n))
    for unknown in proposal.frame.unknowns(proposal.kappa, across=False):
        for a, b in unknown.Pt if unknown.label in proposal.values else ():
            for (i, u), (j, v) in product(a.items(), b.items()):
                half[i, j] += float(proposal.values[unknown.label] * u * v)
    return half + half.T


def reaching(frame: Frame, place: int, row: Row, Pt: Float[ndarray, "n n"], weight: float, left: Left) -> Values | None:
    """Return alpha, beta, rows n_i and tau of a row with a small alpha + weight beta; None where none are found.

    Labels have its place among all such rows.
    """
    kept, system = _kept(frame), system_of(frame)
    found = scaling(system)
    units = np.concatenate([found.entries, found.inputs])
    size = float(np.sqrt(sum((float(v) * units[i]) ** 2 for i, v in row.items())))

    def read(row: Row) -> np.ndarray:
        return np.array([float(row.get(i, 0)) * units[i] for i in kept])

    r = read(row) / size
    unknowns = [*_reaches(frame, place, Pt), *_rows(frame, place, kept), *_values(frame, place, set(kept))]
    sizes = np.array([1 / max(_norms(each, read), 1e-300) for each in unknowns])
    pairs = [(a, b, sizes[k], k) for k, each in enumerate(unknowns) for a, b in each.M]
    margin = [({i: _ONE}, {i: -_HALF}, 1 / units[i] ** 2, len(unknowns)) for i in kept]
    count, constant = len(unknowns), -np.outer(r, r)
    signs = np.eye(count)[[k for k, each in enumerate(unknowns) if each.multiplier]]
    w = START * np.array([each.multiplier for each in unknowns], float)
    low = float(np.linalg.eigvalsh(constant + combine(paired(pairs, count, len(kept), read), w))[0])
    t = min(low, 0.0) - 0.1
    block = definite(paired([*pairs, *margin], count + 1, len(kept), read), np.eye(count + 1), constant)
    region = Region((block,), np.pad(signs, ((0, 0), (0, 1))), ROOM)
    first = minimise(region, -np.eye(count + 1)[-1], np.append(w, t), enough=_positive, left=left).w
    if not first[-1] > 0:
        return None
    block = definite(paired(pairs, count, len(kept), read), np.eye(count), constant)
    region = Region((block,), signs, ROOM * float(np.linalg.norm(first)))
    cost = np.array([_cost(each, weight) for each in unknowns]) * sizes
    numbers = rounded(minimise(region, cost, first[:-1], enough=as_near_as(CLOSE), left=left).w * sizes * size**2)
    return {each.label: _risen(each, v) for each, v in zip(unknowns, numbers, strict=True) if v}


def _positive(centre: Centre) -> bool:
    return centre.objective < 0 or centre.objective - centre.gap > 0


def _risen(unknown: Unknown, value: float) -> Fraction:
    return Fraction(float(value) * (1 + SLACK * (unknown.label[0] in ("alpha", "beta"))))


def _cost(unknown: Unknown, weight: float) -> float:
    return {"alpha": 1.0, "beta": weight}.get(str(unknown.label[0]), 0.0)


def _norms(unknown: Unknown, read: Callable[[Row], np.ndarray]) -> float:
    return 2 * float(sum(np.linalg.norm(read(a)) * np.linalg.norm(read(b)) for a, b in unknown.M))


def _kept(frame: Frame) -> list[int]:
    """Return the entries of zeta that take part: all variables, and what stands in an equation."""
    standing = {i for h in range(frame.order, frame.n) for i in frame.flow[h]}
    return [i for i in range(frame.width) if i < frame.n or i in standing]


def _reaches(frame: Frame, place: int, Pt: Float[ndarray, "n n"]) -> Iterator[Unknown]:
    """Alpha x'Pt x and beta |v|^2."""
    lines = [{j: Fraction(float(v)) / 2 for j, v in enumerate(line)} for line in Pt]
    yield Unknown(("alpha", place), tuple(({i: _ONE}, line) for i, line in enumerate(lines)))
    standing = [i for i in _kept(frame) if i >= frame.entries]
    if standing:
        yield Unknown(("beta", place), tuple(({i: _ONE}, {i: _HALF}) for i in standing))


def _rows(frame: Frame, place: int, kept: list[int]) -> Iterator[Unknown]:
    for h in range(frame.order, frame.n):
        down = {j: -v for j, v in frame.flow[h].items()}
        for i in kept:
            yield Unknown(("reaching", place, h - frame.order, i), (({i: _ONE}, down),), multiplier=False)


def _values(frame: Frame, place: int, kept: set[int]) -> Iterator[Unknown]:
    """Value facts at all points that read no more than this."""
    for p, point in enumerate(frame.points):
        rows = {
            k: point.reads(form.form, frame.places)
            for k, form in enumerate(point.forms)
            if form.kind in ("nondecreasing", "sector")
        }
        own = {k: row for k, row in rows.items() if kept.issuperset(row)}
        for k, j in combinations(own, 2):
            yield Unknown(("reaching", place, p, k, j), ((own[k], {i: -v for i, v in own[j].items()}),))
