"""Expansions at infinity: one mechanism for the tails of functions and, with t = 1/y, for their germs at 0.

An expansion is a finite sum of c e^(b y) y^a (log y)^d. It means a function v(y) on [Y, infinity) for which at every
y >= Y there are numbers in the coefficients c (exact fractions or intervals) that give v(y). The order (b, a, d) is the
order of growth. Whatever decays is bounded by its value at Y, so the leading term gives the sign of v on all of
[Y, infinity).
"""

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction
from operator import add, itemgetter, mul, truediv
from typing import Any

from flint import arb, fmpq

from persid_check.enclosure import Interval, UndefinedError, constant, enclose, require_defined
from persid_check.taylor import ORDER, Coefficient, coefficients_about, series
from persid_check.work import spend

Key = tuple[fmpq, fmpq, fmpq]  # exponents (b, a, d) of e^y, y, log y

MAX_TERMS = 8
BINOMIAL_ORDER = 5
MAX_HEIGHT = 2000  # bits of an exact coefficient
MAX_KEY = 10**6

_NONE, _UNIT = fmpq(0), fmpq(1)
CONSTANT: Key = (_NONE, _NONE, _NONE)
LINEAR: Key = (_NONE, _UNIT, _NONE)
LOGARITHM: Key = (_NONE, _NONE, _UNIT)


def interval(c: Coefficient) -> Interval:
    """Return a coefficient as an interval."""
    return c if isinstance(c, Interval) else enclose(arb(c))


def _exactly(operation: Callable[[Any, Any], Any], a: Coefficient, b: Coefficient) -> Coefficient:
    """Return a + b, a b, ...: exactly where both are fractions and the result is not too long a one."""
    exact = not isinstance(a, Interval) and not isinstance(b, Interval)
    return _low(operation(a, b)) if exact else operation(interval(a), interval(b))


def _low(c: fmpq) -> Coefficient:
    return c if c.height_bits() <= MAX_HEIGHT else interval(c)


def _is_zero(c: Coefficient) -> bool:
    return c.is_zero if isinstance(c, Interval) else bool(c == 0)


def _refuse_large(key: Key) -> None:
    require_defined(all(abs(exponent) <= MAX_KEY for exponent in key), "an exponent is too large")


class Horizon:
    """The half-line [Y, infinity), Y > 0, and the suprema of decaying monomials on it."""

    def __init__(self, Y: Fraction) -> None:
        require_defined(Y > 0, "an end on the other side of 0")
        self.Y = fmpq(Y.numerator, Y.denominator)
        self._suprema: dict[Key, Interval] = {CONSTANT: constant(Fraction(1))}

    def bound(self, key: Key) -> Interval:
        """Return [0, sup] of e^(b y) y^a (log y)^d on y >= Y, for a monomial that decreases there."""
        if key not in self._suprema:
            b, a, d = key
            require_defined(key < CONSTANT and self._decreases(b, a, d), "not proved to decrease")
            self._suprema[key] = Interval(arb(0), self.monomial(key).upper())
        return self._suprema[key]

    def _decreases(self, b: fmpq, a: fmpq, d: fmpq) -> bool:
        """b y + a + d / log y <= 0 for all y >= Y, where b <= 0."""
        total = arb(b * self.Y + a)
        require_defined(d == 0 or self.Y >= 2, "a logarithm near 1")
        if d > 0:
            total += arb(d) / arb(self.Y).log()
        return bool(b <= 0 and total <= 0)

    def monomial(self, key: Key) -> arb:
        """Return a ball about the value at Y."""
        b, a, d = key
        y = arb(self.Y)
        value = (arb(b) * y).exp() * y ** arb(a)
        if d != 0:
            value *= y.log() ** arb(d)
        require_defined(value.is_finite(), "not finite")
        return value


class Expansion:
    """A sum of terms, leading one first, on a horizon; without terms 0. It takes 2 steps, and 2 a term."""

    __slots__ = ("horizon", "terms")

    def __init__(self, horizon: Horizon, terms: Iterable[tuple[Key, Coefficient]]) -> None:
        self.horizon = horizon
        merged: list[tuple[Key, Coefficient]] = []
        listed = sorted(terms, key=itemgetter(0), reverse=True)
        spend(2 + 2 * len(listed))
        for key, c in listed:
            if merged and merged[-1][0] == key:
                merged[-1] = (key, _exactly(add, merged[-1][1], c))
            else:
                merged.append((key, c))
        self.terms = self._shortened([term for term in merged if not _is_zero(term[1])])

    def _shortened(self, terms: list[tuple[Key, Coefficient]]) -> list[tuple[Key, Coefficient]]:
        """Merge the smallest terms into the last one that is kept."""
        if len(terms) <= MAX_TERMS:
            return terms
        last, c = terms[MAX_TERMS - 1]
        for key, other in terms[MAX_TERMS:]:
            c = _exactly(add, c, interval(other) * self.horizon.bound(_ratio(key, last)))
        return [*terms[: MAX_TERMS - 1], (last, c)]

    def _with(self, terms: Iterable[tuple[Key, Coefficient]]) -> "Expansion":
        return Expansion(self.horizon, terms)

    def constant(self, value: Fraction) -> "Expansion":
        """Return the constant."""
        return self._with([(CONSTANT, fmpq(value.numerator, value.denominator))])

    def __add__(self, other: "Expansion") -> "Expansion":
        return self._with([*self.terms, *other.terms])

    def __neg__(self) -> "Expansion":
        return self._with([(key, -c) for key, c in self.terms])

    def __sub__(self, other: "Expansion") -> "Expansion":
        return self + (-other)

    def __mul__(self, other: "Expansion") -> "Expansion":
        products = [(_product(k, m), _exactly(mul, c, d)) for k, c in self.terms for m, d in other.terms]
        return self._with(products)

    def __truediv__(self, other: "Expansion") -> "Expansion":
        return self * other.power(Fraction(-1))

    def scaled(self, factor: Interval) -> "Expansion":
        """Return factor times self, for an unknown number of the interval at each y."""
        return self._with([(key, interval(c) * factor) for key, c in self.terms])

    def lead(self) -> tuple[Key, Coefficient]:
        """Return the leading term."""
        require_defined(self.terms, "zero has no leading term")
        return self.terms[0]

    def relative(self) -> Interval:
        """Return an interval for v(y) / (leading monomial), for all y >= Y."""
        return self.range(self.lead()[0])

    def range(self, unit: Key = CONSTANT) -> Interval:
        """Return an interval for v(y) / (a monomial), for all y >= Y; v must not grow faster than it."""
        total = constant(Fraction(0))
        for key, c in self.terms:
            total += interval(c) * self.horizon.bound(_ratio(key, unit))
        return total

    def grows(self) -> bool:
        """Whether the leading monomial tends to infinity."""
        return bool(self.terms) and self.terms[0][0] > CONSTANT

    def is_nonnegative(self) -> bool:
        """Whether v >= 0 is proved on all of [Y, infinity)."""
        return not self.terms or bool(self.relative().lo >= 0)

    def power(self, exponent: Fraction) -> "Expansion":
        """Return self ** exponent: (c m)^p (1 + w)^p with w decaying, by the binomial series."""
        if exponent.denominator == 1 and exponent >= 0:
            return self._natural_power(int(exponent))
        if not self.terms and exponent > 0:
            return self
        key, c = self.lead()
        _refuse_large(key)
        p = fmpq(exponent.numerator, exponent.denominator)
        head = self._with([((key[0] * p, key[1] * p, key[2] * p), _coefficient_power(c, exponent))])
        rest = self._with([(_ratio(k, key), _exactly(truediv, d, c)) for k, d in self.terms[1:]])
        return head * rest.binomial(exponent)

    def _natural_power(self, n: int) -> "Expansion":
        result, square = self.constant(Fraction(1)), self
        for key, _ in self.terms:
            _refuse_large(key)
        while n:
            if n & 1:
                result = result * square
            n >>= 1
            square = square * square if n else square
        return result

    def binomial(self, exponent: Fraction) -> "Expansion":
        """Return (1 + self) ** exponent for a decaying self > -1."""
        p = fmpq(exponent.numerator, exponent.denominator)
        binomials = [_UNIT]
        for k in range(BINOMIAL_ORDER):
            binomials.append(binomials[-1] * (p - k) / (k + 1))
        if not self.terms:
            return self.constant(Fraction(1))
        reach = constant(Fraction(1)) + self.range().hull(constant(Fraction(0)))
        require_defined(reach.lo > 0, "a base that is not proved positive")
        return self._taylor(binomials[:-1], interval(binomials[-1]) * _real_power(reach, p - BINOMIAL_ORDER))

    def _taylor(self, polynomial: Sequence[Coefficient], remainder: Interval) -> "Expansion":
        """Return sum c_k self^k + remainder self^K, by Horner's rule."""
        total = self._with([(CONSTANT, remainder)])
        for c in reversed(polynomial):
            total = total * self + self._with([(CONSTANT, c)])
        return total

    def log(self) -> "Expansion":
        """Return the logarithm of a positive self: log c + a log y + b y + log(1 + w)."""
        (b, a, d), c = self.lead()
        require_defined(d == 0 and (a == 0 or self.horizon.Y >= 2), "the logarithm of a logarithm")
        require_defined(interval(c).lo > 0, "the logarithm of a number that is not proved positive")
        key = (b, a, d)
        rest = self._with([(_ratio(k, key), _exactly(truediv, e, c)) for k, e in self.terms[1:]])
        head: Coefficient = _NONE if c == 1 else _log(interval(c))
        return self._with([(LINEAR, b), (LOGARITHM, a), (CONSTANT, head)]) + rest.bounded("log1p")

    def exp(self) -> "Expansion":
        """Return the exponential: growth must be linear or logarithmic and exact, or downwards."""
        growing = [(key, c) for key, c in self.terms if key > CONSTANT]
        rest = self._with([term for term in self.terms if term[0] <= CONSTANT]).bounded("exp")
        b = a = _NONE
        for key, c in growing:
            if isinstance(c, Interval) or key not in (LINEAR, LOGARITHM):
                return self._exp_downwards()
            b, a = (c, a) if key == LINEAR else (b, c)
            _refuse_large((b, a, _NONE))
        return rest * self._with([((b, a, _NONE), _UNIT)])

    def _exp_downwards(self) -> "Expansion":
        """e^v <= e^(-k y) where v <= -k y, or e^v <= e^(v(Y) bound) where v falls more slowly."""
        (b, a, d), fall = self.lead()[0], -self.relative()
        require_defined(fall.lo > 0 and d >= 0, "an exponential grows too fast")
        unit = Interval(arb(0), arb(1))
        if b == 0 and a >= 1 and (d == 0 or self.horizon.Y >= 3):
            rate = (fall.lo * self.horizon.monomial((b, a - 1, _NONE))).lower()
            return self._with([((-_floor(rate), _NONE, _NONE), unit)])
        require_defined(b == 0 and (d == 0 or a == 0), "an exponential falls too fast")
        top = (-fall.lo * self.horizon.monomial((b, a, d)).lower()).upper().exp().upper()
        return self._with([(CONSTANT, Interval(arb(0), top))])

    def bounded(self, name: str) -> "Expansion":
        """Return a smooth function of a self that does not grow, by Taylor's formula about its constant part."""
        center: Coefficient = next((c for key, c in self.terms if key == CONSTANT), _NONE)
        rest = self._with([term for term in self.terms if term[0] != CONSTANT])
        if not rest.terms and not isinstance(center, Interval) and center == 0:
            return self._with([(CONSTANT, series(name)[0])])
        reach = rest.range().hull(constant(Fraction(0))) + interval(center)
        remainder = enclose(coefficients_about(name, reach.ball(), ORDER + 1)[ORDER])
        if isinstance(center, Interval) or center != 0:
            about = [enclose(c) for c in coefficients_about(name, interval(center).ball(), ORDER)]
            return rest._taylor(about, remainder)
        return rest._taylor(series(name)[:ORDER], remainder)

    def apply(self, name: str) -> "Expansion":
        """Return a function of the grammar."""
        if name in _BY_SIGN:
            return _BY_SIGN[name](self)
        if name == "sqrt":
            return self.power(Fraction(1, 2))
        return _GROWING[name](self) if self.grows() else self.bounded(name)


def _product(k: Key, m: Key) -> Key:
    return (k[0] + m[0], k[1] + m[1], k[2] + m[2])


def _ratio(k: Key, m: Key) -> Key:
    return (k[0] - m[0], k[1] - m[1], k[2] - m[2])


def _coefficient_power(c: Coefficient, exponent: Fraction) -> Coefficient:
    if not isinstance(c, Interval) and exponent.denominator == 1:
        return _low(c ** int(exponent))
    if not isinstance(c, Interval) and c == 1:
        return c
    return interval(c).power(exponent)


def _real_power(base: Interval, exponent: fmpq) -> Interval:
    """base ** exponent for a positive base: monotone, so the ends decide."""
    ends = [enclose(x ** arb(exponent)) for x in (base.lo, base.hi)]
    return ends[0].hull(ends[1])


def _log(c: Interval) -> Interval:
    return enclose(c.lo.log()).hull(enclose(c.hi.log()))


def _floor(rate: arb) -> fmpq:
    """A fraction just below a positive exact number."""
    scaled = (rate * 1024).floor().lower().unique_fmpz() if rate < 2**40 else 2**50
    return fmpq(scaled or 0, 1024)


def _sinh(v: Expansion) -> Expansion:
    return (v.exp() - (-v).exp()) * v.constant(Fraction(1, 2))


def _cosh(v: Expansion) -> Expansion:
    return (v.exp() + (-v).exp()) * v.constant(Fraction(1, 2))


def _is_positive(v: Expansion) -> bool:
    """Whether v > 0, else v < 0, for all y >= Y."""
    W = v.relative()
    require_defined(W.lo > 0 or W.hi < 0, "a sign is not proved")
    return bool(W.lo > 0)


def _odd(f: Callable[[Expansion], Expansion]) -> Callable[[Expansion], Expansion]:
    """An odd function of a growing v, from its values for v > 0."""
    return lambda v: f(v) if _is_positive(v) else -f(-v)


def _tanh(v: Expansion) -> Expansion:
    """1 - 2 E / (1 + E), E = exp(-2 v)."""
    one, two = v.constant(Fraction(1)), v.constant(Fraction(2))
    E = (-two * v).exp()
    return one - two * E / (one + E)


def _erf(v: Expansion) -> Expansion:
    """1 - erfc(v), where 0 <= erfc(v) <= exp(-v^2) for v >= 0."""
    return v.constant(Fraction(1)) - (-(v * v)).exp().scaled(Interval(arb(0), arb(1)))


def _bell(v: Expansion) -> Expansion:
    """2 / sqrt(pi) exp(-v^2)."""
    return (-(v * v)).exp().scaled(enclose(2 / arb.pi().sqrt()))


def _arctan(v: Expansion) -> Expansion:
    """pi / 2 - arctan(1 / v)."""
    return v._with([(CONSTANT, enclose(arb.pi() / 2))]) - v.power(Fraction(-1)).bounded("arctan")


def _arcsinh(v: Expansion) -> Expansion:
    return (v + (v * v + v.constant(Fraction(1))).power(Fraction(1, 2))).log()


def _softplus(v: Expansion) -> Expansion:
    """max(v, 0) + log1p(exp(-|v|))."""
    return v + (-v).exp().bounded("log1p") if _is_positive(v) else v.exp().bounded("log1p")


def _wave(v: Expansion) -> Expansion:
    return _within(v, -1, 1)


def _refused(v: Expansion) -> Expansion:
    raise UndefinedError("poles")


_GROWING: dict[str, Callable[[Expansion], Expansion]] = {
    "exp": Expansion.exp,
    "expm1": lambda v: v.exp() - v.constant(Fraction(1)),
    "log1p": lambda v: (v + v.constant(Fraction(1))).log(),
    "sinh": _sinh,
    "cosh": _cosh,
    "tanh": _odd(_tanh),
    "erf": _odd(_erf),
    "erf'": _bell,
    "arctan": _odd(_arctan),
    "arcsinh": _odd(_arcsinh),
    "softplus": _softplus,
    "sin": _wave,
    "cos": _wave,
    "tan": _refused,
}


def _abs(v: Expansion) -> Expansion:
    if v.is_nonnegative():
        return v
    return -v if (-v).is_nonnegative() else v.scaled(Interval(arb(-1), arb(1)))


def _relu(v: Expansion) -> Expansion:
    if v.is_nonnegative():
        return v
    return v.constant(Fraction(0)) if (-v).is_nonnegative() else v.scaled(Interval(arb(0), arb(1)))


def _step(v: Expansion, below: int) -> tuple[int, int]:
    """Bounds of the derivative of what is below v for v < 0 and v for v > 0."""
    least = 1 if v.is_nonnegative() else below
    return least, below if (-v).is_nonnegative() and least < 1 else 1


def _saturation_slope(v: Expansion) -> tuple[int, int]:
    """Bounds of the slope of sat: 1 inside [-1, 1], 0 outside."""
    one = v.constant(Fraction(1))
    if (v - one).is_nonnegative() or (-v - one).is_nonnegative():
        return 0, 0
    return (1, 1) if (one - v).is_nonnegative() and (one + v).is_nonnegative() else (0, 1)


def _within(v: Expansion, low: int, high: int) -> Expansion:
    """An unknown number of an interval at each y, or the one that it holds."""
    return v._with([(CONSTANT, fmpq(low) if low == high else Interval(arb(low), arb(high)))])


def _sat(v: Expansion) -> Expansion:
    one = v.constant(Fraction(1))
    if (v - one).is_nonnegative():
        return one
    if (-v - one).is_nonnegative():
        return -one
    return v if _saturation_slope(v) == (1, 1) else _within(v, -1, 1)


_BY_SIGN: dict[str, Callable[[Expansion], Expansion]] = {
    "abs": _abs,
    "relu": _relu,
    "sat": _sat,
    "deadzone": lambda v: v - _sat(v),
    "abs'": lambda v: _within(v, *_step(v, -1)),
    "relu'": lambda v: _within(v, *_step(v, 0)),
    "sat'": lambda v: _within(v, *_saturation_slope(v)),
    "deadzone'": lambda v: _within(v, *(1 - slope for slope in _saturation_slope(v)[::-1])),
    "softsign": lambda v: v / (v.constant(Fraction(1)) + _abs(v)),
}
