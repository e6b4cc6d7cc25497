"""Fits of known truth: models that are stable by construction, with the multipliers that prove it.

With G = R R', T > 0, M >= 0 diagonal, J skew: S = 2T + M G T + T G M + kappa M G M > 0, Delta with Delta' Delta < S,
A = J - L L'/2 - (eps + kappa/2) I and A1 = (A + kappa/2 I)' R' M ... as derived for V = |x|^2 + 2 sum M int f.
"""

import numpy as np

from persid.models.stable_fit import StableFit


def random_fit(
    seed: int = 0, *, n: int = 2, q: int = 3, m: int = 1, outputs: int = 1, densities: bool = True, kappa: float = 0.0,
    activation: str = "tanh", output_map: str | None = None, hold: str = "zoh",
) -> StableFit:  # fmt: skip
    """Return a random fit of the parametrisation, in physical units with times in s."""
    rng = np.random.default_rng(seed)
    R = rng.normal(size=(q, n))
    T = np.exp(rng.normal(size=q))
    M = 0.3 * np.exp(rng.normal(size=q)) if densities else np.zeros(q)
    while True:
        G = R @ R.T
        S = 2 * np.diag(T) + M[:, None] * G * T + T[:, None] * G * M + kappa * M[:, None] * G * M
        if np.linalg.eigvalsh(S).min(initial=1.0) > 1e-2:
            break
        M = M / 2
    skew, L, X = rng.normal(size=(n, n)), rng.normal(size=(n, n)), rng.normal(size=(n, q))
    J = skew - skew.T
    whole = np.linalg.inv(np.linalg.cholesky(np.eye(q) + X.T @ X)).T
    Delta = np.sqrt(1 - 1e-3) * X @ whole @ np.linalg.cholesky(S).T
    At = J - L @ L.T / 2 - 1e-2 * np.eye(n)
    A = At - kappa / 2 * np.eye(n)
    A1 = At @ R.T * M - R.T * T - L @ Delta - kappa / 2 * R.T * M
    return StableFit(
        A=A, R=R, beta=rng.normal(size=q), A1=A1, B=rng.normal(size=(n, m)), b=rng.normal(size=n),
        C=rng.normal(size=(outputs, n)), D=0.1 * rng.normal(size=(outputs, m)), d=rng.normal(size=outputs),
        u_ref=rng.normal(size=m), x0=rng.normal(size=(1, n)), x_mean=np.zeros(n), x_cov=np.eye(n),
        noise=np.full(outputs, 1e-3), dt=0.1, activation=activation, output_map=output_map, hold=hold,
        inputs=tuple(f"u{i + 1}" for i in range(m)), outputs=tuple(f"y{i + 1}" for i in range(outputs)),
        M=M, T=T, kappa=kappa,
    )  # fmt: skip
