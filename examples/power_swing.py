"""Three areas of a power grid: the swing equations, certified about a loaded operating point.

States are two angle differences and three frequency deviations; power flows as the sine of a difference, so there are
three rows of R. About the angles that carry the scheduled power a region is certified: after a disturbance that
leaves the state in it, and while power imbalances stay within the printed bound, the areas stay in step. Voltages and
protection are not in the model.

    M_i w_i' = P_i - D_i w_i - sum_j K_ij sin(d_i - d_j)          (angles in rad, w in rad/s, powers per unit)

    python examples/power_swing.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

M, D = np.array([1.0, 0.8, 1.2]), np.array([1.0, 0.8, 1.2])
K12, K23, K13 = 1.5, 1.0, 1.2
SCHEDULE = np.array([0.3, -0.1, -0.2])
ANGLES = np.array([[1.0, 0, 0, 0, 0], [0, 1.0, 0, 0, 0], [1.0, -1.0, 0, 0, 0]])  # d1 - d3, d2 - d3, d1 - d2
FLOWS = np.array([[-K13, 0, -K12], [0, -K23, K12], [K13, K23, 0]]) / M[:, None]
GRID = ps.PersidskiiModel(
    A0=np.block([[np.zeros((2, 2)), np.array([[1.0, 0, -1], [0, 1, -1]])], [np.zeros((3, 2)), -np.diag(D / M)]]),
    terms=[("sin(x)", ANGLES, np.vstack([np.zeros((2, 3)), FLOWS]))],
    B=np.vstack([np.zeros((2, 3)), np.diag(1 / M)]),
    states=["d13", "d23", "w1", "w2", "w3"],
    inputs=["P1", "P2", "P3"],
)


def main() -> Figure:
    """Certify a box of angles about the operating point; draw two slices of the region."""
    found = ps.certify(GRID, u_op=SCHEDULE, domain=[[-1.2, 1.2]] * 2 + [[-2.0, 2.0]] * 3).certificate
    print(f"operating angles {found.operating_point[:2].round(4)} rad")
    print(f"|P - schedule| <= {found.input_bound:.3f}, rate {found.rate:.3f} 1/s, gain {found.gain:.2f}")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.8), layout="constrained")
    ps.plots.level_sets(left, found).set_title("angles, frequencies at rest")
    ps.plots.level_sets(right, found, states=(0, 2)).set_title("angle and frequency of area 1")
    return figure


if __name__ == "__main__":
    main().savefig("power_swing.svg")
