"""Identify the real measurements: a fatigue-test rig (irregular clock) and a rotary pendulum (velocities not measured).

python benchmarks/real_data.py ../shared/data
"""

import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from persid.errors import DataError
from persid.identification.baselines import arx
from persid.identification.identifier import PersidskiiIdentifier
from persid.measurements.readers import read_csv
from persid.measurements.trajectories import Trajectories


def rig(folder: Path) -> dict[str, Trajectories]:
    """Return the rig's run with equal steps, and with the times of the file where these increase.

    The file's times are rounded to five digits: after 100 s they move by 10 ms, more than a step, and repeat.
    """
    path = folder / "faster" / "faster.csv"
    try:
        read_csv(path, states=["y"], inputs=["r", "d"])
    except DataError as error:
        print(f"as it stands: {error}\n")
    equal = read_csv(path, states=["y"], inputs=["r", "d"], dt=164.94 / 21274)
    t = np.loadtxt(path, delimiter=",", skiprows=1, usecols=0)
    keep = np.concatenate([[True], np.diff(t) > 0])
    run = equal[0]
    names = {"states": ["y"], "inputs": ["r", "d"]}
    return {
        "equal steps": equal,
        "rounded times": Trajectories.from_arrays(run.x[keep], run.u[keep], t=t[keep], **names),
    }


def line(name: str, data: Trajectories, **options: Any) -> None:
    """Print the free-run score on the held-out last fifth of every run."""
    start = time.perf_counter()
    fit = PersidskiiIdentifier(**options).fit(data)
    seconds, score = time.perf_counter() - start, fit.report_.free_run
    states = ", ".join(f"{s} {r:.3f}" for s, r in zip(fit.model_.states, score.r2_states, strict=True))
    figures = f"ridge {fit.ridge_:.1e}  RMSE {score.rmse:.4f}  R2 {states}  blow-ups {score.blow_ups}"
    print(f"{name:<34} {figures}  {seconds:.1f} s")


def main(folder: Path) -> None:
    """Print one line a fit."""
    if not folder.is_dir():
        sys.exit(f"skipped: there is no folder {folder} with the measurements")
    for name, data in rig(folder).items():
        line(f"rig, {name}", data)
    inputs = ["target_theta", "target_alpha", "feedforward"]
    files = sorted((folder / "qube").glob("*.csv"))
    pendulum = read_csv(files, states=["theta", "alpha"], inputs=inputs)
    line("pendulum, first file", pendulum[:1], derivatives=1)
    line("pendulum, three files", pendulum, derivatives=1)
    line("pendulum, three files, linear", pendulum, derivatives=1, functions=["x"])
    line("pendulum, linear, refined", pendulum, derivatives=1, functions=["x"], refine=True)
    line("pendulum, no velocities", pendulum)
    held = Trajectories(tuple(run[8000:] for run in pendulum), pendulum.states, pendulum.inputs)
    train = Trajectories(tuple(run[:8000] for run in pendulum), pendulum.states, pendulum.inputs)
    print(
        "pendulum, ARX(2,2) for comparison, R2 of states:", np.round(arx(1e-3).fit(train).free_run(held).r2_states, 3)
    )


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data"))
