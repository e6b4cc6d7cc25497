"""Claim L1 in the checker: cones, small files in fractions, large ones by bounded sums, and what must be refused."""

import json
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls

from persid_check import Accepted, canonical_model, check, model_sha256
from persid_check.cone import generators


def dyadic(number: float) -> list[int]:
    """Return [m, e] with number = m 2^e."""
    top, bottom = float(number).as_integer_ratio()
    return [top, 1 - bottom.bit_length()]


def model(A0: Any, terms: Any = (), B: Any = None, b: Any = None) -> dict[str, Any]:
    """Return a model object; terms are (f, R, A)."""
    n = len(A0)
    return {
        "format": "persid-model-1",
        "states": [f"x{i + 1}" for i in range(n)],
        "inputs": [f"u{i + 1}" for i in range(len(B[0]) if B else 0)],
        "A0": A0,
        "terms": [{"f": f, "R": R, "A": A} for f, R, A in terms],
        "B": B,
        "b": b,
    }


def file(subject: dict[str, Any], kinds: Any, weights: Any, kappa: float, *, every: bool = True) -> dict[str, Any]:
    """Return the object of a certificate; `kinds` are ([(text, alpha)], forms)."""
    return {
        "format": "persid-certificate-1",
        "claim": "L1",
        "statement": "",
        "model_sha256": model_sha256(subject),
        "model": canonical_model(subject),
        "operating_point": "every" if every else "reference",
        "kinds": [
            {
                "functions": [[text, dyadic(alpha)] for text, alpha in functions],
                "forms": [[dyadic(c) for c in form] for form in forms],
            }
            for functions, forms in kinds
        ],
        "kappa": dyadic(kappa),
        "weights": [dyadic(w) for w in weights],
        "companion": None,
    }


def answer(content: dict[str, Any]) -> Any:
    """Return the checker's answer to an object."""
    return check(json.dumps(content).encode())


TANH = [("tanh(x)", 1.0)]
TANH_FORMS = [(1, 0), (0, 1), (1, -1)]


@pytest.mark.parametrize(("size", "count"), [(1, 1), (2, 3), (3, 6), (4, 2), (5, 9), (6, 5)])
def test_generators_span_the_cone(size: int, count: int) -> None:
    """Every generator satisfies all forms, and every random point that does is a nonnegative combination of them."""
    rng = np.random.default_rng(size)
    forms = rng.integers(-4, 9, (count, size))
    forms[forms.sum(axis=1) < 0] *= -1
    rays = np.array(generators([[Fraction(int(c)) for c in form] for form in forms], size), float)
    assert (forms @ rays.T >= 0).all()
    points = 1 + rng.normal(size=(2000, size))
    inside = points[(points @ forms.T >= 0).all(axis=1)]
    assert len(inside)
    unit = rays / np.abs(rays).max(axis=1, keepdims=True)
    assert max(nnls(unit.T, x)[1] for x in inside[:200]) < 1e-9


def test_a_small_network_is_accepted() -> None:
    """Two coupled nodes with tanh are accepted, with rate and gain in the sentence."""
    subject = model([[-2, 0.5], [0, -2]], [("tanh(x)", None, [[0, 1], [0.5, 0]])], B=[[1], [0]])
    result = answer(file(subject, [(TANH, TANH_FORMS)], (1, 1), 0.5))
    assert isinstance(result, Accepted), result
    assert "exp(-0.5 t)" in result.statement
    assert "2 sup|u1 - u1*|" in result.statement
    assert "exactly one equilibrium" in result.statement
