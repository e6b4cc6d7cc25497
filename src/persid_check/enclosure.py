"""Intervals with exact dyadic endpoints; every operation rounds outwards, by `arb`.

An operation on intervals raises UndefinedError unless the function is defined and continuous on all of its argument.
So a program that runs through on an interval is continuous there: that is how continuity is proved.
"""

from collections.abc import Callable
from fractions import Fraction
from functools import lru_cache
from operator import add, mul, sub, truediv
from secrets import randbits
from typing import Any, Generic, Protocol, Self, TypeVar

from flint import arb, ctx, fmpq

from persid_check.expression import Program

FAR = arb(2) ** 128  # beyond it sine and cosine are any number from -1 to 1, and the tangent is not defined
SHORT = 2**60  # numbers below are remembered
_SALT = randbits(60)
PRECISION = 192  # bits of ball arithmetic; every bound is rounded outwards, so this decides sharpness, not truth


class UndefinedError(ArithmeticError):
    """A function is not proved to be defined, continuous and finite on the whole argument."""


def require_defined(proved: object, why: str) -> None:
    """Raise UndefinedError unless what a function needs is proved."""
    if not proved:
        raise UndefinedError(why)


class Element(Protocol):
    """What a program may be run on: an interval, an expansion at 0 or at infinity, one of these with its derivative."""

    def __add__(self, other: Self) -> Self: ...
    def __sub__(self, other: Self) -> Self: ...
    def __mul__(self, other: Self) -> Self: ...
    def __truediv__(self, other: Self) -> Self: ...
    def __neg__(self) -> Self: ...

    def power(self, exponent: Fraction) -> Self:
        """Return self ** exponent, an integer or a half-integer."""

    def apply(self, name: str) -> Self:
        """Return a function of the grammar, or the derivative f' of abs, relu, sat, deadzone or erf.

        At a kink this is all values between the two sides.
        """

    def constant(self, value: Fraction) -> Self:
        """Return a constant of the same kind."""


E = TypeVar("E", bound=Element)
_ZERO, _ONE = arb(0), arb(1)


class Interval:
    """All numbers from `lo` to `hi`, both finite."""

    __slots__ = ("hi", "lo")

    def __init__(self, lo: arb, hi: arb) -> None:
        self.lo, self.hi = lo, hi

    def __repr__(self) -> str:
        return f"Interval({self.lo.str(10)}, {self.hi.str(10)})"

    def __add__(self, other: "Interval") -> "Interval":
        return Interval((self.lo + other.lo).lower(), (self.hi + other.hi).upper())

    def __sub__(self, other: "Interval") -> "Interval":
        return Interval((self.lo - other.hi).lower(), (self.hi - other.lo).upper())

    def __neg__(self) -> "Interval":
        return Interval(-self.hi, -self.lo)

    def __mul__(self, other: "Interval") -> "Interval":
        a, b, c, d = self.lo, self.hi, other.lo, other.hi
        if a >= 0 and c >= 0:
            return Interval((a * c).lower(), (b * d).upper())
        products = (a * c, a * d, b * c, b * d)
        return Interval(_least([p.lower() for p in products]), -_least([-p.upper() for p in products]))

    def __truediv__(self, other: "Interval") -> "Interval":
        require_defined(other.lo > 0 or other.hi < 0, "division by zero")
        return self * _finite((1 / other.hi).lower(), (1 / other.lo).upper())

    @property
    def is_zero(self) -> bool:
        """Whether it is 0 alone, exactly."""
        return bool(self.lo == 0 and self.hi == 0)

    def constant(self, value: Fraction) -> "Interval":
        """Return the constant."""
        return constant(value)

    def power(self, exponent: Fraction) -> "Interval":
        """Return self ** exponent; a half-integer needs a base that is not negative."""
        if exponent < 0:
            return constant(Fraction(1)) / self.power(-exponent)
        if exponent.denominator == 2:
            return self.apply("sqrt") * self.power(exponent - Fraction(1, 2))
        n = int(exponent)
        ends = self if n % 2 else self.apply("abs")
        return _finite((ends.lo**n).lower(), (ends.hi**n).upper())

    def apply(self, name: str) -> "Interval":
        """Return the range of a function of the grammar, as closely as is cheap."""
        if name in _MONOTONE:
            f = _MONOTONE[name]
            return _finite(f(self.lo).lower(), f(self.hi).upper())
        return _OTHERS[name](self)

    def hull(self, other: "Interval") -> "Interval":
        """Return the least interval that holds both."""
        return Interval(_least([self.lo, other.lo]), -_least([-self.hi, -other.hi]))

    def ball(self) -> arb:
        """Return a ball that holds the interval."""
        return self.lo.union(self.hi)


def constant(value: Fraction) -> Interval:
    """Return the tightest interval about a fraction, whatever the caller's precision is."""
    n, d = value.numerator, value.denominator
    return _short(n ^ _SALT, d) if -SHORT < n < SHORT and d < SHORT else _constant(n, d)


@lru_cache(maxsize=4096)
def _short(salted: int, d: int) -> Interval:
    """A file cannot choose numbers that stand at one place of this memory: it knows no salt (see work.py)."""
    return _constant(salted ^ _SALT, d)


def _constant(n: int, d: int) -> Interval:
    with ctx.workprec(PRECISION):
        return enclose(arb(fmpq(n, d)))


def enclose(ball: arb) -> Interval:
    """Return the interval of a ball."""
    return _finite(ball.lower(), ball.upper())


def between(low: Fraction, high: Fraction) -> Interval:
    """Return the interval from one fraction to another."""
    return Interval(constant(low).lo, constant(high).hi)


def _finite(lo: arb, hi: arb) -> Interval:
    require_defined(lo.is_finite() and hi.is_finite(), "not finite")
    return Interval(lo, hi)


def _least(values: list[arb]) -> arb:
    """The least of exact numbers."""
    least = values[0]
    for value in values[1:]:
        if value < least:
            least = value
    return least


def _softplus(v: arb) -> arb:
    return v + (-v).exp().log1p() if v > 0 else v.exp().log1p()


def _deadzone(v: arb) -> arb:
    return v - 1 if v > 1 else v + 1 if v < -1 else _ZERO


def _sat(v: arb) -> arb:
    return _ONE if v > 1 else -_ONE if v < -1 else v


# Where one is not defined it is not a number, and so not finite.
_MONOTONE: dict[str, Callable[[arb], arb]] = {
    "sqrt": arb.sqrt,
    "exp": arb.exp,
    "log1p": arb.log1p,
    "expm1": arb.expm1,
    "sinh": arb.sinh,
    "tanh": arb.tanh,
    "arcsinh": arb.asinh,
    "arctan": arb.atan,
    "erf": arb.erf,
    "softsign": lambda v: v / (1 + abs(v)),
    "softplus": _softplus,
    "relu": lambda v: v if v > 0 else _ZERO,
    "deadzone": _deadzone,
    "sat": _sat,
}


def _abs(v: Interval) -> Interval:
    if v.lo >= 0:
        return v
    return -v if v.hi <= 0 else Interval(_ZERO, -_least([v.lo, -v.hi]))


def is_far(v: arb) -> bool:
    """Whether an argument of a wave is so large that to reduce it would take long, and tell nothing."""
    return not abs(v) < FAR


def _wave(v: Interval, f: Callable[[arb], arb], derivative: Callable[[arb], arb]) -> Interval:
    """Sine or cosine: monotone where the other has one sign, else the ball's range, cut to [-1, 1]."""
    if is_far(v.lo) or is_far(v.hi):
        return Interval(-_ONE, _ONE)
    slope = derivative(v.ball())
    if slope > 0:
        return Interval(f(v.lo).lower(), f(v.hi).upper())
    if slope < 0:
        return Interval(f(v.hi).lower(), f(v.lo).upper())
    ball = f(v.ball())
    lo, hi = ball.lower(), ball.upper()
    return Interval(lo if lo > -1 else -_ONE, hi if hi < 1 else _ONE)


def _tan(v: Interval) -> Interval:
    """Tangent: without a zero of the cosine inside, it is continuous and increasing."""
    require_defined(not is_far(v.lo) and not is_far(v.hi), "a tangent too far out")
    cosine = v.ball().cos()
    require_defined(cosine > 0 or cosine < 0, "a pole of the tangent")
    return _finite(v.lo.tan().lower(), v.hi.tan().upper())


def _cosh(v: Interval) -> Interval:
    ends = _abs(v)
    return _finite(ends.lo.cosh().lower(), ends.hi.cosh().upper())


def _bell(v: Interval) -> Interval:
    """The derivative of erf: even, decreasing in |v|."""
    ends = _abs(v)
    factor = 2 / arb.pi().sqrt()
    return Interval((factor * (-ends.hi * ends.hi).exp()).lower(), (factor * (-ends.lo * ends.lo).exp()).upper())


def _step(v: Interval, below: arb) -> Interval:
    """The derivative of what is below v for v < 0 and v for v > 0; the hull at the kink, and at the kink alone."""
    if v.hi > 0:
        return Interval(_ONE if v.lo >= 0 else below, _ONE)
    return Interval(below, below if v.lo < 0 else _ONE)


def _sat_slope(v: Interval) -> Interval:
    inside, outside = v.lo >= -1 and v.hi <= 1, v.lo >= 1 or v.hi <= -1
    return Interval(_ONE if inside and not outside else _ZERO, _ZERO if outside and not inside else _ONE)


_OTHERS: dict[str, Callable[[Interval], Interval]] = {
    "abs": _abs,
    "sin": lambda v: _wave(v, arb.sin, arb.cos),
    "cos": lambda v: _wave(v, arb.cos, lambda ball: -ball.sin()),
    "tan": _tan,
    "cosh": _cosh,
    "erf'": _bell,
    "abs'": lambda v: _step(v, -_ONE),
    "relu'": lambda v: _step(v, _ZERO),
    "sat'": _sat_slope,
    "deadzone'": lambda v: Interval(_ONE, _ONE) - _sat_slope(v),
}


ARITHMETIC: dict[str, Callable[[Any, Any], Any]] = {"+": add, "-": sub, "*": mul, "/": truediv}


def value(program: Program, x: E) -> E:
    """Run a program."""
    stack: list[E] = []
    for step in program:
        if step.name == "x":
            stack.append(x)
        elif step.name == "number":
            stack.append(x.constant(step.value or Fraction(0)))
        elif step.name in ARITHMETIC:
            b, a = stack.pop(), stack.pop()
            stack.append(ARITHMETIC[step.name](a, b))
        elif step.name == "neg":
            stack.append(-stack.pop())
        elif step.name == "**":
            stack.append(stack.pop().power(step.value or Fraction(0)))
        else:
            stack.append(stack.pop().apply(step.name))
    return stack.pop()


def value_and_slope(program: Program, x: E, dx: E) -> tuple[E, E]:
    """Run a program and its derivative together, by the chain rule."""
    found = value(program, _Differentiated(x, dx, x.constant(Fraction(0))))
    return found.v, found.slope


class _Differentiated(Generic[E]):
    """An element and its derivative, with the zero that is the derivative of a constant."""

    __slots__ = ("slope", "v", "zero")

    def __init__(self, v: E, slope: E, zero: E) -> None:
        self.v, self.slope, self.zero = v, slope, zero

    def __add__(self, other: Self) -> "_Differentiated[E]":
        return _Differentiated(self.v + other.v, self.slope + other.slope, self.zero)

    def __sub__(self, other: Self) -> "_Differentiated[E]":
        return _Differentiated(self.v - other.v, self.slope - other.slope, self.zero)

    def __neg__(self) -> "_Differentiated[E]":
        return _Differentiated(-self.v, -self.slope, self.zero)

    def __mul__(self, other: Self) -> "_Differentiated[E]":
        return _Differentiated(self.v * other.v, self.slope * other.v + self.v * other.slope, self.zero)

    def __truediv__(self, other: Self) -> "_Differentiated[E]":
        v = self.v / other.v
        return _Differentiated(v, (self.slope - v * other.slope) / other.v, self.zero)

    def constant(self, value: Fraction) -> "_Differentiated[E]":
        return _Differentiated(self.v.constant(value), self.zero, self.zero)

    def power(self, exponent: Fraction) -> "_Differentiated[E]":
        v = self.v.power(exponent)
        slope = self.v.constant(exponent) * self.v.power(exponent - 1) * self.slope if exponent else self.zero
        return _Differentiated(v, slope, self.zero)

    def apply(self, name: str) -> "_Differentiated[E]":
        v = self.v.apply(name)
        outer = _DERIVATIVES[name](self.v, v) if name in _DERIVATIVES else self.v.apply(f"{name}'")
        return _Differentiated(v, outer * self.slope, self.zero)


_HALF, _UNIT, _TWO = Fraction(1, 2), Fraction(1), Fraction(2)


def _one(a: E) -> E:
    return a.constant(_UNIT)


# The derivative of smooth functions at a, where the value is v; of others it is a function of its own.
_DERIVATIVES: dict[str, Callable[[Any, Any], Any]] = {
    "sqrt": lambda a, v: a.constant(_HALF) / v,
    "exp": lambda a, v: v,
    "expm1": lambda a, v: a.apply("exp"),
    "log1p": lambda a, v: _one(a) / (_one(a) + a),
    "sin": lambda a, v: a.apply("cos"),
    "cos": lambda a, v: -a.apply("sin"),
    "tan": lambda a, v: _one(a) + v.power(_TWO),
    "sinh": lambda a, v: a.apply("cosh"),
    "cosh": lambda a, v: a.apply("sinh"),
    "tanh": lambda a, v: a.apply("cosh").power(-_TWO),
    "arcsinh": lambda a, v: (_one(a) + a.power(_TWO)).power(-_HALF),
    "arctan": lambda a, v: _one(a) / (_one(a) + a.power(_TWO)),
    "softsign": lambda a, v: (_one(a) + a.apply("abs")).power(-_TWO),
    "softplus": lambda a, v: _one(a) / (_one(a) + (-a).apply("exp")),
}
