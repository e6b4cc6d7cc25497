"""The nine-bus grid is that of the textbooks: its power flow, its reductions and its critical clearing time."""

import numpy as np
import pytest

from persid.studies.grid import NORMAL, Condition, Grid
from persid.studies.nine_bus import CASE

GRID = Grid(CASE)


def test_power_flow_is_the_published_one() -> None:
    """Voltages, angles and reactive powers are those of Anderson and Fouad, figure 2.19, and losses 4.6 MW."""
    V = CASE.voltages
    assert np.abs(V[3:]) == pytest.approx([1.026, 0.996, 1.013, 1.026, 1.016, 1.032], abs=5e-4)
    angles = [0.0, 9.3, 4.7, -2.2, -4.0, -3.7, 3.7, 0.7, 2.0]
    assert np.angle(V, deg=True) == pytest.approx(angles, abs=0.05)
    injected = V * (CASE.admittances() @ V).conj()
    assert injected[:3] == pytest.approx([0.716 + 0.270j, 1.63 + 0.067j, 0.85 - 0.109j], abs=1e-3)
    assert injected.real.sum() == pytest.approx(0.0464, abs=1e-4)


def test_internal_voltages_are_the_published_ones() -> None:
    """The voltages behind the transient reactances are 1.0566, 1.0502 and 1.0170 at 2.27, 19.73 and 13.17 degrees."""
    assert np.abs(GRID.E) == pytest.approx([1.0566, 1.0502, 1.0170], abs=1e-4)
    assert np.angle(GRID.E, deg=True) == pytest.approx([2.2717, 19.7315, 13.1664], abs=2e-3)


@pytest.mark.parametrize(
    ("condition", "published"),
    [
        (NORMAL, [0.846 - 2.988j, 0.287 + 1.513j, 0.210 + 1.226j, 0.420 - 2.724j, 0.213 + 1.088j, 0.277 - 2.368j]),
        (Condition(fault=7), [0.657 - 3.816j, 0, 0.070 + 0.631j, -5.486j, 0, 0.174 - 2.796j]),
    ],
)
def test_reduced_admittances_are_the_published_ones(condition: Condition, published: list[complex]) -> None:
    """Kron reduction before and during a short circuit at bus 7 gives the table of Anderson and Fouad."""
    assert GRID.reduced(condition)[np.triu_indices(3)] == pytest.approx(published, abs=1.5e-3)


def test_the_grid_rests_at_its_power_flow() -> None:
    """Nothing moves at the angles of the power flow, and every eigenvalue there is damped."""
    model = GRID.model()
    assert np.abs(model.rhs(GRID.rest)).max() < 1e-9
    assert np.linalg.eigvals(model.jacobian(GRID.rest)).real.max() < -0.2


def test_the_model_is_the_grid() -> None:
    """Without load steps the model and the grid have the same right side, in every condition of the network."""
    x = np.array([70.0, -40.0, 1.0, -2.0, 0.3])
    for condition in (NORMAL, Condition((1.2, 0.8, 1.1)), Condition(fault=8), Condition(off=(5, 7))):
        assert GRID.model(condition).rhs(x) == pytest.approx(GRID.rate(condition)(x), rel=1e-12)


def test_load_steps_enter_to_first_order() -> None:
    """What the model says of a load step differs from what the admittances do by a share that falls with the step."""
    model, errors = GRID.model(), []
    for share in (0.1, 0.01):
        exact = GRID.rate(Condition((1 + share, 1.0, 1.0)))(GRID.rest)
        told = model.rhs(GRID.rest, np.array([share * 125, 0, 0]))
        errors.append(float(np.abs(told - exact).max() / np.abs(exact).max()))
    assert errors[0] < 0.1
    assert errors[1] < 0.02
    assert errors[1] < 0.15 * errors[0]


def test_frequencies_of_the_machines() -> None:
    """The centre of inertia is the mean of the machines' frequencies, by inertia."""
    f = GRID.to_machines @ np.array([0.2, -0.1, 0.05])
    assert CASE.H @ f / CASE.H.sum() == pytest.approx(0.05)
    assert [f[1] - f[0], f[2] - f[0]] == pytest.approx([0.2, -0.1])


def test_textbook_clearing_time() -> None:
    """Undamped, a short circuit at bus 7 must be cleared within the textbook's 0.162 s by opening line 5-7."""
    assert Grid(CASE, damping=0.0).critical_clearing(7, Condition(off=(5, 7))) == pytest.approx(0.162, abs=1.5e-3)
