"""Networks: claim L1 against the interior-point certificate (claims G and E), and a million states.

    python benchmarks/networks.py coupling [--sizes 30,100]
    python benchmarks/networks.py million

`coupling`: for rings and random graphs whose couplings have positive, random or skew signs, the largest coupling that
each method certifies, by bisection to 10 %, with the processor time of the last one. Claim L1 counts when the checker
has accepted the file; of the interior point the search alone is counted and timed, with a diagonal P; where it ran out
of time at a coupling ("out of time") its largest one is a lower bound only. Run it on an idle machine.
`million`: rings and grids of 1,000,000 states with four functions: processor time and memory, each in its own process.
Results are merged into benchmarks/results/networks.json.
"""

import argparse
import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
import scipy
import scipy.sparse as sp

import persid as ps
import persid_check
from persid.lyapunov.search import search
from persid.lyapunov.shifted_model import Setting
from persid.networks.certificate import NetworkCertificate, certify_network

RESULTS = Path(__file__).parent / "results" / "networks.json"
FUNCTIONS = ("tanh(x)", "x**3", "sinh(x)", "arctan(x)")
LIMIT = 30.0  # s of the clock for one interior-point search
LARGEST = 64.0  # couplings beyond are not tried
PRECISION = 1.1


def edges(kind: str, n: int) -> np.ndarray:
    """Return directed edges (from, to): a ring, a square grid, or a random graph of four edges a node."""
    k = np.arange(n)
    if kind == "ring":
        return np.stack([np.tile(k, 2), np.concatenate([(k + 1) % n, (k - 1) % n])])
    if kind == "grid":
        side = int(np.sqrt(n))
        i, j = np.divmod(np.arange(side * side), side)
        pairs = [(i[ok] * side + j[ok], (i[ok] + a) * side + j[ok] + b) for a, b, ok in _steps(i, j, side)]
        return np.stack([np.concatenate([p[end] for p in pairs]) for end in (0, 1)])
    rng = np.random.default_rng(n)
    ends = rng.integers(0, n, (2, 4 * n))
    return np.unique(ends[:, ends[0] != ends[1]], axis=1)


def _steps(i: np.ndarray, j: np.ndarray, side: int) -> list[tuple[int, int, np.ndarray]]:
    return [(1, 0, i + 1 < side), (-1, 0, i > 0), (0, 1, j + 1 < side), (0, -1, j > 0)]


def network(kind: str, signs: str, n: int, coupling: float) -> ps.PersidskiiModel:
    """Return a network of nodes x' = -1.5 x - 0.5 tanh - 0.1 x^3 - 0.05 sinh - 0.3 arctan, coupled by x and tanh.

    The degree-scaled couplings are positive, of random sign, or skew (A[i,k] = -A[k,i]).
    """
    a, b = edges(kind, n)
    size = int(max(a.max(), b.max())) + 1
    rng = np.random.default_rng(size)
    weight = rng.uniform(0.5, 1.5, len(a)) / np.bincount(a, minlength=size)[a]
    if signs == "random":
        weight *= rng.choice([-1.0, 1.0], len(a))
    C = sp.csc_array((weight, (b, a)), shape=(size, size))
    if signs == "skew":
        C = sp.csc_array(sp.triu(C) - sp.triu(C).T)
    eye = sp.csc_array(sp.eye_array(size))
    terms = [
        ("tanh(x)", None, -0.5 * eye + 0.5 * coupling * C),
        ("x**3", None, -0.1 * eye),
        ("sinh(x)", None, -0.05 * eye),
        ("arctan(x)", None, -0.3 * eye),
    ]
    B = sp.csc_array((np.ones(2), ([0, 1], [0, 1])), shape=(size, 2))
    return ps.PersidskiiModel(-1.5 * eye + coupling * C, terms, B)


def by_weights(model: ps.PersidskiiModel) -> bool:
    """Whether claim L1 certifies a model."""
    return isinstance(certify_network(model, True, lambda line: None), NetworkCertificate)


def by_matrices(model: ps.PersidskiiModel) -> bool:
    """Whether the interior-point search finds a Lyapunov function of claims G and E with a diagonal P."""
    setting = Setting.of(model.dense(), None)
    found = search(setting.system, setting.pools, full_P=False, time_limit=LIMIT)
    if found.status.name == "TIME":
        raise TimeoutError
    return found.status.name == "FEASIBLE"


def largest(certifies: Callable[[ps.PersidskiiModel], bool], make: Callable[[float], ps.PersidskiiModel]) -> Any:
    """Return the largest coupling that is certified, to 10 %, and the processor time of the last certificate."""
    seconds: list[float] = []
    late: list[float] = []

    def holds(coupling: float) -> bool:
        started = time.process_time()
        try:
            done = certifies(make(coupling))
        except TimeoutError:
            late.append(coupling)
            return False
        seconds.extend([time.process_time() - started] if done else [])
        return done

    low, high = 0.0, 0.5
    while high < LARGEST and holds(high):
        low, high = high, 2 * high
    if not low:
        return {"coupling": 0.0, "seconds": None, "out of time": late}
    while high < LARGEST and high > PRECISION * low:
        middle = (low * high) ** 0.5
        low, high = (middle, high) if holds(middle) else (low, middle)
    return {"coupling": round(low, 3), "seconds": round(seconds[-1], 2), "out of time": late}


def coupling_table(sizes: list[int]) -> None:
    """Fill the table of largest couplings."""
    for n in sizes:
        for kind in ("ring", "graph"):
            for signs in ("positive", "random", "skew"):
                row: dict[str, Any] = {"n": n, "kind": kind, "signs": signs}
                for name, method in (("L1", by_weights), ("interior point", by_matrices)):
                    row[name] = largest(method, lambda c: network(kind, signs, n, c))  # noqa: B023
                print(row, flush=True)
                merge("coupling", row, ("n", "kind", "signs"))


def million(kind: str, n: int) -> None:
    """Certify and check one large network; print processor times and the peak memory of this process."""
    started = time.process_time()
    model = network(kind, "random", n, 0.5)
    laps = [time.process_time()]
    verdict = ps.certify(model)
    laps.append(time.process_time())
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "network.cert.json"
        verdict.certificate.save(path)
        laps.append(time.process_time())
        answer = persid_check.check(path)
    laps.append(time.process_time())
    spent = np.diff([started, *laps]).round(2).tolist()
    row = {
        "kind": kind,
        "n": model.n,
        "entries": int(model.A0.nnz),
        "accepted": isinstance(answer, ps.Accepted),
        **dict(zip(("model s", "certify s", "save s", "check s"), spent, strict=True)),
        "peak MiB": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024,
        "rate": verdict.certificate.rate,
    }
    print(json.dumps(row))


def merge(name: str, row: dict[str, Any], keys: tuple[str, ...]) -> None:
    """Write a row over the one with the same keys."""
    found = json.loads(RESULTS.read_text()) if RESULTS.is_file() else {}
    rows = [old for old in found.get(name, []) if [old[k] for k in keys] != [row[k] for k in keys]]
    found[name] = [*rows, row]
    found["machine"] = {
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
        "numpy": np.__version__,
        "scipy": scipy.__version__,
        "times": "processor time in s, one thread",
    }
    RESULTS.write_text(json.dumps(found, indent=1) + "\n")


def main() -> None:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("coupling", "million", "one"))
    parser.add_argument("--sizes", default="30,100,400")
    parser.add_argument("--kind", default="ring")
    parser.add_argument("--n", type=int, default=1_000_000)
    options = parser.parse_args()
    if options.what == "coupling":
        coupling_table([int(n) for n in options.sizes.split(",")])
    elif options.what == "one":
        million(options.kind, options.n)
    else:
        for kind in ("ring", "grid"):
            command = [sys.executable, __file__, "one", "--kind", kind, "--n", str(options.n)]
            done = subprocess.run(command, capture_output=True, text=True, check=True)
            print(done.stdout.strip(), flush=True)
            merge("million", json.loads(done.stdout), ("kind", "n"))


if __name__ == "__main__":
    main()
