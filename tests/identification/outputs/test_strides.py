"""Records that are sampled far faster than they change."""

import numpy as np
import pytest

from persid.identification.outputs import least_squares, runs, starts, strides
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.least_squares import Task
from persid.identification.outputs.records import Pieces
from persid.identification.outputs.selection import Candidate, Winner


@pytest.mark.parametrize("noise", [0.0, 0.02, 0.3])
def test_slow_outputs_are_thinned_whatever_their_noise(noise):
    """A sine of 300 samples a period is thinned to 10 to 50 of them; white noise on it does not stop that."""
    rng, y = np.random.default_rng(0), np.sin(2 * np.pi * np.arange(6000) / 300)[:, None]
    found = strides.stride_of([(y, y + noise * rng.normal(size=y.shape))], 100)
    assert 6 <= found <= 30
    assert strides.stride_of([(y, y)], 4) == 4


def test_one_fast_output_keeps_every_sample():
    """Ten samples a period are not thinned, nor where another output is slow."""
    fast, slow = (np.sin(2 * np.pi * np.arange(4000) / period)[:, None] for period in (10, 400))
    assert strides.stride_of([(slow, fast)], 100) == 1
    assert strides.stride_of([(slow, np.hstack([slow, fast]))], 100) == 1


def test_held_inputs_are_averaged_and_lines_are_not():
    """Every third sample: held inputs give their mean until the next one, the last of them over what is left."""
    u, y = np.arange(7.0)[:, None], 10 * np.arange(7.0)[:, None]
    assert strides.thinned((u, y), 3, "zoh")[0].ravel().tolist() == [1.0, 4.0, 6.0]
    assert strides.thinned((u, y), 3, "foh")[0].ravel().tolist() == [0.0, 3.0, 6.0]
    assert strides.thinned((u, y), 3, "zoh")[1].ravel().tolist() == [0.0, 30.0, 60.0]


@pytest.mark.parametrize("stable", [True, False])
def test_a_model_of_every_fourth_sample_is_the_same_at_full_rate(stable):
    """The model that was fitted to every fourth sample runs at its rates divided by four."""
    rng, n, q = np.random.default_rng(0), 2, 3
    A = np.array([[[-0.2, 0.5], [-0.5, -0.3]]])
    A1, forces = 0.1 * rng.normal(size=(1, n, q)) * (not stable), np.array([[[1.0, 0.1], [1.0, -0.2]]])
    W = np.concatenate([A, A1, forces], 2)
    V, O = rng.normal(size=(1, q, n + 1)), rng.normal(size=(1, 1, n + 2))  # noqa: E741
    latent = Latent(W, V, O, rng.normal(size=(1, 1, n)), np.zeros((1, q, 0)))
    if stable:
        parameters, batch, _ = starts.stable_batch(latent, starts.Freedom(True), 0.05)
        batch.w[:] += 0.05 * rng.normal(size=batch.w.shape)
    else:
        parameters, batch = starts.free_batch(latent, starts.Freedom(True))
    winner = Winner(parameters, batch, 0.0, 8, Candidate(n, q, True, 0.0, 0, 0.0, 0.0, 0))
    slow = strides.at_full_rate(winner, 4)
    u = rng.normal(size=(40, 1))
    held, p = np.repeat(u, 4, 0), W.size + V.size + O.size
    fast, every = (
        least_squares.begun(Task(pieces, one.parameters, np.zeros((1, p)), one.substeps), one.batch)
        for one, pieces in (
            (winner, Pieces.of([(u, np.zeros((40, 1)))], length=40)),
            (slow, Pieces.of([(held, np.zeros((160, 1)))], length=4)),
        )
    )
    assert slow.substeps == 2
    samples = runs.swept(winner.latent, Pieces.of([(u, np.zeros((40, 1)))], length=40), fast.start, 8)[:-1:8]
    np.testing.assert_allclose(every.start[0], samples[:, 0, :, 0].T, atol=1e-6)
    found = slow.parameters.latent(slow.batch)[0]
    np.testing.assert_allclose(4 * found.W, winner.latent.W, atol=1e-12)
    if stable:
        proofs = [one.parameters.proved(one.batch) for one in (slow, winner)]
        np.testing.assert_allclose(proofs[0].M, proofs[1].M)
        np.testing.assert_allclose(4 * proofs[0].T, proofs[1].T)
        assert 4 * slow.parameters.shape.kappa == pytest.approx(0.05)
