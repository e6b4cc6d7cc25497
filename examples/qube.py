"""Real measurements: a rotary pendulum (Quanser QUBE-Servo) in closed loop, fitted under the certificate.

Two experiments of 20 s serve the fit; the third is predicted from its first sample and its inputs alone. Velocities
were not measured and are estimated. The certificate says that the fitted model is stable, in closed loop and with the
references as inputs; how far it may be believed is what the scores say.

    python examples/qube.py [FOLDER]      FOLDER holds qube/*.csv; default $PERSID_DATA, then ../shared/data
"""

import os
import sys
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import persid as ps

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("PERSID_DATA", ROOT.parent / "shared" / "data"))


def main(folder: Path = DATA) -> Figure:
    """Fit two runs under the certificate; draw the third, measured and predicted."""
    files = sorted((folder / "qube").glob("*.csv"))
    data = ps.read_csv(files, states=["theta", "alpha"], inputs=["target_theta", "target_alpha", "feedforward"])
    fit = ps.CertifiedIdentifier(ps.PersidskiiIdentifier(["x", "x**3", "tanh(x)"], derivatives=1)).fit(data[:2])
    x0 = [*data[2].x[0], 0.0, 0.0]  # the run begins at rest
    free, found = (model.simulate(x0, data[2].t, data[2].u)[0] for model in (fit.free_, fit))
    blown = "none" if free.diverged_at is None else f"at {free.diverged_at:.1f} s"
    print(f"third experiment, blow-up of the fit by least squares alone: {blown}")
    print(f"under the certificate ({fit.certificate_.claim}):")
    figure, axes = plt.subplots(2, 1, figsize=(8, 5), sharex=True, layout="constrained")
    for k, (ax, name) in enumerate(zip(axes, data.states, strict=True)):
        error = data[2].x[:, k] - found.x[:, k]
        print(f"{name}: R2 {1 - (error**2).mean() / data[2].x[:, k].var():.2f}")
        ps.plots.free_run(ax, data[2], found, k, f"{name} in rad")
    axes[0].set_xlabel("")
    axes[0].legend(frameon=False)
    return figure


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2])).savefig("qube.svg")
