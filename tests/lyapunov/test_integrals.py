"""Constants of integrals: estimated on the safe side, proved, and false ones refused."""

from fractions import Fraction

import numpy as np
import pytest

from persid.lyapunov.integrals import lower_constants, upper_constants
from persid.lyapunov.sectors import Curve
from persid_check.search.prover import prove_integral_lower, prove_integral_upper

KNOWN = {"x**3": 1 / 4, "x**5": 1 / 6, "tanh(x)": 1.0, "x*abs(x)": 1 / 3}
ONE = (Fraction(1),)
ITSELF = (Fraction(0), Fraction(1))


def proves_upper(curve: Curve, c: float) -> bool:
    """Whether the integral of the function is proved to be at most c y f(y)."""
    return prove_integral_upper(curve.exact, ITSELF, Fraction(c), curve.domain, curve.shift)


def proves_lower(curve: Curve, d: float) -> bool:
    """Whether it is proved to be at least d y^2 / 2."""
    return prove_integral_lower(curve.exact, ITSELF, Fraction(d), curve.domain, curve.shift)


@pytest.mark.parametrize("f", KNOWN)
def test_upper(f: str) -> None:
    """c is a little above its known value, is proved, and a value below it is not."""
    curve = Curve((f,), ONE)
    forms = np.eye(2)
    c = upper_constants(curve, forms)
    assert c[0] == 0.5
    assert KNOWN[f] <= c[1] <= 1.05 * KNOWN[f] + 1e-3
    assert proves_upper(curve, max(float(c[1]), KNOWN[f]))
    assert not proves_upper(curve, 0.9 * KNOWN[f])


def test_lower_on_a_domain() -> None:
    """On |y| <= 2 the integral of sin is at least (d/2) y^2 with d near (1 - cos 2)/2, and no larger d is proved."""
    curve = Curve(("sin(x)",), ONE, (Fraction(-2), Fraction(2)), (Fraction(0), Fraction(0)))
    d = float(lower_constants(curve, np.array([[0.0, 1.0]]))[0])
    best = (1 - np.cos(2)) / 2
    assert 0.95 * best <= d <= best
    assert proves_lower(curve, d)
    assert proves_lower(curve, 0.0)
    assert not proves_lower(curve, 1.02 * best)


def test_shifted_cube() -> None:
    """A shifted cube needs c = (3 + sqrt 3)/6 = 0.789, not 1/4."""
    curve = Curve(("x**3",), ONE, None, (Fraction(1), Fraction(0)))
    c = float(upper_constants(curve, np.array([[0.0, 1.0]]))[0])
    assert 0.788 < c < 0.81
    assert not proves_upper(curve, 0.25)


def test_no_constant() -> None:
    """A function that falls to zero far out has no useful c on a long domain."""
    curve = Curve(("x/(1+x**4)",), ONE)
    assert not np.isfinite(upper_constants(curve, np.array([[0.0, 1.0]]))[0])


@pytest.mark.parametrize(("f", "c"), [("x/(1+x**2)", np.nan), ("x/(1+x**4)", np.nan), ("arcsinh(x)", 1.0)])
def test_a_ratio_that_rises_to_the_end_has_no_bound_between(f: str, c: float) -> None:
    """Beside sinh samples end at 230, where the ratio of x/(1+x^2) is 5.4, and rises for ever; arcsinh nears 1."""
    curve = Curve((f, "sinh(x)"), (Fraction(1), Fraction(1)))
    np.testing.assert_equal(upper_constants(curve, np.array([[0.0, 1.0, 0.0]])), [c])
