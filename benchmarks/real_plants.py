"""What may be said of three real plants: margins of certified models, and what the measurements say of them.

    python benchmarks/real_plants.py [FOLDER]        default ../shared/data

One paragraph a record, in docs/plants.md, has its figures from here. The detectors are every 69th of the file.
"""

import sys
from collections.abc import Iterator
from pathlib import Path

import persid as ps
from persid.plants.residuals import inside, measured_residuals

FATIGUE_STEP = 164.94 / 21274  # s; the file's times are rounded
DETECTORS = slice(0, None, 69)  # of 207
INTERVAL = 300.0  # s between two samples of the detectors


def records(folder: Path) -> Iterator[tuple[str, ps.Trajectories, dict[str, object]]]:
    """Yield a name, measurements, and the options of a fit."""
    rig = ps.read_csv(folder / "faster" / "faster.csv", states=["y"], inputs=["r", "d"], dt=FATIGUE_STEP)
    yield "fatigue rig", rig, {"functions": ["x", "tanh(x)"]}
    yield "fatigue rig, instruments", rig, {"functions": ["x", "tanh(x)"], "instruments": True}
    files = sorted((folder / "qube").glob("*.csv"))
    qube = ps.read_csv(files, states=["theta", "alpha"], inputs=["target_theta", "target_alpha", "feedforward"])
    yield "pendulum", qube, {"functions": ["x"], "derivatives": 1}
    yield "pendulum, instruments", qube, {"functions": ["x"], "derivatives": 1, "instruments": True}
    speeds = folder / "los_traffic" / "los_speed.csv"
    names = speeds.read_text("utf-8").split("\n", 1)[0].split(",")[DETECTORS]
    yield "motorway", ps.read_csv(speeds, states=names, dt=INTERVAL), {"functions": ["x"]}


def line(name: str, data: ps.Trajectories, options: dict[str, object]) -> str:
    """Return what is proved and measured of one record."""
    fit = ps.PersidskiiIdentifier(**options).fit(data)
    verdict = ps.certify(fit.model_)
    free = fit.report_.free_run
    foretold = "" if free is None else f", R2 of free runs on the held-out part {free.r2_mean:.4f}"
    head = f"{name}: {type(verdict).__name__.lower()}, window {fit.window_}{foretold}"
    if not isinstance(verdict, ps.Certified) or verdict.margin is None:
        return head
    margin = verdict.margin
    known = fit._known(data)
    measured = measured_residuals(margin.certificate.model, margin, known, fit.hold)
    told = [
        f"delta {margin.delta:.4g} of radius {margin.radius:.4g}, rest {margin.resting:.4g}",
        inside(measured, margin),
    ]
    try:
        told.append(str(ps.plant_margin(fit, verdict, data)))
    except ps.PersidError as error:
        told.append(str(error))
    return "\n    ".join([head, *told])


if __name__ == "__main__":
    for record in records(Path(sys.argv[1] if len(sys.argv) > 1 else "../shared/data")):
        print(line(*record), flush=True)
