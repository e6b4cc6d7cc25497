"""Numbers of certificates: rounded outwards, never exceeded, and asked for only where they hold."""

from fractions import Fraction

import numpy as np
import pytest
from flint import arb
from scipy.integrate import quad

import persid as ps
from adversaries import worst_ratio
from persid.certificates import bounds
from questions import PENDULUM, SEVERAL_INPUTS, SHARP

FEW = ("sinh against tanh", "two states, diagonal", "constant force")


@pytest.fixture(scope="module")
def certificates() -> dict[str, ps.Certificate]:
    """Certificates with a rate, one a name."""
    found = {}
    for name in FEW:
        verdict = ps.certify(ps.PersidskiiModel(**SHARP[name]))
        assert isinstance(verdict, ps.Certified)
        found[name] = verdict.certificate
    return found


@pytest.mark.long
@pytest.mark.parametrize("name", FEW)
def test_never_exceeded(certificates: dict[str, ps.Certificate], name: str) -> None:
    """No adversary exceeds the bound, and the gain is within a factor 2.5 of the worst of them."""
    found = certificates[name]
    n = found.model.n
    starts = found.operating_point + np.vstack([np.zeros(n), np.eye(n), -3 * np.eye(n)])
    assert found.rate is not None
    largest, ratio = worst_ratio(found, starts, 1.0, T=6 / found.rate, steps=240)
    assert 0.3 < largest <= 1
    assert 1 <= ratio < 2.5


@pytest.mark.parametrize("name", FEW)
def test_enclosures_hold_V(certificates: dict[str, ps.Certificate], name: str) -> None:
    """The enclosure of V holds the floating-point V, and is narrow."""
    found = certificates[name]
    for x in np.random.default_rng(0).normal(size=(4, found.model.n)) * 2:
        enclosed = bounds.lyapunov(found.stated, x)
        low, high = float(enclosed.lo), float(enclosed.hi)
        assert low - 1e-9 <= found.V(x[None])[0] <= high + 1e-9
        assert high - low <= 1e-3 * high


def test_enclosure_holds_a_quadrature(certificates: dict[str, ps.Certificate]) -> None:
    """For one state V is p x^2 and integrals of the functions, by adaptive quadrature as well."""
    found = certificates["sinh against tanh"]
    density = np.array(found.stated.parts[0].density, float)
    x = 1.7
    integral = quad(lambda s: float(density @ np.array([s, np.sinh(s), np.tanh(s)])), 0, x, epsabs=1e-13)[0]
    V = found.P[0, 0] * x**2 + 2 * integral
    enclosed = bounds.lyapunov(found.stated, np.array([x]))
    assert float(enclosed.lo) - 1e-11 * V <= V <= float(enclosed.hi) + 1e-11 * V


def test_rounding_outwards() -> None:
    """`below` never exceeds a number and `above` never falls short, by one unit at most, also beyond the floats."""
    third = Fraction(1, 3)
    assert Fraction(bounds.below(third)) <= third < Fraction(np.nextafter(bounds.below(third), 1))
    assert bounds.above(arb(2).sqrt()) >= np.sqrt(2)
    assert bounds.above(arb(10) ** 400) == np.inf
    assert bounds.below(Fraction(10) ** 400) < np.inf
    assert bounds.below(-(Fraction(10) ** 400)) == -np.inf


def test_bound_starts_at_the_overshoot(certificates: dict[str, ps.Certificate]) -> None:
    """At t = 0 without input the bound is the overshoot, at the point itself zero, and it falls with the rate."""
    found = certificates["two states, diagonal"]
    x0 = np.array([1.0, -2.0])
    bound = found.bound(x0, 0.0, [0.0, 1.0])
    assert bound[0] == pytest.approx(found.overshoot(x0), rel=1e-12)
    assert found.rate is not None
    assert bound[1] == pytest.approx(bound[0] * np.exp(-found.rate), rel=1e-9)
    assert found.overshoot(found.operating_point) < 1e-6
    assert found.gain is not None
    assert found.bound(found.operating_point, 1.0, [9.0])[0] == pytest.approx(found.gain, rel=1e-5)


def test_wrong_arguments(certificates: dict[str, ps.Certificate]) -> None:
    """States of another length, negative times and sizes of inputs that are no sizes raise."""
    found = certificates["two states, diagonal"]
    for x0, u_sup, t in (([1.0], 0.0, [0.0]), ([1.0, np.nan], 0.0, [0.0]), ([1.0, 1.0], -1.0, [0.0])):
        with pytest.raises(ps.ModelError):
            found.bound(x0, u_sup, t)
    with pytest.raises(ps.ModelError):
        found.bound([1.0, 1.0], 0.0, [-1.0])
    with pytest.raises(ps.ModelError):
        found.bound([1.0, 1.0], np.nan, [1.0])


def test_region_is_asked_first() -> None:
    """Outside its region, or for larger inputs, a regional certificate gives no bound."""
    verdict = ps.certify(ps.PersidskiiModel(**PENDULUM), domain=[[-2.0, 2.0], [-6.0, 6.0]])
    assert isinstance(verdict, ps.Certified)
    found = verdict.certificate
    assert found.input_bound is not None
    assert found.bound([0.1, 0.1], found.input_bound, [0.0])[0] > 0
    for x0 in ([1.99, 0.0], [2.5, 0.0], [0.0, 5.9], [2 * np.pi, 0.0]):
        with pytest.raises(ps.PersidError, match="region"):
            found.overshoot(x0)
    with pytest.raises(ps.PersidError, match="exceeds"):
        found.bound([0.1, 0.1], 2 * found.input_bound, [0.0])


def test_no_rate_no_bound() -> None:
    """A certificate without a rate says so."""
    verdict = ps.certify(ps.PersidskiiModel(None, [("x**3", None, [[-1.0]])], [[1.0]]))
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.stated.drops_states
    assert (verdict.certificate.rate, verdict.certificate.gain, verdict.certificate.input_bound) == (None, None, None)
    with pytest.raises(ps.PersidError, match="no rate"):
        verdict.certificate.bound([1.0], 1.0, [0.0])


@pytest.fixture(scope="module")
def units() -> ps.Certificate:
    """A gain for each of two inputs of very different units."""
    verdict = ps.certify(ps.PersidskiiModel(**SEVERAL_INPUTS["inputs of different units"]), gains="each")
    assert isinstance(verdict, ps.Certified)
    return verdict.certificate


@pytest.mark.long
@pytest.mark.parametrize("sizes", [(1.0, 0.0), (0.0, 200.0), (1.0, 200.0)])
def test_gain_of_each_input_is_never_exceeded(units: ps.Certificate, sizes: tuple[float, float]) -> None:
    """With one input alone, or both, no adversary exceeds the bound, which is within a factor 2.5 of the worst."""
    assert units.rate is not None
    starts = np.vstack([np.zeros(2), np.eye(2), -3 * np.eye(2)])
    largest, ratio = worst_ratio(units, starts, np.array(sizes), T=6 / units.rate, steps=240)
    assert 0.3 < largest <= 1
    assert 1 <= ratio < 2.5


def test_gains_add_up(units: ps.Certificate) -> None:
    """A weak input has a small gain; the bound of both is between the larger part and the sum of the parts."""
    gains, late = units.gains, [60.0]
    assert gains is not None
    assert gains[1] < 0.02 * gains[0]
    one, two, both = (units.bound([0, 0], sizes, late)[0] for sizes in ([1.0, 0.0], [0.0, 150.0], [1.0, 150.0]))
    assert one == pytest.approx(gains[0], rel=1e-6)
    assert two == pytest.approx(150 * gains[1], rel=1e-6)
    assert max(one, two) <= both <= (one + two) * (1 + 1e-12)
    assert units.gain == pytest.approx(np.sqrt(np.linalg.eigvalsh(_Gamma(units))[-1]) / _unit(units), rel=1e-2)


def _Gamma(found: ps.Certificate) -> np.ndarray:
    width = found.model.m
    return np.array([[float(v) for v in row] for row in bounds.coupling(found.stated.gamma, width)])


def _unit(found: ps.Certificate) -> float:
    return float(found.stated.kappa * found.stated.p) ** 0.5


def test_inputs_that_act_alike_do_not_pay_for_each_other() -> None:
    """x' = -x + u1 + u2 has two gains near 1, and together exactly their sum."""
    verdict = ps.certify(ps.PersidskiiModel([[-1.0]], [], [[1.0, 1.0]]), gains="each")
    assert isinstance(verdict, ps.Certified)
    found = verdict.certificate
    assert found.gains == pytest.approx([1.0, 1.0], rel=0.03)
    assert found.bound([0.0], [1.0, 1.0], [60.0])[0] == pytest.approx(found.gains.sum(), rel=0.01)


def test_vector_of_inputs_for_a_joint_gain(certificates: dict[str, ps.Certificate]) -> None:
    """A certificate with one gain bounds inputs given one by one as it bounds their Euclidean norm."""
    found = certificates["two states, diagonal"]
    assert found.gains == pytest.approx([found.gain], rel=1e-9)
    x0, t = [1.0, -2.0], [0.0, 2.0]
    assert found.bound(x0, [0.5], t) == pytest.approx(found.bound(x0, 0.5, t), rel=1e-12)
    with pytest.raises(ps.ModelError, match="one for each of 1 inputs"):
        found.bound(x0, [1.0, 2.0], t)


def test_supply_takes_the_worst_signs() -> None:
    """v'Gamma v over a box of v is bounded with every term at its worst sign, exactly."""
    assert bounds.supply(((Fraction(1),), (Fraction(-1), Fraction(2))), [3.0, 1.0]) == 9 + 2 * 3 + 2
    assert bounds.supply(Fraction(3, 2), [3.0, 1.0]) == Fraction(3, 2) * 10


def test_region_admits_each_input_apart() -> None:
    """A regional certificate admits a weak input far beyond the joint bound, and refuses what leaves the region."""
    model = ps.PersidskiiModel(**PENDULUM | {"B": [[0.0, 0.05], [1.0, 0.05]]})
    verdict = ps.certify(model, domain=[[-2.0, 2.0], [-6.0, 6.0]], gains="each")
    assert isinstance(verdict, ps.Certified)
    found = verdict.certificate
    assert found.input_bound is not None
    assert found.bound([0.1, 0.1], [0.0, 2 * found.input_bound], [0.0])[0] > 0
    with pytest.raises(ps.PersidError, match="exceeds"):
        found.bound([0.1, 0.1], [2 * found.input_bound, 0.0], [0.0])
    assert found.input_bounds is not None
    for alone in np.diag(found.input_bounds):
        assert found.bound([0.1, 0.1], alone, [0.0])[0] > 0
        with pytest.raises(ps.PersidError, match="exceeds"):
            found.bound([0.1, 0.1], 1.0001 * alone, [0.0])


def test_no_other_word_for_gains() -> None:
    """Gains are joint, or of each input."""
    with pytest.raises(ps.ModelError, match="joint"):
        ps.certify(ps.PersidskiiModel([[-1.0]], [], [[1.0]]), gains="all")


def test_V_is_a_number_where_a_function_that_it_does_not_use_has_none() -> None:
    """Far out, where exp(x) exceeds all floats, V = p x^2 is what it is."""
    model = ps.PersidskiiModel([[-1.0]], [("0.2*exp(x)", None, [[1.0]])], [[1.0]])
    certificate = ps.certify(model, domain="auto", time_limit=10).certificate
    assert not any(part.density[-1] for part in certificate.stated.parts)
    x = certificate.operating_point + np.array([[1e3], [1.0]])
    far, near = certificate.V(x)
    assert far == pytest.approx(1e6 * near, rel=1e-9)
