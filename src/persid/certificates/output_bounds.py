"""Rigorous numbers of the outputs that a certificate bounds, rounded outwards.

Specification: docs/certificate-format.md, "Outputs".
"""

from collections.abc import Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from flint import arb, ctx
from jaxtyping import Float
from numpy import ndarray

from persid.certificates import bounds


def names(content: Mapping[str, Any]) -> tuple[str, ...]:
    """Return the names of the outputs that a certificate bounds."""
    return tuple(content.get("outputs", {}).get("outputs", ()))


def gains(content: Mapping[str, Any]) -> list[arb]:
    """Return the gain from sup|u - u*| to |y_i - y_i*| of each output: L (sqrt(c g/kappa) + |D|), g = |Gamma|."""
    with ctx.workprec(bounds.BITS):
        gamma = bounds.largest_eigenvalue(content["gamma"])
        direct = [
            bounds.ball(sum((Fraction(float.fromhex(v)) ** 2 for v in row), Fraction(0)))
            for row in _block(content)["D"]
        ]
        rate = bounds.ball(bounds.exact(content["kappa"]))
        parts = zip(_constants_of(content), _lipschitz(content), direct, strict=True)
        return [L * ((c * gamma / rate).sqrt() + D.sqrt()) for c, L, D in parts]


def bound(
    content: Mapping[str, Any], x0: Float[ndarray, " n"], u_sup: float, t: Float[ndarray, " N"]
) -> Float[ndarray, "N l"]:
    """Return the bound of |y_i - y_i*| at times t (s) from x0, for inputs with sup|u - u*| <= u_sup."""
    with ctx.workprec(bounds.BITS):
        V = bounds.lyapunov(content, x0).hi
        rate, steady = bounds.ball(bounds.exact(content["kappa"]) / 2), [g * arb(u_sup) for g in gains(content)]
        start = [
            L * (c * V).sqrt() if V > 0 else arb(0)
            for c, L in zip(_constants_of(content), _lipschitz(content), strict=True)
        ]
        decay = [(-rate * arb(float(s))).exp() for s in t]
        rows = [[bounds.above(s * d + g) for s, g in zip(start, steady, strict=True)] for d in decay]
        return np.array(rows).reshape(len(t), len(start))


def _block(content: Mapping[str, Any]) -> Mapping[str, Any]:
    return content["outputs"]


def _constants_of(content: Mapping[str, Any]) -> list[arb]:
    return [bounds.ball(bounds.exact(pair)) for pair in _block(content)["constants"]]


def _lipschitz(content: Mapping[str, Any]) -> list[arb]:
    stored = _block(content)["lipschitz"]
    return [arb(1) for _ in names(content)] if stored is None else [bounds.ball(bounds.exact(pair)) for pair in stored]
