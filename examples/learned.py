"""Learned functions: two tanks whose outflow nobody knows.

    x1' = q - g(x1),   x2' = g(x1) - g(x2)          (levels and inflow from their working point; g(x) = sign(x) sqrt|x|)

From 1,500 noisy samples the fit learns what each level does to each equation, piecewise linear between knots that the
data place, and the checker accepts a proof for the very model that was learned. Each curve stands over the density of
the samples; the true outflow is dotted.

    python examples/learned.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

rng = np.random.default_rng(0)
t = 0.05 * np.arange(1500)
q = np.repeat(rng.uniform(-1.5, 1.5, 75), 20)


def outflow(x: np.ndarray) -> np.ndarray:
    """Return the flow out of a tank."""
    return np.sign(x) * np.sqrt(np.abs(x))


def measured() -> ps.Trajectories:
    """Simulate the tanks by small steps, and add noise of 1 % of the range."""
    x = np.zeros((len(t), 2))
    for k in range(len(t) - 1):
        x[k + 1] = x[k]
        for _ in range(50):
            g = outflow(x[k + 1])
            x[k + 1] += 0.001 * np.array([q[k] - g[0], g[0] - g[1]])
    noise = 0.01 * np.ptp(x, axis=0) * rng.normal(size=x.shape)
    return ps.Trajectories.from_arrays(x + noise, u=q[:, None], t=t)


def main() -> Figure:
    """Learn, certify, and draw the four curves."""
    data = measured()
    fit = ps.PersidskiiIdentifier(functions=["x", "pwl"], knots=6).fit(data)
    certificate = ps.certify(fit.model_).certificate
    print(f"{fit.knots_} knots a state; certified, rate {certificate.rate:.2f} 1/s, gain {certificate.gain:.1f}")
    figure, axes = plt.subplots(2, 2, figsize=(9, 5.6), layout="constrained")
    for (i, j), sign in {(0, 0): -1, (0, 1): 0, (1, 0): 1, (1, 1): -1}.items():
        x = data[0].x[:, j]
        ps.plots.characteristic(axes[i, j], fit.model_, i, j, x, (-1.2, 1.2))
        true = np.linspace(x.min(), x.max(), 200)
        axes[i, j].plot(true, sign * outflow(true), ":", color=ps.plots.INK)
    return figure


if __name__ == "__main__":
    main().savefig("learned.svg")
