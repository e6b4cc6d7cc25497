"""The barrier of a bilinear matrix inequality: -log det of what has to be positive, and its derivatives.

Every unknown enters the derivative of Z through pairs of rows of one matrix D = [S; rho F; E'], those of the model
too: the coefficient at place (i, c) of F has the pair (e_c, E'_i). So with V = D Z^-1 D' the Hessian of -log det Z is
made of elementwise products of blocks of V, as in `interior_point`, and what the bilinearity adds is one block of V:

    d2(E F + F'E') = rho_i (l e_c' + e_c l')   for a number of V with the pair (l, rho F) and the coefficient (i, c).

Reference: Nesterov & Nemirovskii (1994), ch. 2.
"""

from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from numpy import ndarray

from persid.certified_fits.bilinear import Inequality, Point
from persid.lyapunov.arrays import HOST
from persid.lyapunov.pairs import pair_products, tied
from persid.lyapunov.triangle import triangle

HOLD = 1.0  # weight of |F|^2 / 2 in the barrier: models whose coefficients the data do not hold stay near the others


@dataclass(frozen=True, eq=False)
class State:
    """A point with what its barrier needs: D, the Cholesky factor of Z + slack I, and P."""

    point: Point
    F: ndarray
    D: ndarray
    L: ndarray
    P: ndarray
    barrier: float

    @classmethod
    def at(cls, inequality: Inequality, point: Point) -> "State | None":
        """Return the state, or None where the point is not strictly inside."""
        positive = point.y[inequality.free :]
        if not (positive > 0).all():
            return None
        P = inequality.P(point.y)
        F = inequality.flows(point.w)
        D = inequality.rows(F, inequality.slopes(point.y))
        Z = inequality.matrix(D, point.y)
        Z[np.diag_indices_from(Z)] += point.slack
        L, failed = sla.lapack.dpotrf(Z, lower=1, clean=1)
        R, failed_P = sla.lapack.dpotrf(P, lower=1) if len(P) else (P, 0)
        if failed or failed_P:
            return None
        logarithms = 2 * np.log(np.diag(L)).sum() + 2 * np.log(np.diag(R)).sum() + np.log(positive).sum()
        return cls(point, F, D, L, P, 0.5 * HOLD * float((F**2).sum()) - float(logarithms))

    @property
    def inverse(self) -> Float[ndarray, "W W"]:
        """(Z + slack I)^-1."""
        half = sla.lapack.dtrtri(self.L, lower=1)[0]  # triangular solves of SciPy start threads at every size
        return np.asarray(half.T @ half)


def pairings(inequality: Inequality, V: Float[ndarray, "d d"]) -> Float[ndarray, " u"]:
    """Return the sum of 2 V[p, q] over the pairs of every unknown."""
    pairs = inequality.pairs
    return np.bincount(pairs.owner, 2 * pairs.weight * V[pairs.p, pairs.q], inequality.tie.shape[1])


def derivatives(inequality: Inequality, state: State) -> tuple[ndarray, ndarray, ndarray]:
    """Return the barrier's gradient, its Hessian without the bilinear block, and that block (coefficients x y)."""
    half = sla.blas.dtrsm(1.0, state.L, state.D.T, lower=1)
    V = half.T @ half
    tie, K, free = inequality.tie, inequality.coefficients, inequality.free
    g = pairings(inequality, V)
    H = tied(pair_products(inequality.pairs.p, inequality.pairs.q, V, V, inequality.square, HOST.block), tie.T)
    flow = inequality.flow
    held = tie[: len(flow.p), :K]
    g[:K] += HOLD * (held.T @ state.F[flow.q, flow.p])
    H[:K, :K] += HOLD * (held.T @ held).toarray()
    y = state.point.y[free:]
    g[K + free :] -= 1 / y
    diagonal = np.arange(K + free, len(g))
    H[diagonal, diagonal] += 1 / y**2
    if free:
        inverse = np.linalg.inv(state.P)
        g[K : K + free] -= triangle(len(inverse)).pairings(inverse)
        H[K : K + free, K : K + free] += triangle(len(inverse)).schur(inverse, inverse)
    return g, H, _bilinear(inequality, V)


def _bilinear(inequality: Inequality, V: ndarray) -> ndarray:
    """Return tr(Z^-1 d2Q) of every coefficient with every number of V."""
    flow, gradient, tie, K = inequality.flow, inequality.gradient, inequality.tie, inequality.coefficients
    block = 2 * inequality.rho[gradient.q][:, flow.q].T * V[np.ix_(flow.p, gradient.p)]
    f, e = len(flow.p), len(gradient.p)
    left, right = tie[:f, :K], tie[f : f + e, K:]
    return np.asarray(left.T @ np.ascontiguousarray((right.T @ block.T).T))


def with_slack(
    inequality: Inequality, state: State, g: ndarray, H: ndarray, c: ndarray, beta: float
) -> tuple[ndarray, ndarray, ndarray]:
    """Border gradient and Hessian by the slack s: Z + s I, objective s."""
    inverse = state.inverse
    border = -beta * pairings(inequality, state.D @ inverse @ inverse @ state.D.T)
    corner = beta * float((inverse**2).sum())
    H = np.block([[H, border[:, None]], [border[None], np.array([[corner]])]])
    return np.append(g, 1.0 - beta * np.trace(inverse)), H, np.append(c, 0.0)
