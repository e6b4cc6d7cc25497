"""Three public benchmarks of nonlinear system identification: inputs and outputs alone, official splits and metric.

The metric is the root-mean-square error of a free run over the official test, in the unit of the benchmark; the state
at its start is estimated from its first 5, 50 or 4 samples, which are not scored. Nothing is chosen by hand for a data
set, and nothing by its test. Every row is one run of `OutputIdentifier` with other random starts.

    tanks      cascaded tanks, V: train uEst, yEst; test uVal, yVal
    silverbox  mV: train the first 75 % of samples 40650:127400, test the rest, the arrow 100:40575, its first 32,000
    drives     coupled electric drives: the first 400 samples of two records train, the last 100 of each test;
               the sensor ignores the sign

Published figures: those collected in arXiv 2405.10779 and on nonlinearbenchmark.org.

    python benchmarks/public.py [tanks silverbox drives] [--seeds 5] [--folder ../shared/data/benchmarks]

Rows are merged into benchmarks/results/public.json.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from children import joined, keep, kept
from numpy import ndarray

from persid.certified_fits.outputs import OutputIdentifier
from persid.measurements.trajectories import Trajectories

FOLDER = Path(__file__).resolve().parents[2] / "shared" / "data" / "benchmarks"
RESULTS = "public"
Record = tuple[ndarray, ndarray]


@dataclass(frozen=True)
class Benchmark:
    """Hold a benchmark: records to train and to test, first samples that are not scored, and what was published."""

    train: list[Record]
    tests: dict[str, Record]
    start: int
    dt: float
    unit: float
    published: str
    output_map: str | None = None


def tanks(folder: Path) -> Benchmark:
    """Return the cascaded tanks (V)."""
    u, u_test, y, y_test = np.genfromtxt(folder / "cts.csv", delimiter=",", skip_header=1, usecols=range(4)).T
    good = np.isfinite(y)
    published = ".191 grey box; .306 CT-SUBNET; .396 GRU; .413 pNARX; .588 linear"
    return Benchmark([(u[good], y[good])], {"test": (u_test[good], y_test[good])}, 5, 4.0, 1.0, published)


def silverbox(folder: Path) -> Benchmark:
    """Return the Silverbox (mV)."""
    from scipy.io import loadmat

    content = loadmat(folder / "SNLS80mV.mat")
    u, y = content["V1"].ravel().astype(float), content["V2"].ravel().astype(float)
    cut = 40650 + int(0.75 * (127400 - 40650))
    tests = {"multisine": (cut, 127400), "arrow": (100, 40575), "no extrapolation": (100, 32100)}
    published = ".36/.26/.32 best; GP-NARX .30/.60/.26; GRU 1.5/2.8/.95; linear 7.0/14.4/6.6"
    found = {name: (u[a:b], y[a:b]) for name, (a, b) in tests.items()}
    return Benchmark([(u[40650:cut], y[40650:cut])], found, 50, 1 / 610.35, 1000.0, published)


def drives(folder: Path) -> Benchmark:
    """Return the coupled electric drives; the two records."""
    pairs = [
        tuple(np.loadtxt(folder / f"ced_{side}_{part}.txt", skiprows=1) for side in "XY") for part in ("train", "test")
    ]
    tests = {f"test {k + 1}": (u[400:], y[400:]) for k, (u, y) in enumerate(pairs)}
    published = ".115/.074 best; GP-NARX .102/.090; linear .224/.384"
    return Benchmark([(u[:400], y[:400]) for u, y in pairs], tests, 4, 0.02, 1.0, published, "abs")


KNOWN: dict[str, Callable[[Path], Benchmark]] = {"tanks": tanks, "silverbox": silverbox, "drives": drives}


def row(name: str, given: Benchmark, seed: int) -> dict[str, Any]:
    """Return the errors on the tests, processor time and verdict of one run."""
    data = Trajectories.from_arrays(
        [y[:, None] for _, y in given.train], [u[:, None] for u, _ in given.train], dt=given.dt, states=["y"]
    )
    start = time.process_time()
    fit = OutputIdentifier(output=given.output_map, random_state=3 * seed, time_limit=0).fit(data)
    seconds, errors = time.process_time() - start, {}
    for test, (u, y) in given.tests.items():
        t, k = given.dt * np.arange(len(u)), given.start
        found = fit.model_.simulate(t, u[:, None], y_init=y[:k, None])[0].x[:, 0]
        errors[test] = float(np.sqrt(np.mean((found - y)[k:] ** 2)) * given.unit) if len(found) == len(y) else np.inf
    chosen = fit.report_.chosen
    return {
        "benchmark": name, "seed": seed, "errors": errors, "seconds": seconds, "certified": fit.verdict_.is_certified,
        "order": chosen.order, "neurons": chosen.neurons, "feedthrough": chosen.feedthrough,
    }  # fmt: skip


def main() -> None:
    """Print a line for each run and the medians; keep the rows."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=list(KNOWN))
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--folder", type=Path, default=FOLDER)
    asked = parser.parse_args()
    for name in asked.names:
        given, rows = KNOWN[name](asked.folder), []
        for seed in range(asked.seeds):
            rows.append(row(name, given, seed))
            one = rows[-1]
            shown = "  ".join(f"{test} {error:.3f}" for test, error in one["errors"].items())
            size = f"n {one['order']} q {one['neurons']} D {one['feedthrough']}"
            print(
                f"{name:10} {seed:2}  {shown}  {one['seconds']:5.1f} s  certified {one['certified']}  {size}",
                flush=True,
            )
            keep(RESULTS, rows=joined(kept(RESULTS, "rows"), one, ("benchmark", "seed")))
        medians = "  ".join(f"{test} {np.median([r['errors'][test] for r in rows]):.3f}" for test in given.tests)
        print(f"{name:10} median  {medians}  certified {sum(r['certified'] for r in rows)} of {len(rows)}")
        print(f"{name:10} published  {given.published}")


if __name__ == "__main__":
    main()
