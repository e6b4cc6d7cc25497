# ruff: noqa: E741 (l is the letter of the mathematics)
"""Time of the checker: `python benchmarks/checker.py`. Targets: size 400 in 3 s, size 1000 in 20 s.

The producer here (NumPy) writes a certificate for a diagonally dominant model with three functions a state; only the
checker is timed. Its file holds everything, so reading and proving the forms are part of the time. A second table has
the time that the prover takes for one form: all candidates of a curve, at x_ref and about another point.
"""

import argparse
import json
import time
from fractions import Fraction
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


def proofs() -> None:
    """Print the processor time of a proof that a form is a sector form, and that it is nondecreasing."""
    from persid.lyapunov.sectors import Curve, nondecreasing_pool, pool
    from persid_check.search.prover import prove_nondecreasing, prove_sector_form

    print(f"\n{'curve':28s} {'about':>6s} {'sector form':>12s} {'proved':>8s} {'nondecreasing':>14s} {'proved':>8s}")
    for functions in (("x**3", "tanh(x)"), FUNCTIONS, ("x**3", "x*abs(x)", "arctan(x)")):
        for shift in (None, (Fraction(3, 8), Fraction(1, 2**40))):
            curve = Curve(functions, (Fraction(1),) * len(functions), None, shift)
            line = f"{', '.join(functions):28s} {'0' if shift is None else '3/8':>6s}"
            for prove, forms in ((prove_sector_form, pool(curve)), (prove_nondecreasing, nondecreasing_pool(curve))):
                exact = [tuple(map(Fraction, form)) for form in forms]
                start = time.process_time()
                proved = sum(prove(curve.exact, form, None, shift) for form in exact)
                busy = (time.process_time() - start) / len(exact)
                line += f" {1e3 * busy:9.1f} ms {proved:5d}/{len(exact)}"
            print(line, flush=True)


def main() -> None:
    """Print one line a size, and one a curve."""
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
    proofs()


if __name__ == "__main__":
    main()
