"""One iterate of the interior-point method, how it begins, goes on with new unknowns, and takes a step.

The symbols are those of `interior_point`, in coordinates in which X0 = I.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float, Int
from numpy import ndarray

from persid.lyapunov.pairs import (
    BLOCK,
    Problem,
    combine,
    dual_of_P,
    lengths,
    pack,
    pairings,
    sandwich,
    schur,
    schur_of_P,
    symmetric_entries,
    unpack,
)

SHARE = 0.95  # of the way to the boundary that a step goes
CLOSELY, ROUGHLY = 0.02, 0.2  # relative errors of the way to the boundary, in a step and in its prediction
LANCZOS_ORDER = 64  # from which the way to the boundary comes from Lanczos' method
ROUNDING = 1e-14  # of its size: a price that is negative by less counts as zero
RIDGE = 1e-13  # added to the unit diagonal of the Schur complement; the next step corrects what it changes
JOINING_SHARE = 0.5  # of the way to the boundary that unknowns go which join; also x_k over its size for a bad price


@dataclass(frozen=True, eq=False)
class Iterate:
    """Primal X, U, x, m and dual y, t, with Z and P(y), in coordinates in which X0 = I."""

    problem: Problem
    y: Float[ndarray, " J"]
    t: float
    m: float
    X: Float[ndarray, "N N"]
    U: Float[ndarray, "k k"]
    x: Float[ndarray, " s"]
    Z: Float[ndarray, "N N"] = field(init=False)
    P: Float[ndarray, "k k"] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "Z", -combine(self.problem, self.y) - self.t * np.eye(self.problem.order))
        object.__setattr__(self, "P", unpack(self.problem, self.y))

    @property
    def s(self) -> Float[ndarray, " s"]:
        """The unknowns that must be positive: all but the entries of P."""
        return self.y[self.problem.free :]

    @cached_property
    def gap(self) -> float:
        """Total complementarity: m - t where the equalities are met."""
        return float(np.vdot(self.X, self.Z) + np.vdot(self.U, self.P) + self.x @ self.s)

    @property
    def mu(self) -> float:
        """Mean complementarity."""
        return self.gap / (self.problem.order + self.problem.symmetric + len(self.x))

    @cached_property
    def halves(self) -> tuple[ndarray, ndarray, ndarray, ndarray]:
        """Inverse Cholesky factors of X, U, Z and P(y): L^-1 with M = L L'."""
        return _half(self.X), _half(self.U), _half(self.Z), _half(self.P)

    @property
    def is_interior(self) -> bool:
        """Whether y and t satisfy their inequalities strictly."""
        return bool((self.s > 0).all()) and _is_positive(self.Z) and _is_positive(self.P)

    @cached_property
    def defect(self) -> Float[ndarray, " J"]:
        """What the equalities of (P) lack."""
        free, lack = self.problem.free, pairings(self.problem, self.X) + self.m * self.problem.cost
        lack[:free] -= pack(self.U)
        lack[free:] -= self.x
        return lack

    @property
    def is_dual_feasible(self) -> bool:
        """Whether X proves the bound m: with it the equalities of (P) have solutions x >= 0 and U >= 0."""
        free, price = self.problem.free, pairings(self.problem, self.X) + self.m * self.problem.cost
        least = -ROUNDING * lengths(self.problem, self.X)[free:]
        return bool((price[free:] >= least).all()) and _is_positive(dual_of_P(self.problem, price[:free]))


def first_iterate(problem: Problem, least: float = 0.0) -> Iterate:
    """Strictly feasible, nearly central, m > least: X = I / order; U, x, m to match; y = mu / x, P = mu U^-1."""
    free, k, c = problem.free, problem.symmetric, problem.cost[problem.free :]
    X = np.eye(problem.order) / problem.order
    paired = pairings(problem, X)
    W = dual_of_P(problem, paired[:free])  # U = W + m I solves <F_k, X> - <E_k, U> + m c_k = 0
    costly = c > 0
    needed = [0.0, least, *(-paired[free:][costly] / c[costly])]
    if k:
        needed.append(-float(np.linalg.eigvalsh(W)[0]))
    m = 1.5 * max(needed) + 1e-3 / problem.order
    U, x = W + m * np.eye(k), paired[free:] + m * c
    x = np.where(x > 0, x, 1e-3 * lengths(problem, X)[free:])  # where X0 is not interior the equality comes later
    P = _inverse(_half(U))
    mu = 1 / (np.trace(P) + c @ (1 / x))
    y = mu * np.concatenate([symmetric_entries(P), 1 / x])
    largest = sla.eigvalsh(combine(problem, y), subset_by_index=[problem.order - 1] * 2)[0]
    return Iterate(problem, y, -float(largest) - mu * problem.order, m, X, U, x)


def resumed(problem: Problem, old: Iterate, places: Int[ndarray, " J"]) -> Iterate:
    """Return the iterate with new unknowns: x_k is their price, or of the size of F_k where that is negative.

    y_k = b mu / x_k, where b keeps Z > 0.
    """
    known, free = places >= 0, problem.free
    price = pairings(problem, old.X) + old.m * problem.cost
    new_x = np.where(price > 0, price, JOINING_SHARE * lengths(problem, old.X))
    joining = np.where(known, 0.0, old.mu / new_x)
    b = min(1.0, JOINING_SHARE * _to_boundary(old.halves[2], -combine(problem, joining)))
    y = np.where(known, old.y[places], b * joining)
    x = np.where(known[free:], old.x[np.maximum(places[free:] - free, 0)], new_x[free:])
    total = float(problem.cost @ y)
    return Iterate(problem, y / total, old.t / total, old.m, old.X, old.U, x)


@dataclass(frozen=True, eq=False)
class _Direction:
    y: ndarray
    t: float
    m: float
    X: ndarray
    U: ndarray
    x: ndarray
    Z: ndarray
    P: ndarray


def _symmetric(M: ndarray) -> ndarray:
    return np.asarray(0.5 * (M + M.T))


def _half(M: ndarray) -> ndarray:
    """Return L^-1, M = L L'; LinAlgError where M is not positive definite."""
    if not len(M):
        return M
    factor, failed = sla.lapack.dpotrf(M, lower=1, clean=1)
    if failed:
        raise sla.LinAlgError("not positive definite")
    half: ndarray = sla.lapack.dtrtri(factor, lower=1, overwrite_c=1)[0]  # trtrs would start threads at every size
    return half


def _inverse(half: ndarray) -> ndarray:
    return np.asarray(half.T @ half)


def _is_positive(M: ndarray) -> bool:
    return not len(M) or sla.lapack.dpotrf(M, lower=1, clean=0)[1] == 0


@dataclass(frozen=True, eq=False)
class Step:
    """The next iterate, the share of the way that a limit left to it, and the dual (X, m) at the end of the way."""

    state: Iterate
    share: float
    end: tuple[Float[ndarray, "N N"], float]


def step(state: Iterate, limit: Callable[[ndarray, float], float] | None = None) -> Step | None:
    """One predictor-corrector step; None when the linear algebra gives out.

    `limit` says which share of the step of the dual matrix to X and m may be taken.
    """
    free = state.problem.free
    try:
        direction = _newton(state)
        predicted = direction(0.0, None)
        a, b = _steps(state, predicted, rough=True)
        gap = (
            np.vdot(state.X + a * predicted.X, state.Z + b * predicted.Z)
            + np.vdot(state.U + a * predicted.U, state.P + b * predicted.P)
            + (state.x + a * predicted.x) @ (state.s + b * predicted.y[free:])
        )
        size = state.problem.order + state.problem.symmetric + len(state.x)
        sigma = min(1.0, max(float(gap) / size / state.mu, 1e-6) ** 2)
        corrected = direction(sigma * state.mu, predicted)
        a, b = _steps(state, corrected)
    except (sla.LinAlgError, ValueError):
        return None
    if max(a, b) < 1e-7:
        return None
    end = state.X + a * corrected.X, state.m + a * corrected.m
    share = 1.0 if limit is None else limit(*end)
    a *= share
    following = Iterate(
        state.problem,
        state.y + b * corrected.y,
        state.t + b * corrected.t,
        state.m + a * corrected.m,
        state.X + a * corrected.X,
        state.U + a * corrected.U,
        state.x + a * corrected.x,
    )
    return Step(following, share, end)


def _factored(M: ndarray) -> Callable[[ndarray], ndarray]:
    """Return v -> M^-1 v; only the lower triangle of M is read, and overwritten."""
    scale = 1 / np.sqrt(np.diag(M))
    for start in range(0, len(M), BLOCK):
        rows, stop = slice(start, start + BLOCK), start + BLOCK
        M[rows, :stop] *= scale[rows, None] * scale[:stop]
    M[range(len(M)), range(len(M))] += RIDGE
    factor = sla.cho_factor(M.T, lower=False, overwrite_a=True, check_finite=False)  # M' is in LAPACK's order: no copy
    return lambda v: (scale * sla.cho_solve(factor, (scale * v.T).T, check_finite=False).T).T


def _newton(state: Iterate) -> Callable[[float, _Direction | None], _Direction]:
    """Factor the Newton system once; return the direction for a target mu and an optional second-order correction."""
    problem, free, c = state.problem, state.problem.free, state.problem.cost
    ratio = state.x / state.s
    Z_inverse, P_inverse = _inverse(state.halves[2]), _inverse(state.halves[3])
    M = schur(problem, sandwich(problem, state.X), sandwich(problem, Z_inverse))
    M[:free, :free] += schur_of_P(state.U, P_inverse)
    M[range(free, len(c)), range(free, len(c))] += ratio
    back = _factored(M)
    XZ = _symmetric(state.X @ Z_inverse)
    g = pairings(problem, XZ)
    Mg, Mc = back(np.stack([g, c], axis=1)).T
    border = np.array([[c @ Mg, c @ Mc], [np.trace(XZ) - g @ Mg, -(g @ Mc)]])
    trace_defect = np.trace(state.X) - 1

    def direction(target: float, second: _Direction | None) -> _Direction:
        C, CU, cx = target * Z_inverse - state.X, target * P_inverse - state.U, target / state.s - state.x
        if second is not None:
            C = C - _symmetric(second.X @ second.Z @ Z_inverse)
            CU = CU - _symmetric(second.U @ second.P @ P_inverse)
            cx = cx - second.x * second.y[free:] / state.s
        r = -pairings(problem, C) - state.defect
        r[:free] += pack(CU)
        r[free:] += cx
        Mr = back(r)
        dt, dm = np.linalg.solve(border, [c @ Mr, -np.trace(C) - trace_defect - g @ Mr])
        dy = Mr - Mg * dt - Mc * dm
        F, dP = combine(problem, dy), unpack(problem, dy)
        dX = C + _symmetric(state.X @ F @ Z_inverse) + dt * XZ
        dU = CU - _symmetric(state.U @ dP @ P_inverse)
        dx = cx - ratio * dy[free:]
        return _Direction(dy, float(dt), float(dm), dX, dU, dx, -F - dt * np.eye(problem.order), dP)

    return direction


def _steps(state: Iterate, d: _Direction, rough: bool = False) -> tuple[float, float]:
    """Return the primal and the dual step length, a fixed share of the way to the boundary; `rough`: untested."""
    X, U, Z, P = state.halves
    primal = min(1.0, SHARE * _ratio(state.x, d.x))
    dual = min(1.0, SHARE * _ratio(state.s, d.y[state.problem.free :]))
    for M, half, dM in ((state.X, X, d.X), (state.U, U, d.U)):
        primal = _inside(M, half, dM, primal, rough)
    for M, half, dM in ((state.Z, Z, d.Z), (state.P, P, d.P)):
        dual = _inside(M, half, dM, dual, rough)
    return primal, dual


def _inside(M: ndarray, half: ndarray, dM: ndarray, a: float, rough: bool) -> float:
    """Return a step of at most a that keeps M + a dM positive definite, and tests that it does unless it is rough."""
    a = min(a, SHARE * _to_boundary(half, dM, ROUGHLY if rough else CLOSELY))
    if rough:
        return a
    for _ in range(20):
        if _is_positive(M + a * dM):
            return a
        a *= 0.7
    return 0.0


def _ratio(v: ndarray, dv: ndarray) -> float:
    falling = dv < 0
    return float((-v[falling] / dv[falling]).min()) if falling.any() else np.inf


def _to_boundary(half: ndarray, dM: ndarray, tolerance: float = CLOSELY) -> float:
    """Return the largest a with M + a dM >= 0, to a tolerance: from L^-1 dM L^-T, half = L^-1, M = L L'."""
    if not len(half):
        return np.inf
    dense = len(half) <= LANCZOS_ORDER
    smallest = np.linalg.eigvalsh(half @ dM @ half.T)[0] if dense else _lanczos_smallest(half, dM, tolerance)
    return -1 / float(smallest) if smallest < 0 else np.inf


def _lanczos_smallest(half: ndarray, dM: ndarray, tolerance: float, steps: int = 30) -> float:
    """Return a lower estimate of the smallest eigenvalue: the Ritz value less its residual (Toh 2002)."""
    Q, alphas, betas = np.empty((steps + 1, len(dM))), np.zeros(steps), np.zeros(steps)
    v = np.random.default_rng(0).normal(size=len(dM))
    Q[0] = v / np.linalg.norm(v)
    for k in range(steps):
        w, known = half @ (dM @ (half.T @ Q[k])), Q[: k + 1]
        alphas[k] = w @ Q[k]
        w -= known.T @ (known @ w)
        w -= known.T @ (known @ w)
        betas[k] = np.linalg.norm(w)
        if k % 3 == 2 or k == steps - 1 or betas[k] < 1e-12:
            values, vectors, _ = sla.lapack.dstev(alphas[: k + 1], betas[: max(k, 1)])
            residual = betas[k] * abs(vectors[-1, 0])
            if residual <= tolerance * abs(values[0]) + 1e-9:
                break
        Q[k + 1] = w / betas[k]
    return float(values[0] - residual)
