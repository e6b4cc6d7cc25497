r"""A barrier method for small matrix inequalities with an objective and with linear equations among the unknowns.

    minimise c'w   subject to   C_b + sum_k w_k F_bk > 0 (blocks b),   (N w)_k > 0 (multipliers k),   |w| < R

The unknowns are y = N w: the columns of N span the solutions of the equations. Newton's method minimises
theta c'w + phi(w), phi minus the sum of log det of the blocks, of log of the multipliers, and of log(R^2 - w'w); theta
rises. With nu the order of all inequalities together a centred point is within nu/theta of the optimum, so the sign of
an optimum is known early. The points that it passes are analytic centres: they keep away from every boundary, which is
what survives rounding.

With Z = L L' and A_k = L^-1 F_k L^-T the gradient of -log det Z is -tr A_k, and its Hessian <A_k, A_l>: small matrices
are kept dense. Of large ones X = Z^-1 is kept, and tr(F_k X F_l X) comes from the pairs of rows that make F_k. Faces,
C_f + sum_k w_k F_k > 0 for many f, share their F: with t_k = vec F_k their Hessian is T' (sum_f X_f x X_f) T, whose
middle is of the order of the matrices alone. Reference: Boyd & Vandenberghe (2004), Convex Optimization, chapter 11.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from numpy import ndarray
from scipy import sparse

from persid.lyapunov.pairs import FORMED, Problem, combine, pairings, schur

RISE = 20.0  # of theta once a point is centred
CENTRED = 0.25  # Newton decrement below which it is
NEARLY = 0.95  # of the way to the boundary that a step may go
HALVINGS = 30  # of a step, until the merit falls by the share ENOUGH of what its slope foretells
ENOUGH = 0.05
RIDGES = (1e-14, 1e-11, 1e-8)  # on the unit diagonal of a Hessian, for rounding: the first that lets it be factored
STEPS = 200
ACCURACY = 1e-7  # of the objective's own size, and so its gap


@dataclass(frozen=True, eq=False)
class Inequality(ABC):
    """Matrices C_f + sum_k w_k F_k that differ in their constants alone, and are to be positive definite."""

    constants: Float[ndarray, "B N N"]

    @property
    def order(self) -> int:
        """The orders of all of them together."""
        return int(self.constants.shape[0] * self.constants.shape[1])

    def at(self, w: Float[ndarray, " W"]) -> Float[ndarray, "B N N"]:
        """Return the matrices."""
        return np.asarray(self.constants + self.along(w))

    @abstractmethod
    def along(self, d: Float[ndarray, " W"]) -> Float[ndarray, "N N"]:
        """Return what a step of d adds to each of them."""

    @abstractmethod
    def derivatives(self, w: Float[ndarray, " W"]) -> tuple[Float[ndarray, " W"], Float[ndarray, "W W"]]:
        """Return gradient and Hessian of minus the sum of their log det."""


@dataclass(frozen=True, eq=False)
class Block(Inequality):
    """A small matrix, every F formed."""

    F: Float[ndarray, "W N N"]

    @classmethod
    def of(cls, pairs: Problem, N: Float[ndarray, "J W"], constant: Float[ndarray, "N N"]) -> "Block":
        """Return the block of y = N w, where pairs of rows make the part of each y_k."""
        left = pairs.S.toarray()[pairs.p]
        right = pairs.H[pairs.q - pairs.S.shape[0]]
        half = np.einsum("ki,kj->kij", left, right).reshape(len(left), -1)
        weight = np.eye(len(left)) if pairs.tie is None else pairs.tie.toarray()
        F = ((weight @ N).T @ half).reshape(-1, pairs.order, pairs.order)
        return cls(constant[None], F + F.transpose(0, 2, 1))

    def along(self, d: Float[ndarray, " W"]) -> Float[ndarray, "N N"]:
        """Return what a step of d adds to it."""
        return np.asarray(np.tensordot(d, self.F, 1))

    def derivatives(self, w: Float[ndarray, " W"]) -> tuple[Float[ndarray, " W"], Float[ndarray, "W W"]]:
        """Return gradient and Hessian of -log det."""
        half = _inverse(np.linalg.cholesky(self.at(w)[0]))
        A = half @ self.F @ half.T
        flat = A.reshape(len(w), -1)
        return -np.trace(A, axis1=1, axis2=2), flat @ flat.T


@dataclass(frozen=True, eq=False)
class Paired(Inequality):
    """A large matrix C + sum_k y_k F_k, y = N w, every F_k a sum of pairs of rows."""

    pairs: Problem
    N: sparse.csr_array

    def along(self, d: Float[ndarray, " W"]) -> Float[ndarray, "N N"]:
        """Return what a step of d adds to it."""
        return np.asarray(combine(self.pairs, self.N @ d))

    def derivatives(self, w: Float[ndarray, " W"]) -> tuple[Float[ndarray, " W"], Float[ndarray, "W W"]]:
        """Return gradient and Hessian of -log det."""
        half = _inverse(np.linalg.cholesky(self.at(w)[0]))
        X = half.T @ half
        lower = np.tril(schur(self.pairs, X, X))
        H = lower + np.tril(lower, -1).T
        return -(self.N.T @ pairings(self.pairs, X)), self.N.T @ (self.N.T @ H).T


@dataclass(frozen=True, eq=False)
class Faces(Inequality):
    """Many large matrices; T has the lines vec F_k."""

    T: sparse.csr_array

    def along(self, d: Float[ndarray, " W"]) -> Float[ndarray, "N N"]:
        """Return what a step of d adds to each of them."""
        return np.asarray((self.T.T @ d).reshape(self.constants.shape[1:]))

    def derivatives(self, w: Float[ndarray, " W"]) -> tuple[Float[ndarray, " W"], Float[ndarray, "W W"]]:
        """Return gradient and Hessian of minus the sum of log det."""
        X, N = np.linalg.inv(self.at(w)), self.constants.shape[1]
        middle = np.einsum("fij,fkl->ikjl", X, X, optimize=True).reshape(N * N, N * N)
        return -(self.T @ X.sum(axis=0).ravel()), self.T @ (self.T @ middle).T


def definite(pairs: Problem, N: Float[ndarray, "J W"], constant: Float[ndarray, "N N"] | None = None) -> Block | Paired:
    """Return the inequality C + sum_k y_k F_k > 0, y = N w, where pairs of rows make F_k: dense where it is small."""
    constant = np.zeros((pairs.order, pairs.order)) if constant is None else constant
    if N.shape[1] * pairs.order**2 <= FORMED:
        return Block.of(pairs, N, constant)
    return Paired(constant[None], pairs, sparse.csr_array(N))


def faces(pairs: Problem, N: Float[ndarray, "J W"], constants: Sequence[Float[ndarray, "N N"]]) -> Sequence[Inequality]:
    """Return the inequalities C_f + sum_k y_k F_k > 0, y = N w, for every constant: together where they are large."""
    if len(constants) * N.shape[1] * pairs.order**2 <= FORMED:
        return [Block.of(pairs, N, constant) for constant in constants]
    left, right = pairs.S[pairs.p].toarray(), pairs.H[pairs.q - pairs.S.shape[0]]
    half = np.einsum("ki,kj->kij", left, right)
    products = sparse.csr_array((half + half.transpose(0, 2, 1)).reshape(len(left), -1))
    combined = sparse.csr_array(N).T if pairs.tie is None else sparse.csr_array(N).T @ pairs.tie.T
    return [Faces(np.array(constants), sparse.csr_array(combined @ products))]


@dataclass(frozen=True, eq=False)
class Centre:
    """A point of the central path: its unknowns w, the objective, and how far below it the optimum can be."""

    w: Float[ndarray, " W"]
    objective: float
    gap: float

    def knows_sign(self) -> bool:
        """Whether the sign of the optimum is known: that of the objective, where it is below zero by half the gap."""
        return -self.objective > 0.5 * self.gap or self.objective > self.gap


def as_near_as(share: float) -> Callable[[Centre], bool]:
    """Return what says of a centre whether the optimum is nearer to it than a share of the objective."""
    return lambda centre: centre.gap < share * abs(centre.objective)


@dataclass(frozen=True, eq=False)
class Region:
    """All inequalities: blocks, `signs` w > 0, and a ball; w is of moderate size."""

    blocks: Sequence[Inequality]
    signs: Float[ndarray, "M W"]
    radius: float

    @property
    def order(self) -> int:
        """The order of all inequalities together."""
        return sum(block.order for block in self.blocks) + len(self.signs) + 2

    def value(self, w: Float[ndarray, " W"]) -> float:
        """Return phi(w), infinity outside."""
        y, room = self.signs @ w, self.radius**2 - w @ w
        if room <= 0 or (y <= 0).any():
            return np.inf
        total = -2 * np.log(room) - np.log(y).sum()
        for block in self.blocks:
            try:
                L = np.linalg.cholesky(block.at(w))
            except np.linalg.LinAlgError:
                return np.inf
            total -= 2 * np.log(np.diagonal(L, axis1=1, axis2=2)).sum()
        return float(total)

    def derivatives(self, w: Float[ndarray, " W"]) -> tuple[Float[ndarray, " W"], Float[ndarray, "W W"]]:
        """Return the gradient and the Hessian of phi."""
        y, room = self.signs @ w, self.radius**2 - w @ w
        shares = self.signs / y[:, None]
        gradient = 4 / room * w - shares.sum(axis=0)
        hessian = 4 / room * np.eye(len(w)) + 8 / room**2 * np.outer(w, w) + shares.T @ shares
        for block in self.blocks:
            slope, curvature = block.derivatives(w)
            gradient += slope
            hessian += curvature
        return gradient, hessian

    def reach(self, w: Float[ndarray, " W"], d: Float[ndarray, " W"]) -> float:
        """Return how far w + a d stays inside the blocks and the signs."""
        falling = -(self.signs @ d) / (self.signs @ w)
        for block in self.blocks:
            step = block.along(d)
            halves = (_inverse(L) for L in np.linalg.cholesky(block.at(w)))
            falling = np.append(falling, [-np.linalg.eigvalsh(half @ step @ half.T)[0] for half in halves])
        steepest = float(falling.max(initial=0.0))
        return 1 / steepest if steepest > 0 else np.inf


def _inverse(L: Float[ndarray, "N N"]) -> Float[ndarray, "N N"]:
    return np.asarray(sla.solve_triangular(L, np.eye(len(L)), lower=True))


def minimise(
    region: Region,
    objective: Float[ndarray, " W"],
    start: Float[ndarray, " W"],
    *,
    enough: Callable[[Centre], bool] = lambda centre: False,
    left: Callable[[], float] = lambda: np.inf,
    theta: float | None = None,
) -> Centre:
    """Follow the central path from a strictly feasible start, until the gap is small or a centre is `enough`.

    With no time left it returns what it has, a point inside, after a step at least.
    """
    w, size = np.array(start), max(float(np.linalg.norm(objective)), 1e-300)
    theta = 1 / size if theta is None else theta
    for _ in range(STEPS if np.isfinite(region.value(w)) else 0):
        gradient, hessian = region.derivatives(w)
        total = gradient + theta * objective
        d = _solved(hessian, -total)
        decrement = float(np.sqrt(max(-total @ d, 0.0)))
        if decrement < CENTRED:
            centre = Centre(w, float(objective @ w), region.order / theta)
            if enough(centre) or centre.gap < ACCURACY * (abs(centre.objective) + ACCURACY) or left() <= 0:
                return centre
            theta *= RISE
            continue
        following = _searched(region, objective * theta, w, d, float(total @ d))
        if following is None:
            break
        w = following
        if left() <= 0:
            break
    return Centre(w, float(objective @ w), region.order / theta)


def _searched(
    region: Region, objective: Float[ndarray, " W"], w: Float[ndarray, " W"], d: Float[ndarray, " W"], slope: float
) -> Float[ndarray, " W"] | None:
    """Return a point along d where the merit has fallen, None where there is none."""
    a, merit = min(1.0, NEARLY * region.reach(w, d)), float(objective @ w) + region.value(w)
    for _ in range(HALVINGS):
        there = w + a * d
        if float(objective @ there) + region.value(there) <= merit + ENOUGH * a * slope:
            return there
        a *= 0.5
    return None


def _solved(H: Float[ndarray, "W W"], r: Float[ndarray, " W"]) -> Float[ndarray, " W"]:
    """Solve H d = r, H > 0, scaled to a unit diagonal."""
    scale = 1 / np.sqrt(np.diag(H))
    scaled = scale[:, None] * H * scale
    for ridge in RIDGES:
        try:
            factor = sla.cho_factor(scaled + ridge * np.eye(len(H)), lower=True)
        except sla.LinAlgError:
            continue
        return np.asarray(scale * sla.cho_solve(factor, scale * r))
    return np.asarray(scale * np.linalg.lstsq(scaled, scale * r, rcond=None)[0])
