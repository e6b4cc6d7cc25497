"""Simulate the paper's traffic system (Sec. 5.1) under disturbance d2 and write examples/traffic.csv.

    ẋ = A x + B u + (sin x1, cos x2) + d,   x(0) = (1, 3),   u = sin t,   t in [0, 30] s, 1000 samples

d2 is Gaussian, standard deviation 0.05, drawn anew for every sample and held over its step.

    python examples/make_traffic.py examples/traffic.csv
"""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.integrate import solve_ivp

A = np.array([[-0.1, 0.05], [0.05, -0.15]])
B = np.array([0.5, 0.3])
SAMPLES, SPAN, SEED = 1000, 30.0, 0


def traffic(t: float, x: np.ndarray, d: np.ndarray) -> np.ndarray:
    """Return x' of the traffic system."""
    return A @ x + B * np.sin(t) + np.array([np.sin(x[0]), np.cos(x[1])]) + d


def simulate(seed: int = SEED) -> pd.DataFrame:
    """Return the table t, x1, x2, u."""
    t = np.linspace(0, SPAN, SAMPLES)
    d = np.random.default_rng(seed).normal(0, 0.05, (SAMPLES, 2))
    x = [np.array([1.0, 3.0])]
    for k in range(SAMPLES - 1):
        step = solve_ivp(traffic, (t[k], t[k + 1]), x[-1], args=(d[k],), rtol=1e-9, atol=1e-11)
        x.append(step.y[:, -1])
    states = np.array(x)
    return pd.DataFrame({"t": t, "x1": states[:, 0], "x2": states[:, 1], "u": np.sin(t)})


if __name__ == "__main__":
    path = Path(sys.argv[1] if sys.argv[1:] else "traffic.csv")
    simulate().to_csv(path, index=False, float_format="%.12g")
    print(f"wrote {path}")
