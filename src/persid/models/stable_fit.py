"""A model fitted to inputs and outputs alone, with the multipliers of its own proof of stability."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

ACTIVATIONS = ("tanh", "softsign", "arctan")  # slopes in (0, 1], one at 0: the sector that the proof uses


@dataclass(frozen=True, eq=False)
class StableFit:
    """Hold x' = A x + A1 f(R x + beta) + B (u - u_ref) + b, y = h(C x + D (u - u_ref) + d), and why it is stable.

    f acts elementwise and its slopes lie in [0, 1]. The states x have no unit: they are coordinates in which P = I.
    A, A1, B, b are in 1/s (B per unit of u); C, D, d in the units of y (per unit of u for D). h is the output map,
    None or "abs". x0 holds the state at the first sample of every record that was fitted.

    x_mean and x_cov are mean and covariance of the states along the fitted runs, noise the root-mean-square residual of
    each output there: what is known of a new record's first state before its first outputs are seen.

    M >= 0 (no unit) and T > 0 (1/s), one per neuron, and kappa >= 0 (1/s) prove stability: about any equilibrium x*,
    with z = x - x*, w = f(R x + beta) - f(R x* + beta) and G = [A A1],

        V = |z|^2 + 2 sum M_c int_0^(r_c z) (f(s + r_c x* + beta_c) - f(r_c x* + beta_c)) ds,
        V' + kappa (|z|^2 + 2 w' M R z) + 2 w' T (R z - w) = -(z, w)' Z (z, w),  Z > 0,

    and w' T (R z - w) >= 0. They are None where the fit was not made under the inequality.
    """

    A: Float[ndarray, "n n"]
    R: Float[ndarray, "q n"]
    beta: Float[ndarray, " q"]
    A1: Float[ndarray, "n q"]
    B: Float[ndarray, "n m"]
    b: Float[ndarray, " n"]
    C: Float[ndarray, "l n"]
    D: Float[ndarray, "l m"]
    d: Float[ndarray, " l"]
    u_ref: Float[ndarray, " m"]
    x0: Float[ndarray, "records n"]
    x_mean: Float[ndarray, " n"]
    x_cov: Float[ndarray, "n n"]
    noise: Float[ndarray, " l"]
    dt: float
    activation: str = "tanh"
    output_map: str | None = None
    hold: str = "zoh"
    inputs: tuple[str, ...] = ()
    outputs: tuple[str, ...] = ()
    M: Float[ndarray, " q"] | None = None
    T: Float[ndarray, " q"] | None = None
    kappa: float = 0.0

    def inequality(self) -> Float[ndarray, "n+q n+q"]:
        """Return Z, positive definite where M, T and kappa prove stability; in floats, so it decides nothing."""
        if self.M is None or self.T is None:
            raise ValueError("this fit carries no multipliers; certify its model instead")
        RM, RT = self.R.T * self.M, self.R.T * self.T
        corner = -(self.A + self.A.T) - self.kappa * np.eye(len(self.A))
        side = -(self.A1 + self.A.T @ RM + RT + self.kappa * RM)
        return np.block([[corner, side], [side.T, 2 * np.diag(self.T) - (RM.T @ self.A1 + self.A1.T @ RM)]])
