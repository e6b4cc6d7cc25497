"""Derivatives of free runs against differences, and pieces against one long run."""

from dataclasses import replace

import numpy as np
import pytest

from persid.identification.outputs import runs, sensitivities
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.records import Pieces
from persid.identification.outputs.runs import Guess, errors, simulated, swept
from persid.identification.outputs.sensitivities import normal

N, Q, M, L = 2, 3, 2, 2


def batch(activation: str, output_map: str | None, hardening: int = 0) -> Latent:
    rng = np.random.default_rng(0)
    A = -0.1 * np.eye(N) + 0.05 * rng.normal(size=(2, N, N))
    W = np.concatenate([A, 0.1 * rng.normal(size=(2, N, Q)), 0.3 * rng.normal(size=(2, N, M + 1))], 2)
    V, O = rng.normal(size=(2, Q, N + 1)), rng.normal(size=(2, L, N + M + 1))  # noqa: E741
    F = rng.uniform(size=(2, Q, 5 if activation == "pwl" else 0))
    return Latent(W, V, O, rng.normal(size=(2, 2, N)), F, activation, output_map, hardening)


def pieces_of(hold: str, length: int) -> Pieces:
    rng = np.random.default_rng(1)
    records = [(rng.normal(size=(k, M)), rng.normal(size=(k, L))) for k in (50, 70)]
    return Pieces.of(records, hold, length, kept=0.9)


def run(latent: Latent, pieces: Pieces):
    S = len(pieces.record)
    return simulated(latent, pieces, Guess(np.zeros((2, N, S)), np.zeros((2, S, N, N))), 2, sweeps=20)


def residuals(latent: Latent, pieces: Pieces) -> np.ndarray:
    x = swept(latent, pieces, run(latent, pieces).start, 2)[:-1:2]
    return np.moveaxis(errors(latent, pieces, x) * pieces.weight[:, None, None], 1, 0).reshape(2, -1)


def differences(latent: Latent, pieces: Pieces) -> np.ndarray:
    columns = []
    for name in ("W", "V", "F", "O", "x0"):
        given = getattr(latent, name)
        for place in np.ndindex(given.shape[1:]):
            step = np.zeros_like(given)
            step[(slice(None), *place)] = 1e-6
            up, down = (residuals(replace(latent, **{name: given + s * step}), pieces) for s in (1, -1))
            columns.append((up - down) / 2e-6)
    return np.array(columns)


@pytest.mark.parametrize(
    ("activation", "hold", "output_map", "hardening"),
    [("tanh", "foh", None, 0), ("softsign", "zoh", "abs", 1), ("arctan", "zoh", None, 3), ("pwl", "foh", None, 1)],
)
def test_normal_equations_are_those_of_differences(activation, hold, output_map, hardening):
    """J'J and J'r over all parameters and first states are those of finite differences, whatever the pieces."""
    latent, pieces = batch(activation, output_map, hardening), pieces_of(hold, 16)
    found = normal(latent, pieces, run(latent, pieces).start, 2)
    J, r, p = differences(latent, pieces), residuals(latent, pieces), found.H.shape[1]
    for k in range(2):
        H, g = J[:, k] @ J[:, k].T, J[:, k] @ r[k]
        np.testing.assert_allclose(found.H[k], H[:p, :p], atol=1e-7 * np.abs(H).max())
        np.testing.assert_allclose(np.hstack(list(found.side[k])), H[:p, p:], atol=1e-7 * np.abs(H).max())
        np.testing.assert_allclose(np.concatenate([found.g[k], found.g0[k].ravel()]), g, atol=1e-7 * np.abs(g).max())


def test_pieces_join_to_one_run():
    """A record simulated in pieces gives what it gives in one."""
    latent = batch("tanh", None)
    short, long = (pieces_of("zoh", length) for length in (16, 70))
    np.testing.assert_allclose(
        np.sort(residuals(latent, short)[residuals(latent, short) != 0]),
        np.sort(residuals(latent, long)[residuals(latent, long) != 0]),
        atol=1e-7,
    )


def test_blocks_change_no_sum(monkeypatch):
    """Runs and normal equations are the same however few pieces are held at a time."""
    latent, pieces = batch("tanh", None), pieces_of("foh", 8)
    whole, sums = run(latent, pieces), normal(latent, pieces, run(latent, pieces).start, 2)
    monkeypatch.setattr(runs, "BLOCK", 1)
    monkeypatch.setattr(sensitivities, "LANES", 2)
    monkeypatch.setattr(sensitivities, "CHUNK", 7)
    split = run(latent, pieces)
    np.testing.assert_allclose(split.square, whole.square, rtol=1e-9)
    np.testing.assert_allclose(split.held, whole.held, rtol=1e-9)
    for one, other in zip(normal(latent, pieces, split.start, 2), sums, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())


def test_hardening_neurons_are_activations_turned():
    """A model with hardening neurons runs as the one in which s - f(s) is written with f, and back."""
    latent, pieces = batch("tanh", None, 2), pieces_of("zoh", 16)
    plain = latent.in_activations()
    assert plain.hardening == 0
    np.testing.assert_allclose(run(plain, pieces).start, run(latent, pieces).start, atol=1e-9)
    np.testing.assert_allclose(plain.hardened(2).W, latent.W, atol=1e-12)


def test_the_loudest_fitted_samples_are_held_out_too():
    """Pieces made quiet hold out the largest outputs among the fitted samples, and lose none."""
    pieces = pieces_of("zoh", 16)
    quiet = pieces.quiet(0.1)
    size = np.abs(pieces.y).max(1)
    moved = pieces.weight & ~quiet.weight
    assert size[quiet.weight].max() < size[moved].min()
    assert abs(moved.sum() - 0.1 * pieces.weight.sum()) <= 2
    assert ((quiet.weight | quiet.held) == (pieces.weight | pieces.held)).all()
