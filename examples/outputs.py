"""Inputs and outputs only: two tanks and one sensor; fitted, certified and foretold.

Water is pumped into an upper tank and runs on into a lower one, less than in proportion to the level; only the lower
level is measured, with noise, as a deviation from its usual value. The model is stable by construction, and so is
every model that the fit tries; the last quarter of the record chooses among them. The gain is what the certificate
proves: by how much the level moves at most, for one unit by which the pump does.

    python examples/outputs.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

TANKS = ps.PersidskiiModel(
    [[-0.1, 0.0], [0.1, -0.1]],
    [("tanh(x)", None, [[-0.3, 0.0], [0.3, -0.3]])],
    [[0.1], [0.0]],
    states=["upper", "lower"],
    inputs=["pump"],
)
DT, N = 1.0, 500


def main() -> Figure:
    """Fit the first record; draw the second, which the fit has not seen, with the run of the model and its bound."""
    rng = np.random.default_rng(0)
    t = DT * np.arange(N)
    u = np.repeat(rng.uniform(-4.0, 4.0, (2, N // 25, 1)), 25, axis=1)
    level = [TANKS.simulate([0.0, 0.0], t, pump)[0].x[:, 1:] + 0.005 * rng.normal(size=(N, 1)) for pump in u]
    fit = ps.OutputIdentifier(order=2, min_rate=0.02, seeds=2, time_limit=0).fit(level[0], u=u[0], dt=DT)
    chosen, certificate = fit.report_.chosen, fit.certificate_
    print(f"{chosen.neurons} neurons, feedthrough {chosen.feedthrough}; certified: {fit.verdict_.is_certified}")
    print(f"R2 of the record that was not fitted: {fit.score(level[1], u=u[1], dt=DT):.3f}")
    print(f"rate {certificate.rate:.3f} 1/s, gain of the level {certificate.output_gains[0]:.1f}")
    run = fit.simulate(t, u[1], y_init=level[1][:10])[0]
    figure, axes = plt.subplots(2, 1, figsize=(8, 4.6), sharex=True, height_ratios=(3, 1), layout="constrained")
    axes[0].plot(t, level[1], ".", color="#6b6b6b", markersize=3, label="measured")
    axes[0].plot(t, run.x, color="#1b6ca8", label="free run of the certified model")
    axes[0].set_ylabel("lower level")
    axes[0].legend(frameon=False)
    axes[1].step(t, u[1], where="post", color="#b04a3a", linewidth=1)
    axes[1].set_ylabel("pump")
    axes[1].set_xlabel("t in s")
    return figure


if __name__ == "__main__":
    main().savefig("outputs.svg")
