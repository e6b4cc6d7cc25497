"""A model fitted to inputs and outputs alone, with the multipliers of its own proof of stability."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.linalg import null_space

from persid.errors import ModelError
from persid.models.functions import shifted
from persid.models.learned_curves import table
from persid.models.lookup_tables import WORD

ACTIVATIONS = ("tanh", "softsign", "arctan", WORD)  # slopes in (0, 1], the sector that the proof uses


@dataclass(frozen=True, eq=False)
class StableFit:
    """Hold x' = A x + A1 f(R x + beta) + B (u - u_ref) + b, y = h(C x + D (u - u_ref) + d), and why it is stable.

    f acts elementwise and its slopes lie in [0, 1]. The states x have no unit: they are coordinates in which P = I;
    but see `with_states`. Where x_ref is given, x stands for x - x_ref in both equations.
    A, A1, B, b are in 1/s (B per unit of u); C, D, d in the units of y (per unit of u for D). h is the output map,
    None or "abs". x0 holds the state at the first sample of every record that was fitted.

    F are the slopes of every neuron's function in the pieces of `learned_curves` where f is learnt, else None.

    x_mean and x_cov are mean and covariance of the states along the fitted runs, noise the root-mean-square residual of
    each output there: what is known of a new record's first state before its first outputs are seen.

    M (no unit) and T > 0 (1/s), one per neuron, and kappa >= 0 (1/s) prove stability: about any equilibrium x*,
    with z = x - x*, w = f(R x + beta) - f(R x* + beta) and G = [A A1],

        V = z'P z + 2 sum M_c int_0^(r_c z) (f(s + r_c x* + beta_c) - f(r_c x* + beta_c)) ds,
        V' + kappa (z'P z + 2 w' M R z) + 2 w' T (R z - w) = -(z, w)' Z (z, w),  Z > 0,

    and w' T (R z - w) >= 0. V is positive where P + R' min(M, 0) R is: M < 0 stands for the integral of s - f(s), which
    is the energy of what hardens. They are None where the fit was not made under the inequality.
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
    P: Float[ndarray, "n n"] | None = None
    x_ref: Float[ndarray, " n"] | None = None
    states: tuple[str, ...] = ()
    F: Float[ndarray, "q k"] | None = None

    def with_states(self, measured: Sequence[str]) -> "StableFit":
        """Return the fit in coordinates in which some outputs are the first states, in their own units.

        With y = C x + d for them, and N an orthonormal basis of what C does not see, the new states are
        (y, N x) = x_ref + S x with S = (C; N) and x_ref = (d; 0), and P becomes S^-T P S^-1. The others stay latent.

        Raises:
            ModelError: they are no outputs, an input acts on them at once, or they are not independent states.
        """
        if strange := [name for name in measured if name not in self.outputs]:
            raise ModelError(
                f"measured= names {strange[0]!r}, which is none of the outputs ({', '.join(self.outputs)})"
            )
        n, rows = len(self.A), [self.outputs.index(name) for name in measured]
        C, k = self.C[rows], len(rows)
        if self.output_map is not None or np.any(self.D[rows]):
            raise ModelError("measured= goes with outputs that are states: without output= and without feedthrough=")
        if np.linalg.matrix_rank(C) < k:
            raise ModelError(f"measured= names {k} outputs, but the model has {n} states: they are not independent")
        N = null_space(C).T
        S, back = np.vstack([C, N]), np.hstack([np.linalg.pinv(C), N.T])
        P = back.T @ self.metric @ back
        x_ref = np.concatenate([self.d[rows], np.zeros(n - k)])
        outputs = self.C @ back
        outputs[rows] = np.eye(k, n)
        return replace(
            self, A=S @ self.A @ back, R=self.R @ back, A1=S @ self.A1, B=S @ self.B, b=S @ self.b, C=outputs,
            x0=x_ref + self.x0 @ S.T, x_mean=x_ref + S @ self.x_mean, x_cov=S @ self.x_cov @ S.T, P=P,
            x_ref=x_ref, states=(*(f"x_{name}" for name in measured), *(f"z{i + 1}" for i in range(n - k))),
        )  # fmt: skip

    def in_unit_coordinates(self) -> "StableFit":
        """Return the fit in coordinates without units, S (x - x_ref), in which P + R' min(M, 0) R = S'S is 1."""
        hard = np.zeros(len(self.R)) if self.M is None else np.minimum(self.M, 0.0)
        S = np.linalg.cholesky(self.metric + (self.R.T * hard) @ self.R).T
        back, x_ref = np.linalg.inv(S), np.zeros(len(S)) if self.x_ref is None else self.x_ref
        R = self.R @ back
        return replace(
            self, A=S @ self.A @ back, R=R, A1=S @ self.A1, B=S @ self.B, b=S @ self.b, C=self.C @ back,
            x0=(self.x0 - x_ref) @ S.T, x_mean=S @ (self.x_mean - x_ref), x_cov=S @ self.x_cov @ S.T,
            P=None if self.M is None else np.eye(len(S)) - (R.T * hard) @ R, x_ref=None, states=(),
        )  # fmt: skip

    def function(self, c: int) -> str:
        """Return the function of a neuron with its shift, as an expression of its row times x."""
        by = float(self.beta[c])
        return shifted(self.activation, by) if self.F is None else table(self.F[c], by)

    @property
    def metric(self) -> Float[ndarray, "n n"]:
        """P, which is 1 where none is given."""
        return np.eye(len(self.A)) if self.P is None else self.P

    def inequality(self) -> Float[ndarray, "r r"]:
        """Return Z, positive definite where M, T and kappa prove stability; in floats, so it decides nothing."""
        if self.M is None or self.T is None:
            raise ValueError("this fit carries no multipliers; certify its model instead")
        RM, RT = self.R.T * self.M, self.R.T * self.T
        P = self.metric
        corner = -(P @ self.A + self.A.T @ P) - self.kappa * P
        side = -(P @ self.A1 + self.A.T @ RM + RT + self.kappa * RM)
        return np.block([[corner, side], [side.T, 2 * np.diag(self.T) - (RM.T @ self.A1 + self.A1.T @ RM)]])
