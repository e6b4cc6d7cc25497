"""How time and memory grow with samples, states, functions and inputs, and the machine's floor in the same run.

Base case: n = 4 states, 2 inputs, x, x**3, tanh x, 1e5 samples; one of the four is varied at a time. The fit has no
ridge search (holdout 0): its cost is the pass over the data. Floors, of the same sizes and in the same process:

    functions  every function once over every state, by NumPy
    Gram     2 N p^2 flops of phi'phi (p columns) at the rate that this machine's BLAS reaches for blocks of this shape
    read     the bytes of x and u at the rate at which numpy.sum reads them
    product  the bytes of a sparse matrix, of x and of y at the same rate, against one y = A x (a ring of states with
             four functions each)

Exponents are those of the least-squares line through the logarithms of the upper half of the sizes.

    python benchmarks/growth.py [--quick]
"""

import argparse
import time
import tracemalloc
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from children import keep
from numpy import ndarray
from scipy import sparse

from persid.identification.basis import make_basis
from persid.identification.gram import BLOCK
from persid.identification.identifier import PersidskiiIdentifier
from persid.measurements.trajectories import Trajectories
from persid.models.functions import scalar_function

BASE = {"samples": 100_000, "states": 4, "functions": 3, "inputs": 2}
FUNCTIONS = ("x", "x**3", "tanh(x)", "sinh(x)", "arctan(x)", "arcsinh(x)", "softsign(x)", "x**5", "sin(x)", "erf(x)")
VARIED = {
    "samples": (3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000),
    "states": (1, 2, 4, 8, 16, 32),
    "functions": (1, 2, 4, 6, 8, 10),
    "inputs": (1, 2, 4, 8, 16, 32),
}
PRODUCT = (10_000, 30_000, 100_000, 300_000, 1_000_000)
REPEATS = 3


def fastest(route: Callable[[], Any], repeats: int = REPEATS) -> float:
    """Return the shortest of some processor times in s."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        route()
        times.append(time.process_time() - start)
    return min(times)


def data(size: dict[str, int]) -> Trajectories:
    """Return a smooth random run with held inputs."""
    rng, N = np.random.default_rng(0), size["samples"]
    x = np.sin(np.cumsum(rng.normal(size=(N, size["states"])), axis=0) * 0.01)
    return Trajectories.from_arrays(x, rng.normal(size=(N, size["inputs"])), dt=0.01)


def bandwidth() -> float:
    """Return the bytes a second at which this machine reads an array of 200 MB."""
    long = np.ones(25_000_000)
    return long.nbytes / fastest(long.sum)


def gram_rate(columns: int) -> float:
    """Return the flops a second of phi'phi for a block of rows as long as those of the fit."""
    phi = np.random.default_rng(0).normal(size=(BLOCK, columns))
    count = max(1, int(2e8 / (2 * BLOCK * columns**2)))
    seconds = fastest(lambda: [phi.T @ phi for _ in range(count)]) / count
    return 2 * BLOCK * columns**2 / seconds


def fit(size: dict[str, int], read: float) -> dict[str, Any]:
    """Measure one fit beside its floors."""
    runs, functions = data(size), list(FUNCTIONS[: size["functions"]])
    identifier = PersidskiiIdentifier(functions, holdout=0.0, ridge=1e-6)
    seconds = fastest(lambda: identifier.fit(runs))
    tracemalloc.start()  # in a run of its own: it slows what it watches
    identifier.fit(runs)
    memory = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    columns = make_basis(runs, functions).size
    bytes_ = runs[0].x.nbytes + runs[0].u.nbytes
    floors = {"gram_floor": 2 * size["samples"] * columns**2 / gram_rate(columns), "read_floor": bytes_ / read}
    block = runs[0].x[:BLOCK].copy()
    once = fastest(lambda: [scalar_function(f).value(block) for f in functions if f != "x"])
    floors["function_floor"] = once * size["samples"] / len(block)
    return {"seconds": seconds, "memory_MB": memory, "columns": columns} | floors


def product(n: int, read: float) -> dict[str, Any]:
    """Measure y = A x for the ring of n states with 4 functions a state, against the bytes that it must move."""
    rows = np.repeat(np.arange(n), 12)
    neighbours = (np.arange(n)[:, None] + np.array([-1, 0, 1])) % n
    columns = (neighbours[:, :, None] * 4 + np.arange(4)).reshape(-1)
    A = sparse.csr_array((np.ones(12 * n), (rows, columns)), shape=(n, 4 * n))
    x = np.ones(4 * n)
    moved = A.data.nbytes + A.indices.nbytes + A.indptr.nbytes + x.nbytes + 8 * n
    count = max(1, 1_000_000 // n)
    seconds = fastest(lambda: [A @ x for _ in range(count)]) / count
    return {"seconds": seconds, "bandwidth_floor": moved / read, "memory_MB": moved / 1e6}


def exponent(sizes: ndarray, values: ndarray) -> float:
    """Return the slope of the logarithms over the upper half of the sizes."""
    half = len(sizes) // 2
    return float(np.polyfit(np.log(sizes[half:]), np.log(values[half:]), 1)[0])


def rows(quick: bool) -> Iterator[dict[str, Any]]:
    """Yield a record for each size."""
    read = bandwidth()
    yield {"varied": "read", "size": 200, "GB_per_s": read / 1e9}
    for varied, sizes in VARIED.items():
        for size in sizes[: 3 if quick else None]:
            yield {"varied": varied, "size": size} | fit(BASE | {varied: size}, read)
    for n in PRODUCT[: 3 if quick else None]:
        yield {"varied": "sparse product", "size": n} | product(n, read)


def main() -> None:
    """Measure, print, keep."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="the three smallest sizes only")
    found = []
    for row in rows(parser.parse_args().quick):
        found.append(row)
        print("  ".join(f"{k} {v:.3g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()), flush=True)
    exponents = []
    for name in (*VARIED, "sparse product"):
        part = [r for r in found if r["varied"] == name]
        size = np.array([r["size"] for r in part], float)
        growth = {"varied": name, "time": exponent(size, np.array([r["seconds"] for r in part]))}
        growth["memory"] = exponent(size, np.array([r["memory_MB"] for r in part]))
        exponents.append(growth)
        print(growth)
    keep("growth", base=BASE, exponents=exponents, rows=found)


if __name__ == "__main__":
    main()
