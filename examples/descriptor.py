"""A diode circuit and other loops: equations beside differential equations.

A capacitor feeds a diode through a resistor; the node between them has no capacitor, so its voltage and the diode's
current are algebraic variables, measured with noise. From the samples come a differential equation and two equations;
that these have one solution for every voltage and current is proved with the stability. A loop without delay,
w = sat(x + g w), is of the same kind: for g < 1 there is one w for every x, for g > 1 three, and no proof. So are
pipes from two tanks that meet without a third, flows q(y) = y/4 + arcsinh(y).

    v' = node - v + i,   0 = (2 v - 2 diode)/3 - node,   0 = 0.1 (exp(node) - 1) - diode

    python examples/descriptor.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

WIRES, DIODE = [[-1, 1, 0], [2 / 3, -1, -2 / 3], [0, 0, -1]], ("expm1(x)", [[0, 1, 0]], [[0], [0], [0.1]])
CIRCUIT = ps.DescriptorModel(WIRES, [DIODE], [[1], [0], [0]], states=["v"], algebraic=["node", "diode"], inputs=["i"])
FALLS, FLOWS = np.array([[1, 0, -1], [0, 1, -1], [0, 0, 1]]), np.array([[-1, 0, 0], [0, -1, 0], [1, 1, -1]])
PIPES = ps.DescriptorModel(FLOWS @ FALLS / 4, [("arcsinh(x)", FALLS, FLOWS)], [[1], [0], [0]], algebraic=["p"])


def loop(g: float) -> ps.DescriptorModel:
    """Return the loop with gain g, x' = -x - w + u."""
    return ps.DescriptorModel([[-1, -1], [0, -1]], [("sat(x)", [[1, g]], [[0], [1]])], [[1], [0]], algebraic=["w"])


def main() -> Figure:
    """Identify the circuit, certify all of them, and draw what was measured and what a free run foretells."""
    rng, t = np.random.default_rng(0), np.linspace(0, 30, 1501)
    run = CIRCUIT.simulate([0.0], t, np.repeat(rng.uniform(-1, 3, 31), 50)[:1501, None])
    noisy = ps.Trajectory(t, run[0].x + 0.02 * rng.normal(size=(1501, 3)), run[0].u)
    functions, reads = [["x"], ["x", "expm1(x)"], ["x"]], np.array(WIRES) != 0  # of each variable; of each row
    reads[2] = [False, True, False]
    fit = ps.DescriptorIdentifier(["node", "diode"], functions, pattern=reads, ridge=1e-6, x_ref=[0] * 3, scale=[1] * 3)
    fit.fit(ps.Trajectories((noisy,), run.states, run.inputs))
    print("held-out free run, RMSE:", ", ".join(f"{name} {error:.3f}" for name, error in fit.scores_.items()))
    models = {"circuit": fit.model_, "pipes": PIPES, "loop, g = 0.9": loop(0.9), "loop, g = 2": loop(2.0)}
    for name, model in models.items():
        verdict = ps.certify(model)
        print(f"{name}: {f'certified, gain {verdict.certificate.gain:.2f}' if verdict.is_certified else 'undecided'}")
    found = fit.model_.simulate(noisy.x[0, :1], t, noisy.u)[0]
    figure, axes = plt.subplots(figsize=(9, 3.2), layout="constrained")
    for k, name in enumerate(run.states):
        axes.plot(t[::10], noisy.x[::10, k], ".", markersize=3, color=f"C{k}", alpha=0.5)
        axes.plot(t, found.x[:, k], color=f"C{k}", label=name)
    axes.set(xlabel="t in s", ylabel="measured (dots) and free run", ylim=(-1.2, 5.8))
    axes.legend(frameon=False, ncols=3, loc="upper left")
    return figure


if __name__ == "__main__":
    main().savefig("descriptor.svg")
