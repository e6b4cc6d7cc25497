"""How far plants may be from a model: the bounds from above, and the search."""

import numpy as np
import pytest

import persid as ps
from persid.lyapunov.margins import Residuals, complex_radius, known_equations, largest_margin, resting_bound
from persid.lyapunov.operating_points import find_operating_point
from persid.lyapunov.rates import Question
from persid.lyapunov.shifted_model import Setting


def _largest(model: ps.PersidskiiModel) -> tuple[float, float]:
    """The largest margin that is found, and the complex stability radius."""
    setting = Setting.of(model, find_operating_point(model, model.u_ref)[0])
    question = Question(setting.system, setting.pools, setting.upper, setting.below, model.n > 1)
    residuals = Residuals.of(model, model.m)
    radius = complex_radius(setting.jacobian, residuals)
    return largest_margin(question, residuals, 0.0, lambda: np.inf), radius


@pytest.mark.parametrize("seed", range(4))
def test_radius_is_what_frequencies_show(seed: int) -> None:
    """The radius is the least of 1 / |(jw - J)^-1 L| over a fine grid of frequencies, to the grid's error."""
    rng = np.random.default_rng(seed)
    n = 1 + seed % 4
    J = rng.normal(size=(n, n))
    J -= (np.linalg.eigvals(J).real.max() + rng.uniform(0.1, 1.0)) * np.eye(n)
    free = rng.random(n) < 0.7
    free[0] = True
    width = rng.uniform(0.5, 2.0, n)
    scaled, L = J / width[:, None] * width, np.eye(n)[:, free]
    norms = [np.linalg.norm(np.linalg.solve(1j * w * np.eye(n) - scaled, L), 2) for w in np.linspace(0, 8, 2001)]
    assert complex_radius(J, Residuals(width, free, n)) == pytest.approx(1 / max(norms), rel=1e-3)
    assert complex_radius(J + 10 * np.eye(n), Residuals(width, free, n)) == 0.0


@pytest.mark.parametrize("seed", range(2))
def test_margin_of_a_linear_model_is_its_complex_radius(seed: int) -> None:
    """For linear models a quadratic V reaches the complex stability radius: nothing is lost but the bisection's 4 %."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(3, 3))
    A -= (np.linalg.eigvals(A).real.max() + 0.3) * np.eye(3)
    largest, radius = _largest(ps.PersidskiiModel(A, B=[[1.0], [0.0], [0.0]]))
    assert 0.94 * radius <= largest <= radius


def test_margin_of_a_saturated_model_ends_where_a_plant_rests() -> None:
    """x' = -x - 2 tanh x has the radius 3, but with g = x it may rest far away: the margin stays below the least."""
    model = ps.PersidskiiModel([[-1.0]], [("tanh(x)", None, [[-2.0]])], [[1.0]])
    largest, radius = _largest(model)
    resting = resting_bound(model, model.x_ref, model.u_ref, Residuals.of(model, model.m))
    assert radius == pytest.approx(3.0)
    assert 1 < resting <= 1.2  # (x + 2 tanh x) / x, at ten widths and beyond
    assert 0.9 < largest <= 1.0


def test_a_definition_is_no_fit() -> None:
    """x1' = x2 is known exactly, x2' = -x1 - x2 is not; neither is x1' = 2 x2, nor one that an input enters."""
    spring = ps.PersidskiiModel([[0.0, 1.0], [-1.0, -1.0]], B=[[0.0], [1.0]])
    assert known_equations(spring).tolist() == [True, False]
    doubled = ps.PersidskiiModel([[0.0, 2.0], [-1.0, -1.0]], B=[[0.0], [1.0]])
    driven = ps.PersidskiiModel([[0.0, 1.0], [-1.0, -1.0]], B=[[1.0], [1.0]])
    assert not known_equations(doubled).any()
    assert not known_equations(driven).any()
    moved = ps.PersidskiiModel([[0.0, 1.0], [-1.0, -1.0]], B=[[0.0], [1.0]], b=[0.3, 0.0], x_ref=[0.1, 0.3])
    assert known_equations(moved).tolist() == [True, False]
