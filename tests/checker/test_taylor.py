"""Local Taylor series of the checker: they enclose, and refuse what is not analytic."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb, ctx

from persid.models.functions import scalar_function
from persid_check.enclosure import PRECISION, UndefinedError, between, constant, value
from persid_check.expression import parse
from persid_check.search.series import LOCAL, least, somewhere, variable

SMOOTH = (
    "x**3", "sinh(x)", "tanh(x)", "exp(x)-1", "log1p(x**2)", "sin(2*x)", "cos(x)*x", "cosh(x)/(1+x**2)",
    "arcsinh(3*x)", "arctan(x-1)", "erf(x)", "softplus(2*x)", "softsign(x)", "expm1(x)", "sqrt(1+x**2)",
    "(2+x)**1.5", "x**-2", "relu(x)", "abs(x)**3", "sat(x)*x", "deadzone(x)", "tan(x/4)", "x**-0.5",
)  # fmt: skip


@pytest.mark.parametrize("text", SMOOTH)
@pytest.mark.parametrize(("low", "high"), [(1.5, 1.5625), (0.25, 0.3125)])
def test_taylor_encloses(text: str, low: float, high: float) -> None:
    """Values and slopes over an interval lie above the bound of Taylor's formula, and not far above."""
    a, b = Fraction(low), Fraction(high)
    m, f = (a + b) / 2, scalar_function(text)
    with ctx.workprec(PRECISION):
        about, over = (value(parse(text), variable(*ends)) for ends in ((m, m), (a, b)))
        t = np.linspace(low, high, 201)
        for order, truth in ((0, f.value(t)), (1, f.derivative(t))):
            for sign in (1, -1):
                one, two = (s if order == 0 else s.derivative() for s in (about, over))
                coefficients = [sign * c for c in one.coefficients(LOCAL - 2)]
                bound = float(
                    least(coefficients, sign * two.coefficients(LOCAL - 1)[-1], arb(float(b - m)), both_sides=True)
                )
                assert bound <= (sign * truth).min() + 1e-9
                assert bound >= (sign * truth).min() - 0.5 * (1 + np.abs(truth).max())


SINGULAR = ("1/x", "sqrt(x)", "log1p(x-1)", "abs(x)", "relu(x)", "deadzone(1+x)", "sat(x-1)", "softsign(x)", "x**0.5",
            "x**-1", "tan(x+1.57)", "x**1.5")  # fmt: skip


@pytest.mark.parametrize("text", SINGULAR)
def test_no_series_across_a_singularity(text: str) -> None:
    """Poles, roots and kinks inside the interval leave no series."""
    with ctx.workprec(PRECISION), pytest.raises(UndefinedError):
        value(parse(text), variable(Fraction(-1, 8), Fraction(1, 4))).coefficients(LOCAL)


def test_branches() -> None:
    """On one side of its kinks a function is the branch that holds there."""
    with ctx.workprec(PRECISION):
        right = value(parse("relu(x)"), variable(Fraction(1, 8), Fraction(1))).coefficients(2)
        left = value(parse("abs(x)"), variable(Fraction(-1), Fraction(-1, 8))).coefficients(2)
    assert right[1] == 1
    assert left[1] == -1


def test_derivative_has_one_coefficient_less() -> None:
    """A series never gives more coefficients than it has."""
    with ctx.workprec(PRECISION):
        series = value(parse("exp(x)"), variable(Fraction(0), Fraction(1)))
        with pytest.raises(UndefinedError):
            series.derivative().coefficients(LOCAL)


def test_short_library_setting_is_refused() -> None:
    """With a global cap of the power series there are no proofs by them."""
    before = ctx.cap
    try:
        ctx.cap = 4
        with pytest.raises(UndefinedError):
            variable(Fraction(0), Fraction(1))
    finally:
        ctx.cap = before


def test_unknown_constant_is_an_interval() -> None:
    """f about every point of a ball holds f at each of them."""
    with ctx.workprec(PRECISION):
        over = value(parse("sinh(x)"), somewhere(Fraction(1), Fraction(5, 4))).coefficients(1)[0]
        at = value(parse("sinh(x)"), constant(Fraction(9, 8)))
        assert over.contains(at.ball())
        assert between(Fraction(1), Fraction(5, 4)).ball().sinh().overlaps(over)


def test_one_sided_bound() -> None:
    """On one side a rising term costs nothing; on both sides it does."""
    one = [arb(1), arb(2), arb(-3)]
    assert float(least(one, arb(0), arb(0.5), both_sides=False)) == pytest.approx(0.25)
    assert float(least(one, arb(0), arb(0.5), both_sides=True)) == pytest.approx(-0.75)
