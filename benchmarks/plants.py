"""What measurements are said to tell of a plant, with and without instruments, where noise acts: known truth.

python benchmarks/plants.py [--runs N] [-o benchmarks/results/plants.json]

Two states with tanh, driven by a held white input, sampled at .05 s; a run is 2000 samples. A run is
covered where the true x' lies within the band at all of 500 places in the range of the data, and its models are where
the true coefficients lie in the ellipsoids about those of a fit that are certified as sets. A second table has fits:
the error of x' (root mean square, relative) and the damping -trace dF/dx at 0, which is 3.
"""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import persid as ps
from persid.identification.estimates import Dictionary, estimate, windows_of
from persid.identification.windows import WITH_INSTRUMENTS, choose_window
from persid.measurements.trajectories import Trajectories
from persid.plants.alarms import Evidence, alarms
from persid.plants.members import ellipsoids

A0, T, B = np.array([[-1.0, 0.5], [-0.5, -1.0]]), np.array([[-0.5, 0.0], [0.0, -0.5]]), np.array([1.0, 0.5])
SAMPLES, DT, SUBSTEPS, PLACES = 2000, 0.05, 10, 500
KINDS = ("over-identification", "residual correlation", "hold", "quadrature", "noise bias")
CASES = {
    "quiet: measurement noise .02": {"noise": 0.02},
    "process noise .3": {"process": 0.3},
    "process noise .3, without instruments": {"process": 0.3, "instruments": False},
    "process noise .2, measurement noise .02": {"process": 0.2, "noise": 0.02},
    "an input that varies between samples, taken as held": {"noise": 0.002, "varies": True},
    "a cubic force that the functions do not have": {"noise": 0.002, "cubic": 0.4},
    "a slow force that nobody measured": {"noise": 0.002, "force": 0.5},
}
FITS = ({"process": 0.3}, {"process": 0.2, "noise": 0.02}, {"noise": 0.02}, {"noise": 0.0})


def plant(x: np.ndarray, u: np.ndarray, cubic: float = 0.0) -> np.ndarray:
    """x' at states (N, 2) and inputs (N, 1)."""
    return x @ A0.T + np.tanh(x) @ T.T + u * B - cubic * x**3


def measured(
    runs: int, *, process: float = 0.0, noise: float = 0.0, varies: bool = False, cubic: float = 0.0, force: float = 0.0
) -> list[Trajectories]:
    """Runs of the plant (Euler and Maruyama in short steps), with noise on what is measured; all from seed 0."""
    rng = np.random.default_rng(0)
    levels = rng.normal(0, 1.5, (runs, SAMPLES // 10 + 2))
    h, x, slow = DT / SUBSTEPS, np.zeros((runs, 2)), np.zeros((runs, 1))
    states, inputs = np.zeros((SAMPLES, runs, 2)), np.zeros((SAMPLES, runs, 1))
    for k in range(SAMPLES):
        last, share = divmod(k, 10)
        start, slope = levels[:, last : last + 1], levels[:, last + 1 : last + 2] - levels[:, last : last + 1]
        u = start + slope * share / 10 if varies else start
        states[k], inputs[k] = x, u
        for s in range(SUBSTEPS):
            now = u + (slope * s / SUBSTEPS / 10 if varies else 0.0)
            slow = slow - h * slow + np.sqrt(2 * h) * rng.normal(size=(runs, 1))
            x = x + h * (plant(x, now, cubic) + force * slow) + process * np.sqrt(h) * rng.normal(size=(runs, 2))
    states += noise * rng.normal(size=states.shape)
    return [Trajectories.from_arrays(states[:, r], inputs[:, r], dt=DT) for r in range(runs)]


def answers(
    runs: int, confidences: Sequence[float], *, instruments: bool = True, **how: float
) -> tuple[list[float], float, dict[str, float]]:
    """The share of runs whose band holds the truth, for each confidence, that of ellipsoids for the highest, and the
    share in which each alarm rings.
    """
    rng, held, rung = np.random.default_rng(1), np.zeros(len(confidences)), dict.fromkeys(KINDS, 0.0)
    allowed = 0
    for data in measured(runs, **how):
        phi = Dictionary(model_of(data, instruments))
        window = choose_window(data, WITH_INSTRUMENTS)
        windows = windows_of(data, phi, window, "zoh", instruments)
        found = estimate(windows, np.ones((phi.size, 2), bool))
        about = Evidence(data, phi, windows, found, "zoh", instruments, max(confidences))
        x, u = data[0].x, data[0].u
        x = rng.uniform(x.min(axis=0), x.max(axis=0), (PLACES, 2))
        u = rng.uniform(u.min(), u.max(), (PLACES, 1))
        columns = phi.columns(x, u)
        error = np.abs(plant(x, u, how.get("cubic", 0.0)) - columns @ found.theta)
        error -= np.abs(columns @ about.quadrature)
        held += [(error <= found.band(columns, confidence)).all() for confidence in confidences]
        allowed += allows(about)
        for alarm in alarms(about):
            rung[alarm.kind] += 1
    return (held / runs).tolist(), allowed / runs, {kind: count / runs for kind, count in rung.items()}


def allows(about: Evidence) -> bool:
    """Whether the coefficients of the plant lie in the ellipsoids about a fit."""
    model = about.phi.model
    away = np.hstack([A0 - model.A0, T - model.terms[0].A, B[:, None] - model.B])
    pairs = zip(away, ellipsoids(about, about.windows.X), strict=True)
    return all(np.linalg.norm(np.linalg.lstsq(each.C.T, d)[0]) <= 1 for d, each in pairs)


def model_of(data: Trajectories, instruments: bool) -> ps.PersidskiiModel:
    """A fit with the functions of the plant and the usual window."""
    how = {"ridge": 0.0, "x_ref": 0.0, "scale": 1.0}
    return ps.PersidskiiIdentifier(["x", "tanh(x)"], instruments=instruments, **how).fit(data).model_


def fitted(data: Trajectories, instruments: bool) -> tuple[float, float]:
    """The relative error of x' and the damping of a fit with the functions of the plant and the usual window."""
    model = model_of(data, instruments)
    truth = plant(data[0].x, data[0].u)
    error = np.linalg.norm(model.rhs(data[0].x, data[0].u) - truth) / np.linalg.norm(truth)
    return float(error), -float(np.trace(model.jacobian(np.zeros(2))))


def main() -> None:
    """Print and record a row a case."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--runs", type=int, default=100)
    parser.add_argument("-o", "--output", type=Path, default=Path(__file__).parent / "results" / "plants.json")
    given = parser.parse_args()
    rows = []
    for name, how in CASES.items():
        (usual, high), allowed, rung = answers(given.runs, (0.95, 0.99), **how)
        coverage = {"0.95": usual, "0.99": high, "models, 0.99": allowed}
        rows.append({"case": name, "runs": given.runs, "coverage": coverage, "alarms": rung})
        listed = ", ".join(f"{kind} {share:.2f}" for kind, share in rung.items())
        print(f"{name:<55} nominal .95: {usual:.2f}, .99: {high:.2f}, models {allowed:.2f}; {listed}", flush=True)
    fits = []
    for how in FITS:
        record = measured(given.runs, **how)
        for instruments in (False, True):
            error, damping = np.mean([fitted(data, instruments) for data in record], axis=0)
            fits.append({**how, "instruments": instruments, "error": float(error), "damping": float(damping)})
            print(f"{how!s:<35} instruments {instruments!s:<5} error {error:.3f}, damping {damping:.2f}", flush=True)
    given.output.write_text(json.dumps({"bands": rows, "fits": fits}, indent=1) + "\n")


if __name__ == "__main__":
    main()
