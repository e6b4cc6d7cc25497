"""The 39-bus grid is that of the publications: its power flow, its inertias, and the model of its ten machines."""

import numpy as np
import pytest

from persid.studies import phasors
from persid.studies.grid import Condition, Grid
from persid.studies.new_england import CASE

GRID = Grid(CASE)
SIZES = [
    1.0393836, 1.0484941, 1.0307077, 1.00446, 1.0060063, 1.0082256, 0.99839728, 0.99787232, 1.038332, 1.0178431,
    1.0133858, 1.000815, 1.014923, 1.012319, 1.0161854, 1.0325203, 1.0342365, 1.0315726, 1.0501068, 0.99101054,
    1.0323192, 1.0501427, 1.0451451, 1.038001, 1.0576827, 1.0525613, 1.0383449, 1.0503737, 1.0501149, 1.0499,
    0.982, 0.9841, 0.9972, 1.0123, 1.0494, 1.0636, 1.0275, 1.0265, 1.03,
]  # fmt: skip
ANGLES = [
    -13.536602, -9.7852666, -12.276384, -12.626734, -11.192339, -10.40833, -12.755626, -13.335844, -14.178442,
    -8.170875, -8.9369663, -8.9988236, -8.9299272, -10.715295, -11.345399, -10.033348, -11.116436, -11.986168,
    -5.4100729, -6.8211783, -7.6287461, -3.1831199, -3.3812763, -9.9137585, -8.3692354, -9.4387696, -11.362152,
    -5.9283592, -3.1698741, -7.3704746, 0.0, -0.1884374, -0.19317445, -1.631119, 1.7765069, 4.4684374, -1.5828988,
    3.8928177, -14.535256,
]  # fmt: skip


def test_power_flow_is_the_published_one() -> None:
    """Voltages and angles at all 39 buses are those printed with the data, to all of their digits."""
    assert np.abs(CASE.voltages) == pytest.approx(SIZES, abs=6e-7)
    assert np.angle(CASE.voltages, deg=True) == pytest.approx(ANGLES, abs=6e-6)


def test_generation_is_the_published_one() -> None:
    """The machine at bus 31 balances with 677.871 MW, and all give the printed reactive powers."""
    reactive = [78.4674, 221.574, 206.965, 108.293, 166.688, 210.661, 100.165, -1.36945, 21.7327, 161.762]
    assert 100 * CASE.generated[1].real == pytest.approx(677.871, abs=1e-3)
    assert 100 * CASE.generated.imag == pytest.approx(reactive, abs=1e-3)


def test_load_is_the_published_one() -> None:
    """All loads together take 6254 MW, of which the losses of 43.6 MW are apart."""
    assert CASE.nominal.sum() == pytest.approx(6254.23)
    assert 100 * CASE.generated.real.sum() - CASE.nominal.sum() == pytest.approx(43.64, abs=0.01)


def test_machines_rest_and_are_damped() -> None:
    """Nothing moves at the power flow; nine swings of 0.6 to 1.6 Hz are damped, every one at 0.25 1/s."""
    model = GRID.model()
    assert np.abs(model.rhs(GRID.rest)).max() < 1e-9
    modes = np.linalg.eigvals(model.jacobian(GRID.rest))
    swings = np.sort(modes.imag[modes.imag > 0]) / (2 * np.pi)
    assert len(swings) == 9
    assert swings[[0, -1]] == pytest.approx([0.615, 1.545], abs=2e-3)
    assert modes.real[modes.imag > 0] == pytest.approx(-0.25, abs=1e-9)


def test_the_model_is_the_grid() -> None:
    """Without load steps the model and the grid have the same right side, with faults at machines' buses as well."""
    x = GRID.rest + np.random.default_rng(0).normal(0, 5, len(GRID.states))
    for condition in (Condition(), Condition(fault=16), Condition(fault=35), Condition(off=(16, 17))):
        assert GRID.model(condition).rhs(x) == pytest.approx(GRID.rate(condition)(x), rel=1e-10, abs=1e-9)


def test_a_short_circuit_at_a_machine_takes_its_power() -> None:
    """A machine whose bus is short-circuited gives nothing and is tied to no other."""
    Y = GRID.reduced(Condition(fault=35))
    assert np.abs(np.delete(Y[5], 5)).max() == 0.0
    assert Y[5, 5] == pytest.approx(1 / 0.05j)


@pytest.mark.long
def test_free_runs_foretell_new_short_circuits() -> None:
    """Four minutes of load steps and twenty ring-downs give a model right to 1 % of the swings after new faults."""
    random = np.random.default_rng(1)
    steps = [phasors.load_steps(GRID, 60.0, random) for _ in range(4)]
    faults = (3, 4, 7, 10, 12, 16, 20, 23, 25, 28, 30, 31, 32, 33, 34, 35, 36, 37, 38, 39)
    model = phasors.identify(GRID, [*steps, *(phasors.ring_down(GRID, bus, 0.1, 10.0) for bus in faults)], random)
    for bus in (8, 21, 26):
        record = phasors.ring_down(GRID, bus, 0.12, 5.0)
        size = phasors.rms(GRID, (record.x - GRID.rest) @ phasors.to_shown(GRID).T)
        error = phasors.rms(GRID, phasors.FreeRun.of(GRID, model, record).errors)
        assert error[0] < 0.01 * size[0]
        assert error[1] < 0.015 * size[1]
