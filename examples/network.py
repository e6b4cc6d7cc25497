"""A network of 10,000 states: a weighted sum of distances that decreases.

Each node of a ring decays and is pushed by its two neighbours through tanh, with random signs. For networks V is a
weighted sum of |x_k|, found and checked with sparse sums alone. Up to a coupling near 1/2 the network is certified
about the equilibrium of every constant input; beyond, it is proved that no weights exist, which does not say that it
is unstable: a sum of distances cannot see the signs, which may well help.

    x_k' = -x_k - 0.1 x_k^3 + c (s_k tanh(x_k-1) + s'_k tanh(x_k+1)) + B_k u
    s, s' = 1 or -1; B_k = 1 for one node in 100, else 0

    python examples/network.py
"""

import matplotlib.pyplot as plt
import numpy as np
import scipy.sparse as sp
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp

import persid as ps

N = 10_000
rng = np.random.default_rng(0)
k, ones = np.arange(N), sp.eye_array(N, format="csr")
RING = sp.csr_array((rng.choice([-1.0, 1.0], 2 * N), (np.tile(k, 2), np.concatenate([k - 1, k + 1]) % N)), (N, N))
B = (k % 100 == 0).astype(float)[:, None]


def ring(c: float) -> ps.PersidskiiModel:
    """Return the ring with coupling c."""
    return ps.PersidskiiModel(A0=-1.0 * ones, terms=[("tanh(x)", None, c * RING), ("x**3", None, -0.1 * ones)], B=B)


def main() -> Figure:
    """Print the verdict for each coupling; draw the certified rates, and V along a run of the strongest."""
    rows, certificate = [], None
    for c in (0.1, 0.2, 0.3, 0.4, 0.48, 0.55):
        verdict = ps.certify(ring(c))
        if verdict.is_certified:
            certificate = verdict.certificate
            rows.append((c, certificate.rate))
        print(f"c = {c}:", f"certified, rate {rows[-1][1]:.3f} 1/s" if verdict.is_certified else verdict)
    t, x0 = np.linspace(0, 10, 201), rng.normal(size=N)
    x = solve_ivp(lambda _, x: -x - 0.1 * x**3 + 0.48 * (RING @ np.tanh(x)), (0, 10), x0, t_eval=t).y.T
    V, proved = certificate.V(x), np.exp(-rows[-1][1] * t)
    print(f"c = 0.48: V falls to {V[-1] / V[0]:.5f} of its start in 10 s; proved: to at most {proved[-1]:.2f}")
    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    left.plot(*zip(*rows, strict=True), "o-")
    left.set(xlabel="coupling c", ylabel="certified rate in 1/s", ylim=(0, None))
    right.semilogy(t, V[0] * proved, color=ps.plots.LEVEL, label="proved bound")
    right.semilogy(t, V, "--", color=ps.plots.MODEL, label="model, free run")
    right.set(xlabel="t in s", ylabel="V for c = 0.48")
    right.legend(frameon=False)
    return figure


if __name__ == "__main__":
    main().savefig("network.svg")
