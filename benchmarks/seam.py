"""What does it cost that the interior-point method is written against the array API standard?

The same inequalities are decided by turns with NumPy behind the helper of the standard, as always, and with NumPy
itself in the helper's place; the fastest of each counts, in seconds of the processor.

    OMP_NUM_THREADS=1 python benchmarks/seam.py [--sizes 2,10,50,100] [--seconds 20]
"""

import argparse
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
from speed import decided, drawn, warm

from persid.lyapunov import arrays, pairs
from persid.lyapunov.sectors import pool


@contextmanager
def numpy_alone() -> Iterator[None]:
    """Put NumPy in the place of the standard's helper."""
    kept = arrays.Host.xp, pairs.array_namespace
    arrays.Host.xp, pairs.array_namespace = np, lambda M: np
    try:
        yield
    finally:
        arrays.Host.xp, pairs.array_namespace = kept


def once(kind: str, model: object) -> float:
    """Return the seconds of one decision, finding the forms included."""
    pool.cache_clear()
    started = time.process_time()
    decided(kind, model)
    return time.process_time() - started


def compared(kind: str, n: int, seconds: float) -> tuple[float, float]:
    """Return the fastest decision behind the helper and with NumPy alone."""
    model, usual, alone = drawn(kind, n), list[float](), list[float]()
    while sum(usual) < seconds / 2 or len(usual) < 3:
        usual.append(once(kind, model))
        with numpy_alone():
            alone.append(once(kind, model))
    return min(usual), min(alone)


def main() -> None:
    """Print one line a case."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sizes", default="2,10,50,100")
    parser.add_argument("--seconds", type=float, default=20.0, help="for each case")
    options = parser.parse_args()
    for kind in ("paper", "forms"):
        warm(kind)
        for n in map(int, options.sizes.split(",")):
            usual, alone = compared(kind, n, options.seconds)
            ratio = usual / alone
            print(f"{kind:6} n = {n:4}  {1e3 * usual:9.2f} ms  NumPy alone {1e3 * alone:9.2f} ms  ratio {ratio:.3f}")


if __name__ == "__main__":
    main()
