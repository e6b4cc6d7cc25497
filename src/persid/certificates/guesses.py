"""Guesses in floating point, for many pieces at once, of what the checker's interval arithmetic proves on each.

An enclosure is made of floats that are not rounded outwards, by the rules of `persid_check.enclosure`. It proves
nothing: it says where cuts are worth trying, and where a quantity is negative, so that nothing need be tried.
"""

from collections.abc import Callable
from fractions import Fraction
from functools import partial

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid.models.functions import VALUES
from persid_check.enclosure import value, value_and_slope
from persid_check.ledger.lemmas import SLOPES, Lemma

ROUNDING = 1e-13  # of the terms of a sum: what floats may be wrong by


class Spans:
    """All numbers from `lo` to `hi`, for each of many pieces; NaN where a function is not defined."""

    __slots__ = ("hi", "lo")

    def __init__(self, lo: ndarray, hi: ndarray) -> None:
        self.lo, self.hi = lo, hi

    def __add__(self, other: "Spans") -> "Spans":
        return Spans(self.lo + other.lo, self.hi + other.hi)

    def __sub__(self, other: "Spans") -> "Spans":
        return Spans(self.lo - other.hi, self.hi - other.lo)

    def __neg__(self) -> "Spans":
        return Spans(-self.hi, -self.lo)

    def __mul__(self, other: "Spans") -> "Spans":
        if self.lo is self.hi:  # a point
            a, b = self.lo * other.lo, self.lo * other.hi
            return Spans(np.minimum(a, b), np.maximum(a, b))
        if other.lo is other.hi:
            return other * self
        a, b, c, d = self.lo * other.lo, self.lo * other.hi, self.hi * other.lo, self.hi * other.hi
        return Spans(np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d)))

    def __truediv__(self, other: "Spans") -> "Spans":
        defined = (other.lo > 0) | (other.hi < 0)
        return self * Spans(np.where(defined, 1 / other.hi, np.nan), np.where(defined, 1 / other.lo, np.nan))

    def constant(self, number: Fraction) -> "Spans":
        """Return a constant."""
        return _point(np.array(float(number)))

    def power(self, exponent: Fraction) -> "Spans":
        """Return self ** exponent."""
        if exponent < 0:
            return self.constant(Fraction(1)) / self.power(-exponent)
        if exponent.denominator == 2:
            return self.apply("sqrt") * self.power(exponent - Fraction(1, 2))
        ends = self if exponent % 2 else self.apply("abs")
        return Spans(ends.lo ** float(exponent), ends.hi ** float(exponent))

    def apply(self, name: str) -> "Spans":
        """Return the range of a function of the grammar."""
        if name in _OTHERS:
            return _OTHERS[name](self)
        f = VALUES[name]
        return _point(f(self.lo)) if self.lo is self.hi else Spans(f(self.lo), f(self.hi))

    @property
    def size(self) -> ndarray:
        """The largest magnitude."""
        return np.asarray(np.maximum(np.abs(self.lo), np.abs(self.hi)))


def _abs(v: Spans) -> Spans:
    ends = np.abs(v.lo), np.abs(v.hi)
    return Spans(np.where((v.lo < 0) & (v.hi > 0), 0.0, np.minimum(*ends)), np.maximum(*ends))


def _even(f: Callable[[ndarray], ndarray], falls: bool, v: Spans) -> Spans:
    """Return the range of an even function that rises, or falls, with |v|."""
    ends = v.apply("abs")
    near, far = f(ends.lo), f(ends.hi)
    return Spans(far, near) if falls else Spans(near, far)


def _wave(f: Callable[[ndarray], ndarray], peak: float, v: Spans) -> Spans:
    """Return the range of a sine or cosine with a peak there."""
    ends, turn = (f(v.lo), f(v.hi)), 2 * np.pi
    tops, bottoms = (np.floor((v.hi - at) / turn) >= np.ceil((v.lo - at) / turn) for at in (peak, peak + np.pi))
    return Spans(np.where(bottoms, -1.0, np.minimum(*ends)), np.where(tops, 1.0, np.maximum(*ends)))


def _tan(v: Spans) -> Spans:
    cosine = v.apply("cos")
    defined = (cosine.lo > 0) | (cosine.hi < 0)
    return Spans(np.where(defined, np.tan(v.lo), np.nan), np.where(defined, np.tan(v.hi), np.nan))


def _step(below: float, v: Spans) -> Spans:
    """The derivative of what is below v for v < 0 and v for v > 0."""
    return Spans(np.where((v.hi > 0) & (v.lo >= 0), 1.0, below), np.where((v.hi <= 0) & (v.lo < 0), below, 1.0))


def _sat_slope(v: Spans) -> Spans:
    inside, outside = (v.lo >= -1) & (v.hi <= 1), (v.lo >= 1) | (v.hi <= -1)
    return Spans(np.where(inside & ~outside, 1.0, 0.0), np.where(outside & ~inside, 0.0, 1.0))


_OTHERS: dict[str, Callable[[Spans], Spans]] = {
    "abs": _abs,
    "sin": partial(_wave, np.sin, np.pi / 2),
    "cos": partial(_wave, np.cos, 0.0),
    "tan": _tan,
    "cosh": partial(_even, np.cosh, False),
    "erf'": partial(_even, lambda y: 2 / np.sqrt(np.pi) * np.exp(-y * y), True),
    "abs'": partial(_step, -1.0),
    "relu'": partial(_step, 0.0),
    "sat'": _sat_slope,
    "deadzone'": lambda v: Spans(np.ones(()), np.ones(())) - _sat_slope(v),
}


Array = Float[ndarray, " K"]


def least_on(lemma: Lemma, lo: Array, hi: Array) -> tuple[Array, Array]:
    """Return about the least that is known of a lemma's quantity on pieces, each on one side of the centre.

    Also what it is known to within: the rounding of floats.
    """
    y, (low, high) = Spans(lo, hi), (float(v) for v in lemma.centre or (0, 0))
    with np.errstate(all="ignore"):
        G, D, size = _combined(lemma, y)
        if lemma.kind in SLOPES:
            return D.lo, ROUNDING * size
        away = _point(np.where((lo >= high) | (lemma.kind == "one-signed"), 1.0, -1.0))
        star, base = Spans(np.array(low), np.array(high)), y.constant(Fraction(0))
        if lemma.centre is not None:
            base = _value(lemma, star)
            size = size + base.size
        direct = away * (G - base)
        if lemma.kind == "upper":
            rise = y.constant(lemma.c) * (y - star) * D * away + y.constant(lemma.c - 1) * direct
            return rise.lo, ROUNDING * size
        slope = away * D
        end = np.where(slope.lo >= 0, lo, np.where(slope.hi <= 0, hi, (lo + hi) / 2))
        half = np.where((end == lo) | (end == hi), 0.0, (hi - lo) / 2)
        near = away * (_value(lemma, _point(end)) - base) + slope * Spans(-half, half)
        return np.fmax(direct.lo, near.lo), ROUNDING * size


def rise_on(lemma: Lemma, lo: Array, hi: Array) -> Array:
    """Return about the least rise of what is added up over pieces: an offset's by their middles, too."""
    least, width = least_on(lemma, lo, hi)[0], hi - lo
    if lemma.kind == "offset":
        middle = least_on(lemma, (lo + hi) / 2, (lo + hi) / 2)[0]
        with np.errstate(all="ignore"):
            D = _combined(lemma, Spans(lo, hi))[1]
            mean = middle - (D.hi - D.lo) * width / 8
            fits = (least >= 0) | (middle + D.size * width / 2 <= 0)
        least = np.where(fits, np.fmax(mean, least), least)
    return np.asarray(width * least)


def mean_on(lemma: Lemma, lo: Array, hi: Array) -> Bool[ndarray, " K"]:
    """Return on which pieces about the centre the quantity, over the distance from it, seems to be positive."""
    y = Spans(lo, hi)
    with np.errstate(all="ignore"):
        _, D, size = _combined(lemma, y)
        mean = y.constant(lemma.c - 1) * D + y.constant(lemma.c) * D if lemma.kind == "upper" else D
        return np.asarray(mean.lo >= -ROUNDING * size)


def _point(at: ndarray) -> Spans:
    return Spans(at, at)


def _combined(lemma: Lemma, y: Spans) -> tuple[Spans, Spans, ndarray]:
    """Return g = l'phi(y), its derivative, and the sizes of their terms."""
    G, D = y.constant(lemma.form[0]) * y, _point(np.full(y.lo.shape, float(lemma.form[0])))
    size = G.size + D.size
    for c, (program, alpha) in zip(lemma.form[1:], lemma.functions, strict=True):
        if c:
            scale, weight = y.constant(alpha), y.constant(c)
            f, slope = value_and_slope(program, scale * y, scale)
            f, slope = weight * f, weight * slope
            G, D, size = G + f, D + slope, size + f.size + slope.size
    return G, D, size


def _value(lemma: Lemma, y: Spans) -> Spans:
    terms = zip(lemma.form[1:], lemma.functions, strict=True)
    listed = [y.constant(c) * value(program, y.constant(alpha) * y) for c, (program, alpha) in terms if c]
    return sum(listed, y.constant(lemma.form[0]) * y)
