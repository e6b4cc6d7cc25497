"""What windows of measurements say about a plant, and how sure they are: known truth, and alarms."""

import numpy as np
import pytest
from benchmarks.plants import CASES, KINDS, answers, measured

import persid as ps
from persid.errors import UnderdeterminedError
from persid.identification.estimates import Dictionary, estimate, every_second, windows_of

RUNS = 12


def test_bands_cover_a_plant_that_noise_acts_on() -> None:
    """With instruments bands and ellipsoids of nominal 99 % hold the truth in nearly all runs, no alarm is usual."""
    (usual,), allowed, rung = answers(RUNS, (0.99,), **CASES["process noise .3"])
    assert usual >= 0.8
    assert allowed >= 0.8
    assert max(rung.values()) <= 0.2


def test_without_instruments_they_do_not() -> None:
    """Least squares is biased where noise acts on the plant: its bands miss the truth, however narrow they are."""
    (usual,), *_ = answers(RUNS, (0.99,), **CASES["process noise .3, without instruments"])
    assert usual <= 0.2


@pytest.mark.parametrize(
    ("case", "kinds"),
    [
        ("an input that varies between samples, taken as held", ("hold",)),
        ("a cubic force that the functions do not have", ("quadrature", "residual correlation", "over-identification")),
        ("a slow force that nobody measured", ("residual correlation", "over-identification")),
    ],
)
def test_alarms_ring_where_an_assumption_fails(case: str, kinds: tuple[str, ...]) -> None:
    """A wrong hold, a missing function, a force with a memory: in most runs one of the alarms for it rings."""
    *_, rung = answers(6, (0.99,), **CASES[case])
    assert set(rung) == set(KINDS)
    assert max(rung[kind] for kind in kinds) >= 0.5


def test_exact_data_give_the_coefficients() -> None:
    """Without noise the estimate is the truth, to the error of Simpson's rule, with and without instruments."""
    model = ps.PersidskiiModel([[-1.0, 0.5], [-0.5, -1.0]], [("tanh(x)", None, -0.5 * np.eye(2))], [[1.0], [0.5]])
    t = 0.02 * np.arange(1500)
    u = np.repeat(np.random.default_rng(0).normal(size=(75, 1)), 20, axis=0)
    data = model.simulate([1.0, -1.0], t, u)
    phi = Dictionary(model)
    for instruments in (True, False):
        found = estimate(windows_of(data, phi, 2, "zoh", instruments), np.ones((phi.size, 2), bool))
        truth = np.vstack([model.A0.T, model.terms[0].A.T, model.B.T, model.b[None]])
        assert np.abs(found.theta - truth).max() < 2e-2


def test_too_few_windows_are_refused() -> None:
    """A short record, or more functions than blocks allow, is refused with what to do."""
    (run,) = measured(1)
    short = run[0][:40]
    phi = Dictionary(ps.PersidskiiModel(-np.eye(2), B=[[1.0], [1.0]]))
    with pytest.raises(UnderdeterminedError, match="measure longer"):
        windows_of([short], phi, 2, "zoh", True)
    windows = windows_of([run[0][:200]], phi, 2, "zoh", False)
    with pytest.raises(UnderdeterminedError, match="fewer functions"):
        estimate(windows, np.ones((windows.blocks, 2), bool))


def test_every_second_sample_keeps_times_and_mean_inputs() -> None:
    """Of a thinned run the times stay, and a held input is the mean of the two that it stands for."""
    (run,) = measured(1)
    (thin,) = every_second(run)
    assert np.array_equal(thin.t, run[0].t[: len(run[0]) - 1 : 2])
    assert thin.u[3, 0] == pytest.approx(run[0].u[6:8, 0].mean())
