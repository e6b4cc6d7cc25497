"""Groups of channels and their sector forms: what a proof may use about the functions of a model.

Channels whose argument rows agree up to a factor form a group with phi(y) = (y, f_1(a_1 y), …, f_J(a_J y)).
A *sector form* is a vector l with y * l'phi(y) >= 0 on the domain. The forms of a group are the dual cone of the curve
sign(y) phi(y), so the sharpest ones are the facets of its conic hull. They are found here in floating point, relaxed
a little, rounded to dyadic rationals, and believed only when `persid_check` has proved them.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid.lyapunov.cones import facets, interior
from persid.models.channels import Channels
from persid.models.functions import scalar_function
from persid_check.expression import Program
from persid_check.search.prover import prove_nondecreasing, prove_sector_form

ALIKE = 1e-4  # a cosine this near to one: a facet that only relaxes an exact form
POOL_SIZE = 48  # facets kept of a curve, the most different ones first
FINE_POOL_SIZE = 480  # and where a model needs what lies between these
LOOSE = 2.0**-8  # the same for nondecreasing forms, whose proof takes about 1 / sqrt(LOOSE) pieces
RELAXATION = 2.0**-13  # how far a facet is moved outward, relative to the form that is deepest inside the dual cone
ROUNDING = 2.0**-20
HULL_SAMPLES = {1: 10, 2: 400, 3: 400, 4: 400, 5: 120, 6: 40}  # by dimension: the number of facets grows with a power
FINE_SAMPLES = 3000
TOUCHING = 1e-5  # of a unit vector: a form that dips so low between samples counts as one that touches zero
FLAT = 1e-12  # and a dip that is less deep than this as rounding
NEAR_INTEGER = 1e-4  # a sampled slope so near to an integer is taken for it, before it is proved
STEEP = 1e6  # a sampled slope beyond this has no bound
SIZE_BITS = 100  # sizes beyond 2^+-100, as of softplus at -700, would overflow in products
LARGEST_VALUE = 1e120  # samples of the curve stop where a function exceeds this


@dataclass(frozen=True)
class Curve:
    """phi(y) = (y, f_1(a_1 (y* + y)) - f_1(a_1 y*), …) on a domain (None: R), y* within the ball `shift`."""

    functions: tuple[str, ...]
    factors: tuple[Fraction, ...]
    domain: tuple[Fraction, Fraction] | None = None
    shift: tuple[Fraction, Fraction] | None = None
    fixed: bool = False  # the argument row is zero: y is always 0, and a form in y alone vanishes

    @property
    def size(self) -> int:
        """Number of entries of phi."""
        return 1 + len(self.functions)

    def values(self, y: Float[ndarray, " N"]) -> Float[ndarray, "N d"]:
        """Return phi(y), one row a sample."""
        at = 0.0 if self.shift is None else float(self.shift[0])
        columns = [y]
        for text, factor in zip(self.functions, self.factors, strict=True):
            f, a = scalar_function(text), float(factor)
            base = np.zeros(1) if self.shift is None else f.value(np.array([a * at]))
            columns.append(f.value(a * (at + y)) - base)
        return np.stack(columns, axis=1)

    def slopes(self, y: Float[ndarray, " N"]) -> Float[ndarray, "N d"]:
        """Return phi'(y), one row a sample."""
        at = 0.0 if self.shift is None else float(self.shift[0])
        columns = [np.ones_like(y)]
        for text, factor in zip(self.functions, self.factors, strict=True):
            a = float(factor)
            columns.append(a * scalar_function(text).derivative(a * (at + y)))
        return np.stack(columns, axis=1)

    @property
    def exact(self) -> tuple[tuple[Program, Fraction], ...]:
        """The curve as the checker's prover takes it."""
        return tuple((scalar_function(f).program, a) for f, a in zip(self.functions, self.factors, strict=True))

    def proves(self, form: Iterable[float]) -> bool:
        """Whether the checker's prover establishes y * form'phi(y) >= 0 on the domain."""
        return prove_sector_form(self.exact, tuple(Fraction(float(c)) for c in form), self.domain, self.shift)


Form = tuple[Curve, int]  # a curve, and the place in its pool: forms of equal curves are proved once


@dataclass(frozen=True, eq=False)
class Group:
    """Channels with one argument row r: entry 0 of phi is y = r'x, entry 1 + j belongs to `channels[j]`.

    `members` lists all channels with this row; those with a zero column have no effect and no place in phi.
    """

    row: Float[ndarray, " n"]
    channels: tuple[int, ...]
    members: tuple[int, ...]
    curve: Curve


@dataclass(frozen=True)
class Place:
    """Where functions are looked at: about x* = x_ref + `offset`, known up to `radius`, on a `box` relative to x*."""

    offset: tuple[Fraction, ...]
    radius: Fraction = Fraction(0)
    box: tuple[tuple[Fraction, Fraction], ...] | None = None

    @classmethod
    def about(
        cls,
        x: Float[ndarray, " n"],
        x_ref: Float[ndarray, " n"],
        radius: float = 0.0,
        box: Float[ndarray, "n 2"] | None = None,
    ) -> "Place":
        """Return the place about x* in the ball of this radius around x, exactly as the checker computes it."""
        centre, r = [Fraction(float(v)) for v in x], Fraction(radius)
        offset = tuple(a - Fraction(float(v)) for a, v in zip(centre, x_ref, strict=True))
        if box is None:
            return cls(offset, r)
        sides = [(Fraction(float(low)), Fraction(float(high))) for low, high in box]
        return cls(offset, r, tuple((lo - a + r, hi - a - r) for (lo, hi), a in zip(sides, centre, strict=True)))

    def shift(self, row: ndarray) -> tuple[Fraction, Fraction]:
        """Return the ball (center, radius) of r'(x* - x_ref)."""
        exact = {int(i): Fraction(float(row[i])) for i in np.flatnonzero(row)}
        center = sum((r * self.offset[i] for i, r in exact.items()), Fraction(0))
        return center, sum((abs(r) for r in exact.values()), Fraction(0)) * self.radius

    def domain(self, row: ndarray) -> tuple[Fraction, Fraction] | None:
        """Return the interval r'box."""
        if self.box is None:
            return None
        ends = [sorted(Fraction(float(row[i])) * end for end in self.box[i]) for i in np.flatnonzero(row)]
        if not ends:
            return Fraction(-1), Fraction(1)
        return sum((low for low, _ in ends), Fraction(0)), sum((high for _, high in ends), Fraction(0))


def groups(channels: Channels, place: Place | None = None) -> tuple[Group, ...]:
    """Group channels by argument row, exactly; the row of a group is the row of its first channel, active or not.

    Without a place nothing is shifted and the domain is all of R.
    """
    joined: dict[tuple[tuple[int, Fraction], ...], list[tuple[int, Fraction]]] = {}
    for c, row in enumerate(channels.rows):
        support = np.flatnonzero(row)
        size = Fraction(float(row[support[0]])) if len(support) else Fraction(1)
        key = tuple((int(i), Fraction(float(row[i])) / size) for i in support)
        joined.setdefault(key, []).append((c, size))
    active = np.abs(channels.columns).sum(axis=0) > 0
    found = []
    for members in joined.values():
        first, size = members[0]
        row = channels.rows[first]
        present = [(c, s / size) for c, s in members if active[c]]
        curve = Curve(
            tuple(channels.functions[c].text for c, _ in present),
            tuple(factor for _, factor in present),
            None if place is None else place.domain(row),
            None if place is None else place.shift(row),
            not row.any(),
        )
        found.append(Group(row, tuple(c for c, _ in present), tuple(c for c, _ in members), curve))
    return tuple(found)


def _samples(curve: Curve, count: int, slopes: bool) -> Float[ndarray, "N d"]:
    """Sample sign(y) phi(y), or the slopes phi'(y), at `count` points on either side of 0, densely in log |y|."""
    return np.vstack(_sides(curve, count, slopes))


def _sides(curve: Curve, count: int, slopes: bool) -> list[Float[ndarray, "_ d"]]:
    """Return the samples of each side, outward."""
    low, high = (1e8, 1e8) if curve.domain is None else (-float(curve.domain[0]), float(curve.domain[1]))
    sides = []
    for sign, end in ((1.0, high), (-1.0, low)):
        for _ in range(2):  # the second time up to where the values of the first grew too large
            y = sign * np.geomspace(min(1e-3, 1e-3 * end), end, count)
            with np.errstate(all="ignore"):
                phi = curve.slopes(y) if slopes else sign * curve.values(y)
            usable = np.max(np.abs(phi), axis=1) < LARGEST_VALUE
            if usable.all() or not usable[0]:
                break
            end = abs(float(y[np.flatnonzero(usable)[-1]]))
        sides.append(phi[usable])
    return sides


def _touching(sides: Sequence[Float[ndarray, "_ d"]], L: Float[ndarray, "K d"]) -> Bool[ndarray, " K"]:
    """Return which forms dip to about zero between samples, by the parabola through the lowest of three.

    What dips to zero may dip below where no sample is, and intervals about such a place show nothing.
    """
    found = np.zeros(len(L), bool)
    for side in sides:
        heights = _directions(side) @ L.T
        fall, rise = heights[:-2] - heights[1:-1], heights[2:] - heights[1:-1]
        dips = (fall > FLAT) & (rise > FLAT)
        lowest = heights[1:-1] - (rise - fall) ** 2 / (8 * np.where(dips, rise + fall, 1.0))
        found |= (dips & (lowest < TOUCHING)).any(axis=0)
    return found


@lru_cache(maxsize=512)
def sizes(curve: Curve) -> Float[ndarray, " d"]:
    """Return the size of each entry of phi at |y| = 1 (or at the end of a smaller domain): powers of two."""
    end = 1.0 if curve.domain is None else min(1.0, -float(curve.domain[0]), float(curve.domain[1]))
    value = np.abs(curve.values(np.array([-end, end]))).max(axis=0) / end
    value = np.where((value > 0) & np.isfinite(value), value, 1.0)
    return np.exp2(np.clip(np.round(np.log2(value)), -SIZE_BITS, SIZE_BITS))


def _spread(L: ndarray, count: int) -> ndarray:
    """Order rows so that each next one is farthest from those before it; keep the first `count`."""
    chosen = [int(np.argmin(L @ L.mean(axis=0)))]
    distance = 1 - L @ L[chosen[0]]
    while len(chosen) < min(count, len(L)) and distance.max() > 1e-9:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, 1 - L @ L[chosen[-1]])
    return L[chosen]


@lru_cache(maxsize=512)
def pool(curve: Curve) -> tuple[tuple[float, ...], ...]:
    """Return candidate sector forms of a curve, dyadic and relaxed, the most different ones first; not yet proved."""
    return _relaxed_facets(curve, POOL_SIZE, slopes=False)


@lru_cache(maxsize=32)
def fine_pool(curve: Curve) -> tuple[tuple[float, ...], ...]:
    """Return ten times as many candidates, where the curve has so many facets."""
    return _relaxed_facets(curve, FINE_POOL_SIZE, slopes=False)


@lru_cache(maxsize=512)
def nondecreasing_facets(curve: Curve) -> tuple[tuple[float, ...], ...]:
    """Return facets of the conic hull of the slopes phi'(y), each relaxed a little: room for a fit to move in."""
    return _relaxed_facets(curve, POOL_SIZE // 3, slopes=True)


@lru_cache(maxsize=512)
def nondecreasing_pool(curve: Curve) -> tuple[tuple[float, ...], ...]:
    """Return candidate nondecreasing forms: facets of the conic hull of the slopes phi'(y), the most different
    ones first, and exact ones in place of those that only relax them.

    They are sector forms under every shift, and their integral is at most y l'phi(y).
    """
    exact = slope_forms(curve)
    if (
        curve.domain is None and curve.size == 2 and len(exact) == 2
    ):  # these two are all the facets that the curve of a single function has
        return exact
    relaxed = nondecreasing_facets(curve)
    return (*(form for form in relaxed if not _is_near(form, exact, sizes(curve))), *exact)


def _is_near(form: tuple[float, ...], others: tuple[tuple[float, ...], ...], unit: ndarray) -> bool:
    """Whether a form is one of the others but for its relaxation: two almost alike cost steps and prove no more."""
    mine, rows = np.array(form) * unit, np.array(others).reshape(-1, len(unit)) * unit
    lengths = np.linalg.norm(rows, axis=1) * np.linalg.norm(mine)
    return bool((rows @ mine >= (1 - ALIKE) * lengths).any())


def slope_forms(curve: Curve) -> tuple[tuple[float, ...], ...]:
    """Return f_j - s y and S y - f_j for functions whose slopes are proved to lie in [s, S], on all of R.

    Facets have to be relaxed to be proved. These are not: a neuron tanh(x + b) keeps its sector from 0 to 1, and where
    a model leaves little room that decides.
    """
    return _between_slopes(curve, _slopes)


def unit_forms(curve: Curve) -> tuple[tuple[float, ...], ...]:
    """Return the same for slopes in [0, 1]: f_j and a_j y - f_j, where a_j < 0 f_j - a_j y and -f_j.

    Those of a learned curve lie closer together; but the multipliers of a fit belong to these forms.
    """
    return _between_slopes(curve, lambda _: (0.0, 1.0))


def _between_slopes(curve: Curve, ends: Callable[[str], tuple[float, float]]) -> tuple[tuple[float, ...], ...]:
    """Return the forms of the functions whose slopes are proved to lie between two ends.

    It is proved of f itself: sign (f - slope t) rises with t = a y if a > 0, else it falls. So the slopes of f(a y) are
    a times those of f, rounded outwards, and where a < 0 their order turns.
    """
    found = []
    for j, (text, factor) in enumerate(zip(curve.functions, curve.factors, strict=True), start=1):
        way = 1 if factor > 0 else -1
        itself = ((scalar_function(text).program, Fraction(1)),)
        for slope, sign in zip(ends(text)[::way], (1, -1), strict=True):
            if not np.isfinite(slope):
                continue
            if prove_nondecreasing(itself, [-Fraction(slope) * sign * way, Fraction(sign * way)]):
                found.append(_alone(curve, j, _above(-Fraction(slope) * sign * factor), float(sign)))
    return tuple(found)


def _alone(curve: Curve, j: int, y: float, f: float) -> tuple[float, ...]:
    """Return the form y times the argument and f times function j."""
    return (y, *(f if k == j else 0.0 for k in range(1, curve.size)))


def _above(number: Fraction) -> float:
    """Return the least float that is no less."""
    nearest = float(number)
    return nearest if Fraction(nearest) >= number else float(np.nextafter(nearest, np.inf))


def steepest(text: str) -> float:
    """Return what seems to be the Lipschitz constant of a function; infinite where there is none."""
    return max(abs(slope) for slope in _slopes(text))


@lru_cache(maxsize=512)
def _slopes(text: str) -> tuple[float, float]:
    """Return what the least and the largest slope of a function seem to be; infinite where there is none.

    A shift is taken off first: it changes no slope, and samples are dense about 0.
    """
    f = scalar_function(text).unshifted[0]
    if f.table is not None:
        return _rounded(float(f.table.slopes.min()), np.floor), _rounded(float(f.table.slopes.max()), np.ceil)
    y = np.concatenate([[0.0], np.geomspace(1e-4, 1e8, FINE_SAMPLES)])
    with np.errstate(all="ignore"):
        found = f.derivative(np.concatenate([-y, y]))
    return _outward(float(found.min()), np.floor), _outward(float(found.max()), np.ceil)


def _outward(slope: float, rounding: np.ufunc) -> float:
    """Round a slope to an integer where it is about one, else outwards."""
    nearest = round(slope) if np.isfinite(slope) and abs(slope) < STEEP else np.inf
    if abs(nearest) == np.inf or abs(slope - nearest) < NEAR_INTEGER:
        return float(nearest)
    return _rounded(slope, rounding)


def _rounded(slope: float, rounding: np.ufunc) -> float:
    """Round outwards to a short number; one that is short stays as it is."""
    return float(rounding(slope / ROUNDING) * ROUNDING)


@lru_cache(maxsize=512)
def axes(curve: Curve) -> tuple[tuple[float, ...], ...]:
    """Return the functions of a curve, and y, that look like sector functions themselves: the paper's only forms."""
    sides, alone = _sides(curve, FINE_SAMPLES, False), np.eye(curve.size)
    doubted = _touching([side / sizes(curve) for side in sides], alone)
    found = alone[np.min(np.vstack(sides), axis=0) >= 0].tolist()
    return tuple(tuple(row) for row in found if not doubted[row.index(1.0)] or curve.proves(row))


@lru_cache(maxsize=512)
def sectors_alone(curve: Curve) -> tuple[tuple[float, ...], ...]:
    """Return the sector of each function by itself, where it stands beside others.

    On a narrow strip the hull of all of them is almost flat, sin(y) beside y and y**3: its facets, relaxed, then no
    longer bound a single function.
    """
    found = []
    for j, function in enumerate(zip(curve.functions, curve.factors, strict=True), start=1):
        alone = replace(curve, functions=function[:1], factors=function[1:])
        found += [_alone(curve, j, *form) for form in pool(alone)]
    return tuple(found) if curve.size > 2 else ()


def _relaxed_facets(curve: Curve, count: int, *, slopes: bool) -> tuple[tuple[float, ...], ...]:
    unit = sizes(curve)
    samples = HULL_SAMPLES[min(curve.size, 6)], FINE_SAMPLES
    coarse_sides, sides = ([side / unit for side in _sides(curve, number, slopes)] for number in samples)
    V, fine = _directions(np.vstack(coarse_sides)), _directions(np.vstack(sides))
    deepest = interior(V)
    depth = fine @ deepest
    if not len(V) or depth.min() <= 0:
        return ()
    normals = facets(V)
    if not len(normals):
        return ()
    L = _spread(normals, count)
    lack = np.max(-(fine @ L.T) / depth[:, None], axis=0, initial=0.0)  # between samples a facet may cut the curve
    L = L + (1.25 * lack + (LOOSE if slopes else RELAXATION))[:, None] * deepest
    L = np.round(L / ROUNDING) * ROUNDING
    sparse = np.where(np.abs(L) < 16 * RELAXATION, 0.0, L)
    holds = np.min(fine @ sparse.T, axis=0) >= 0
    for k in np.flatnonzero(holds & _touching(sides, sparse)):
        holds[k] = not slopes and curve.proves(sparse[k] / unit)
    L = np.where(holds[:, None], sparse, L)  # x**3 rather than x**3 + 1e-4 x
    L = L[(fine @ L.T >= 0).all(axis=0)]
    return tuple(tuple(float(c) for c in row) for row in np.unique(L, axis=0)[_first_seen(L)] / unit)


def _directions(V: ndarray) -> ndarray:
    return np.asarray(V / np.linalg.norm(V, axis=1, keepdims=True))


def _first_seen(L: ndarray) -> ndarray:
    """Return the indices into np.unique's rows that restore the order of first appearance."""
    return np.argsort(np.unique(L, axis=0, return_index=True)[1])
