"""The univariate prover proves what is true in the list of the specification, and nothing that is false."""

import random
from fractions import Fraction

import pytest
from flint import ctx

from checker.expressions import is_sector_function, odd_part
from persid_check.enclosure import UndefinedError, between
from persid_check.expression import parse
from persid_check.search import memory
from persid_check.search.prover import (
    is_odd,
    prove_bounded,
    prove_bounded_below,
    prove_continuous,
    prove_integral_lower,
    prove_integral_unbounded,
    prove_integral_upper,
    prove_nondecreasing,
    prove_radially_unbounded,
    prove_sector_form,
    prove_strict_sector_form,
    prove_strictly_increasing,
)
from persid_check.search.series import variable
from persid_check.work import allowance, limited

F = Fraction
ONE = (F(0), F(1))
INCREASING = [
    "x",
    "x**3",
    "x**5",
    "sinh(x)",
    "tanh(x)",
    "arctan(x)",
    "softsign(x)",
    "arcsinh(x)",
    "erf(x)",
    "x+sin(x)",
    "exp(x)-1",
    "tanh(50*x)",
    "(x+1)**3-1",
]
MORE_TRUE = [
    "relu(x)",
    "sat(2*x)",
    "deadzone(x)",
    "x*abs(x)",
    "sqrt(abs(x))*x",
    "x/(1+x**2)",
    "x*exp(-x**2)",
    "log1p(x**2)*x",
    "expm1(x)",
]
FALSE = [
    "x**3-x",
    "x**2",
    "sin(x)",
    "cos(x)",
    "1/x",
    "exp(x)",
    "-x",
    "x-1.0001*tanh(x)",
    "tanh(x)-0.9999*x",
    "abs(x)",
    "x**0.5",
    "log1p(x)",
    "tan(x)",
    "x-2",
]
DYADIC_BALL = F(1, 2**30)


@pytest.fixture(autouse=True)
def _fresh():
    """Every test proves anew, at the checker's precision."""
    memory.forget()
    with ctx.workprec(192):
        yield


def curve(*texts: str, alpha: Fraction = Fraction(1)):
    """A curve of functions."""
    return tuple((parse(text), alpha) for text in texts)


@pytest.mark.parametrize("text", INCREASING + MORE_TRUE)
def test_true_sector_functions_are_proved(text: str) -> None:
    """Each true sector function is proved on R, within the steps that a file may take."""
    with limited(allowance(1000)):
        assert prove_sector_form(curve(text), ONE)


@pytest.mark.parametrize("shift", [F(7, 10), F(-23, 10)])
@pytest.mark.parametrize("text", INCREASING)
def test_increasing_functions_are_proved_under_shifts(text: str, shift: Fraction) -> None:
    """Each increasing function stays a sector function about every point of a small ball."""
    assert prove_nondecreasing(curve(text), ONE)
    assert prove_sector_form(curve(text), ONE, None, (shift, DYADIC_BALL))


@pytest.mark.parametrize(
    ("texts", "form"),
    [
        (("sinh(x)", "x**3"), (0, 1, F(-371, 1000))),
        (("tanh(x)",), (1, -1)),
        (("sinh(x)", "x**3"), (-1, 1, F(-1, 6))),
        (("tanh(x)", "x**3"), (-1, 1, F(1, 3))),
        (("relu(x)",), (1, -1)),
        (("sat(x)",), (F(3, 10), F(-3, 10))),
    ],
)
def test_true_forms_are_proved(texts, form) -> None:
    """Each true form of several functions is proved on R."""
    assert prove_sector_form(curve(*texts), form)


@pytest.mark.parametrize("text", FALSE)
def test_false_sector_functions_are_refused(text: str) -> None:
    """No false sector function is proved."""
    assert not prove_sector_form(curve(text), ONE)


@pytest.mark.parametrize("c", [F(3711, 10000), F(3712, 10000), F(37101862, 10**8)])
def test_the_constant_of_sinh_and_cube_is_sharp(c: Fraction) -> None:
    """sinh - c x^3 is refused above the infimum 0.3710186..., of sinh / x^3."""
    assert not prove_sector_form(curve("sinh(x)", "x**3"), (0, 1, -c))
    assert prove_sector_form(curve("sinh(x)", "x**3"), (0, 1, F(-37101, 10**5)))


def test_sine_has_its_sign_on_less_than_a_half_turn() -> None:
    """sin is proved on [-3, 3] and refused on [-4, 4]."""
    assert prove_sector_form(curve("sin(x)"), ONE, (F(-3), F(3)))
    assert not prove_sector_form(curve("sin(x)"), ONE, (F(-4), F(4)))
    assert not prove_sector_form(curve("sin(x)", alpha=F(2)), ONE, (F(-3), F(3)))


def test_a_falling_function_is_refused_under_a_shift() -> None:
    """x^3 - 3 x^2 + 2.5 x is a sector function about 0 and not about 0.8, nor is it nondecreasing."""
    cubic = curve("x**3-3*x**2+2.5*x")
    assert prove_sector_form(cubic, ONE)
    assert not prove_sector_form(cubic, ONE, None, (F(4, 5), DYADIC_BALL))
    assert not prove_nondecreasing(cubic, ONE)


@pytest.mark.parametrize(
    ("text", "c", "shift", "truth"),
    [
        ("x**3", F(1, 4), None, True),
        ("x**3", F(249, 1000), None, False),
        ("x**3", F(789, 1000), (F(1, 2), DYADIC_BALL), True),
        ("x**3", F(788, 1000), (F(1, 2), DYADIC_BALL), False),
        ("tanh(x)", F(1), None, True),
        ("tanh(x)", F(99, 100), None, False),
        ("sinh(x)", F(1, 2), None, True),
        ("sinh(x)", F(49, 100), None, False),
        ("x", F(1, 2), None, True),
        ("x", F(499, 1000), None, False),
        ("cos(x)", F(1), None, False),
    ],
)
def test_upper_bounds_of_integrals(text: str, c: Fraction, shift, truth: bool) -> None:
    """The integral is at most c y f(y) exactly for the constants that are large enough."""
    assert prove_integral_upper(curve(text), ONE, c, None, shift) is truth


@pytest.mark.parametrize(("c", "truth"), [(F(47, 10), False), (F(471, 100), True), (F(5), True)])
def test_upper_bounds_of_the_integral_of_sine(c: Fraction, truth: bool) -> None:
    """On [-3, 3], 1 - cos y <= c y sin y needs c = 4.7005, although sin is not monotone there."""
    assert prove_integral_upper(curve("sin(x)"), ONE, c, (F(-3), F(3))) is truth


@pytest.mark.parametrize(("d", "truth"), [(F(442, 1000), True), (F(443, 1000), False), (F(1, 10), True)])
def test_lower_bounds_of_the_integral_of_sine(d: Fraction, truth: bool) -> None:
    """On [-3, 3], 1 - cos y >= d y^2 / 2 needs d <= 0.44222."""
    assert prove_integral_lower(curve("sin(x)"), ONE, d, (F(-3), F(3))) is truth


@pytest.mark.parametrize(
    ("text", "monotone", "strict", "unbounded", "bounded", "integral"),
    [
        ("x", 1, 1, 1, 0, 1),
        ("x**3", 1, 1, 1, 0, 1),
        ("(x+1)**3-1", 1, 1, 1, 0, 1),
        ("x+sin(x)", 1, 1, 1, 0, 1),
        ("tanh(x)", 1, 1, 0, 1, 1),
        ("arcsinh(x)", 1, 1, 1, 0, 1),
        ("exp(x)-1", 1, 1, 0, 0, 1),
        ("relu(x)", 1, 0, 0, 0, 0),
        ("deadzone(x)", 1, 0, 1, 0, 0),
        ("sat(x)", 1, 0, 0, 1, 1),
        ("x/(1+x**2)", 0, 0, 0, 1, 1),
        ("x/(1+x**4)", 0, 0, 0, 1, 0),
        ("sin(x)", 0, 0, 0, 1, 0),
    ],
)
def test_properties(text: str, monotone: int, strict: int, unbounded: int, bounded: int, integral: int) -> None:
    """Monotonicity, (un)boundedness and the integral's divergence are proved where true and only there."""
    c = curve(text)
    assert prove_nondecreasing(c, ONE) is bool(monotone)
    assert prove_strictly_increasing(c, ONE) is bool(strict)
    assert prove_radially_unbounded(c, ONE) is bool(unbounded)
    assert prove_bounded(c, ONE) is bool(bounded)
    assert prove_integral_unbounded(c, ONE) is bool(integral)


def test_strict_sector_functions_vanish_only_at_zero() -> None:
    """tanh is strict; a dead zone and relu are not, nor is sin on [-4, 4]."""
    assert prove_strict_sector_form(curve("tanh(x)"), ONE)
    assert not prove_strict_sector_form(curve("deadzone(x)"), ONE)
    assert not prove_strict_sector_form(curve("relu(x)"), ONE)


def test_bounded_below_on_one_side_is_not_both() -> None:
    """exp is bounded below and -exp is not; -tanh is; -arcsinh and -log growth is not."""
    assert prove_bounded_below(curve("exp(x)"), ONE)
    assert not prove_bounded_below(curve("exp(x)"), (F(0), F(-1)))
    assert prove_bounded_below(curve("tanh(x)"), (F(0), F(-1)))
    assert not prove_bounded_below(curve("arcsinh(x)"), (F(0), F(-1)))
    assert prove_bounded_below(curve("x**2-sinh(x/8)*x"), (F(0), F(-1)))


@pytest.mark.parametrize(
    "text", ["1/x", "tan(x)", "x**0.5", "log1p(x)", "1/(x-1)", "sinh(x)/x", "x**(-2)".replace("(", "").replace(")", "")]
)
def test_discontinuous_functions_are_refused(text: str) -> None:
    """What is not defined, continuous and finite on all of R is not proved continuous."""
    assert not prove_continuous(curve(text))


def test_a_pole_outside_the_interval_does_no_harm() -> None:
    """tan is continuous on [-1.5, 1.5] and not on [-1.6, 1.6]."""
    assert prove_continuous(curve("tan(x)"), (F(-3, 2), F(3, 2)))
    assert not prove_continuous(curve("tan(x)"), (F(-8, 5), F(8, 5)))


@pytest.mark.parametrize(
    ("name", "kink", "low", "high"),
    [
        ("abs", 0, -1, 1),
        ("relu", 0, 0, 1),
        ("sat", 1, 0, 1),
        ("sat", -1, 0, 1),
        ("deadzone", 1, 0, 1),
        ("deadzone", -1, 0, 1),
    ],
)
def test_the_slope_at_a_kink_holds_both_sides(name: str, kink: int, low: int, high: int) -> None:
    """At a kink itself, and on any interval about it, the slope is the hull of both sides; beside it, one value."""
    about = [between(F(kink), F(kink)), between(F(kink) - F(1, 8), F(kink) + F(1, 8))]
    assert [(part.apply(f"{name}'").lo, part.apply(f"{name}'").hi) for part in about] == [(low, high)] * 2
    beside = [between(F(kink), F(kink) + F(1, 8)), between(F(kink) - F(1, 8), F(kink))]
    slopes = [part.apply(f"{name}'") for part in beside]
    assert all(slope.lo == slope.hi for slope in slopes)
    assert {int(float(slope.lo)) for slope in slopes} == {low, high}


def test_hard_expressions_end_soon() -> None:
    """Expressions made to be hard are answered within the steps that a file may take."""
    for text in (
        "sin(1000*x)*x",
        "(" * 60 + "x" + "**64)" * 60,
        "exp(exp(exp(exp(x))))",
        "x*sin(x)**2+x/1e300",
        "sin(exp(x))+x",
    ):
        with limited(allowance(1000)):
            prove_sector_form(curve(text), ONE)


def _shares(count: int, seed: int) -> tuple[int, int, int]:
    """Among random expressions: false ones proved, true ones, true ones proved."""
    choose = random.Random(seed)
    wrong = true = proved = done = 0
    while done < count:
        text = odd_part(choose)
        truth = is_sector_function(text)
        if truth is None:
            continue
        done += 1
        answer = prove_sector_form(curve(text), ONE)
        wrong += answer and not truth
        true += truth
        proved += answer and truth
    print(f"{count} expressions: {true} true, {proved} of them proved; {count - true} false, {wrong} of them proved")
    return wrong, true, proved


@pytest.mark.long
def test_random_expressions() -> None:
    """Of 200 random expressions no false one is proved, and more than half of the true ones are."""
    wrong, true, proved = _shares(200, seed=2)
    assert wrong == 0
    assert true >= 50
    assert proved > 0.5 * true


@pytest.mark.slow
def test_many_random_expressions() -> None:
    """Of 5,000 random expressions no false one is proved."""
    assert _shares(5000, seed=3)[0] == 0


@pytest.mark.parametrize(
    ("text", "odd"),
    [
        ("x", True), ("x**3", True), ("x**-1", True), ("x - x", True), ("-sinh(2*x)", True), ("x*abs(x)", True),
        ("x*exp(-x**2)", True), ("tanh(x)/(1 + x**2)", True), ("abs(x)**0.5*x", True), ("sat(x) + deadzone(x)", True),
        ("x**2", False), ("cos(x)", False), ("exp(x)", False), ("x + 1", False), ("relu(x)", False),
        ("x + x**2", False), ("softplus(x) - softplus(-x)", False), ("sin(x + 1)", False), ("abs(x)", False),
    ],
)  # fmt: skip
def test_odd_functions_are_known_by_their_form(text: str, odd: bool) -> None:
    """A function is taken for odd only where its form shows it, so one side may stand for both."""
    assert is_odd(parse(text)) is odd


@pytest.mark.parametrize("kink", [-1, 0, 1])
def test_series_need_distance_from_a_kink(kink: int) -> None:
    """At a kink itself there is no Taylor series, so that a point and an interval about it cannot take two branches."""
    function = {-1: "sat", 0: "abs", 1: "deadzone"}[kink]
    at, beside = (variable(Fraction(kink) + gap, Fraction(kink) + gap) for gap in (Fraction(0), Fraction(1, 1024)))
    with pytest.raises(UndefinedError):
        at.apply(function)
    assert beside.apply(function).coefficients(2)
