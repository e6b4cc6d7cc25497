"""Taylor coefficients of the smooth functions of the grammar: exact at 0, enclosed about a ball."""

from collections.abc import Callable
from functools import lru_cache

from flint import arb, arb_series, ctx, fmpq, fmpq_series

from persid_check.enclosure import PRECISION, Interval, UndefinedError, enclose, is_far

Coefficient = fmpq | Interval

ORDER = 9  # of Taylor's polynomials; the remainder has this power


@lru_cache(maxsize=64)
def series(name: str) -> list[Coefficient]:
    """Taylor coefficients at 0, exact where they are rational, else at the checker's precision."""
    x = fmpq_series([0, 1], prec=ORDER + 1)
    one = fmpq_series([1], prec=ORDER + 1)
    exact: dict[str, Callable[[], fmpq_series]] = {
        "exp": x.exp,
        "expm1": lambda: x.exp() - one,
        "log1p": lambda: (one + x).log(),
        "sin": x.sin,
        "cos": x.cos,
        "tan": x.tan,
        "sinh": x.sinh,
        "cosh": x.cosh,
        "tanh": x.tanh,
        "arcsinh": x.asinh,
        "arctan": x.atan,
    }
    if name not in exact:
        with ctx.workprec(PRECISION):
            return [enclose(c) for c in coefficients_about(name, arb(0), ORDER)]
    refuse_short_series()
    found: list[Coefficient] = list(exact[name]().coeffs())
    return (found + [fmpq(0)] * ORDER)[:ORDER]


def coefficients_about(name: str, center: arb, count: int) -> list[arb]:
    """Taylor coefficients of a function, enclosed for every center in the ball."""
    refuse_short_series()
    x = arb_series([center, 1], prec=count)
    try:
        expansion = power_series(name, x, center, count)
    except (ValueError, ZeroDivisionError) as error:
        raise UndefinedError(f"no series of {name} there: {error}") from None
    if expansion.prec < count:
        raise UndefinedError(f"a short series of {name}")
    return (list(expansion.coeffs()) + [arb(0)] * count)[:count]


def refuse_short_series() -> None:
    """A series cut shorter than asked for would look like a polynomial."""
    if ctx.cap < ORDER + 1:
        raise UndefinedError("the library is set to shorter power series")


def power_series(name: str, x: arb_series, center: arb, count: int) -> arb_series:
    one = arb_series([1], prec=count)
    if name in ("sin", "cos", "tan") and is_far(center):
        raise UndefinedError(f"no series of {name} so far out")
    match name:
        case "exp" | "sin" | "cos" | "tan" | "erf":
            found: arb_series = getattr(x, name)()
            return found
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
            return _primitive(center.asinh(), (one + x * x).rsqrt() * x.derivative())
        case "erf'":
            return (-(x * x)).exp() * (2 / arb.pi().sqrt())
        case "softplus":
            return _primitive(center.exp().log1p(), one / (one + (-x).exp()) * x.derivative())
    raise UndefinedError(f"no series of {name}")


def _primitive(start: arb, slope: arb_series) -> arb_series:
    rise = slope.integral()
    return rise + arb_series([start], prec=rise.prec)
