"""Taylor coefficients of the smooth functions of the grammar: exact at 0, enclosed about a ball."""

from functools import lru_cache
from typing import Any

from flint import arb, arb_series, ctx, fmpq, fmpq_series

from persid_check.enclosure import PRECISION, Interval, UndefinedError, enclose, is_far, require_defined

Coefficient = fmpq | Interval
Series = Any  # arb_series, of balls, or fmpq_series, of fractions

ORDER = 9  # of Taylor's polynomials; the remainder has this power
IRRATIONAL = ("erf", "erf'", "softplus")  # functions whose coefficients at 0 are not all rational


@lru_cache(maxsize=64)
def series(name: str) -> list[Coefficient]:
    """Taylor coefficients at 0, exact where they are rational, else at the checker's precision."""
    if name in IRRATIONAL:
        with ctx.workprec(PRECISION):
            return [enclose(c) for c in coefficients_about(name, arb(0), ORDER)]
    refuse_short_series()
    x = fmpq_series([0, 1], prec=ORDER + 1)
    found: list[Coefficient] = list(power_series(name, x, fmpq(0), ORDER + 1).coeffs())
    return (found + [fmpq(0)] * ORDER)[:ORDER]


def coefficients_about(name: str, center: arb, count: int) -> list[arb]:
    """Taylor coefficients of a function, enclosed for every center in the ball."""
    refuse_short_series()
    x = arb_series([center, 1], prec=count)
    try:
        expansion = power_series(name, x, center, count)
    except (ValueError, ZeroDivisionError) as error:
        raise UndefinedError(f"no series of {name} there: {error}") from None
    require_defined(expansion.prec >= count, f"a short series of {name}")
    return (list(expansion.coeffs()) + [arb(0)] * count)[:count]


def refuse_short_series() -> None:
    """A series cut shorter than asked for would look like a polynomial."""
    require_defined(ctx.cap > ORDER, "the library is set to shorter power series")


def power_series(name: str, x: Series, center: Any, count: int) -> Series:
    """Return a function of a series x, which is center + ..., of numbers that are exact or of balls."""
    one = type(x)([1], prec=count)
    if name in ("sin", "cos", "tan"):
        require_defined(not is_far(center), f"no series of {name} so far out")
    match name:
        case "exp" | "sin" | "cos" | "tan" | "erf":
            return getattr(x, name)()
        case "expm1":
            return x.exp() - one
        case "log1p":
            return (one + x).log()
        case "sinh":
            return (x.exp() - (-x).exp()) / 2
        case "cosh":
            return (x.exp() + (-x).exp()) / 2
        case "tanh":
            return one - 2 / (one + (2 * x).exp())
        case "arctan":
            return x.atan()
        case "arcsinh":
            return _primitive(center.asinh() if center else center, (one + x * x).rsqrt() * x.derivative())
        case "erf'":
            return (-(x * x)).exp() * (2 / arb.pi().sqrt())
        case "softplus":
            return _primitive(center.exp().log1p(), one / (one + (-x).exp()) * x.derivative())
    raise UndefinedError(f"no series of {name}")


def _primitive(start: Any, slope: Series) -> Series:
    rise = slope.integral()
    return rise + type(rise)([start], prec=rise.prec)
