"""Integration: runs end, and end honestly, whatever the model."""

import numpy as np
import pytest

from persid.identification.free_runs import free_run_score
from persid.measurements.trajectories import Trajectories
from persid.models import integration as integrate
from persid.models.model import PersidskiiModel

T = np.linspace(0, 2, 201)
WHITE = np.random.default_rng(0).normal(size=(201, 1))


def run(model: PersidskiiModel, x0: float = 1.0, u: np.ndarray | None = None):
    """Return the run of a model from x0 in every state."""
    return model.simulate(np.full(model.n, x0), T, u)[0]


@pytest.mark.parametrize("f", ["sinh(x)", "x**3"])
def test_blow_ups_end_at_their_time(f):
    """x' = f(x) from 1 blows up at the time that its integral gives, though times do not resolve the blow-up."""
    exact = {"sinh(x)": -np.log(np.tanh(0.5)), "x**3": 0.5}[f]
    found = run(PersidskiiModel([[0.0]], [(f, None, [[1.0]])], [[0.0]]))
    assert found.diverged_at == pytest.approx(exact, rel=1e-6)
    assert found.stopped_at is None
    assert len(found) == np.searchsorted(T, exact)


def test_an_unstable_sinh_model_ends_soon(monkeypatch):
    """A saddle of sinh functions under a white input ends as a divergence, long before its budget is spent."""
    looks, drift = [], integrate._Solver.drift
    monkeypatch.setattr(integrate._Solver, "drift", lambda solver, x: looks.append(None) or drift(solver, x))
    saddle = PersidskiiModel(
        np.diag([0.3, 0.2]), [("sinh(x)", [[4.0, 0], [0, 4.0]], [[-1.0, 3], [2, -1]])], [[1.0], [0.5]]
    )
    assert run(saddle, u=WHITE).diverged_at < 1
    assert len(looks) < integrate.BUDGET / 10


@pytest.mark.long
@pytest.mark.parametrize("rate", [1e4, 1e12, 1e30])
@pytest.mark.parametrize("u", [None, WHITE])
def test_stiff_and_bounded_is_no_divergence(rate, u):
    """x' = rate (u - x) is followed to its end, however stiff: x takes on the input."""
    found = run(PersidskiiModel([[-rate]], [], [[rate]]), u=u)
    assert (found.diverged_at, found.stopped_at, len(found)) == (None, None, len(T))
    held = np.zeros(len(T)) if u is None else u[:, 0]
    assert found.x[1:, 0] == pytest.approx(held[:-1], abs=0.01)


@pytest.mark.parametrize("x0", [30.0, 400.0, 600.0])
def test_stiff_sinh_models_are_followed(x0):
    """x' = -sinh(x) comes down from any height, also where sinh is too large for a float's square."""
    found = run(PersidskiiModel([[0.0]], [("sinh(x)", None, [[-1.0]])], [[0.0]]), x0)
    assert (found.diverged_at, found.stopped_at) == (None, None)
    assert found.x[-1, 0] == pytest.approx(2 * np.arctanh(np.exp(-T[-1])), rel=1e-4)


def test_a_budget_stops_a_run_that_is_too_fast(monkeypatch):
    """A bounded oscillation of 1e9 rad/s is stopped by the budget, not called a divergence; the score says so."""
    monkeypatch.setattr(integrate, "BUDGET", 2000)
    monkeypatch.setattr(integrate, "BUDGET_PER_SAMPLE", 10)
    model = PersidskiiModel([[0, 1e9], [-1e9, 0]], B=[[1.0], [0.0]])
    found = run(model)
    assert found.diverged_at is None
    assert 0 < found.stopped_at < T[1]
    assert len(found) == 1
    data = Trajectories.from_arrays(np.ones((201, 2)), np.zeros((201, 1)), t=T)
    scored = free_run_score(model, data)
    assert (scored.blow_ups, scored.unfinished) == (0, 1)
