"""Free runs of identified models on six systems, for every tool with its own defaults and with the same functions.

Each system is measured in ten runs (traffic: the paper's one run under its first disturbance; wave: 30 runs on 30
points, the same functions only: 30 states have more cubic monomials than there are samples) with 1 % of white noise,
and every model predicts noise-free runs that it has not seen: eight whose starts lie where the data's do ("near") and
eight up to three times as far out ("far"; none for the wave). The error is the root mean square over the run relative
to the spread of each true state; a blow-up is a run that leaves 1,000 times the largest measured state. "persid
certified" is the fit under the certificate, 30 s at most, with the same functions only; for systems that are not
input-to-state stable (Van der Pol) it has no model or one of a region. The systems stand in SYSTEMS below with their
equations.

    python benchmarks/peers_accuracy.py [--systems ...] [--tools ...]
"""

import argparse
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from children import child, joined, keep, kept, python_of
from numpy import ndarray
from scipy.integrate import solve_ivp

TOOLS = ("persid", "persid certified", "NumPy", "PySINDy", "pykoop", "PyKoopman")
RUNS, SAMPLES, HOLD, NOISE, STARTS = 10, 400, 20, 0.01, 8
CASE = ("system", "functions", "tool")


@dataclass(frozen=True)
class System:
    """x' = rate(x, u) with a held input of the given range, starts in a box, and the functions that all are given."""

    rate: Callable[[ndarray, float], list[Any]]
    box: tuple[tuple[float, float], ...]
    inputs: tuple[float, float]
    dt: float
    functions: str


def lure(x: ndarray, u: float) -> list[Any]:
    """Return x' of a Lur'e system whose one nonlinearity sees both states."""
    y = np.tanh(2 * x[0] - x[1])
    return [-0.5 * x[0] + x[1] - y, -x[0] - 0.5 * x[1] + 0.5 * y + u]


def tanks(x: ndarray, u: float) -> list[Any]:
    """Return x' of two tanks in a row, levels in m, flow out as the square root of the level."""
    out = 0.5 * np.sqrt(np.maximum(x, 0))
    return [u - out[0], out[0] - out[1]]


SYSTEMS = {
    "Duffing": System(
        lambda x, u: [x[1], -x[0] - 0.4 * x[1] - 0.5 * x[0] ** 3 + u], ((-1, 1), (-1, 1)), (-1, 1), 0.05, "x**3"
    ),
    "Van der Pol": System(  # mu = 5, in Lienard's coordinates
        lambda x, u: [5 * (x[0] - x[0] ** 3 / 3 + x[1]), -x[0] / 5 + u], ((-2, 2), (-1, 1)), (-0.1, 0.1), 0.02, "x**3"
    ),
    "two tanks": System(tanks, ((0.2, 1.0), (0.2, 1.0)), (0.2, 0.5), 0.2, "sqrt(abs(x))"),
    "Lur'e": System(lure, ((-1, 1), (-1, 1)), (-1, 1), 0.05, "x**3;tanh(x)"),
}


def simulated(system: System, starts: ndarray, u: ndarray) -> ndarray:
    """Return x (runs, N, n) for held inputs u (runs, N, 1)."""
    x = np.empty((*u.shape[:2], starts.shape[1]))
    for r, start in enumerate(starts):
        x[r, 0] = start
        for a in range(0, u.shape[1] - 1, HOLD):
            b = min(a + HOLD, u.shape[1] - 1)
            t = system.dt * np.arange(b - a + 1)
            span = partial(_rate, system, float(u[r, a, 0]))
            x[r, a : b + 1] = solve_ivp(span, (0, t[-1]), x[r, a], "LSODA", t, rtol=1e-9, atol=1e-11).y.T
    return x


def _rate(system: System, u: float, t: float, x: ndarray) -> list[Any]:
    return system.rate(x, u)


def classical(name: str) -> tuple[dict[str, Any], ndarray]:
    """Return the measurements, starts and inputs of a system of SYSTEMS, and the true runs."""
    system, rng = SYSTEMS[name], np.random.default_rng(1)
    low, high = np.array(system.box).T

    def forces(runs: int) -> ndarray:
        return np.repeat(rng.uniform(*system.inputs, (runs, SAMPLES // HOLD, 1)), HOLD, axis=1)

    u = forces(RUNS)
    x = simulated(system, rng.uniform(low, high, (RUNS, 2)), u)
    x += NOISE * x.std(axis=(0, 1)) * rng.normal(size=x.shape)
    near, far = (rng.uniform(low, high, (STARTS, 2)) for _ in range(2))
    far = 3 * far if name != "two tanks" else 3 * np.abs(far)
    starts, test = np.concatenate([near, far]), forces(2 * STARTS)
    given = {"x": x, "u": u, "dt": system.dt, "held": True, "starts": starts, "forces": test}
    return given, simulated(system, starts, test)


def traffic() -> tuple[dict[str, Any], ndarray]:
    """Return the paper's run under d1, and true runs from its near and far starts."""
    from persid.studies.traffic import FAR, NEAR, T, disturbed, undisturbed

    run, truth = disturbed("d1")[0], undisturbed((*NEAR, *FAR))
    given = {"x": run.x[None], "u": run.u[None], "dt": T[1] - T[0], "held": False}
    starts = np.array([*NEAR, *FAR])
    forces = np.array([r.u for r in truth])
    return given | {"starts": starts, "forces": forces, "near": len(NEAR)}, np.array([r.x for r in truth])


def wave(points: int = 30) -> tuple[dict[str, Any], ndarray]:
    """Return 30 runs of the paper's wave on a coarser grid, and eight others."""
    from persid.studies.wave import DT, runs

    seen, held_out = runs(points, 30, 0), runs(points, STARTS, 1)
    x, u = (np.array([getattr(run, name) for run in seen]) for name in ("x", "u"))
    truth, forces = (np.array([getattr(run, name) for run in held_out]) for name in ("x", "u"))
    x = x + NOISE * x.std(axis=(0, 1)) * np.random.default_rng(0).normal(size=x.shape)
    given = {"x": x, "u": u, "dt": DT, "held": False, "starts": truth[:, 0], "forces": forces}
    return given | {"near": len(truth)}, truth


CASES: dict[str, tuple[Callable[[], tuple[dict[str, Any], ndarray]], str]] = {
    name: (partial(classical, name), system.functions) for name, system in SYSTEMS.items()
} | {"traffic": (traffic, "sin(x);cos(x)"), "wave": (wave, "x**3;tanh(x)")}


def scored(predicted: ndarray, truth: ndarray, near: int) -> dict[str, Any]:
    """Return the median error of the near and of the far runs (None: more than half blew up), and the blow-ups."""
    spread = truth[:near].std(axis=(0, 1))
    error = np.sqrt(np.mean(((predicted - truth) / spread) ** 2, axis=(1, 2)))
    parts = {"near": error[:near], "far": error[near:]}
    found: dict[str, Any] = {}
    for name, part in parts.items():
        middle = float(np.median(np.nan_to_num(part, nan=np.inf))) if len(part) else np.inf
        found |= {f"{name}_error": middle if np.isfinite(middle) else None}
        found |= {f"{name}_blow_ups": int(np.isnan(part).sum()), f"{name}_runs": len(part)}
    return found


def run(name: str, tools: list[str]) -> None:
    """Run every tool on one system with both libraries; print and keep a line each."""
    build, functions = CASES[name]
    given, truth = build()
    near = given.pop("near", STARTS)
    with tempfile.TemporaryDirectory() as folder:
        path, out = Path(folder) / "data.npz", Path(folder) / "out.npz"
        np.savez(path, **given)
        for kind in ("same",) if name == "wave" else ("same", "own"):
            for tool in (tool for tool in tools if kind == "same" or tool != "persid certified"):
                words = functions if kind == "same" else "own"
                row = {"system": name, "functions": kind, "tool": tool}
                row |= child("peers.py", tool, words, str(path), str(out), python=python_of(tool))
                row.pop("versions", None)
                row |= scored(np.load(out)["predicted"], truth, near) if row["answer"] == "done" else {}
                print(
                    "  ".join(f"{k} {v:.2g}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items()),
                    flush=True,
                )
                rows = joined(kept("peers_accuracy", "rows"), row, CASE)
                keep("peers_accuracy", noise=NOISE, totals=totals(rows), rows=sorted(rows, key=_order))


def _order(row: dict[str, Any]) -> tuple[int, bool, int]:
    return list(CASES).index(row["system"]), row["functions"] == "own", TOOLS.index(row["tool"])


def totals(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one line a tool and library: runs, blow-ups, and the systems on which it gave no model."""
    found = []
    for kind in ("same", "own"):
        for tool in TOOLS:
            part = [row for row in rows if row["tool"] == tool and row["functions"] == kind]
            if not part:
                continue
            done = [row for row in part if row["answer"] == "done"]
            counts = {
                f"{p}_{w}": sum(row[f"{p}_{w}"] for row in done) for p in ("near", "far") for w in ("blow_ups", "runs")
            }
            found.append({"functions": kind, "tool": tool} | counts | {"no_model": len(part) - len(done)})
    return found


def main() -> None:
    """Run the systems that are asked for."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--systems", default=",".join(CASES))
    parser.add_argument("--tools", default=",".join(TOOLS))
    options = parser.parse_args()
    for name in options.systems.split(","):
        run(name, options.tools.split(","))


if __name__ == "__main__":
    main()
