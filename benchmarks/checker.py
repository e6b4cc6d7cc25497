# ruff: noqa: E741 (l is the letter of the mathematics)
"""Time and memory of the checker: `python benchmarks/checker.py`. Targets: 1,000 rows in 1 s, 4,000 in a minute.

A certificate is written for a diagonally dominant model with three functions a state; only the checker is timed, which
reads all of the file and its companion and proves the forms. Memory is the most that the process ever held. A second
table has the time that the prover takes for one form: all candidates of a curve, at x_ref and about another point.
"""

import argparse
import hashlib
import resource
import time
from fractions import Fraction
from typing import Any

import numpy as np

import persid as ps
from persid.certificates.curves import Curve, Curves, Use, written_point
from persid.certificates.encoding import encode, separated
from persid.certificates.ledger import draft, with_proof
from persid.models.sparse import archive
from persid_check import Accepted, canonical_model, check

FUNCTIONS = ("x**3", "sinh(x)", "tanh(x)")
TARGETS = {250: 1.0, 1000: 60.0}
TAU, GAMMA = [2, 0], [1, 12]


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


def certificate(n: int, seed: int = 0) -> tuple[bytes, bytes | None]:
    """The bytes of a ledger with a matrix of 4 n + 1 rows, and of its companion.

    P = I, mu = 1 on each function and TAU on each pair of (y, f_1, f_2, f_3), found for such models by their
    eigenvalues; the checker says whether they prove it.
    """
    model = ps.PersidskiiModel.from_canonical(canonical_model(dominant_model(n, seed)))
    forms = [tuple(Fraction(i == j) for j in range(4)) for i in range(4)]
    curves = Curves()
    uses = [Use(forms[0]), *(Use(form, Fraction(1)) for form in forms[1:])]
    curve, at = curves.place(Curve(tuple((f, Fraction(1)) for f in FUNCTIONS), None, None), uses)
    shares = [[k, [1, 0]] for k in at[1:]]
    points = [written_point(curve, {i: Fraction(1)}, [i, n + i, 2 * n + i], shares) for i in range(n)]
    products = [[i, at[k], at[l], TAU] for i in range(n) for k in range(4) for l in range(k + 1, 4)]
    content = draft(model, "iss", None, curves, points, {"value": products})
    content, arrays = separated(with_proof(content | {"P": {"diagonal": [[1, 0]] * n}, "gamma": GAMMA}))
    if not arrays:
        return encode(content), None
    beside = archive(arrays)
    stored = {"npz": "benchmark.npz", "sha256": hashlib.sha256(beside).hexdigest()}
    return encode(content | {"companion": stored}), beside


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
    parser.add_argument("--sizes", default="10,50,100,250", help="numbers of states; up to 1000")
    for n in (int(text) for text in parser.parse_args().sizes.split(",")):
        data, beside = certificate(n)
        start, busy = time.perf_counter(), time.process_time()
        result = check(data, arrays=beside)
        seconds, busy = time.perf_counter() - start, time.process_time() - busy
        outcome = "accepted" if isinstance(result, Accepted) else str(result)
        target = f"target {TARGETS[n]:.0f} s" if n in TARGETS else ""
        size = f"{4 * n + 1:5d} rows  {(len(data) + len(beside or b'')) / 2**20:6.1f} MiB"
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20
        spent = f"{seconds:6.2f} s (processor {busy:.2f})  {memory:5.2f} GiB"
        print(f"n = {n:4d}  {size}  {spent}  {outcome}  {target}", flush=True)
    proofs()


if __name__ == "__main__":
    main()
