"""Three public benchmarks of nonlinear system identification: inputs and outputs alone, official splits and metric.

The metric is the root-mean-square error of a free run over the official test, in the unit of the benchmark; the state
at its start is estimated from its first 5, 50 or 4 samples, which are not scored. Nothing is chosen by hand for a data
set, and nothing by its test: neurons are tanh or share a learned curve, whichever foretells the held-out part. Every
row is one run of `OutputIdentifier` with other random starts.

    tanks      cascaded tanks, V: train uEst, yEst; test uVal, yVal
    silverbox  mV: train the first 75 % of samples 40650:127400, test the rest, the arrow 100:40575, its first 32,000
    drives     coupled electric drives: the first 400 samples of two records train, the last 100 of each test;
               the sensor ignores the sign

Published figures: those collected in arXiv 2405.10779 and on nonlinearbenchmark.org.

    python benchmarks/public.py [tanks silverbox drives file.csv] [--seeds 5] [--folder ../shared/data/benchmarks]

A file.csv of the form of the tanks' is read likewise: columns uEst, uVal, yEst, yVal, in this order, one sample a row.
Say its sampling time with --dt, how many first samples tell the state with --start, an output map with --output-map.

Rows and published figures are merged into benchmarks/results/public.json.
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field
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
    """Hold a benchmark: records to train and to test, first samples that are not scored, and what was published.

    `scale` turns the data's unit into the unit in which errors are told; `options` are of the estimator, what is known
    of the plant before any data: a sensor without a sign, one law of outflow for all tanks.
    """

    train: list[Record]
    tests: dict[str, Record]
    start: int
    dt: float
    unit: str
    scale: float = 1.0
    published: dict[str, tuple[float, ...]] = field(default_factory=dict)
    options: dict[str, Any] = field(default_factory=dict)


SOURCE = "arXiv 2405.10779, nonlinearbenchmark.org"


def from_csv(path: Path, dt: float, start: int, **more: Any) -> Benchmark:
    """Return a benchmark of one record each, from columns uEst, uVal, yEst, yVal; some may end early."""
    u, u_test, y, y_test = np.genfromtxt(path, delimiter=",", skip_header=1, usecols=range(4)).T
    good, seen = np.isfinite(u) & np.isfinite(y), np.isfinite(u_test) & np.isfinite(y_test)
    return Benchmark([(u[good], y[good])], {"test": (u_test[seen], y_test[seen])}, start, dt, **more)


def tanks(folder: Path) -> Benchmark:
    """Return the cascaded tanks (V)."""
    published = {
        "grey box": (0.191,), "CT-SUBNET": (0.306,), "GRU": (0.396,), "pNARX": (0.413,), "linear": (0.588,),
    }  # fmt: skip
    one_law = {"functions": ("tanh", "pwl"), "one_curve": True}
    return from_csv(folder / "cts.csv", 4.0, 5, unit="V", published=published, options=one_law)


def silverbox(folder: Path) -> Benchmark:
    """Return the Silverbox (mV)."""
    from scipy.io import loadmat

    content = loadmat(folder / "SNLS80mV.mat")
    u, y = content["V1"].ravel().astype(float), content["V2"].ravel().astype(float)
    cut = 40650 + int(0.75 * (127400 - 40650))
    tests = {"multisine": (cut, 127400), "arrow": (100, 40575), "no extrapolation": (100, 32100)}
    published = {
        "best of the tables": (0.36, 0.26, 0.32), "GP-NARX": (0.30, 0.60, 0.26), "GRU": (1.5, 2.8, 0.95),
        "linear": (7.0, 14.4, 6.6),
    }  # fmt: skip
    found = {name: (u[a:b], y[a:b]) for name, (a, b) in tests.items()}
    return Benchmark([(u[40650:cut], y[40650:cut])], found, 50, 1 / 610.35, "mV", 1000.0, published)


def drives(folder: Path) -> Benchmark:
    """Return the coupled electric drives; the two records."""
    pairs = [
        tuple(np.loadtxt(folder / f"ced_{side}_{part}.txt", skiprows=1) for side in "XY") for part in ("train", "test")
    ]
    tests = {f"test {k + 1}": (u[400:], y[400:]) for k, (u, y) in enumerate(pairs)}
    published = {"best of the tables": (0.115, 0.074), "GP-NARX": (0.102, 0.090), "linear": (0.224, 0.384)}
    return Benchmark(
        [(u[:400], y[:400]) for u, y in pairs], tests, 4, 0.02, "ticks/s", 1.0, published, {"output": "abs"}
    )


KNOWN: dict[str, Callable[[Path], Benchmark]] = {"tanks": tanks, "silverbox": silverbox, "drives": drives}


def row(name: str, given: Benchmark, seed: int) -> dict[str, Any]:
    """Return the errors on the tests, processor time and verdict of one run."""
    data = Trajectories.from_arrays(
        [y[:, None] for _, y in given.train], [u[:, None] for u, _ in given.train], dt=given.dt, states=["y"]
    )
    start = time.process_time()
    fit = OutputIdentifier(**given.options, random_state=3 * seed, time_limit=0).fit(data)
    seconds, errors = time.process_time() - start, {}
    for test, (u, y) in given.tests.items():
        t, k = given.dt * np.arange(len(u)), given.start
        found = fit.model_.simulate(t, u[:, None], y_init=y[:k, None])[0].x[:, 0]
        errors[test] = float(np.sqrt(np.mean((found - y)[k:] ** 2)) * given.scale) if len(found) == len(y) else np.inf
    chosen = fit.report_.chosen
    return {
        "benchmark": name, "seed": seed, "errors": errors, "seconds": seconds, "certified": fit.verdict_.is_certified,
        "order": chosen.order, "neurons": chosen.neurons, "feedthrough": chosen.feedthrough, "unit": given.unit,
    }  # fmt: skip


def published(name: str, given: Benchmark) -> list[dict[str, Any]]:
    """Return what others have published, in the order of the tests."""
    return [
        {"benchmark": name, "model": model, "errors": dict(zip(given.tests, errors, strict=True)), "source": SOURCE}
        for model, errors in given.published.items()
    ]


def told(errors: dict[str, float]) -> str:
    """Return errors in one line."""
    return "  ".join(f"{test} {error:.3f}" for test, error in errors.items())


def main() -> None:
    """Print a line for each run and the medians; keep the rows."""
    parser = argparse.ArgumentParser()
    parser.add_argument("names", nargs="*", default=list(KNOWN), help="tanks, silverbox, drives, or a file.csv")
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--folder", type=Path, default=FOLDER)
    parser.add_argument("--dt", type=float, default=1.0, help="seconds a sample of a file.csv")
    parser.add_argument("--start", type=int, default=50, help="samples of its test that tell the state, not scored")
    parser.add_argument("--output-map", choices=["abs"], help="a sensor that ignores the sign")
    asked = parser.parse_args()
    for name in asked.names:
        if name in KNOWN and not asked.folder.is_dir():
            print(f"{name}: there is no folder {asked.folder}; give one with --folder")
            continue
        given = (
            KNOWN[name](asked.folder)
            if name in KNOWN
            else from_csv(Path(name), asked.dt, asked.start, unit="1", options={"output": asked.output_map})
        )
        rows = []
        for seed in range(asked.seeds):
            rows.append(row(Path(name).stem, given, seed))
            one = rows[-1]
            size = f"n {one['order']} q {one['neurons']} D {one['feedthrough']}"
            proof = "certified" if one["certified"] else "not certified"
            print(f"{name:10} {seed:2}  {told(one['errors'])}  {one['seconds']:5.1f} s  {proof}  {size}", flush=True)
            others = [line for line in kept(RESULTS, "published") if line["benchmark"] != one["benchmark"]]
            keep(
                RESULTS,
                rows=joined(kept(RESULTS, "rows"), one, ("benchmark", "seed")),
                published=others + published(one["benchmark"], given),
            )
        medians = {test: float(np.median([one["errors"][test] for one in rows])) for test in given.tests}
        print(f"{name:10} median of {len(rows)}: {told(medians)} {given.unit}")
        for line in published(name, given):
            print(f"{name:10} {line['model']}: {told(line['errors'])}")


if __name__ == "__main__":
    main()
