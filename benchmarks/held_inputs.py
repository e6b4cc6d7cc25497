"""EDMD with a white input that is held between samples: hold="zoh" gives every coefficient, hold="paper" is refused.

x' = A0 x + A1 tanh(x) + B u,   n = 2, 100,000 samples without noise

python benchmarks/held_inputs.py
"""

import numpy as np
from numpy import ndarray

from persid.errors import GeneratorError
from persid.identification.identifier import PersidskiiIdentifier
from persid.measurements.trajectories import Trajectories
from persid.models.model import PersidskiiModel

A0 = np.array([[-1.0, 0.4], [-0.3, -0.8]])
A1 = np.array([[-0.5, 0.2], [0.1, -0.6]])
B = np.array([[1.0], [0.5]])
SAMPLES, STEP, SEEDS = 100_000, 0.01, 20


def batch(samples: int = SAMPLES, dt: float = STEP, seeds: int = SEEDS) -> list[Trajectories]:
    """Return one run a seed; all seeds are integrated side by side."""
    u = np.stack([np.random.default_rng(seed).normal(size=samples) * 3 for seed in range(seeds)], axis=1)
    x, states = np.tile([1.0, -1.0], (seeds, 1)), np.empty((samples, seeds, 2))

    def rate(y: ndarray, force: ndarray) -> ndarray:
        return y @ A0.T + np.tanh(y) @ A1.T + force

    for k in range(samples):
        states[k] = x
        force = u[k][:, None] * B[:, 0]
        k1 = rate(x, force)
        k2 = rate(x + dt / 2 * k1, force)
        k3 = rate(x + dt / 2 * k2, force)
        x = x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + rate(x + dt * k3, force))
    return [Trajectories.from_arrays(states[:, s], u[:, s], dt=dt) for s in range(seeds)]


def worst_digit(model: PersidskiiModel) -> float:
    """Return the largest relative error of a coefficient."""
    pairs = ((model.A0, A0), (model.terms[0].A, A1), (model.B, B))
    return max(float(np.abs((found - true) / true).max()) for found, true in pairs)


def main() -> None:
    """Print one line a seed, and the counts."""
    good = refused = 0
    for seed, data in enumerate(batch()):
        options = {"method": "edmd", "scale": 1.0, "holdout": 0.0}
        worst = worst_digit(PersidskiiIdentifier(["x", "tanh(x)"], **options).fit(data).model_)
        good += worst < 1e-3
        try:
            PersidskiiIdentifier(["x", "tanh(x)"], hold="paper", **options).fit(data)
            answer = "accepted"
        except GeneratorError as error:
            refused += 1
            answer = f"refused: {str(error).split('. Spectrum')[0].split(': ', 1)[1]}"
        print(f"seed {seed:2d}: zoh, largest relative error {worst:.1e};  paper, {answer}", flush=True)
    print(f"three digits under zoh: {good} of {SEEDS};  refused under paper: {refused} of {SEEDS}")


if __name__ == "__main__":
    main()
