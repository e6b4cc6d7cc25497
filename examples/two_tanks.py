"""Two tanks in a row: a square-root outflow, certified in a region about a working level.

The square root is defined for levels from 0 on only, so the claim is regional: from every pair of levels in the
shaded set the levels return to 1 m, and while the inflow stays within the printed bound of 0.5 they never leave the
set. Nothing is said about a tank that runs empty.

    h1' = q - a sqrt(h1),   h2' = a sqrt(h1) - a sqrt(h2)          (h in m, q in m/s of the tanks' surface, a = 0.5)

    python examples/two_tanks.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

a = 0.5
TANKS = ps.PersidskiiModel(
    terms=[("sqrt(x)", None, [[-a, 0.0], [a, -a]])],
    B=[[1.0], [0.0]],
    states=["h1", "h2"],
    inputs=["q"],
)


def main() -> Figure:
    """Certify a box about h = (1, 1) at q = 0.5; draw the region, and a run against its bound."""
    certificate = ps.certify(
        TANKS, operating_point=[1.0, 1.0], u_op=[0.5], domain=[[0.25, 1.75], [0.25, 1.75]]
    ).certificate
    print(f"|q - 0.5| <= {certificate.input_bound:.3f} keeps the levels in the set V <= {certificate.level:.3f}")
    print(f"rate {certificate.rate:.3f} 1/s, gain {certificate.gain:.2f} s")
    t = np.linspace(0, 60, 1200)
    run = TANKS.simulate([0.65, 1.3], t, (0.5 + 0.07 * np.sin(0.2 * t))[:, None])[0]
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.6), layout="constrained")
    ps.plots.level_sets(left, certificate, runs=[run])
    ps.plots.bound(right, certificate, run)
    return figure


if __name__ == "__main__":
    main().savefig("two_tanks.svg")
