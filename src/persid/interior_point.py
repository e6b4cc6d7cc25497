r"""A structured primal-dual interior-point method for sector-form matrix inequalities.

    maximise t   subject to   Z = -sum_k y_k F_k - t N >= 0,   P(y) >= 0,   y_k >= 0 (multipliers),   c'y = 1      (D)
    minimise m   subject to   x_k = <F_k, X> - <E_k, U> + m c_k >= 0 (= 0 for entries of P),  X, U >= 0,  <N, X> = 1 (P)

N is the inverse of a matrix X0 > 0 with <F_k, X0> > 0 wherever c_k = 0, such as the mean of z z' over points of the
sector cone. Where X0 is the identity the cone is round, and the start X = I / order is nearly central.

Every unknown enters through *pairs* of rows of one matrix D:  F_k = sum over its pairs of  d_p d_q' + d_q d_p'.  So
with Y = D X D' and V = D Z^-1 D' the Schur complement of the HKM direction is made of elementwise products of blocks,

    tr(F_k X F_l Z^-1) = Y[q,r] V[p,s] + Y[q,s] V[p,r] + Y[p,r] V[q,s] + Y[p,s] V[q,r]      for k = (p, q), l = (r, s),

and no F_k is ever formed. Strictly feasible starts exist on both sides, hence no phase 1: at every iterate t is a lower
and m an upper bound of the optimal margin, and the sign of the margin is known as soon as t > 0 or m < 0.
References: Helmberg, Rendl, Vanderbei & Wolkowicz (1996), SIAM J. Optim. 6(2); Mehrotra (1992), SIAM J. Optim. 2(4).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from enum import Enum

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse
from scipy.sparse.csgraph import connected_components

SHARE = 0.95  # of the way to the boundary that a step goes
NOISE = 1e-12  # of the first distance of the bounds: a margin below it is not told from zero
RIDGE = 1e-13  # added to the unit diagonal of the Schur complement; the next step corrects what it changes
BLOCK = 32  # rows of the Schur complement made at once: what they gather from stays in the cache


class Status(Enum):
    """Why the method stopped, as a full sentence."""

    FEASIBLE = "A strictly feasible point was found."
    INFEASIBLE = "A dual matrix shows that no feasible point exists in this family."
    STALLED = "The bounds met, or steps became too short, before the sign of the margin was decided."
    ROUGH = "The bounds came as near to each other as was asked, and the sign of the margin is still open."
    TIME = "The time limit was reached."
    INTERRUPTED = "The run was interrupted; the best point so far is kept."


@dataclass(frozen=True, eq=False)
class Problem:
    """Data of (D). D = [S; H], S sparse, H dense; pair k is (p[k], q[k]) with p[k] always a row of S.

    Unknown j sums the pairs of column j of `tie` (None: one pair each). The first `symmetric`(`symmetric` + 1)/2
    unknowns are the upper triangle of a symmetric matrix P, entry (i, j) standing for e_i e_j' + e_j e_i'; 0 without P.
    `cost` is c; `X` is X0, positive definite with <F_k, X0> > 0 for every multiplier of zero cost.
    """

    S: sparse.csr_array
    H: Float[ndarray, "h N"]
    p: Int[ndarray, " K"]
    q: Int[ndarray, " K"]
    cost: Float[ndarray, " J"]
    X: Float[ndarray, "N N"]
    symmetric: int = 0
    tie: sparse.csr_array | None = None

    @property
    def order(self) -> int:
        """Order of the matrix inequality."""
        return self.H.shape[1]

    @property
    def free(self) -> int:
        """Number of unknowns that are entries of P."""
        return self.symmetric * (self.symmetric + 1) // 2


@dataclass(frozen=True, eq=False)
class Solution:
    """The last iterate: lower <= optimal margin <= upper; `X` is the dual matrix, `log` one line per iteration."""

    status: Status
    y: Float[ndarray, " J"]
    lower: float
    upper: float
    X: Float[ndarray, "N N"]
    log: tuple[str, ...]


def solve(
    problem: Problem, *, time_limit: float = np.inf, quality: float = 0.1, gap: float = 1e-13, iterations: int = 80
) -> Solution:
    """Decide the sign of the optimal margin; a feasible answer has t >= quality * m where the method gets that far."""
    problem, C = whitened(problem)
    state = _start(problem)
    first = state.m - state.t
    started, log, status = time.perf_counter(), [], Status.STALLED
    try:
        for count in range(iterations):
            log.append(f"{count:3d}  t = {state.t: .3e}  m = {state.m: .3e}  mu = {state.mu:.1e}")
            if state.m < -NOISE * first:
                status = Status.INFEASIBLE
                break
            if state.t > quality * state.m:
                break
            if time.perf_counter() - started > time_limit:
                status = Status.TIME
                break
            following = _iterate(problem, state)
            if following is None or state.m - state.t < NOISE * first:
                break
            if state.m - state.t < gap * first:
                status = Status.ROUGH
                break
            state = following
    except KeyboardInterrupt:
        status = Status.INTERRUPTED
    if state.t > 0:
        status = Status.FEASIBLE
    return Solution(status, state.y, state.t, state.m, C @ state.X @ C.T, tuple(log))


@dataclass(frozen=True, eq=False)
class _State:
    """Primal X, U, x, m and dual y, t with the Cholesky factors of Z and P(y)."""

    problem: Problem
    y: ndarray
    t: float
    m: float
    X: ndarray
    U: ndarray
    x: ndarray
    Z: ndarray = field(init=False)
    P: ndarray = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "Z", -combine(self.problem, self.y) - self.t * np.eye(self.problem.order))
        object.__setattr__(self, "P", unpack(self.problem, self.y))

    @property
    def s(self) -> ndarray:
        return self.y[self.problem.free :]

    @property
    def mu(self) -> float:
        """Mean complementarity."""
        gap = np.vdot(self.X, self.Z) + np.vdot(self.U, self.P) + self.x @ self.s
        return float(gap) / (self.problem.order + self.problem.symmetric + len(self.x))


def combine(problem: Problem, y: Float[ndarray, " J"]) -> Float[ndarray, "N N"]:
    """Return sum_k y_k F_k."""
    weights = y if problem.tie is None else problem.tie @ y
    rows = problem.S.shape[0]
    inside = problem.q < rows
    outside = ~inside
    W = sparse.coo_array((weights[inside], (problem.p[inside], problem.q[inside])), shape=(rows, rows)).tocsr()
    half = (problem.S.T @ (W @ problem.S)).toarray()
    if outside.any():
        index = (problem.q[outside] - rows, problem.p[outside])
        W = sparse.coo_array((weights[outside], index), shape=(len(problem.H), rows)).tocsr()
        half += (W @ problem.S).T @ problem.H
    return half + half.T


def unpack(problem: Problem, y: Float[ndarray, " J"]) -> Float[ndarray, "k k"]:
    """Return the matrix P(y)."""
    P = np.zeros((problem.symmetric, problem.symmetric))
    P[np.triu_indices(problem.symmetric)] = y[: problem.free]
    return P + P.T


def _pack(problem: Problem, M: ndarray) -> ndarray:
    """Return <E_k, M> for the entries of P, M symmetric."""
    return 2 * M[np.triu_indices(problem.symmetric)]


def _sandwich(problem: Problem, M: ndarray) -> ndarray:
    """Return D M D' for a symmetric M."""
    SM, HM = problem.S @ M, problem.H @ M
    SS, SH = problem.S @ np.ascontiguousarray(SM.T), SM @ problem.H.T
    return np.block([[SS, SH], [SH.T, HM @ problem.H.T]])


def pairings(problem: Problem, M: Float[ndarray, "N N"]) -> Float[ndarray, " J"]:
    """Return <F_k, M> for every unknown, M symmetric."""
    SM = problem.S @ M
    inside = problem.q < len(SM)
    products = np.empty(len(problem.p))
    products[inside] = 2 * (problem.S @ np.ascontiguousarray(SM.T))[problem.q[inside], problem.p[inside]]
    products[~inside] = 2 * (SM @ problem.H.T)[problem.p[~inside], problem.q[~inside] - len(SM)]
    return products if problem.tie is None else problem.tie.T @ products


def _schur(problem: Problem, Y: ndarray, V: ndarray) -> ndarray:
    """Return the matrix of tr(F_k X F_l Z^-1); without ties only its lower triangle, all that Cholesky reads."""
    p, q, tie = problem.p, problem.q, problem.tie
    M = np.zeros((len(p), len(p)))
    for start in range(0, len(p), BLOCK):
        rows, stop = slice(start, start + BLOCK), min(start + BLOCK, len(p))
        r, s = p[:stop], q[:stop]
        Yp, Yq, Vp, Vq = Y[p[rows]], Y[q[rows]], V[p[rows]], V[q[rows]]
        block = Yq.take(r, 1) * Vp.take(s, 1)
        block += Yq.take(s, 1) * Vp.take(r, 1)
        block += Yp.take(r, 1) * Vq.take(s, 1)
        block += Yp.take(s, 1) * Vq.take(r, 1)
        M[rows, :stop] = block
    if tie is None:
        return M
    M = np.tril(M) + np.tril(M, -1).T
    return tie.T @ (tie.T @ M).T


def _schur_of_P(problem: Problem, U: ndarray, P_inverse: ndarray) -> ndarray:
    """Return the matrix of tr(E_k U E_l P^-1)."""
    i, j = np.triu_indices(problem.symmetric)

    def part(a: ndarray, b: ndarray) -> ndarray:
        return U[np.ix_(a, b)]

    def inverse(a: ndarray, b: ndarray) -> ndarray:
        return P_inverse[np.ix_(a, b)]

    return (
        part(j, i) * inverse(i, j)
        + part(j, j) * inverse(i, i)
        + part(i, i) * inverse(j, j)
        + part(i, j) * inverse(j, i)
    )


def _start(problem: Problem) -> _State:
    """Strictly feasible and nearly central: X = I / order; U, x, m to match; y = mu / x, P = mu U^-1, t by mu X^-1."""
    free, k, c = problem.free, problem.symmetric, problem.cost[problem.free :]
    X = np.eye(problem.order) / problem.order
    paired = pairings(problem, X)
    W = _dual_of_P(problem, paired[:free])  # U = W + m I solves <F_k, X> - <E_k, U> + m c_k = 0
    costly = c > 0
    needed = [0.0, *(-paired[free:][costly] / c[costly])]
    if k:
        needed.append(-float(np.linalg.eigvalsh(W)[0]))
    m = 1.5 * max(needed) + 1e-3 / problem.order
    U, x = W + m * np.eye(k), paired[free:] + m * c
    P = _inverse(U)
    inverse = 1 / np.maximum(np.abs(x), 1e-300)
    mu = 1 / (np.trace(P) + c @ inverse)
    y = mu * np.concatenate([(P / (1 + np.eye(k)))[np.triu_indices(k)], inverse])
    largest = sla.eigvalsh(combine(problem, y), subset_by_index=[problem.order - 1] * 2)[0]
    return _State(problem, y, -float(largest) - mu * problem.order, m, X, U, x)


def _dual_of_P(problem: Problem, values: ndarray) -> ndarray:
    """Return the symmetric W with <E_k, W> = values for every entry of P."""
    W = np.zeros((problem.symmetric, problem.symmetric))
    W[np.triu_indices(problem.symmetric)] = values / 2
    return W + np.triu(W, 1).T


def _blocks(problem: Problem) -> list[tuple[ndarray, ...]]:
    """Return the blocks of entries that rows of S, and products of two rows of S, hold together."""
    rows, width = problem.S.shape
    pattern = sparse.csr_array((np.ones(problem.S.nnz), problem.S.indices, problem.S.indptr), shape=(rows, width))
    inside = problem.q < rows
    pairs = sparse.coo_array((np.ones(inside.sum()), (problem.p[inside], problem.q[inside])), shape=(rows, rows))
    count, block = connected_components(pattern.T @ (sparse.eye_array(rows) + pairs) @ pattern)
    return [np.ix_(block == b, block == b) for b in range(count)]


def whitened(problem: Problem) -> tuple[Problem, Float[ndarray, "N N"]]:
    """Return the problem in coordinates z = C w in which its dual matrix, restricted to its blocks, is I; and C."""
    C = np.zeros((problem.order, problem.order))
    X = _inward(problem)
    for inside in _blocks(problem):
        C[inside] = np.linalg.cholesky(X[inside])
    S = sparse.csr_array(problem.S @ sparse.csr_array(C))
    return replace(problem, S=S, H=problem.H @ C, X=np.eye(problem.order)), C


def _inward(problem: Problem) -> ndarray:
    """Return X0, less a multiple of I where it was regularised so much that it left the sector cone."""
    free = problem.cost == 0
    free[: problem.free] = False
    price, change = (pairings(problem, M)[free] for M in (problem.X, np.eye(problem.order)))
    opposite = change < 0
    least = float((price[opposite] / change[opposite]).max(initial=-np.inf))
    if least < 0:
        return problem.X
    most = min(float(np.linalg.eigvalsh(problem.X)[0]), (price[~opposite] / change[~opposite]).min(initial=np.inf))
    return problem.X - 0.5 * (least + most) * np.eye(problem.order) if least < most else problem.X


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
    return 0.5 * (M + M.T)


def _inverse(M: ndarray) -> ndarray:
    factor = sla.cho_factor(M, lower=True)
    return _symmetric(sla.cho_solve(factor, np.eye(len(M))))


def _iterate(problem: Problem, state: _State) -> _State | None:
    """One predictor-corrector step; None when the linear algebra gives out, or no interior start was given."""
    if not (state.x > 0).all():
        return None
    try:
        Z_inverse, P_inverse = _inverse(state.Z), _inverse(state.P)
        direction = _newton(problem, state, Z_inverse, P_inverse)
        predicted = direction(0.0, None)
        a, b = _steps(state, predicted)
        gap = (
            np.vdot(state.X + a * predicted.X, state.Z + b * predicted.Z)
            + np.vdot(state.U + a * predicted.U, state.P + b * predicted.P)
            + (state.x + a * predicted.x) @ (state.s + b * predicted.y[problem.free :])
        )
        size = problem.order + problem.symmetric + len(state.x)
        sigma = min(1.0, max(float(gap) / size / state.mu, 1e-6) ** 2)
        corrected = direction(sigma * state.mu, predicted)
        a, b = _steps(state, corrected)
    except (sla.LinAlgError, ValueError):
        return None
    if max(a, b) < 1e-7:
        return None
    return _State(
        problem,
        state.y + b * corrected.y,
        state.t + b * corrected.t,
        state.m + a * corrected.m,
        state.X + a * corrected.X,
        state.U + a * corrected.U,
        state.x + a * corrected.x,
    )


def _newton(
    problem: Problem, state: _State, Z_inverse: ndarray, P_inverse: ndarray
) -> Callable[[float, _Direction | None], _Direction]:
    """Factor the Newton system once; return the direction for a target mu and an optional second-order correction."""
    free, c = problem.free, problem.cost
    ratio = state.x / state.s
    M = _schur(problem, _sandwich(problem, state.X), _sandwich(problem, Z_inverse))
    M[:free, :free] += _schur_of_P(problem, state.U, P_inverse)
    M[range(free, len(c)), range(free, len(c))] += ratio
    scale = 1 / np.sqrt(np.diag(M))
    M *= scale
    M *= scale[:, None]
    M[range(len(c)), range(len(c))] += RIDGE
    factor = sla.cho_factor(M, lower=True, overwrite_a=True, check_finite=False)

    def back(v: ndarray) -> ndarray:
        return scale * sla.cho_solve(factor, scale * v, check_finite=False)

    XZ = _symmetric(state.X @ Z_inverse)
    g = pairings(problem, XZ)
    Mg, Mc = back(g), back(c)
    border = np.array([[c @ Mg, c @ Mc], [np.trace(XZ) - g @ Mg, -(g @ Mc)]])
    defect = pairings(problem, state.X) + state.m * c  # rounding errors of the equalities, corrected as we go
    defect[:free] -= _pack(problem, state.U)
    defect[free:] -= state.x

    def direction(target: float, second: _Direction | None) -> _Direction:
        C, CU, cx = target * Z_inverse - state.X, target * P_inverse - state.U, target / state.s - state.x
        if second is not None:
            C = C - _symmetric(second.X @ second.Z @ Z_inverse)
            CU = CU - _symmetric(second.U @ second.P @ P_inverse)
            cx = cx - second.x * second.y[free:] / state.s
        r = -pairings(problem, C) - defect
        r[:free] += _pack(problem, CU)
        r[free:] += cx
        Mr = back(r)
        trace_defect = np.trace(state.X) - 1
        dt, dm = np.linalg.solve(border, [c @ Mr, -np.trace(C) - trace_defect - g @ Mr])
        dy = Mr - Mg * dt - Mc * dm
        F, dP = combine(problem, dy), unpack(problem, dy)
        dX = C + _symmetric(state.X @ F @ Z_inverse) + dt * XZ
        dU = CU - _symmetric(state.U @ dP @ P_inverse)
        dx = cx - ratio * dy[free:]
        return _Direction(dy, float(dt), float(dm), dX, dU, dx, -F - dt * np.eye(problem.order), dP)

    return direction


def _steps(state: _State, d: _Direction) -> tuple[float, float]:
    """Return the primal and the dual step length, a fixed share of the way to the boundary."""
    free = state.problem.free
    primal = min(1.0, SHARE * _ratio(state.x, d.x))
    dual = min(1.0, SHARE * _ratio(state.s, d.y[free:]))
    for M, dM in ((state.X, d.X), (state.U, d.U)):
        primal = _inside(M, dM, primal)
    for M, dM in ((state.Z, d.Z), (state.P, d.P)):
        dual = _inside(M, dM, dual)
    return primal, dual


def _inside(M: ndarray, dM: ndarray, a: float) -> float:
    """Return a step of at most a that keeps M + a dM positive definite, and tests that it does."""
    a = min(a, SHARE * _to_boundary(M, dM))
    for _ in range(20):
        if sla.lapack.dpotrf(M + a * dM, lower=1, clean=0)[1] == 0:
            return a
        a *= 0.7
    return 0.0


def _ratio(v: ndarray, dv: ndarray) -> float:
    falling = dv < 0
    return float((-v[falling] / dv[falling]).min()) if falling.any() else np.inf


def _to_boundary(M: ndarray, dM: ndarray) -> float:
    """Return the largest a with M + a dM >= 0, to a few percent, by Lanczos on L^-1 dM L^-T (M = L L')."""
    if not len(M):
        return np.inf
    inverse = sla.lapack.dtrtri(np.linalg.cholesky(M), lower=1)[0]  # trtrs would start threads at every size
    smallest = np.linalg.eigvalsh(inverse @ dM @ inverse.T)[0] if len(M) <= 64 else _lanczos_smallest(inverse, dM)
    return -1 / float(smallest) if smallest < 0 else np.inf


def _lanczos_smallest(inverse: ndarray, dM: ndarray, steps: int = 30) -> float:
    """Return a lower estimate of the smallest eigenvalue: the Ritz value less its residual (Toh 2002)."""
    v = np.random.default_rng(0).normal(size=len(dM))
    basis, alphas, betas = [v / np.linalg.norm(v)], [], []
    for step in range(steps):
        w = inverse @ (dM @ (inverse.T @ basis[-1]))
        alphas.append(float(w @ basis[-1]))
        Q = np.array(basis)
        w -= Q.T @ (Q @ w)
        w -= Q.T @ (Q @ w)
        betas.append(float(np.linalg.norm(w)))
        if step >= 5 or betas[-1] < 1e-12:
            values, vectors = sla.eigh_tridiagonal(alphas, betas[:-1])
            residual = betas[-1] * abs(vectors[-1, 0])
            if residual <= 0.02 * abs(values[0]) + 1e-9:
                return float(values[0] - residual)
        basis.append(w / betas[-1])
    return float(values[0] - residual)
