"""What synchrophasors would show of the nine-bus grid, and the model that is identified from it."""

import numpy as np
import pytest

import persid as ps
from persid.studies import phasors
from persid.studies.grid import Condition, Grid
from persid.studies.nine_bus import CASE
from persid.studies.phasors import FreeRun, Record

GRID = Grid(CASE)


@pytest.fixture(scope="module")
def model() -> ps.PersidskiiModel:
    """The model that half a minute of load steps and three short circuits give."""
    random = np.random.default_rng(1)
    rings = [phasors.ring_down(GRID, bus, 0.1, 4.0) for bus in (5, 7, 9)]
    return phasors.identify(GRID, [phasors.load_steps(GRID, 24.0, random), *rings], random)


def test_noise_is_what_is_said() -> None:
    """Angles have noise of 0.02 degrees a machine, frequencies of 1 mHz, and the third angle is measured like them."""
    t = np.arange(20_000) / phasors.FRAMES
    still = Record(t, np.tile(GRID.rest, (len(t), 1)), np.zeros((len(t), 3)))
    noise = still.measured(GRID, np.random.default_rng(0)) - phasors.from_states(GRID) @ GRID.rest
    assert noise[:, :5].std(axis=0) == pytest.approx(np.sqrt(2) * np.array([0.02, 0.02, 0.02, 1e-3, 1e-3]), rel=0.03)
    assert noise[:, 1] - noise[:, 0] == pytest.approx(-noise[:, 2], abs=1e-9)
    assert 5e-4 < noise[:, 5].std() < 1e-3


def test_load_steps_change_the_grid() -> None:
    """In a record the loads' admittances change, by 25 % at most, and the frame in which a step comes says so."""
    record = phasors.load_steps(GRID, 9.0, np.random.default_rng(0))
    assert np.abs(record.u / CASE.nominal).max() <= phasors.LARGEST_STEP
    changes = np.flatnonzero(np.abs(np.diff(record.u, axis=0)).max(axis=1)) + 1
    assert changes.tolist() == [240, 480]
    loads = (1 + record.u[300] / CASE.nominal).tolist()
    slope = GRID.rate(Condition(tuple(loads)))(record.x[300])
    assert (record.x[301] - record.x[299]) * 30 == pytest.approx(slope, rel=0.02, abs=0.02)


def test_the_equations_are_found(model: ps.PersidskiiModel) -> None:
    """The sines are found to 3 % of the largest, the damping to 0.03 1/s, the rows of angles exactly."""
    true = GRID.model()
    assert (model.A0[:2, :2] == 0).all()
    assert (model.A0[:2, 2:] == GRID.kinematics).all()
    assert model.A0[2:, 2:] == pytest.approx(true.A0[2:, 2:], abs=0.03)
    for found, known in zip(model.terms, true.terms, strict=True):
        assert np.abs(found.R - known.R).max() < 1e-12
        assert np.abs(found.A - known.A).max() < 0.03 * np.abs(true.terms[0].A).max()
    assert np.abs(model.B - true.B).max() < 0.05 * np.abs(true.B).max()


def test_free_runs_foretell_a_new_short_circuit(model: ps.PersidskiiModel) -> None:
    """After a short circuit that the fit has not seen angles are foretold within 1 % of how far they go."""
    record = phasors.ring_down(GRID, 8, 0.15, 3.0)
    run = FreeRun.of(GRID, model, record)
    size = np.abs((record.x - GRID.rest) @ phasors.to_shown(GRID).T)[:, :3].max()
    assert phasors.rms(GRID, run.errors)[0] < 0.01 * size


def test_frequencies_between_machines_stand_alone(model: ps.PersidskiiModel) -> None:
    """The model of angles and frequencies between machines is the first four rows of that of all states."""
    x, u = np.array([40.0, -10.0, 0.5, -0.3, 0.2]), np.array([10.0, -5.0, 2.0])
    assert phasors.relative(model).rhs(x[:4], u) == pytest.approx(model.rhs(x, u)[:4], rel=1e-12)
