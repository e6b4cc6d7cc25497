"""CPU time of the weak form and of EDMD against a bare chunked NumPy Gram that evaluates the same functions.

n = 9 states, 9 inputs, 1e6 samples, functions x, x**3, sinh, tanh, arctan and a constant: 55 columns. Each route runs
in one thread, in one process, the shortest of three CPU times counts; memory is the growth over the data themselves.
The weak form is compared with one product phi'phi, EDMD with the two that it needs.

    OMP_NUM_THREADS=1 python benchmarks/identification.py [samples]
"""

import sys
import time
import tracemalloc
from collections.abc import Callable

import numpy as np
from numpy import ndarray

from persid.identification.basis import Basis, make_basis
from persid.identification.estimators.weak import window_rows
from persid.identification.gram import BLOCK, accumulate
from persid.identification.koopman import edmd, make_lifting
from persid.identification.structure import make_structure
from persid.measurements.trajectories import Trajectories

N = 9
FUNCTIONS = ["x", "x**3", "sinh(x)", "tanh(x)", "arctan(x)"]
STEP = 0.01


def data(samples: int) -> Trajectories:
    """Return a smooth random run: a filtered random walk in 9 states with 9 held inputs."""
    rng = np.random.default_rng(0)
    u = rng.normal(size=(samples, N))
    x = np.cumsum(rng.normal(size=(samples, N)), axis=0) * 0.01
    return Trajectories.from_arrays(np.sin(x), u, dt=STEP)


def bare(run_x: ndarray, run_u: ndarray, basis: Basis) -> tuple[ndarray, ndarray]:
    """Accumulate phi'phi and phi'dx in chunks with plain NumPy."""
    p = 5 * N + N + 1
    G, H = np.zeros((p, p)), np.zeros((p, N))
    for k in range(0, len(run_x) - 1, BLOCK):
        x = run_x[k : k + BLOCK + 1]
        dx = x[:-1] - basis.x_ref
        y = dx / basis.scale
        u = run_u[k : k + BLOCK][: len(dx)]
        phi = np.hstack([dx, y * y * y, np.sinh(y), np.tanh(y), np.arctan(y), u, np.ones((len(dx), 1))])
        G += phi.T @ phi
        H += phi.T @ np.diff(x, axis=0)
    return G, H


def bare_pairs(run_x: ndarray, run_u: ndarray, basis: Basis) -> tuple[ndarray, ndarray]:
    """Accumulate what EDMD needs, psi'psi and psi'psi_next, in chunks with plain NumPy."""
    p = 5 * N + N + 1
    M, C = np.zeros((p, p)), np.zeros((p, p))
    for k in range(0, len(run_x) - 1, BLOCK):
        dx = run_x[k : k + BLOCK + 1] - basis.x_ref
        y = dx / basis.scale
        u = run_u[k : k + BLOCK + 1]
        psi = np.hstack([dx, y * y * y, np.sinh(y), np.tanh(y), np.arctan(y), u, np.ones((len(dx), 1))])
        M += psi[:-1].T @ psi[:-1]
        C += psi[:-1].T @ psi[1:]
    return M, C


def measured(route: Callable[[], object]) -> tuple[float, float]:
    """Return the shortest of three CPU times in s, and the peak of new memory in MB."""
    times = []
    for _ in range(3):
        start = time.process_time()
        route()
        times.append(time.process_time() - start)
    tracemalloc.start()
    route()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return min(times), peak / 1e6


def main(samples: int) -> None:
    """Print one line a route."""
    runs = data(samples)
    basis = make_basis(runs, FUNCTIONS)
    structure, lifting = make_structure(basis), make_lifting(basis)
    routes = {
        "bare Gram": lambda: bare(runs[0].x, runs[0].u, basis),
        "weak form": lambda: accumulate(window_rows(runs[0], None, basis, 2, "zoh"), basis, structure),
        "bare pairs": lambda: bare_pairs(runs[0].x, runs[0].u, basis),
        "EDMD": lambda: edmd(runs, lifting),
    }
    print(f"n = {N}, {samples} samples, {basis.size} columns")
    reference = 1.0
    for name, route in routes.items():
        seconds, peak = measured(route)
        reference = seconds if name.startswith("bare") else reference
        print(
            f"{name:<10} {seconds:6.2f} s CPU   ratio {seconds / reference:4.2f}   new memory {peak:6.1f} MB",
            flush=True,
        )


if __name__ == "__main__":
    main(int(float(sys.argv[1])) if len(sys.argv) > 1 else 1_000_000)
