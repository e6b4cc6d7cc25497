"""Recurrent networks by their weights: the model runs as the network does, and what is no such network is refused."""

import sys

import numpy as np
import pytest

import persid as ps
from persid.errors import ModelError, PersidError


def _weights(sizes: tuple[int, ...], inputs: int = 2, seed: int = 0) -> dict[str, np.ndarray]:
    rng, found, before = np.random.default_rng(seed), {}, inputs
    for k, n in enumerate(sizes):
        shapes = {"weight_ih": (n, before), "weight_hh": (n, n), "bias_ih": (n,), "bias_hh": (n,)}
        found |= {f"{name}_l{k}": (0.4 * rng.normal(size=s)).astype(np.float32) for name, s in shapes.items()}
        before = n
    return found


def _hidden(weights: dict[str, np.ndarray], f, v: np.ndarray) -> list[np.ndarray]:
    """The hidden states of every layer after each input, as PyTorch defines them."""
    layers = []
    for k in range(len(weights) // 4):
        W, U, b, c = (
            weights[f"{name}_l{k}"].astype(float) for name in ("weight_ih", "weight_hh", "bias_ih", "bias_hh")
        )
        h, run = np.zeros(len(b)), []
        for row in v:
            h = f(W @ row + b + U @ h + c)
            run.append(h)
        v = np.array(run)
        layers.append(v)
    return layers


@pytest.mark.parametrize("nonlinearity", ["tanh", "relu"])
def test_the_model_runs_as_the_network_does(nonlinearity: str) -> None:
    """Hidden states of two layers are the function of the model's states, those of the second one step late."""
    weights, v = _weights((3, 4)), np.random.default_rng(1).normal(size=(30, 2))
    f = np.tanh if nonlinearity == "tanh" else lambda a: np.maximum(a, 0)
    first, second = _hidden(weights, f, v)
    model = ps.from_rnn({f"rnn.{name}": value for name, value in weights.items()}, nonlinearity, dt=0.5)
    assert (model.n, model.m, model.dt) == (7, 2, 0.5)
    a1 = weights["weight_ih_l0"].astype(float) @ v[0] + weights["bias_ih_l0"] + weights["bias_hh_l0"]
    start = np.concatenate([a1, np.zeros(4)])  # the second layer has seen nothing yet
    run = model.simulate(start, 0.5 * np.arange(29), v[1:])[0]
    assert np.allclose(f(run.x[:, :3]), first[:29], atol=1e-6)
    assert np.allclose(f(run.x[1:, 3:]), second[:28], atol=1e-6)


def test_a_flax_cell_is_transposed() -> None:
    """The kernels of a Flax cell are those of PyTorch transposed; its model is the same."""
    weights = _weights((3,))
    cell = {
        "i": {"kernel": weights["weight_ih_l0"].T, "bias": weights["bias_ih_l0"]},
        "h": {"kernel": weights["weight_hh_l0"].T},
    }
    plain = {name: value for name, value in weights.items() if name != "bias_hh_l0"}
    assert ps.from_rnn(cell) == ps.from_rnn(plain)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"weight_hh_l0": None}, "weight_hh_l0 is missing"),
        ({"weight_hh_l0": np.ones((12, 3)), "weight_ih_l0": np.ones((12, 2))}, "LSTM"),
        ({"bias_hh_l0": np.ones(5)}, r"bias_hh_l0 has shape \(5,\)"),
        ({"weight_hh_l0_reverse": np.ones((3, 3))}, "no weight of a plain recurrent network"),
        ({"weight_hh_l2": np.ones((3, 3))}, r"layers \[0, 2\]"),
        ({"weight_hh_l0": "none"}, "no array of numbers"),
    ],
)
def test_what_is_no_such_network_is_refused(change, words: str) -> None:
    """Missing and unknown weights, gates, both directions and wrong shapes are named."""
    weights = {name: value for name, value in (_weights((3,)) | change).items() if value is not None}
    with pytest.raises(ModelError, match=words):
        ps.from_rnn(weights)


def test_an_unknown_function_is_refused() -> None:
    """Only tanh and relu cells are known."""
    with pytest.raises(ModelError, match="tanh, relu"):
        ps.from_rnn(_weights((2,)), "sigmoid")


def test_a_network_is_certified_and_forgets() -> None:
    """A contracting network is certified between any two solutions, without PyTorch or JAX."""
    weights, before = _weights((4,)), set(sys.modules)
    verdict = ps.certify(ps.from_rnn(weights), claim="incremental")
    assert verdict.certificate.is_incremental
    assert {"torch", "jax"}.isdisjoint(set(sys.modules) - before)


def test_residuals_bound_the_free_run() -> None:
    """One-step residuals of a plant that is no such model bound the error of the model's free run, in each state."""
    terms = [("tanh(x)", None, 0.2 * np.eye(2))]
    model = ps.PersidskiiModel([[0.5, 0.1], [-0.1, 0.4]], terms, [[1.0], [0.0]], time="discrete", dt=0.1)
    certificate = ps.certify(model, claim="incremental").certificate
    rng, x, states = np.random.default_rng(0), np.zeros(2), []
    u = rng.normal(size=(200, 1))
    for k in range(200):
        states.append(x)
        x = model.rhs(x, u[k]) + 0.02 * np.sin(3 * x[::-1]) + 0.01 * rng.normal(size=2)
    run = ps.Trajectory(0.1 * np.arange(200), np.array(states), u)
    bound = ps.free_run_bound(certificate, run)
    error = np.abs(model.simulate(run.x[0], run.t, u)[0].x - run.x)
    assert (error <= bound).all()
    assert bound[0].tolist() == [0.0, 0.0]
    assert bound.max() < 0.4
    field = ps.certify(ps.PersidskiiModel([[-1.0]], (), [[1.0]])).certificate
    with pytest.raises(PersidError, match='claim="incremental"'):
        ps.free_run_bound(field, run)


def test_pairs_are_asked_about_all_states() -> None:
    """claim="incremental" is refused in a region."""
    with pytest.raises(ModelError, match="all states"):
        ps.certify(ps.from_rnn(_weights((2,))), claim="incremental", domain=[[-1.0, 1.0]] * 2)
