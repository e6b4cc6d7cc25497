"""Certify a region of a damped pendulum: how far may it swing, and how hard may it be pushed?

The pendulum rests at every multiple of pi, so no global claim can hold: certify proves that it is not globally
stable. Inside a box about the lower position sin x has the sign of x, and a region can be certified. Nothing is said
about states outside it; the pendulum may well return from many of them.

    x1' = x2,   x2' = -sin x1 - 0.5 x2 + u          (x1 in rad, x2 in rad/s, u in rad/s^2)

    python examples/pendulum.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

PENDULUM = ps.PersidskiiModel(
    A0=[[0.0, 1.0], [0.0, -0.5]],
    terms=[("sin(x)", [[1.0, 0.0]], [[0.0], [-1.0]])],
    B=[[0.0], [1.0]],
    states=["angle", "speed"],
    inputs=["torque"],
)


def main() -> Figure:
    """Print the global verdict and the regional ones for boxes |x1| <= r; draw the last two."""
    print(ps.certify(PENDULUM), "\n")
    print("   r  |torque| <=  angle at rest <=  rate 1/s   gain")
    figure, axes = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    for ax, r in zip([None, None, *axes], (1.0, 2.0, 3.0, 3.1), strict=True):
        found = ps.certify(PENDULUM, domain=[[-r, r], [-3 * r, 3 * r]]).certificate
        angles = np.linspace(0, r, 2001)
        reach = angles[found.V(np.stack([angles, 0 * angles], axis=1)) <= found.level].max()
        print(f"{r:4.1f} {found.input_bound:12.3f} {reach:17.2f} {found.rate:9.3f} {found.gain:6.2f}")
        if ax is not None:
            ps.plots.level_sets(ax, found, box=[[-r, r], [-3, 3]]).set_title(f"box |angle| <= {r}")
    return figure


if __name__ == "__main__":
    main().savefig("pendulum.svg")
