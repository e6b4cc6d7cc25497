"""The free runs that are fitted and those of the model that is delivered."""

from dataclasses import replace

import numpy as np
import pytest

import persid as ps
from persid.identification.outputs import refit, runs
from persid.identification.outputs.answer import answered
from persid.identification.outputs.records import Pieces, Scales
from persid.identification.outputs.selection import Question

DT, FINE = 0.25, 16  # s a sample, Runge-Kutta steps in it


def records_of(count: int, hold: str) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return noisy records of a softening spring."""
    spring = ps.PersidskiiModel(
        [[0.0, 1.0], [-1.0, -0.6]], [("tanh(x)", [[1.0, 0.0]], [[0.0], [-1.0]])], [[0.0], [2.0]]
    )
    plant, rng, found = ps.OutputModel(spring, [[1.0, 0.0]], hold=hold), np.random.default_rng(0), []
    for k in range(count):
        u = np.repeat(rng.normal(size=(25, 1)), 4, 0)[: 100 - 17 * k]
        y = plant.simulate(DT * np.arange(len(u)), u, x0=rng.normal(size=2))[0].x
        found.append((u, y + 0.01 * rng.normal(size=y.shape)))
    return found


@pytest.mark.long
@pytest.mark.parametrize("hold", ["zoh", "foh"])
@pytest.mark.parametrize("count", [1, 3])
def test_a_fit_and_its_model_give_the_same_free_runs(count: int, hold: str) -> None:
    """From estimated first states, the fit's own runs are the model's, and so is the error that is told."""
    records = records_of(count, hold)
    answer = answered(
        records, DT, Question(order=2, neurons=1, feedthrough=False, seeds=(0,), ridges=(2e-2,), hold=hold)
    )
    model, scales = ps.OutputModel.from_fit(answer.fit), Scales.of(records)
    x0 = [model.estimate_state(DT * np.arange(len(u)), u, y) for u, y in records]
    pieces = Pieces.of([scales.standardised(record) for record in records], hold)
    latent = replace(refit._standardised(answer.fit, records, scales, DT), x0=np.array(x0)[None])
    still = runs.Guess(np.zeros((1, 2, pieces.count)), np.zeros((1, pieces.count, 2, 2)))
    start = runs.simulated(latent, pieces, still, FINE, sweeps=pieces.count + 1).start
    x = runs.swept(latent, pieces, start, FINE)[:-1:FINE]
    y = (runs.errors(latent, pieces, x)[:, 0] + pieces.y) * scales.y_scale[:, None] + scales.y_mean[:, None]
    square, size = 0.0, 0
    for k, (u, seen) in enumerate(records):
        mine = np.concatenate([y[:, 0, s] for s in np.flatnonzero(pieces.record == k)])[: len(u), None]
        t = DT * np.arange(len(u))
        np.testing.assert_allclose(mine, model.simulate(t, u, x0=x0[k])[0].x, atol=1e-6 * np.ptp(seen))
        own = model.simulate(t, u, x0=answer.fit.x0[k])[0].x
        square, size = square + float((((own - seen) / scales.y_scale) ** 2).sum()), size + len(u)
    assert answer.error == pytest.approx(np.sqrt(square / size), rel=2e-6)
