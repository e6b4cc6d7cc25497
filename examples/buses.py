"""Three buses of a power grid: a generator, a load, and the rest of the grid.

Lines carry sines of angle differences. The load's bus has no inertia but an equation, which has several solutions, or
none where a line would have to carry more than it can. Strips are found in which it has exactly one, and a set of the
generator's angle and speed that no run on this branch leaves, with a load that varies within the bound. Dots are
starts from which simulated runs come to rest at the same point; from the crosses they do not, or nothing is solved.

    angle' = speed,   speed' = 0.6 - speed - sin(angle) - 1.5 sin(angle - bus),
    0 = 1.5 sin(angle - bus) - 1.5 sin(bus) - 0.8 - load

    python examples/buses.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

ANGLES = [[1, 0, 0], [1, 0, -1], [0, 0, 1]]  # of the lines grid - generator, generator - load, load - grid
POWERS = [[0, 0, 0], [-1, -1.5, 0], [0, 1.5, -1.5]]
BUSES = ps.DescriptorModel(
    [[0, 1, 0], [0, -1, 0], [0, 0, 0]], [("sin(x)", ANGLES, POWERS)], [[0], [0], [-1]], b=[0, 0.6, -0.8],
    states=["angle", "speed"], algebraic=["bus"], inputs=["load"],
)  # fmt: skip


def returns(x0: np.ndarray, rest: np.ndarray) -> bool:
    """Whether a simulated run comes to rest at the equilibrium."""
    try:
        run = BUSES.simulate(x0, np.linspace(0, 25, 26), near=BUSES.solve(x0, near=rest[2:]), rtol=1e-4, atol=1e-5)[0]
    except ps.ModelError:
        return False
    return len(run) == 26 and bool(np.abs(run.x[-1] - rest).max() < 0.01)


def main() -> Figure:
    """Certify the largest region that is found, and draw it over what simulations do."""
    certificate = ps.certify(BUSES, domain="auto", rate=0.2).certificate
    rest = np.append(certificate.operating_point, BUSES.solve(certificate.operating_point, near=[-0.2]))
    print(f"rest at angle {np.degrees(rest[0]):.1f}, bus {np.degrees(rest[2]):.1f} degrees")
    print(f"certified, rate {certificate.rate:.2f} 1/s, load varying by up to {certificate.input_bound:.3f} of 0.8")
    angle, speed = np.meshgrid(np.radians(np.linspace(-170, 190, 181)), np.linspace(-4, 4, 161))
    V = certificate.V(np.stack([angle.ravel(), speed.ravel()], axis=1)).reshape(angle.shape) / certificate.level
    print("angles from {:.0f} to {:.0f} degrees".format(*np.degrees([angle[V <= 1].min(), angle[V <= 1].max()])))
    starts = np.stack([angle[10::20, 10::20].ravel(), speed[10::20, 10::20].ravel()], axis=1)
    home = np.array([returns(start, rest) for start in starts])
    figure, axes = plt.subplots(figsize=(7, 4), layout="constrained")
    axes.contourf(np.degrees(angle), speed, V, levels=[0, 1], colors=["C0"], alpha=0.3)
    for chosen, mark, name in ((home, "C2.", "comes to rest"), (~home, "C3x", "does not")):
        axes.plot(np.degrees(starts[chosen, 0]), starts[chosen, 1], mark, markersize=4, label=name)
    run = BUSES.simulate([1.0, 0.6], np.linspace(0, 20, 401), near=rest[2:])[0]
    axes.plot(np.degrees(run.x[:, 0]), run.x[:, 1], color="0.3", linewidth=1)
    axes.set(xlabel="generator's angle in degrees", ylabel="speed in rad/s", ylim=(-4, 4.9))
    axes.legend(frameon=False, loc="upper right", ncols=2)
    return figure


if __name__ == "__main__":
    main().savefig("buses.svg")
