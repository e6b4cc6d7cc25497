"""Identification by persid, bare NumPy, PySINDy, pykoop and PyKoopman on the same data with the same functions.

    x' = A0 x + A3 x**3 + At tanh(x) + B u + b,   n = 2 and 9, one input held for 20 samples, dt = 0.01 s

with 1 % of white noise on every state; 1e5 and 1e6 samples, in one run or in 1,000. Asked of everyone: the processor
time of the fit, the growth of the peak of memory over the data, the largest error of a coefficient (relative to the
largest one; Koopman models have none that can be compared), the error of free runs on held-out inputs.

    python benchmarks/peers_identification.py [--samples 1e5,1e6] [--states 2,9] [--tools ...]
"""

import argparse
import tempfile
from pathlib import Path

import numpy as np
from children import child, joined, keep, kept, python_of
from numpy import ndarray
from peers import TOOLS
from recover import stable_model

from persid.models.model import PersidskiiModel

DT, HOLD, NOISE = 0.01, 20, 0.01
HELD_OUT, LENGTH = 4, 400
CASE = ("n", "samples", "runs", "tool")


def simulated(model: PersidskiiModel, starts: ndarray, u: ndarray) -> ndarray:
    """Return x (runs, N, n) by compiled Runge-Kutta steps of dt with held inputs u (runs, N, m)."""
    import numba

    rhs = model.to_callable(jit=True)

    @numba.njit
    def runge_kutta(starts: ndarray, u: ndarray) -> ndarray:
        x = np.empty((u.shape[0], u.shape[1], starts.shape[1]))
        for r in range(u.shape[0]):
            y = starts[r].copy()
            for k in range(u.shape[1]):
                x[r, k] = y
                k1 = rhs(0.0, y, u[r, k])
                k2 = rhs(0.0, y + DT / 2 * k1, u[r, k])
                k3 = rhs(0.0, y + DT / 2 * k2, u[r, k])
                k4 = rhs(0.0, y + DT * k3, u[r, k])
                y = y + DT / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        return x

    return runge_kutta(starts, u)


def inputs(rng: np.random.Generator, runs: int, samples: int) -> ndarray:
    """Return uniform inputs in [-3, 3], held for HOLD samples."""
    return np.repeat(rng.uniform(-3, 3, (runs, -(-samples // HOLD), 1)), HOLD, axis=1)[:, :samples].copy()


def data(n: int, samples: int, runs: int) -> tuple[dict, ndarray, ndarray]:
    """Return the data of a case, the true held-out runs, and the true coefficients."""
    rng, model = np.random.default_rng(n), stable_model(0, n)
    u = inputs(rng, runs, samples // runs)
    x = simulated(model, rng.uniform(-2, 2, (runs, n)), u)
    x += NOISE * x.std(axis=(0, 1)) * rng.normal(size=x.shape)
    starts, forces = rng.uniform(-2, 2, (HELD_OUT, n)), inputs(rng, HELD_OUT, LENGTH)
    A = np.hstack([model.A0, *(term.A for term in model.terms), model.B, model.b[:, None]])
    given = {"x": x, "u": u, "dt": DT, "held": True, "starts": starts, "forces": forces}
    return given, simulated(model, starts, forces), A


def scored(out: Path, truth: ndarray, A: ndarray) -> dict:
    """Return the error of the coefficients, and of the free runs relative to the spread of the states."""
    found = np.load(out)
    error = np.sqrt(np.mean(((found["predicted"] - truth) / truth.std(axis=(0, 1))) ** 2, axis=(1, 2)))
    lost = int(np.isnan(error).sum())
    worst = float(np.abs(found["A"] - A).max() / np.abs(A).max()) if "A" in found else None
    return {
        "coefficient_error": worst,
        "free_run_error": float(np.median(np.nan_to_num(error, nan=np.inf))) if 2 * lost < len(error) else None,
        "blow_ups": lost,
    }


def run(n: int, samples: int, runs: int, tools: list[str]) -> None:
    """Run every tool on one case; print and keep a line each."""
    with tempfile.TemporaryDirectory() as folder:
        given, truth, A = data(n, samples, runs)
        path, out = Path(folder) / "data.npz", Path(folder) / "out.npz"
        np.savez(path, **given)
        for tool in tools:
            row = {"n": n, "samples": samples, "runs": runs, "tool": tool}
            row |= child("peers.py", tool, "x**3;tanh(x)", str(path), str(out), python=python_of(tool))
            tool_versions = row.pop("versions", {})
            row |= scored(out, truth, A) if row["answer"] == "done" else {}
            name = {"PySINDy smoothed": "pysindy", "persid EDMD": "persid"}.get(tool, tool.lower())
            row["version"] = tool_versions.get(name)
            print(line(row), flush=True)
            rows = joined(kept("peers_identification", "rows"), row, CASE)
            keep("peers_identification", noise=NOISE, rows=sorted(rows, key=lambda r: [r[k] for k in CASE[:3]]))


def line(row: dict) -> str:
    """Return a row of the printed table."""
    head = f"n = {row['n']}  {row['samples']:8d} samples {row['runs']:5d} runs  {row['tool']:<17}"
    if row["answer"] != "done":
        return f"{head} {row['answer']} {row.get('why', '')}"
    errors = f"coefficients {_number(row['coefficient_error'])}  free runs {_number(row['free_run_error'])}"
    return f"{head} {row['seconds']:7.2f} s  {row['memory_MB'] or 0:8.1f} MB  {errors}  {row['blow_ups']} blow-ups"


def _number(value: float | None) -> str:
    return "      —" if value is None else f"{value:7.1e}"


def main() -> None:
    """Run the cases that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--samples", default="1e5,1e6")
    parser.add_argument("--states", default="2,9")
    parser.add_argument("--runs", default="1,1000")
    parser.add_argument("--tools", default=",".join(tool for tool in TOOLS if tool != "persid certified"))
    options = parser.parse_args()
    for n in map(int, options.states.split(",")):
        for samples in map(int, map(float, options.samples.split(","))):
            for runs in map(int, options.runs.split(",")):
                run(n, samples, runs, options.tools.split(","))


if __name__ == "__main__":
    main()
