"""Points: curves put on rows of the states, and what is known of their forms: what facts across channels are made of.

A group of channels is a point of the ledger (docs/ledger.md, section 2). Its row and the factors of its functions are
dyadic, as files write them. A form is a candidate, seen on samples, until the checker's lemmas prove it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache
from itertools import product
from math import gcd

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import is_dyadic
from persid.lyapunov.integrals import lower_constants, upper_constants
from persid.lyapunov.sectors import (
    LARGEST_VALUE,
    LOOSE,
    RELAXATION,
    ROUNDING,
    Curve,
    Group,
    Place,
    _is_near,
    _samples,
    _slopes,
    axes,
    groups,
    nondecreasing_pool,
    pool,
    sectors_alone,
    sizes,
)
from persid.models.model import PersidskiiModel
from persid_check.ledger.lemmas import is_odd

FORMS = 10  # candidates of a curve, more where sums and single functions have more
SUMS = 2  # of its functions that are looked at
FINE = 3000
ALIKE = 1 - 1e-9  # cosine of the angle between two sums that are one
_ZERO = Fraction(0)
Row = dict[int, Fraction]
Form = tuple[float, ...]


@dataclass(frozen=True)
class Known:
    """A candidate form: its kind, c and d of its integral; c is NaN where it is no density.

    `square` is d of (d/2) g^2, a lower bound of the integral by the square of the form g itself. Of the kind "offset",
    which practical stability knows, the integral is at least -offset and at most e more than c y g.
    """

    form: Form
    kind: str
    c: float = np.nan
    d: float = 0.0
    square: float = 0.0
    offset: float = 0.0
    e: float = 0.0


@dataclass(frozen=True, eq=False)
class Point:
    """A curve at y = row'x with its channels, those with a column that is not zero, and the forms it may use.

    `sums` are the directions in which the values of its channels enter the equations.
    """

    row: Row
    curve: Curve
    channels: tuple[int, ...]
    forms: tuple[Known, ...]
    sums: tuple[Form, ...] = ()

    def reads(self, form: Form, places: dict[int, int]) -> Row:
        """Return the row of l'Phi over the states and the channels, which have these places."""
        y, *values = (Fraction(v) for v in form)
        found = {i: y * r for i, r in self.row.items()} if y else {}
        return found | {places[c]: v for c, v in zip(self.channels, values, strict=True) if v}

    @cached_property
    def rising(self) -> list[int]:
        """The nondecreasing forms that are no sums of others: their products imply those of all others."""
        return _extreme(form.form if form.kind == "nondecreasing" else None for form in self.forms)

    @cached_property
    def restricted(self) -> tuple[int, ...]:
        """The channels whose slopes are bounded on both sides: two nondecreasing forms read them with both signs."""
        forms = [self.forms[k].form for k in self.rising]
        signs = [{np.sign(form[1 + i]) for form in forms} for i in range(len(self.channels))]
        return tuple(c for c, each in zip(self.channels, signs, strict=True) if {-1.0, 1.0} <= each)

    @property
    def steady(self) -> list[int]:
        """The forms of `rising` that read such channels alone."""
        loose = [i for i, c in enumerate(self.channels) if c not in self.restricted]
        return [k for k in self.rising if not any(self.forms[k].form[1 + i] for i in loose)]

    @cached_property
    def is_odd(self) -> bool:
        """Whether Phi(-y) = -Phi(y), by the form of the functions."""
        shift, domain = self.curve.shift, self.curve.domain
        symmetric = domain is None or domain[0] == -domain[1]
        return is_odd(self.curve.exact) and symmetric and (shift is None or not any(shift))

    def on(self, reach: tuple[float | Fraction, float | Fraction]) -> "Point":
        """Return the point on a strip lo < y < hi instead, with the forms that hold there."""
        curve = replace(self.curve, domain=(Fraction(reach[0]), Fraction(reach[1])))
        return replace(self, curve=curve, forms=known(curve, self.sums))


def points_of(model: PersidskiiModel, place: Place | None) -> tuple[Point, ...]:
    """Return the points of a model about a place (None: x_ref, functions not shifted), those that act."""
    found = []
    for group in groups(model.channels, place):
        if group.channels:
            _, row, curve = written(group)
            sums = directions(model.channels.columns[:, list(group.channels)])
            found.append(Point(row, curve, group.channels, known(curve), sums))
    return tuple(found)


def directions(columns: Float[ndarray, "n J"]) -> tuple[Form, ...]:
    """Return the rows of columns, each direction once."""
    seen, found = list[ndarray](), list[Form]()
    for row in columns:
        unit = row / (np.linalg.norm(row) or 1.0)
        if unit.any() and not any(abs(unit @ other) > ALIKE for other in seen):
            seen.append(unit)
            found.append(tuple(row.tolist()))
    return tuple(found)


def written(group: Group) -> tuple[Fraction, Row, Curve]:
    """Return k, the row r/k and the curve over y/k, all dyadic as files write them."""
    row = {int(i): Fraction(float(group.row[i])) for i in np.flatnonzero(group.row)}
    k = _common(row, group.curve.factors)
    return k, {i: v / k for i, v in row.items()}, _stretched(group.curve, k)


def _common(row: Row, factors: Iterable[Fraction]) -> Fraction:
    """Return k for which r/k and the factors times k are dyadic: 1 where they are, else nearly 1.

    The cuts of lemmas lie about 1, where functions of arguments of the size of r'x bend.
    """
    if all(map(is_dyadic, factors)) or not row:
        return Fraction(1)
    common = gcd(*(value.numerator for value in row.values()))
    return Fraction(common, 1 << common.bit_length())


def _stretched(curve: Curve, k: Fraction) -> Curve:
    """Return the curve over y/k."""
    if k == 1:
        return curve
    domain, shift = (None if pair is None else (pair[0] / k, pair[1] / k) for pair in (curve.domain, curve.shift))
    return replace(curve, factors=tuple(k * factor for factor in curve.factors), domain=domain, shift=shift)


@lru_cache(maxsize=4096)
def known(curve: Curve, sums: tuple[Form, ...] = ()) -> tuple[Known, ...]:
    """Return the candidate forms of a curve: its functions, exact facets of the slopes, facets of the values.

    Where sums of its functions are given that enter equations, their sectors come first.
    """
    if curve.fixed:
        return ()
    listed: list[Form] = []
    mixed = [a for a in sums if np.count_nonzero(a) > 1][:SUMS]
    of_sums = [form for a in mixed for form in sectors_of_sum(curve, a)]
    alone, rising = sectors_alone(curve), nondecreasing_pool(curve)[-FORMS // 2 :]
    most = max(FORMS, len(of_sums) + len(alone))
    for form in (*of_sums, *alone, *axes(curve), *rising, *pool(curve)):
        if len(listed) < most and not _is_near(form, tuple(listed), sizes(curve)):
            listed.append(form)
    forms = np.array(listed, float).reshape(-1, curve.size)
    rising = (_samples(curve, FINE, slopes=True) @ forms.T >= 0).all(axis=0)
    c = upper_constants(curve, forms)
    c = np.where(rising, np.fmin(c, 1.0), c)
    d = lower_constants(curve, forms) if curve.domain is not None else np.zeros(len(forms))
    kinds = np.where(rising, "nondecreasing", "sector")
    found = [Known(*each) for each in zip(listed, kinds.tolist(), c.tolist(), d.tolist(), strict=True)]
    return (*found, *(Known(form, "one-signed") for form in one_signed(curve)))


def sectors_of_sum(curve: Curve, a: Form) -> Iterator[Form]:
    """Yield a'f - low y and high y - a'f, the tightest sector of the sum g = a'f and then that of its slopes.

    Of the curve (y, g) the first two are all facets: where functions enter the equations as this sum alone, nothing
    else of their values counts. Facets in all functions leave gaps about it.
    """
    for slopes, room in ((False, RELAXATION), (True, LOOSE)):
        samples = _samples(curve, FINE, slopes)
        g = samples[:, 1:] @ np.array(a) / samples[:, 0]
        low, high = float(g.min()), float(g.max())
        grid = np.exp2(np.floor(np.log2(max(room * (high - low), ROUNDING * abs(g).max(), 1e-300))))
        yield (-float(np.floor(low / grid) - 1) * grid, *a)
        yield (float(np.ceil(high / grid) + 1) * grid, *(-v for v in a))


def steepness(curve: Curve, form: Form) -> float:
    """Return the largest slope of a form that samples show."""
    slopes = np.vstack([_samples(curve, FINE, slopes=True), curve.slopes(np.zeros(1))])
    return float((slopes @ np.array(form)).max(initial=0.0))


def one_signed(curve: Curve) -> list[Form]:
    """Return forms ±(f_j - s y) that look one-signed, s the least or the largest slope of f_j, or that at 0."""
    low, high = (1e4, 1e4) if curve.domain is None else (-float(curve.domain[0]), float(curve.domain[1]))
    y = np.concatenate([-np.geomspace(1e-6 * low, low, FINE), np.geomspace(1e-6 * high, high, FINE)])
    with np.errstate(all="ignore"):
        phi, at_0 = curve.values(y), curve.slopes(np.zeros(1))[0]
    phi = phi[(np.abs(phi) < LARGEST_VALUE).all(axis=1)]
    found: list[Form] = []
    for j, (text, factor) in enumerate(zip(curve.functions, curve.factors, strict=True), start=1):
        tried = {*(s * float(factor) for s in _slopes(text)), float(at_0[j])}
        for slope, sign in product(sorted(s for s in tried if np.isfinite(s)), (1.0, -1.0)):
            form = np.zeros(curve.size)
            form[0], form[j] = 0.0 - sign * slope, sign
            value = phi @ form
            if value.min(initial=0.0) >= 0 and value.max(initial=0.0) > 0:
                found.append(tuple(form.tolist()))
    return list(dict.fromkeys(found))


def _extreme(forms: Iterable[Form | None]) -> list[int]:
    """Return the places of forms that are no nonnegative combinations of the others."""
    from scipy.optimize import nnls

    kept = {k: np.array(form) / np.linalg.norm(form) for k, form in enumerate(forms) if form is not None}
    for k in list(kept):
        others = [form for j, form in kept.items() if j != k]
        if others and nnls(np.array(others).T, kept[k])[1] < 1e-9:
            del kept[k]
    return list(kept)
