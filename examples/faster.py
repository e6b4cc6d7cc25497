"""Real measurements: a fatigue-test rig in closed loop, its clock rounded.

The file's times are rounded to five digits and repeat after 100 s, so equal steps are used. Four fifths of 165 s
serve the fit, the rest is predicted from one sample and the inputs alone. With one state the reference nearly decides
the output, which is why the score is high; the certified rate and gain are those of the model about its equilibrium.

    python examples/faster.py [FOLDER]      FOLDER holds faster/faster.csv; default $PERSID_DATA, then ../shared/data
"""

import os
import sys
from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import persid as ps

ROOT = Path(__file__).parents[1]
DATA = Path(os.environ.get("PERSID_DATA", ROOT.parent / "shared" / "data"))
STEP = 164.94 / 21274  # s


def main(folder: Path = DATA) -> Figure:
    """Fit under the certificate, ask for a rate and a gain, and draw the held-out prediction."""
    data = ps.read_csv(folder / "faster" / "faster.csv", states=["y"], inputs=["r", "d"], dt=STEP)
    train, test = data.split(5)[:4], data.split(5)[4:]
    fit = ps.CertifiedIdentifier(ps.PersidskiiIdentifier(["x", "x**3", "tanh(x)"])).fit(train)
    free, certified = fit.report_.free.rmse, fit.report_.certified.rmse
    print(f"RMSE of free runs on the data of the fit: {free:.4f}, under the certificate {certified:.4f}")
    print(f"R2 of the free run on the last fifth: {fit.score(test):.4f}")
    y, r = test[0].x[:, 0], test[0].u[:, 0]
    print(f"R2 of y = r there: {1 - ((y - r) ** 2).mean() / y.var():.4f}")
    certificate = ps.certify(fit.model_).certificate
    print(f"{certificate.claim}: rate {certificate.rate:.2f} 1/s, gain {certificate.gain:.3f}")
    figure, ax = plt.subplots(figsize=(8, 3), layout="constrained")
    found = fit.simulate(test[0].x[0], test[0].t, test[0].u)[0]
    shown = slice(0, 1000)
    ps.plots.free_run(ax, test[0][shown], found[shown], 0, "y").legend(frameon=False)
    return figure


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:2])).savefig("faster.svg")
