"""Fits under the certificate: what they cost in accuracy and in time.

Every model that is printed as certified has been accepted by persid_check on the very floats of the model. "far" counts
the blow-ups of free runs from 8 far initial states (traffic). Times are of the processor, of one thread:
set OMP_NUM_THREADS=1.

    python benchmarks/constrained.py [traffic] [seeds] [random] [qube] [rig] [--data ../shared/data]
"""

import argparse
import time
from pathlib import Path

import numpy as np
from traffic import FAR, T, disturbed

from persid.certified_fits.identifier import CertifiedIdentifier
from persid.identification.free_runs import Score, free_run_score
from persid.identification.identifier import PersidskiiIdentifier
from persid.measurements.readers import read_csv
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.model import PersidskiiModel
from persid_check import Accepted, check


def accepted(fit: CertifiedIdentifier) -> str:
    """Return the claim that the checker accepts for the model of a fit, or that there is none."""
    if fit.certificate_ is None:
        return "NOT CERTIFIED"
    answer = check(fit.certificate_.data)
    same = fit.certificate_.content["model_sha256"] == fit.model_.sha256
    return f"claim {answer.claim}" if isinstance(answer, Accepted) and same else "NOT ACCEPTED"


def text(score: Score) -> str:
    """Return RMSE and the R2 of the states."""
    blown = f" {score.blow_ups} blow up" if score.blow_ups else ""
    return f"RMSE {score.rmse:.4f} R2 " + " ".join(f"{r:.3f}" for r in score.r2_states) + blown


def traffic() -> None:
    """Print the four disturbances of the paper's traffic study."""
    print("traffic: free fit (validated ridge) | fitted under the certificate")
    for name in ("d1", "d2", "d3", "d4"):
        data = disturbed(name)
        began = time.process_time()
        fit = CertifiedIdentifier(PersidskiiIdentifier()).fit(data)
        seconds = time.process_time() - began
        far = sum(fit.simulate(x0, T, data[0].u)[0].diverged_at is not None for x0 in FAR)
        free, score = (free_run_score(model, data) for model in (fit.free_.model_, fit.model_))
        end = f"far {far}/8  {accepted(fit)}  {seconds:.1f} s"
        print(f"  {name}  {text(free)} | {text(score)}  {end}", flush=True)


def seeds(count: int = 10) -> None:
    """Print how often a certified model is found, over seeds of d2 and of d1 with measurement noise."""
    for name in ("d2", "noisy d1"):
        found, times = 0, []
        for seed in range(count):
            data = disturbed("d2", seed) if name == "d2" else noisy(disturbed("d1"), seed)
            began = time.process_time()
            found += accepted(CertifiedIdentifier(PersidskiiIdentifier()).fit(data)).startswith("claim")
            times.append(time.process_time() - began)
        seconds = f"{np.median(times):.1f} s (median), {max(times):.1f} s (most)"
        print(f"seeds of {name}: {found} of {count} certified, {seconds}", flush=True)


def noisy(data: Trajectories, seed: int, size: float = 0.02) -> Trajectories:
    """Return trajectories with white measurement noise."""
    rng = np.random.default_rng(seed)
    runs = tuple(Trajectory(run.t, run.x + size * rng.normal(size=run.x.shape), run.u) for run in data)
    return Trajectories(runs, data.states, data.inputs)


def truth(n: int, seed: int) -> PersidskiiModel:
    """Return a random model with row and column dominance of every block: it is stable by construction."""
    rng = np.random.default_rng(seed)
    blocks = []
    for size in (1.0, 0.1, 0.1, 1.0):
        M = rng.normal(size=(n, n)) * size / np.sqrt(n)
        M -= np.diag(np.diag(M))
        M -= np.diag(np.maximum(np.abs(M).sum(axis=0), np.abs(M).sum(axis=1)) + 0.2 * size)
        blocks.append(M)
    names = ("x**3", "sinh(x)", "tanh(x)")
    terms = [(f, None, A) for f, A in zip(names, blocks[1:], strict=True)]
    return PersidskiiModel(blocks[0], terms, rng.normal(size=(n, 2)))


def measured(model: PersidskiiModel, runs: int, seed: int) -> Trajectories:
    """Return noisy runs of 500 samples under random held inputs, from random initial states."""
    rng = np.random.default_rng(seed)
    t = 0.02 * np.arange(500)
    found = []
    for _ in range(runs):
        u = np.repeat(3 * rng.normal(size=(20, model.m)), 25, axis=0)
        found.append(model.simulate(2 * rng.normal(size=model.n), t, u, rtol=1e-6, atol=1e-8)[0])
    return noisy(Trajectories(tuple(found), model.states, model.inputs), seed, 0.01)


def random_models() -> None:
    """Print random certified truths: 5,000 noisy samples, scored on two held-out runs."""
    for n, limit in ((10, 60.0), (20, 240.0)):
        model = truth(n, 1)
        data, test = measured(model, 10, 2), measured(model, 2, 3)
        began = time.process_time()
        free = PersidskiiIdentifier().fit(data)
        middle = time.process_time()
        fit = CertifiedIdentifier(free, time_limit=limit).fit(data)
        seconds = time.process_time() - middle
        before, after = (free_run_score(m, test).rmse for m in (free.model_, fit.model_))
        print(
            f"n = {n}: held-out RMSE free {before:.5f} ({middle - began:.1f} s), certified {after:.5f} "
            f"({100 * (after / before - 1):+.2f} %), {accepted(fit)}, {seconds:.1f} s", flush=True,
        )  # fmt: skip


def pendulum(folder: Path) -> None:
    """Print the rotary pendulum, velocities estimated: two experiments to fit, the third to score."""
    files = sorted((folder / "qube").glob("*.csv"))
    data = read_csv(files, states=["theta", "alpha"], inputs=["target_theta", "target_alpha", "feedforward"])
    compare("pendulum", data[:2], data[2:], ["x", "x**3", "tanh(x)"], derivatives=1)


def rig(folder: Path) -> None:
    """Print the fatigue-test rig, with equal steps: the first four fifths to fit, the rest to score."""
    data = read_csv(folder / "faster" / "faster.csv", states=["y"], inputs=["r", "d"], dt=164.94 / 21274)
    cut = int(0.8 * len(data[0]))
    train, test = (Trajectories((run,), data.states, data.inputs) for run in (data[0][:cut], data[0][cut:]))
    for options in ({}, {"derivatives": 1}):
        compare(f"rig {options or ''}", train, test, ["x", "x**3", "tanh(x)"], **options)


def compare(name: str, train: Trajectories, test: Trajectories, functions: list[str], **options: int) -> None:
    """Print free, linear and certified fits on a test run."""
    free = PersidskiiIdentifier(functions, **options).fit(train)
    linear = PersidskiiIdentifier(["x"], **options).fit(train)
    began = time.process_time()
    fit = CertifiedIdentifier(free).fit(train)
    seconds = time.process_time() - began
    scores = []
    for model in (free.model_, linear.model_, fit.model_):
        scores.append(free_run_score(model, free._known(test, None, None, None)))
    print(name)
    for label, found in zip(("free", "linear", f"certified ({accepted(fit)}, {seconds:.1f} s)"), scores, strict=True):
        print(f"  {label}: {text(found)}")
    best = np.maximum(scores[0].r2_states, scores[1].r2_states)
    print("  certified minus best of free and linear:", np.round(np.array(scores[2].r2_states) - best, 3), flush=True)


def main() -> None:
    """Print the parts that are named, or all of them."""
    parser = argparse.ArgumentParser()
    parser.add_argument("parts", nargs="*", default=["traffic", "seeds", "random", "qube", "rig"])
    parser.add_argument("--data", type=Path, default=Path("../shared/data"))
    given = parser.parse_args()
    parts = {"traffic": traffic, "seeds": seeds, "random": random_models}
    for name in given.parts:
        if name in parts:
            parts[name]()
        else:
            {"qube": pendulum, "rig": rig}[name](given.data)


if __name__ == "__main__":
    main()
