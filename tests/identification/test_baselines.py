"""Baselines: one-step maps that are run freely and scored like models."""

import numpy as np
import pytest
from sklearn.base import clone

import places
from persid.errors import DataError
from persid.identification.baselines import OneStepRegressor, arx, polynomial, radial
from persid.measurements.readers import read_csv
from persid.measurements.trajectories import Trajectories
from persid.models.model import PersidskiiModel

TRAFFIC = read_csv(places.TRAFFIC, states=["x1", "x2"], inputs=["u"])


def linear_runs() -> Trajectories:
    """Simulate a linear system with white held inputs from three starts."""
    model = PersidskiiModel([[-1, 0.5], [-0.5, -1]], B=[[1.0], [0.3]])
    rng, t = np.random.default_rng(0), np.arange(200) * 0.1
    runs = [model.simulate(rng.normal(size=2), t, rng.normal(size=(200, 1)))[0] for _ in range(3)]
    return Trajectories(tuple(runs), model.states, model.inputs)


@pytest.mark.parametrize("make", [arx, polynomial])
def test_linear_systems_are_predicted_exactly(make):
    """A map that contains the linear step follows a linear system over whole runs."""
    data = linear_runs()
    assert make(1e-9).fit(data).free_run(data).rmse < 1e-5


@pytest.mark.parametrize("make", [arx, polynomial, radial])
def test_free_runs_of_the_traffic_data_are_scored(make):
    """Every baseline runs freely on the traffic data and is scored with finite figures."""
    score = make(1e-3).fit(TRAFFIC).free_run(TRAFFIC)
    assert np.isfinite(score.rmse)
    assert score.r2 > 0.3
    assert len(score.diverged_at) == 1


def test_a_diverging_map_ends_its_run():
    """A map fitted to growth leaves the box of the data, and the time is named."""
    x = np.exp(np.arange(30) * 0.1)[:, None]
    fit = polynomial(1e-9).fit(Trajectories.from_arrays(x, dt=0.1))
    run = fit.simulate([1.0], np.arange(200) * 0.1)[0]
    assert run.diverged_at is not None
    assert len(run) < 200
    assert np.isfinite(run.x).all()


def test_runs_are_not_paired_across_their_ends():
    """Two runs give two pairs less than their samples joined."""
    data = linear_runs()
    apart = arx(0.0).fit(data)
    assert apart.free_run(data).rmse < 1e-9


def test_radial_functions_are_reproducible():
    """The same seed gives the same map."""
    a, b = (radial(1e-2, seed=3).fit(TRAFFIC).free_run(TRAFFIC).rmse for _ in range(2))
    assert a == b


def test_estimators_can_be_cloned_and_unknown_kinds_are_refused():
    """Baselines are scikit-learn estimators; a wrong kind is named."""
    assert clone(arx(0.5)).get_params() == {"kind": "arx", "ridge": 0.5, "seed": 0}
    with pytest.raises(DataError, match="arx, poly, rbf"):
        OneStepRegressor("other").fit(TRAFFIC)
