"""A recurrent network is a Persidskii model: how strong may its feedback be?

    ẋ = -x + g W tanh(x) + B u          (6 neurons, W random, spectral radius of W printed)

For each feedback strength g the verdict is asked for. Small ones are certified, with a rate and a gain about every
equilibrium of every constant input; for the next it is proved that this family of Lyapunov functions holds none,
which does not say that the network is unstable; for the largest the rest state is proved unstable.

    python examples/recurrent_network.py
"""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

import persid as ps

rng = np.random.default_rng(0)
W, B = rng.normal(size=(6, 6)) / np.sqrt(6), rng.normal(size=(6, 1))
STRENGTHS = (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 2.5, 4.0)


def network(g: float) -> ps.PersidskiiModel:
    """Return the network with feedback strength g."""
    return ps.PersidskiiModel(A0=-np.eye(6), terms=[("tanh(x)", None, g * W)], B=B)


def main() -> Figure:
    """Print the verdict for each strength; draw rate and gain where there are any."""
    print(f"spectral radius of W {np.abs(np.linalg.eigvals(W)).max():.2f}, norm {np.linalg.norm(W, 2):.2f}")
    rows = []
    for g in STRENGTHS:
        verdict = ps.certify(network(g))
        if verdict.is_certified:
            rows.append((g, verdict.certificate.rate, verdict.certificate.gain))
            print(f"g = {g:4.2f}: certified, rate {rows[-1][1]:.3f} 1/s, gain {rows[-1][2]:.2f}")
        else:
            print(f"g = {g:4.2f}: {str(verdict).split('.')[0]}.")
    strengths, rates, gains = zip(*rows, strict=True)
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    left.plot(strengths, rates, "o-")
    left.set(xlabel="feedback strength g", ylabel="certified rate in 1/s", ylim=(0, None))
    right.plot(strengths, gains, "o-")
    right.set(xlabel="feedback strength g", ylabel="certified gain", ylim=(0, None))
    return figure


if __name__ == "__main__":
    main().savefig("recurrent_network.svg")
