"""Taylor's formula: functions about a point, or about all points of an interval, as their first coefficients.

On [a, b] with m inside, v(t) = sum of c_k (t - m)^k for k < K, plus c_K (t - m)^K with c_K a coefficient about some
point of [a, b]: the last one is enclosed about the whole interval, the others about m alone.
"""

from collections.abc import Callable
from fractions import Fraction

from flint import arb, arb_series, fmpq

from persid_check.enclosure import UndefinedError, between
from persid_check.taylor import power_series, refuse_short_series

LOCAL = 6  # coefficients of a Series


class Series:
    """A function about a point, or about all points of a ball: its first Taylor coefficients, in balls.

    Unless the function is analytic there, an operation raises UndefinedError or leaves coefficients that are not
    finite, which `coefficients` refuses.
    """

    __slots__ = ("terms",)

    def __init__(self, terms: arb_series) -> None:
        self.terms = terms

    def __add__(self, other: "Series") -> "Series":
        return Series(self.terms + other.terms)

    def __sub__(self, other: "Series") -> "Series":
        return Series(self.terms - other.terms)

    def __mul__(self, other: "Series") -> "Series":
        return Series(self.terms * other.terms)

    def __truediv__(self, other: "Series") -> "Series":
        try:
            return Series(self.terms / other.terms)
        except (ValueError, ZeroDivisionError):
            raise UndefinedError("division by zero") from None

    def __neg__(self) -> "Series":
        return Series(-self.terms)

    def constant(self, value: Fraction) -> "Series":
        """Return the constant."""
        return Series(arb_series([arb(fmpq(value.numerator, value.denominator))], prec=LOCAL))

    def power(self, exponent: Fraction) -> "Series":
        """Return self ** exponent, an integer or a half-integer."""
        if exponent < 0:
            return self.constant(Fraction(1)) / self.power(-exponent)
        whole = Series(self.terms ** int(exponent))
        return whole if exponent.denominator == 1 else whole * Series(self.terms.sqrt())

    def apply(self, name: str) -> "Series":
        """Return a function of the grammar; one with kinks where the ball lies on one side of each."""
        if name in _BRANCHES:
            return _BRANCHES[name](self)
        if name == "sqrt":
            return self.power(Fraction(1, 2))
        try:
            return Series(power_series(name, self.terms, self.terms[0], LOCAL))
        except (ValueError, ZeroDivisionError):
            raise UndefinedError(f"no series of {name} there") from None

    def derivative(self) -> "Series":
        """Return the derivative; it has one coefficient less."""
        return Series(self.terms.derivative())

    def coefficients(self, count: int) -> list[arb]:
        """Return the first coefficients, all finite."""
        found = list(self.terms.coeffs())[:count]
        if self.terms.prec < count or not all(c.is_finite() for c in found):
            raise UndefinedError("a series is too short or not finite")
        return found + [arb(0)] * (count - len(found))


def variable(low: Fraction, high: Fraction) -> Series:
    """Return t about every point of an interval."""
    refuse_short_series()
    return Series(arb_series([between(low, high).ball(), 1], prec=LOCAL))


def somewhere(low: Fraction, high: Fraction) -> Series:
    """Return an unknown constant in an interval."""
    return Series(arb_series([between(low, high).ball()], prec=LOCAL))


def least(about: list[arb], remainder: arb, reach: arb, *, both_sides: bool) -> arb:
    """Return a lower bound of c_0 + c_1 s + ... + remainder s^K for 0 <= s <= reach, or for |s| <= reach."""
    total, power = about[0], arb(1)
    for k, c in enumerate([*about[1:], remainder], start=1):
        power *= reach
        loss = abs(c).upper() if both_sides and k % 2 else -c.lower()
        if loss > 0:
            total -= loss * power
    return total.lower()


def _one_sided(v: Series, kink: int) -> bool:
    """Whether v > kink (else v < kink) on the ball; where it may be either, there is no series.

    Strictly: where v touches the kink, an interval and a point of it could choose different branches.
    """
    if v.terms[0] > kink:
        return True
    if v.terms[0] < kink:
        return False
    raise UndefinedError("a kink inside")


def _abs(v: Series) -> Series:
    return v if _one_sided(v, 0) else -v


def _relu(v: Series) -> Series:
    return v if _one_sided(v, 0) else v.constant(Fraction(0))


def _sat(v: Series) -> Series:
    one = v.constant(Fraction(1))
    if _one_sided(v, 1):
        return one
    return v if _one_sided(v, -1) else -one


_BRANCHES: dict[str, Callable[[Series], Series]] = {
    "abs": _abs,
    "relu": _relu,
    "sat": _sat,
    "deadzone": lambda v: v - _sat(v),
    "softsign": lambda v: v / (v.constant(Fraction(1)) + _abs(v)),
}
