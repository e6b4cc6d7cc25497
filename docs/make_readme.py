"""Draw docs/images/readme.svg: measurements, the model's free run, and what is proved, side by side.

python docs/make_readme.py
"""

from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np

import persid as ps

mpl.use("agg")
ROOT = Path(__file__).resolve().parents[1]
PICTURE = Path(__file__).with_name("images") / "readme.svg"
BLUE, RED, GREY = "#27408b", "#c2452d", "#777777"


def draw() -> None:
    """Draw the picture."""
    data = ps.read_csv(ROOT / "examples" / "traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
    model = ps.PersidskiiIdentifier().fit(data).model_
    verdict = ps.certify(model)
    if not isinstance(verdict, ps.Certified):
        raise SystemExit(f"nothing to draw: {verdict}")
    run = data[0]
    mpl.rcParams |= {"svg.hashsalt": "readme", "figure.facecolor": "white", "font.size": 10, "axes.titlesize": 11}
    figure, axes = plt.subplots(1, 3, figsize=(10.5, 3.0), layout="constrained")
    axes[0].plot(run.t, run.x, color=BLUE, lw=1.2)
    axes[0].plot(run.t, run.u, color=GREY, lw=0.8)
    axes[0].set(title="measured: two states and an input", xlabel="t in s")
    model_run = model.simulate(run.x[0], run.t, run.u)[0]
    axes[1].plot(run.t, run.x, color=BLUE, lw=1.2)
    axes[1].plot(run.t, model_run.x, color=RED, lw=1.4, ls="--")
    axes[1].set(title="identified: the model alone (dashed)", xlabel="t in s")
    _proved(axes[2], model, verdict.certificate)
    figure.savefig(PICTURE, metadata={"Date": None})


def _proved(ax: plt.Axes, model: ps.PersidskiiModel, certificate: ps.Certificate | ps.NetworkCertificate) -> None:
    """Draw the distance from x* of runs under random inputs of size 1, and the bound that none of them exceeds."""
    rng, t, x0 = np.random.default_rng(0), np.linspace(0, 25, 501), np.array([5.0, -3.0])
    for _ in range(25):
        u = model.u_ref + np.repeat(rng.uniform(-1, 1, size=(21, 1)), 25, axis=0)[: len(t)]
        run = model.simulate(x0, t, u)[0]
        ax.plot(run.t, np.linalg.norm(run.x - certificate.operating_point, axis=1), color=RED, lw=0.5, alpha=0.6)
    ax.plot(t, certificate.bound(x0, u_sup=1.0, t=t), color="black", lw=1.8)
    ax.set(title="certified: no run exceeds the line", xlabel="t in s", ylabel="distance from x*", ylim=(0, None))


if __name__ == "__main__":
    draw()
