"""From a CSV file to a global certificate: the traffic system under disturbance.

The file holds 30 s of two traffic states and one input. The model is identified from it and certified: from every
initial state and under every bounded input it stays within the printed bound of x*. The proof is about the model; how
well the model follows the measurements is what the free run on held-out samples says.

    python examples/traffic.py
"""

from pathlib import Path

import matplotlib.pyplot as plt
from matplotlib.figure import Figure

import persid as ps

HERE = Path(__file__).parent


def main() -> Figure:
    """Identify and certify; draw level sets of V, and the bound on a far run."""
    data = ps.read_csv(HERE / "traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
    fit = ps.PersidskiiIdentifier(functions=["x", "x**3", "sinh(x)", "tanh(x)"]).fit(data)
    certificate = ps.certify(fit.model_).certificate
    far = fit.model_.simulate([5.0, -3.0], data[0].t, data[0].u)[0]
    print(f"RMSE of the free run on held-out samples: {fit.report_.free_run.rmse:.4f}")
    print(f"{certificate.claim} about x* = {certificate.operating_point.round(3)}")
    print(f"rate {certificate.rate:.3f} 1/s, gain {certificate.gain:.2f}")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    ps.plots.level_sets(left, certificate, runs=data)
    ps.plots.bound(right, certificate, far)
    return figure


if __name__ == "__main__":
    main().savefig("traffic.svg")
