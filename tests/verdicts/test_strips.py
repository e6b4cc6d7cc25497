"""Regions whose bounds the search chooses."""

import numpy as np
import pytest

import persid as ps
from persid.certificates import bounds

pytestmark = pytest.mark.long


def test_the_basin_of_a_cube_is_found_without_being_told() -> None:
    """x' = -x + x^3 rests at -1 and 1: almost all between is certified, nothing beyond."""
    verdict = ps.certify(ps.PersidskiiModel([[-1.0]], [("x**3", None, [[1.0]])], [[1.0]]), domain="auto")
    assert isinstance(verdict, ps.Certified)
    certificate = verdict.certificate
    assert certificate.claim == "region"
    assert bounds.is_in_region(certificate.stated, np.array([0.985]))
    assert not bounds.is_in_region(certificate.stated, np.array([1.0]))


def test_all_states_are_the_largest_region() -> None:
    """Where a claim for all states is proved, nobody gets a smaller region; where a run escapes, a region."""
    whole = ps.certify(ps.PersidskiiModel([[-1.0]], [("x**3", None, [[-1.0]])], [[1.0]]), domain="auto")
    assert isinstance(whole, ps.Certified)
    assert whole.certificate.scope == "global"


def test_a_strip_reads_what_its_function_reads() -> None:
    """A saturated feedback around an unstable plant is bounded by a strip of the feedback, not by a box of states."""
    K = np.array([[1.2231, -2.2486]])
    A0, B = np.array([[0.6, -0.8], [0.8, 0.6]]), np.array([[2.0], [4.0]])
    certificate = ps.certify(ps.PersidskiiModel(A0, [("sat(x)", K, B)], B), domain="auto").certificate
    ((row, low, high),) = certificate.stated.strips
    assert [float(row[i]) for i in (0, 1)] == K[0].tolist()
    assert low == -high
    assert high > 1  # beyond the corner of the saturation


def test_a_region_is_about_a_stable_point() -> None:
    """A double well has none about 0, where it is unstable; one about a well is certified."""
    verdict = ps.certify(ps.PersidskiiModel([[1.0]], [("x**3", None, [[-1.0]])], [[1.0]]), domain="auto")
    assert isinstance(verdict, ps.Certified)
    assert abs(verdict.certificate.operating_point[0]) == pytest.approx(1.0)


def test_a_strip_ends_before_its_function_does() -> None:
    """x' = 1 - sqrt(x) + u rests at 1: strips stay where the root is defined, and no box has to be named."""
    model = ps.PersidskiiModel([[0.0]], [("sqrt(x)", None, [[-1.0]])], [[1.0]], b=[1.0])
    certificate = ps.certify(model, domain="auto").certificate
    ((_, low, high),) = certificate.stated.strips
    assert 1 + low > 0
    assert high > 0.9


def test_a_region_of_strips_bounds_the_outputs() -> None:
    """Of a pendulum whose angle is the output, the angle is bounded in its own unit, and no latent gain is shown."""
    pendulum = ps.PersidskiiModel([[0, 1], [0, -0.5]], [("sin(x)", [[1, 0]], [[0], [-1.0]])], [[0.0], [1.0]])
    certificate = ps.certify(ps.OutputModel(pendulum, [[1.0, 0.0]], outputs=["angle"]), domain="auto").certificate
    assert (certificate.claim, certificate.outputs, certificate.gain) == ("region", ("angle",), None)
    t = np.linspace(0, 20, 201)
    bound = certificate.output_bound([1.0, 0.0], 0.0, t)
    run = pendulum.simulate([1.0, 0.0], t, np.zeros((201, 1)))[0]
    assert (np.abs(run.x[:, :1]) <= bound).all()


def test_functions_of_one_argument_keep_their_own_bounds_on_narrow_strips() -> None:
    """x' = -2 sin x + x^3 / 2 - x / (10 (1 + x)), read in both directions, is certified on almost all of |x| < 1."""
    terms = [("sin(x)", [[-1.0], [1.0]], [[1.0, -1.0]]), ("-x**3", [[-0.8]], [[1.0]]), ("x/(1+x)", None, [[-0.1]])]
    certificate = ps.certify(ps.PersidskiiModel([[-0.5]], terms, [[1.0]]), domain="auto").certificate
    assert bounds.is_in_region(certificate.stated, np.array([-0.9]))
    assert not bounds.is_in_region(certificate.stated, np.array([-1.0]))


@pytest.mark.parametrize(
    ("a0", "terms", "end"),
    [
        (-1.09, [("deadzone(x)", 1.1, -0.76), ("arctan(x)", 0.6, 0.81), ("exp(x)-1", 0.8, 0.36)], 3.3079),
        (-0.47, [("cos(x)-1", 1.1, 0.09), ("softsign(x)", 1.8, 0.17), ("x**5", 1.3, 0.09)], 0.9822),
        (0.25, [("exp(x)-1", 1.6, -0.44), ("x**3", 1.3, 0.54), ("deadzone(x)", 0.8, -0.24)], 0.4581),
    ],
)
def test_sums_of_functions_keep_their_own_sector(a0, terms, end) -> None:
    """Up to the next place of rest nearly all is certified, whatever each function does apart from their sum."""
    model = ps.PersidskiiModel([[a0]], [(f, [[s]], [[a]]) for f, s, a in terms], [[1.0]])
    certificate = ps.certify(model, domain="auto", operating_point=[0.0]).certificate
    assert bounds.is_in_region(certificate.stated, np.array([0.97 * end]))
    assert bounds.is_in_region(certificate.stated, np.array([-0.97 * end]))
    assert not all(bounds.is_in_region(certificate.stated, np.array([s * 1.001 * end])) for s in (1, -1))
