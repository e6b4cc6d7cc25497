"""Recurrent networks of tanh or relu cells, given by their weights, as models in discrete time.

A layer is h_k = f(W_ih v_k + W_hh h_{k-1} + b), v the inputs, or the h of the layer before it.
Its arguments a_k are the states of the model, of layer l one step late for each layer before it: with h_k = f(a_k)

    a_{k+1} = W_hh f(a_k) + W_ih v_{k+1} + b,          a2_k = W_hh2 f(a2_{k-1}) + W_ih2 f(a1_k) + b2,

so that with y_k = (a1_k, a2_{k-1}, ...) the network is y_{k+1} = W f(y_k) + B u_k + b, exactly, where u_k = v_{k+1} is
the input that arrives in the step, W has the W_hh on its diagonal and the W_ih of later layers below it.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import ModelError
from persid.models.model import PersidskiiModel

FUNCTIONS = {"tanh": "tanh(x)", "relu": "relu(x)"}
_NAME = re.compile(r"(?:.*\.)?(weight|bias)_(ih|hh)(?:_l(\d+))?")


@dataclass(frozen=True, eq=False)
class Layer:
    """One layer: h = f(W_ih v + W_hh h + b)."""

    W_ih: Float[ndarray, "n m"]
    W_hh: Float[ndarray, "n n"]
    b: Float[ndarray, " n"]


def from_rnn(weights: Mapping[str, object], nonlinearity: str = "tanh", dt: float | int = 1.0) -> PersidskiiModel:
    """Return a recurrent network as a model in discrete time, exactly; its states are the arguments of the neurons.

    Hidden states are h = tanh(x) or relu(x), so that what is proved of |x - x*| holds of |h - h*| too.
    The input of a step is the one that arrives in it, and layers after the first are one step late each.

    Args:
        weights: arrays by name, as the state dictionary of a PyTorch RNN or RNNCell has them (weight_ih_l0,
            weight_hh_l0, bias_ih_l0, bias_hh_l0, weight_ih_l1, …), of any type that NumPy reads; a name may have a
            prefix such as "rnn.". Or {"i": {"kernel", "bias"}, "h": {"kernel"}} of a Flax SimpleCell.
        nonlinearity: "tanh" or "relu".
        dt: the length of a step in s.

    Raises:
        ModelError: a weight is missing, not known (gates, both directions) or of the wrong shape.

    Examples:
        >>> model = ps.from_rnn({"weight_ih": [[1.0], [0.0]], "weight_hh": [[0.2, -0.5], [0.4, 0.1]]})
        >>> ps.certify(model, claim="incremental").certificate.is_incremental
        True
    """
    if nonlinearity not in FUNCTIONS:
        raise ModelError(f"nonlinearity={nonlinearity!r}; choose one of {', '.join(FUNCTIONS)}")
    layers = [_flax(weights)] if {"i", "h"} <= set(weights) else _torch(weights)
    sizes = [len(layer.b) for layer in layers]
    starts = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    W, B = np.zeros((starts[-1], starts[-1])), np.zeros((starts[-1], layers[0].W_ih.shape[1]))
    B[: sizes[0]] = layers[0].W_ih
    for k, (layer, first, last) in enumerate(zip(layers, starts, starts[1:], strict=False)):
        W[first:last, first:last] = layer.W_hh
        if k:
            before = slice(starts[k - 1], first)
            if layer.W_ih.shape[1] != sizes[k - 1]:
                raise ModelError(
                    f"weight_ih_l{k} reads {layer.W_ih.shape[1]} values; the layer before has {sizes[k - 1]}"
                )
            W[first:last, before] = layer.W_ih
    terms = [(FUNCTIONS[nonlinearity], None, W)]
    return PersidskiiModel(None, terms, B, np.concatenate([layer.b for layer in layers]), time="discrete", dt=float(dt))


def _torch(weights: Mapping[str, object]) -> list[Layer]:
    """Return the layers of a state dictionary in PyTorch's names."""
    found: dict[int, dict[str, ndarray]] = {}
    for name, value in weights.items():
        match = _NAME.fullmatch(name)
        if match is None:
            raise ModelError(f"{name!r} is no weight of a plain recurrent network, such as weight_hh_l0 or bias_ih")
        found.setdefault(int(match[3] or 0), {})[f"{match[1]}_{match[2]}"] = _array(name, value)
    if sorted(found) != list(range(len(found))) or not found:
        raise ModelError(f"layers {sorted(found)} are given; needed is every one from 0 on")
    return [_layer(k, found[k]) for k in sorted(found)]


def _flax(weights: Mapping[str, Any]) -> Layer:
    """Return the layer of a Flax cell, whose kernels are transposed."""
    plain = {"weight_ih": _array("i.kernel", weights["i"]["kernel"]).T}
    plain["weight_hh"] = _array("h.kernel", weights["h"]["kernel"]).T
    biases = {
        f"bias_{part}h": _array(f"{part}.bias", weights[part]["bias"]) for part in "ih" if "bias" in weights[part]
    }
    return _layer(0, plain | biases)


def _layer(k: int, parts: Mapping[str, ndarray]) -> Layer:
    if missing := {"weight_ih", "weight_hh"} - set(parts):
        raise ModelError(f"{sorted(missing)[0]}_l{k} is missing")
    W_ih, W_hh = parts["weight_ih"], parts["weight_hh"]
    n = len(W_hh)
    if W_hh.shape != (n, n) or W_ih.ndim != 2 or len(W_ih) != n:
        gated = W_hh.ndim == 2 and n in (3 * W_hh.shape[1], 4 * W_hh.shape[1])
        more = "; GRU and LSTM cells are no such network" if gated else ""
        raise ModelError(
            f"weight_hh_l{k} is {W_hh.shape} and weight_ih_l{k} is {W_ih.shape}; needed are n x n, n x m{more}"
        )
    b = np.zeros(n)
    for name in ("bias_ih", "bias_hh"):
        part = parts.get(name, np.zeros(n))
        if part.shape != (n,):
            raise ModelError(f"{name}_l{k} has shape {part.shape}; needed is ({n},)")
        b = b + part
    return Layer(W_ih, W_hh, b)


def _array(name: str, value: object) -> ndarray:
    try:
        return np.asarray(value, float)
    except (TypeError, ValueError, RuntimeError) as error:  # a tensor that still needs its gradient
        raise ModelError(f"{name} is no array of numbers: {error}") from None
