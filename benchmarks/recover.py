"""identify(simulate(model)): how well random stable models come back from noise-free simulations.

Six runs of 400 samples, 10 ms apart, with inputs held for 20 samples; weak form, windows of 2 samples, no ridge.

    python benchmarks/recover.py [models]
"""

import sys

import numpy as np

from persid.identification.identifier import PersidskiiIdentifier
from persid.measurements.trajectories import Trajectories
from persid.models.model import PersidskiiModel
from persid.verdicts.certify import certify

FUNCTIONS = ["x", "x**3", "tanh(x)"]


def stable_model(seed: int, n: int) -> PersidskiiModel:
    """Draw a model that a certificate exists for: every matrix has a dominant negative diagonal."""
    rng = np.random.default_rng(seed)

    def matrix(size: float) -> np.ndarray:
        off = rng.uniform(-1, 1, (n, n)) * (1 - np.eye(n))
        return size * (0.3 * off / n - np.diag(rng.uniform(0.5, 1, n)))

    terms = [("x**3", None, matrix(0.5)), ("tanh(x)", None, matrix(0.8))]
    return PersidskiiModel(matrix(1.0), terms, rng.uniform(0.5, 1, (n, 1)), rng.uniform(-0.2, 0.2, n))


def simulated(model: PersidskiiModel, seed: int) -> Trajectories:
    """Simulate six runs from random starts with random held inputs."""
    rng, t = np.random.default_rng(seed), np.arange(400) * 0.01
    runs = []
    for _ in range(6):
        u = np.repeat(rng.uniform(-3, 3, (20, 1)), 20, axis=0)
        runs.append(model.simulate(rng.uniform(-2, 2, model.n), t, u, rtol=1e-10, atol=1e-12)[0])
    return Trajectories(tuple(runs), model.states, model.inputs)


def errors(truth: PersidskiiModel, data: Trajectories, refine: bool) -> tuple[float, float]:
    """Return the largest relative error of the vector field on the data, and of a coefficient (of the largest one)."""
    options = {"ridge": 0.0, "x_ref": 0.0, "scale": 1.0, "window": 2, "holdout": 0.0, "refine": refine}
    fit = PersidskiiIdentifier(FUNCTIONS, **options).fit(data)
    x, u = (np.concatenate([getattr(run, name) for run in data]) for name in ("x", "u"))
    rate = truth.rhs(x, u)
    field = np.abs(fit.model_.rhs(x, u) - rate).max() / np.abs(rate).max()
    theta = fit.basis_.coefficients(truth).T
    return float(field), float(np.abs(fit.coef_ - theta).max() / np.abs(theta).max())


def main(count: int) -> None:
    """Print one line for each number of states."""
    for n in (1, 2, 3, 5):
        verdict = certify(stable_model(0, n))
        print(f"n = {n}, the first model: {type(verdict).__name__} in {verdict.seconds:.1f} s", flush=True)
        runs = [(stable_model(seed, n), seed) for seed in range(count)]
        data = [(model, simulated(model, seed)) for model, seed in runs]
        for refine in (False, True):
            field, theta = np.array([errors(model, run, refine) for model, run in data]).max(axis=0)
            label = "refined" if refine else "weak form"
            print(f"n = {n}, {count} models, {label:<9}: worst error of rates {field:.1e}, of coefficients {theta:.1e}")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 25)
