"""The matrix inequality of a fit under the certificate: bilinear in the model and its Lyapunov function.

    minimise  f(w) = 1/2 (w - w0)'M (w - w0)   subject to   Z(w, y) >= 0,   P(y) >= 0,   y_k >= 0,   c'y = 1

w are the coefficients of the flow F = [G, B] (affine in w), y the numbers of the Lyapunov function and the multipliers,

    Z = -(E F + F'E') - kappa W - S - delta I,      E = E(y) half the gradient of V,  S = S(y) the products of forms.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy import sparse

from persid.lyapunov.triangle import triangle


@dataclass(frozen=True, eq=False)
class Pairs:
    """Terms p q' + q p' of Z's derivative: rows of D by number, the unknown each belongs to, and its weight in it."""

    p: Int[ndarray, " K"]
    q: Int[ndarray, " K"]
    owner: Int[ndarray, " K"]
    weight: Float[ndarray, " K"]

    def __getitem__(self, which: Bool[ndarray, " K"]) -> "Pairs":
        """Return some of the pairs."""
        return Pairs(self.p[which], self.q[which], self.owner[which], self.weight[which])


@dataclass(frozen=True, eq=False)
class Inequality:
    """Z(w, y) > 0 with the unknowns u = (w, y).

    `S` are rows in z (and inputs), the first being unit rows; `rho` (h x n) gradients with their constants `upper`, of
    which row h stands for rho_h (F + kappa upper_h I). `gradient` pairs (row of S, row of rho) and `product` pairs (two
    rows of S) are in y, `flow` pairs (column c, row i of F) in w. `base` is F at w = 0. y begins with the entries of P:
    `symmetric` > 0 is the order of a full P; a diagonal one is positive like all the rest of y. `cost` is c.
    `coefficients` counts w, with those that no pair has: inputs and constants.
    """

    S: Float[ndarray, "s W"]
    rho: Float[ndarray, "h n"]
    upper: Float[ndarray, " h"]
    base: Float[ndarray, "n W"]
    states: Int[ndarray, " k"]
    gradient: Pairs
    product: Pairs
    flow: Pairs
    cost: Float[ndarray, " J"]
    symmetric: int
    kappa: float
    delta: float
    coefficients: int

    @property
    def free(self) -> int:
        """Number of entries of a full P."""
        return self.symmetric * (self.symmetric + 1) // 2

    @property
    def barriers(self) -> int:
        """Order of all inequalities together: how much a unit of the barrier's weight costs at its centre."""
        return int(self.S.shape[1] + self.symmetric + len(self.cost) - self.free)

    @cached_property
    def pairs(self) -> Pairs:
        """The pairs of all unknowns u = (w, y), as rows of D: those of w first, then gradients, then products."""
        s, h, K = len(self.S), len(self.rho), self.coefficients
        flow, gradient, product = self.flow, self.gradient, self.product
        return Pairs(
            np.concatenate([flow.p, gradient.p, product.p]),
            np.concatenate([s + h + flow.q, s + gradient.q, product.q]),
            np.concatenate([flow.owner, K + gradient.owner, K + product.owner]),
            np.concatenate([flow.weight, gradient.weight, product.weight]),
        )

    @cached_property
    def tie(self) -> sparse.csr_array:
        """The weight of each pair (row) in its unknown (column)."""
        shape = (len(self.pairs.p), self.coefficients + len(self.cost))
        return sparse.csr_array((self.pairs.weight, (np.arange(shape[0]), self.pairs.owner)), shape=shape)

    @cached_property
    def square(self) -> Float[ndarray, "K K"]:
        """Room for the products of all pairs, which every step of a descent overwrites."""
        return np.empty((len(self.pairs.p), len(self.pairs.p)))

    def flows(self, w: Float[ndarray, " K"]) -> Float[ndarray, "n W"]:
        """Return F."""
        F = self.base.copy()
        np.add.at(F, (self.flow.q, self.flow.p), self.flow.weight * w[self.flow.owner])
        return F

    def slopes(self, y: Float[ndarray, " J"]) -> Float[ndarray, "W n"]:
        """Return E."""
        g = self.gradient
        return np.asarray(self.S[g.p].T @ ((g.weight * y[g.owner])[:, None] * self.rho[g.q]))

    def rows(self, F: ndarray, E: ndarray) -> Float[ndarray, "d W"]:
        """Return D = [S; rho (F + kappa upper I); E']."""
        H = self.rho @ F
        if self.kappa:
            H[:, : len(self.states)] += self.kappa * self.upper[:, None] * self.rho[:, self.states]
        return np.vstack([self.S, H, E.T])

    def matrix(self, D: ndarray, y: ndarray) -> Float[ndarray, "W W"]:
        """Return Z."""
        g, t, s = self.gradient, self.product, len(self.S)
        half = self.S[g.p].T @ ((g.weight * y[g.owner])[:, None] * D[s + g.q])
        half += self.S[t.p].T @ ((t.weight * y[t.owner])[:, None] * self.S[t.q])
        return np.asarray(-(half + half.T) - self.delta * np.eye(self.S.shape[1]))

    def P(self, y: Float[ndarray, " J"]) -> Float[ndarray, "k k"]:
        """Return the full matrix P(y), of order 0 where P is diagonal."""
        return np.asarray(triangle(self.symmetric).matrix(y[: self.free]))


@dataclass(frozen=True, eq=False)
class Fit:
    """The convex function f(w) = 1/2 (w - w0)'M (w - w0)."""

    M: Float[ndarray, "K K"]
    w0: Float[ndarray, " K"]

    def __call__(self, w: Float[ndarray, " K"]) -> float:
        """Return f."""
        return 0.5 * float((w - self.w0) @ self.M @ (w - self.w0))


@dataclass(frozen=True, eq=False)
class Point:
    """Unknowns and slack: Z + slack I, P and y are positive definite; feasible where the slack is 0."""

    w: Float[ndarray, " K"]
    y: Float[ndarray, " J"]
    slack: float = 0.0
