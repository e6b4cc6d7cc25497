"""Operating points: found, proved, sorted."""

from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import persid as ps
from persid.lyapunov import operating_points
from persid.lyapunov.operating_points import prove
from persid_check import equilibrium
from persid_check.equilibrium import flow
from persid_check.model import model_of
from questions import PENDULUM, TRAFFIC


@settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))
@given(st.lists(st.integers(-8, 8), min_size=5, max_size=5))
def test_rest(drawn: list[int]) -> None:
    """At a proved point the model rests: F is tiny, and exactly zero where the radius is."""
    a, b, c, d, u = (k / 4 for k in drawn)
    model = ps.PersidskiiModel([[a, b], [-b, -1.0]], [("tanh(x)", None, [[c, 0.0], [0.0, d]])], [[1.0], [0.5]])
    for point in ps.find_operating_point(model, [u]):
        speed = np.abs(model.rhs(point.x, point.u)).max()
        assert speed <= 1e-9
        if point.radius == 0:
            assert speed == 0


def test_nearest_first() -> None:
    """Points are sorted by their distance from x_ref, or from the state that is named."""
    model = ps.PersidskiiModel(**PENDULUM)
    near = [point.x[0] for point in ps.find_operating_point(model)]
    assert near[0] == 0
    assert np.all(np.diff(np.abs(near)) >= -1e-9)
    assert ps.find_operating_point(model, near=[3.0, 0.0])[0].x == pytest.approx([np.pi, 0.0])


def test_constant_input_moves_the_point() -> None:
    """The equilibrium of x' = -x + u for u = 3 is 3, exactly."""
    (point,) = ps.find_operating_point(ps.PersidskiiModel([[-1.0]], [], [[1.0]]), [3.0])
    assert (point.x, point.radius) == (np.array([3.0]), 0.0)


def test_point_with_a_singular_jacobian() -> None:
    """x' = -x^3 rests at 0 exactly, though Newton's method has no slope to use there."""
    (point,) = ps.find_operating_point(ps.PersidskiiModel(None, [("x**3", None, [[-1.0]])], [[1.0]]))
    assert (point.x, point.radius) == (np.array([0.0]), 0.0)


def test_slopes_that_are_singular_everywhere() -> None:
    """Where a whole line is at rest, points of it are found that rest exactly, and nothing ends in an error."""
    model = ps.PersidskiiModel([[-1.0, 1.0], [-1.0, 1.0]])
    points = ps.find_operating_point(model)
    assert len(points) > 1
    assert all(point.radius == 0 and not model.rhs(point.x).any() for point in points)


def test_traffic_has_dozens() -> None:
    """The traffic system with its true right-hand side rests at 20 states or more."""
    model = ps.PersidskiiModel(**TRAFFIC, domain=[[-20.0, 20.0], [-20.0, 20.0]])
    points = ps.find_operating_point(model, starts=128)
    assert len(points) >= 20
    assert min(np.abs(point.x - [2.92225, 1.49289]).max() for point in points) < 1e-4


def test_unproved_point() -> None:
    """A state that is no equilibrium is not proved to be one."""
    model = ps.PersidskiiModel([[-1.0]], [], [[1.0]])
    assert prove(model, np.array([0.5]), np.array([0.0])) is None


@pytest.mark.parametrize("arguments", [{"u": [1.0, 2.0]}, {"u": [np.nan]}, {"near": [1.0, 2.0]}, {"near": "here"}])
def test_wrong_arguments(arguments: dict[str, Any]) -> None:
    """Vectors of a wrong length or with numbers that are not finite raise."""
    with pytest.raises(ps.ModelError, match="needed"):
        ps.find_operating_point(ps.PersidskiiModel([[-1.0]], [], [[1.0]]), **arguments)


@pytest.mark.parametrize("at", [[0.0, 0.0, 0.0], [0.5, 0.0, 0.0], [0.0, 0.25, -1.5]])
@pytest.mark.parametrize("u", [[0.0], [0.75]])
def test_the_flow_is_exact_where_some_offsets_are_zero(at: list[float], u: list[float]) -> None:
    """Products with zero are left out, and what is left is the flow: of dyadic numbers exactly, cubes included."""
    rng = np.random.default_rng(0)
    A0, A, B = (rng.integers(-8, 8, shape) / 4 for shape in ((3, 3), (3, 3), (3, 1)))
    model = ps.PersidskiiModel(A0, [("x**3", None, A)], B, x_ref=[0.0, 0.25, 0.0], b=[0.5, 0.0, -1.0])
    exact = model_of(model.canonical, discrete=True)
    found = flow(exact, [Fraction(v) for v in at], [Fraction(v) for v in u]).entries()
    expected = model.rhs(np.array(at), np.array(u))
    assert all(each == value for each, value in zip(found, expected.tolist(), strict=True))


def test_the_entries_of_matrices_are_not_enclosed_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a model of twice as many states, with n^2 entries, a proof encloses twice as many numbers, not four times."""
    calls: list[Fraction] = []
    enclosed = equilibrium.constant
    monkeypatch.setattr(equilibrium, "constant", lambda v: calls.append(v) or enclosed(v))
    counts = []
    for n in (8, 16):
        A = np.random.default_rng(0).normal(size=(n, n)) / n
        model = ps.PersidskiiModel(A - 2 * np.eye(n), [("tanh(x)", None, A)], np.eye(n)[:, :1], b=np.ones(n))
        found = ps.find_operating_point(model, starts=2)
        calls.clear()
        assert prove(model, found[0].x, found[0].u) is not None
        counts.append(len(calls))
    assert 0 < counts[1] <= 2 * counts[0]


def test_starts_that_have_arrived_are_not_moved_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Newton's method takes few points to the end of the way of the slowest."""
    points: list[int] = []
    slopes = operating_points.residual_slopes
    monkeypatch.setattr(operating_points, "residual_slopes", lambda m, x: points.append(x[..., 0].size) or slopes(m, x))
    assert len(ps.find_operating_point(ps.PersidskiiModel(**PENDULUM))) > 10
    steps = [size for size in points if size > 1]
    assert steps == sorted(steps, reverse=True)
    assert steps[-1] < steps[0] / 4
