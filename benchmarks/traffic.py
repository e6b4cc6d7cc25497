"""The paper's traffic study: free-run errors of every estimator under four disturbances, beside the paper's figures.

    x' = A x + B u + (sin x1, cos x2) + d,   x(0) = (1, 3),   u = sin t,   1000 samples on [0, 30] s

Every model is fitted to the disturbed data and runs freely from (1, 3) without d. "far" counts the blow-ups of free
runs from 8 far initial states, over 30 s. Functions x, x**3, sinh, tanh, input and constant.

    python benchmarks/traffic.py
"""

from collections.abc import Callable

import numpy as np
from numpy import ndarray
from scipy.integrate import solve_ivp

from persid.errors import GeneratorError
from persid.identification.free_runs import free_run_score
from persid.identification.identifier import PersidskiiIdentifier
from persid.measurements.trajectories import Trajectories

A = np.array([[-0.1, 0.05], [0.05, -0.15]])
B = np.array([0.5, 0.3])
T = np.linspace(0, 30, 1000)
FAR = [(6, 6), (-6, 6), (6, -6), (-6, -6), (8, 0), (-8, 0), (0, 8), (0, -8)]
PAPER = {"d1": ".0489/.9954", "d2": ".0059/.9999", "d3": ".0419/.9966", "d4": "not certified"}

SMOOTH: dict[str, Callable[[float], ndarray]] = {
    "d1": lambda t: 0.05 * np.array([np.sin(2 * t), np.cos(2 * t)]),
    "d3": lambda t: 0.1 * np.array([np.sin(t) * np.cos(2 * t), np.cos(t) * np.sin(2 * t)]),
    "d4": lambda t: np.array([np.sin(2 * t), np.cos(2 * t)]),
}

PLAIN = {"x_ref": 0.0, "scale": 1.0}  # the functions of x itself, as in the paper
ESTIMATORS = {
    "EDMD + log, coordinates": PLAIN | {"method": "edmd"},
    "EDMD + log, hold=paper": PLAIN | {"method": "edmd", "hold": "paper"},
    "EDMD + log, literal": PLAIN | {"method": "edmd", "gamma": "literal"},
    "least squares, derivatives": PLAIN | {"method": "derivative", "ridge": 0.0},
    "weak form, ridge 1e-5": PLAIN | {"ridge": 1e-5},
    "weak form, ridge .02": PLAIN | {"ridge": 0.02},
    "default (validated ridge)": {},
    "default, refined": {"refine": True},
}


def truth(t: float, x: ndarray, d: ndarray) -> ndarray:
    """Return x' of the traffic system."""
    return A @ x + B * np.sin(t) + np.array([np.sin(x[0]), np.cos(x[1])]) + d


def disturbed(name: str, seed: int = 0) -> Trajectories:
    """Return the run under a disturbance; d2 is white, drawn anew for every sample and held over its step."""
    if name in SMOOTH:
        d = SMOOTH[name]
        x = solve_ivp(lambda t, x: truth(t, x, d(t)), (0, 30), [1, 3], t_eval=T, rtol=1e-9, atol=1e-11).y.T
    else:
        noise = np.random.default_rng(seed).normal(0, 0.05, (len(T), 2))
        states = [np.array([1.0, 3.0])]
        for k in range(len(T) - 1):
            step = solve_ivp(truth, (T[k], T[k + 1]), states[-1], args=(noise[k],), rtol=1e-9, atol=1e-11)
            states.append(step.y[:, -1])
        x = np.array(states)
    return Trajectories.from_arrays(x, np.sin(T), t=T)


def cell(options: dict, data: Trajectories) -> str:
    """Return RMSE / pooled R2 / mean R2 of the states / far blow-ups of one estimator, or its refusal."""
    try:
        fit = PersidskiiIdentifier(**options).fit(data)
    except GeneratorError:
        return "refused"
    score = free_run_score(fit.model_, data)
    far = sum(fit.simulate(x0, T, data[0].u)[0].diverged_at is not None for x0 in FAR)
    if score.blow_ups:
        return f"blows up, far {far}/8"
    return f"{score.rmse:.4f}/{score.r2:.4f}/{score.r2_mean:6.3f} {far}/8"


def main() -> None:
    """Print the table."""
    names = ["d1", "d2", "d3", "d4"]
    data = {name: disturbed(name) for name in names}
    print(f"{'RMSE/R2 pooled/R2 states far':<28}" + "".join(f"{name:<28}" for name in names))
    print(f"{'paper':<28}" + "".join(f"{PAPER[name]:<28}" for name in names))
    for label, options in ESTIMATORS.items():
        print(f"{label:<28}" + "".join(f"{cell(options, data[name]):<28}" for name in names), flush=True)


if __name__ == "__main__":
    main()
