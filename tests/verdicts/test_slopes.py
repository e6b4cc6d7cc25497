"""Slopes along solutions: loops of a plant and a function that only they certify, and what is said of them."""

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import persid as ps
from published_problems import BY_NAME, Slope

HOW = "slopes along solutions"
A0 = np.array([[-2.0, -1.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
ROW, COLUMN = np.array([[1.0, -0.2, -0.1]]), np.array([[-1.0], [0.0], [0.0]])
LIMIT = 4.589  # the slope at which the loop loses its stability


def loop(k: float, f: str = "tanh(x)", b: float = 0.0) -> ps.PersidskiiModel:
    """The plant (s^2 - .2s - .1)/(s^3 + 2s^2 + s + 1) with a function of slopes 0 to k fed back."""
    return ps.PersidskiiModel(A0, [(f, k * ROW, COLUMN)], COLUMN, [0.0, b, 0.0])


@cache
def shifted() -> ps.Certificate:
    """The certificate of a loop whose equilibrium is not 0."""
    return ps.certify(loop(3.0, b=0.05), u_op=[0.3]).certificate


@pytest.mark.parametrize("f", ["tanh(x)", "sat(x)"])
def test_a_loop_is_certified_nearly_to_its_limit(f: str) -> None:
    """With kinks or without, slopes along solutions certify what products at one moment do not."""
    verdict = ps.certify(loop(4.4, f))
    assert isinstance(verdict, ps.Certified)
    assert (verdict.certificate.claim, verdict.attempts[-1].what) == ("rate-and-gain", HOW)
    assert "every equilibrium" not in verdict.certificate.statement


def test_beyond_its_limit_a_loop_is_refuted() -> None:
    """One percent beyond, the linearisation is unstable."""
    assert isinstance(ps.certify(loop(1.01 * LIMIT)), ps.Refuted)


def test_signs_units_and_order_change_nothing() -> None:
    """A loop in other coordinates, with the row and the column of other signs, is certified by the same attempt."""
    T = np.array([[0.0, -4.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.0, -1.0]])
    back = np.linalg.inv(T)
    twin = ps.PersidskiiModel(T @ A0 @ back, [("tanh(x)", -4 * ROW @ back, -T @ COLUMN)], T @ COLUMN)
    one, other = ps.certify(loop(4.0)), ps.certify(twin)
    assert isinstance(one, ps.Certified)
    assert isinstance(other, ps.Certified)
    assert other.attempts[-1].what == HOW
    assert other.certificate.rate == pytest.approx(one.certificate.rate, rel=0.15)


def test_bounds_hold_along_runs_whose_inputs_jump() -> None:
    """V reads no input, so it does not jump with one; V and the bound of the state hold along runs of the model."""
    certificate = shifted()
    model, star, (u,) = certificate.model, certificate.operating_point, certificate.input
    rng = np.random.default_rng(0)
    for _ in range(5):
        x, jumps = star + rng.normal(size=3) * 10 ** rng.uniform(-1, 1.5), rng.choice([-1.0, 1.0], 40)
        start, V = x, float(certificate.V(x[None])[0])
        for i, jump in enumerate(jumps):
            x = solve_ivp(lambda t, y, w=u + jump: model.rhs(y, np.array([w])), (0, 0.5), x, rtol=1e-8).y[:, -1]
            assert np.linalg.norm(x - star) <= certificate.bound(start, 1.0, [0.5 * (i + 1)])[0]
        assert float(certificate.stated.p) * np.sum((start - star) ** 2) <= V


def test_V_is_enclosed_with_the_values_that_it_reads() -> None:
    """The overshoot encloses V, which reads the function's value less that at the operating point."""
    certificate = shifted()
    assert certificate.P.shape == (4, 4)
    for x in np.random.default_rng(1).normal(size=(20, 3)) * 3:
        V = float(certificate.V(x[None])[0])
        assert certificate.overshoot(x) ** 2 * float(certificate.stated.p) == pytest.approx(V, rel=0.02)
        assert certificate.overshoot(x) ** 2 * float(certificate.stated.p) >= V * (1 - 1e-9)


def test_a_function_of_unbounded_slope_is_not_asked() -> None:
    """A cube has no bounded slope: the attempt is not made, and what it would certify stays undecided."""
    cubic = ps.PersidskiiModel([[0, 1], [-1, 0.5]], [("x**3", [[0, 1.0]], [[0], [-1.0]])], [[0.0], [1.0]])
    assert HOW not in [attempt.what for attempt in ps.certify(cubic).attempts]


def test_a_badly_scaled_plant_is_certified_ten_times_as_far() -> None:
    """The published plant of seven states, its coefficients over nine powers of ten, goes from a slope of 5.8 to 60."""
    problem = BY_NAME["plant of seven states"]
    assert isinstance(problem, Slope)
    assert ps.certify(problem.family(58.0)).is_certified
