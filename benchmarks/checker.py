# ruff: noqa: E741 (l is the letter of the mathematics)
"""Time of the checker: `python benchmarks/checker.py`. Targets: size 400 in 3 s, size 1000 in 20 s.

The producer here (NumPy) writes a certificate for a diagonally dominant model with three functions a state; only the
checker is timed. Its file holds everything, so reading and proving the forms are part of the time.
"""

import argparse
import json
import time
from typing import Any

import numpy as np

from persid_check import Accepted, canonical_model, check, model_sha256

FUNCTIONS = ("x**3", "sinh(x)", "tanh(x)")
TARGETS = {100: 3.0, 250: 20.0}
BITS = 16  # of the entries of T


def dominant_model(n: int, seed: int) -> dict[str, Any]:
    """A model whose four blocks are strictly diagonally dominant with negative diagonal."""
    rng = np.random.default_rng(seed)
    blocks = []
    for _ in range(4):
        A = rng.normal(size=(n, n)) / n
        np.fill_diagonal(A, 0)
        blocks.append(A - np.diag(1.2 * np.maximum(np.abs(A).sum(0), np.abs(A).sum(1)) + 0.1))
    return {
        "format": "persid-model-1",
        "states": [f"x{i}" for i in range(n)],
        "inputs": ["u"],
        "A0": blocks[0].tolist(),
        "terms": [{"f": f, "R": None, "A": A.tolist()} for f, A in zip(FUNCTIONS, blocks[1:], strict=True)],
        "B": rng.normal(size=(n, 1)).tolist(),
    }


def _inequality(model: dict[str, Any], tau: float, gamma: float) -> np.ndarray:
    """[[-Q, -E B], [., gamma I]] for P = I, mu = 1 on each function, tau on each pair of (y, f_1, f_2, f_3)."""
    A = [np.array(model["A0"]), *(np.array(term["A"]) for term in model["terms"])]
    n = len(A[0])
    G = np.hstack(A)
    E = np.vstack([np.eye(n)] * 4)
    pairs = np.ones((4, 4)) - np.eye(4)
    Q = E @ G + (E @ G).T + tau * np.kron(pairs, np.eye(n))
    side = -E @ np.array(model["B"])
    return np.block([[-Q, side], [side.T, gamma * np.eye(side.shape[1])]])


def certificate(n: int, seed: int = 0) -> bytes:
    """The bytes of a certificate of claim G with z of size 4 n."""
    model = dominant_model(n, seed)
    tau, exponent = _best_tau(model), 0
    while np.linalg.eigvalsh(_inequality(model, tau, 2.0**exponent))[0] <= 1e-6:
        exponent += 1
    M = _inequality(model, tau, 2.0**exponent)
    T = np.linalg.inv(np.linalg.cholesky(M))
    T *= 2**BITS / np.abs(T).max(axis=1, keepdims=True)
    rows = np.rint(T).astype(int).tolist()
    forms = [[[int(i == j), 0] for j in range(4)] for i in range(4)]
    mantissa = round(tau * 2**20)
    pairs = [[k, l, [mantissa, -20]] for k in range(4) for l in range(k + 1, 4)]
    group = {"forms": forms, "mu": [[int(k > 0), 0] for k in range(4)], "products": pairs}
    return json.dumps(
        {
            "format": "persid-certificate-1",
            "claim": "G",
            "statement": "benchmark",
            "model_sha256": model_sha256(model),
            "model": canonical_model(model),
            "operating_point": None,
            "P": {"diagonal": [[1, 0]] * n},
            "groups": [group] * n,
            "dropped": [],
            "gamma": [1, exponent],
            "proof": {"P": [[int(i == j) for j in range(i + 1)] for i in range(n)],
                      "Q": [row[: i + 1] for i, row in enumerate(rows)]},
        }
    ).encode()  # fmt: skip


def _best_tau(model: dict[str, Any]) -> float:
    """The multiplier of a small list that leaves most room."""
    n = len(model["A0"])
    room = {tau: np.linalg.eigvalsh(_inequality(model, tau, 1.0)[: 4 * n, : 4 * n])[0] for tau in np.linspace(0, 4, 9)}
    return max(room, key=lambda tau: room[tau])


def main() -> None:
    """Print one line a size."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--sizes", default="10,50,100,250", help="numbers of states")
    for n in (int(text) for text in parser.parse_args().sizes.split(",")):
        data = certificate(n)
        start, busy = time.perf_counter(), time.process_time()
        result = check(data)
        seconds, busy = time.perf_counter() - start, time.process_time() - busy
        outcome = "accepted" if isinstance(result, Accepted) else str(result)
        target = f"target {TARGETS[n]:.0f} s" if n in TARGETS else ""
        size = f"size {4 * n + 1:5d}  {len(data) / 2**20:6.1f} MiB"
        print(f"n = {n:4d}  {size}  {seconds:6.2f} s (processor {busy:.2f})  {outcome}  {target}")


if __name__ == "__main__":
    main()
