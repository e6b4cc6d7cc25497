"""One iterate of the interior-point method, how it begins, goes on with new unknowns, and takes a step.

The symbols are those of `interior_point`, in coordinates in which X0 = I.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from types import ModuleType

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float, Int
from numpy import ndarray

from persid.lyapunov.arrays import Array, Arrays
from persid.lyapunov.pairs import Problem, combine, lengths, pairings, schur

SHARE = 0.95  # of the way to the boundary that a step goes
SHORT = 1e-7  # a longer one at least, in X or in y, else the method has come to its end
LEAST = 1e-6  # share to which a predicted step may lower mu: with its square the step aims at a centre
CLOSELY, ROUGHLY = 0.02, 0.2  # relative errors of the way to the boundary, in a step and in its prediction
LANCZOS_ORDER = 64  # from which the way to the boundary comes from Lanczos' method
NOTHING_NEW, TINY = 1e-12, 1e-300  # lengths of new vectors there: what follows is rounding, and what divides by zero
ROUNDING = 1e-14  # of its size: a price that is negative by less counts as zero
RIDGE = 1e-13  # added to the unit diagonal of the Schur complement; the next step corrects what it changes
JOINING_SHARE = 0.5  # of the way to the boundary that unknowns go which join; also x_k over its size for a bad price


@dataclass(frozen=True, eq=False)
class Iterate:
    """Primal X, U, x, m and dual y, t, with Z and P(y), in coordinates in which X0 = I."""

    problem: Problem
    y: Float[Array, " J"]
    t: float
    m: float
    X: Float[Array, "N N"]
    U: Float[Array, "k k"]
    x: Float[Array, " s"]
    Z: Float[Array, "N N"] = field(init=False)
    P: Float[Array, "k k"] = field(init=False)

    def __post_init__(self) -> None:
        problem = self.problem
        object.__setattr__(self, "Z", _less(problem, -combine(problem, self.y), self.t))
        object.__setattr__(self, "P", problem.triangle.matrix(self.y[: problem.free]))

    @property
    def s(self) -> Float[Array, " s"]:
        """The unknowns that must be positive: all but the entries of P."""
        return self.y[self.problem.free :]

    @cached_property
    def gap(self) -> float:
        """Total complementarity: m - t where the equalities are met."""
        inner = self.problem.arrays.inner
        return inner(self.X, self.Z) + inner(self.U, self.P) + inner(self.x, self.s)

    @property
    def mu(self) -> float:
        """Mean complementarity."""
        return self.gap / self.size

    @property
    def size(self) -> int:
        """Order of all that is complementary."""
        return self.problem.order + self.problem.symmetric + int(self.x.shape[0])

    @cached_property
    def halves(self) -> tuple[Array, Array, Array, Array]:
        """Inverse Cholesky factors of X, U, Z and P(y): L^-1 with M = L L'."""
        of = self.problem.arrays
        return _half(of, self.X), _half(of, self.U), _half(of, self.Z), _half(of, self.P)

    @property
    def is_interior(self) -> bool:
        """Whether y and t satisfy their inequalities strictly."""
        xp = self.problem.arrays.xp
        return _all(xp, self.s > 0) and self._is_positive(self.Z) and self._is_positive(self.P)

    @cached_property
    def defect(self) -> Float[Array, " J"]:
        """What the equalities of (P) lack."""
        free, lack = self.problem.free, self._price
        lack[:free] -= self.problem.triangle.pairings(self.U)
        lack[free:] -= self.x
        return lack

    @property
    def is_dual_feasible(self) -> bool:
        """Whether X proves the bound m: with it the equalities of (P) have solutions x >= 0 and U >= 0."""
        xp, free, price = self.problem.arrays.xp, self.problem.free, self._price
        least = -ROUNDING * lengths(self.problem, self.X)[free:]
        return _all(xp, price[free:] >= least) and self._is_positive(self.problem.triangle.dual(price[:free]))

    @property
    def _price(self) -> Array:
        return pairings(self.problem, self.X) + self.m * self.problem.costs

    def _is_positive(self, M: Array) -> bool:
        return not M.shape[0] or self.problem.arrays.is_positive(M)


def first_iterate(problem: Problem, least: float = 0.0) -> Iterate:
    """Strictly feasible, nearly central, m > least: X = I / order; U, x, m to match; y = mu / x, P = mu U^-1."""
    of, free, k, c = problem.arrays, problem.free, problem.symmetric, problem.costs[problem.free :]
    xp = of.xp
    X = of.identity(problem.order) / problem.order
    paired = pairings(problem, X)
    W = problem.triangle.dual(paired[:free])  # U = W + m I solves <F_k, X> - <E_k, U> + m c_k = 0
    lacking = xp.where(c > 0, -paired[free:] / xp.where(c > 0, c, 1.0), 0.0)
    m = 1.5 * max(least, _largest(xp, lacking), -of.smallest(W) if k else 0.0) + 1e-3 / problem.order
    U, x = of.add_to_diagonal(W, m), paired[free:] + m * c
    x = xp.where(x > 0, x, 1e-3 * lengths(problem, X)[free:])  # where X0 is not interior the equality comes later
    P = _inverse(_half(of, U))
    mu = 1 / float(xp.linalg.trace(P) + xp.sum(c / x))
    y = mu * xp.concat([problem.triangle.entries(P), 1 / x])
    smallest = _smallest(of, -combine(problem, y), CLOSELY)
    return Iterate(problem=problem, y=y, t=smallest - mu * problem.order, m=m, X=X, U=U, x=x)


def central_iterate(problem: Problem, y: Float[Array, " J"], t: float) -> Iterate:
    """Central at a strictly feasible y, c'y = 1, and t: X = mu Z^-1 with <N, X> = 1; its equalities come in the steps.

    LinAlgError where y and t are not strictly feasible.
    """
    free, c = problem.free, problem.costs
    V, P = _inverse(_half(problem.arrays, _less(problem, -combine(problem, y), t))), problem.triangle.matrix(y[:free])
    mu = 1 / _measure(problem, V)
    X, x = mu * V, mu / y[free:]
    inner = problem.arrays.inner
    m = inner(c[free:], x - pairings(problem, X)[free:]) / inner(c, c)
    return Iterate(problem=problem, y=y, t=t, m=m, X=X, U=mu * _inverse(_half(problem.arrays, P)), x=x)


def resumed(problem: Problem, old: Iterate, places: Int[ndarray, " J"]) -> Iterate:
    """Return the iterate with new unknowns: x_k is their price, or of the size of F_k where that is negative.

    y_k = b mu / x_k, where b keeps Z > 0.
    """
    of, free = problem.arrays, problem.free
    xp, known, at = of.xp, of.put(places >= 0), of.put(np.maximum(places, 0))
    price = pairings(problem, old.X) + old.m * problem.costs
    new_x = xp.where(price > 0, price, JOINING_SHARE * lengths(problem, old.X))
    joining = xp.where(known, xp.zeros_like(new_x), old.mu / new_x)
    b = min(1.0, JOINING_SHARE * _to_boundary(of, old.halves[2], -combine(problem, joining)))
    y = xp.where(known, xp.take(old.y, at), b * joining)
    before = of.put(np.maximum(places[free:] - free, 0))
    x = xp.where(known[free:], xp.take(old.x, before), new_x[free:])
    total = of.inner(problem.costs, y)
    return Iterate(problem=problem, y=y / total, t=old.t / total, m=old.m, X=old.X, U=old.U, x=x)


@dataclass(frozen=True, eq=False)
class _Direction:
    y: Array
    t: float
    m: float
    X: Array
    U: Array
    x: Array
    Z: Array
    P: Array
    turned: Array  # Z Z^-1 at the iterate, of which both X and the correction of the next direction are made


def _less(problem: Problem, M: Array, t: float) -> Array:
    """Return M - t N; M may be overwritten."""
    return problem.arrays.add_to_diagonal(M, -t) if problem.along is None else M - t * problem.along


def _measure(problem: Problem, M: Array) -> float:
    """Return <N, M>."""
    xp = problem.arrays.xp
    return float(xp.linalg.trace(M)) if problem.along is None else problem.arrays.inner(problem.along, M)


def _largest(xp: ModuleType, v: Array) -> float:
    """Return the largest entry, or 0 where none is positive."""
    return max(float(xp.max(v)), 0.0) if v.shape[0] else 0.0


def _all(xp: ModuleType, conditions: Array) -> bool:
    return bool(xp.all(conditions))


def _symmetric(M: Array) -> Array:
    return 0.5 * (M + M.T)


def _half(of: Arrays, M: Array) -> Array:
    """Return L^-1, M = L L'; LinAlgError where M is not positive definite."""
    return of.half(M) if M.shape[0] else M


def _inverse(half: Array) -> Array:
    return half.T @ half


@dataclass(frozen=True, eq=False)
class Step:
    """The next iterate, the share of the way that a limit left to it, and the dual (X, m) at the end of the way."""

    state: Iterate
    share: float
    end: tuple[Float[Array, "N N"], float]


def step(state: Iterate, limit: Callable[[Array, float], float] | None = None) -> Step | None:
    """One predictor-corrector step; None when the linear algebra gives out.

    `limit` says which share of the step of the dual matrix to X and m may be taken.
    """
    inner, free = state.problem.arrays.inner, state.problem.free
    try:
        direction = _newton(state)
        predicted = direction(0.0, None)
        a, b = _steps(state, predicted, rough=True)
        gap = (
            inner(state.X + a * predicted.X, state.Z + b * predicted.Z)
            + inner(state.U + a * predicted.U, state.P + b * predicted.P)
            + inner(state.x + a * predicted.x, state.s + b * predicted.y[free:])
        )
        sigma = min(1.0, max(gap / state.size / state.mu, LEAST) ** 2)
        corrected = direction(sigma * state.mu, predicted)
        a, b = _steps(state, corrected)
    except sla.LinAlgError:
        return None
    if max(a, b) < SHORT:
        return None
    end = state.X + a * corrected.X, state.m + a * corrected.m
    share = 1.0 if limit is None else limit(*end)
    a *= share
    following = Iterate(
        problem=state.problem,
        y=state.y + b * corrected.y,
        t=state.t + b * corrected.t,
        m=state.m + a * corrected.m,
        X=state.X + a * corrected.X,
        U=state.U + a * corrected.U,
        x=state.x + a * corrected.x,
    )
    return Step(following, share, end)


def _factored(of: Arrays, M: Array) -> Callable[[Array], Array]:
    """Return v -> M^-1 v; only the lower triangle of M is read, and overwritten."""
    xp, size = of.xp, M.shape[0]
    scale = 1 / xp.sqrt(xp.linalg.diagonal(M))
    for start in range(0, size, of.block):
        stop = min(start + of.block, size)
        rows = slice(start, stop)
        M[rows, :stop] *= scale[rows, None] * scale[None, :stop]
    solve = of.solver(of.add_to_diagonal(M, RIDGE))
    return lambda v: scale[:, None] * solve(scale[:, None] * v)


def _newton(state: Iterate) -> Callable[[float, _Direction | None], _Direction]:
    """Factor the Newton system once; return the direction for a target mu and an optional second-order correction."""
    problem, free, c, of = state.problem, state.problem.free, state.problem.costs, state.problem.arrays
    xp, ratio = of.xp, state.x / state.s
    Z_inverse, P_inverse = _inverse(state.halves[2]), _inverse(state.halves[3])
    M = schur(problem, state.X, Z_inverse)
    M[:free, :free] += problem.triangle.schur(state.U, P_inverse)
    M = of.add_to_diagonal(M, xp.concat([xp.zeros_like(c[:free]), ratio]))
    back = _factored(of, M)
    XZ = _symmetric((state.X if problem.along is None else state.X @ problem.along) @ Z_inverse)
    g = pairings(problem, XZ)
    solved = back(xp.stack([g, c], axis=1))
    Mg, Mc = solved[:, 0], solved[:, 1]
    trace = _measure(problem, XZ)
    border = np.array([[of.inner(c, Mg), of.inner(c, Mc)], [trace - of.inner(g, Mg), -of.inner(g, Mc)]])
    trace_defect = _measure(problem, state.X) - 1

    def direction(target: float, second: _Direction | None) -> _Direction:
        C, CU, cx = target * Z_inverse - state.X, target * P_inverse - state.U, target / state.s - state.x
        if second is not None:
            C = C - _symmetric(second.X @ second.turned)
            CU = CU - _symmetric(second.U @ second.P @ P_inverse)
            cx = cx - second.x * second.y[free:] / state.s
        r = -pairings(problem, C) - state.defect
        r[:free] += problem.triangle.pairings(CU)
        r[free:] += cx
        Mr = back(r[:, None])[:, 0]
        dt, dm = np.linalg.solve(border, [of.inner(c, Mr), -_measure(problem, C) - trace_defect - of.inner(g, Mr)])
        dt, dm = float(dt), float(dm)
        dy = Mr - Mg * dt - Mc * dm
        dZ, dP = _less(problem, -combine(problem, dy), dt), problem.triangle.matrix(dy[:free])
        turned = dZ @ Z_inverse
        dX = C - _symmetric(state.X @ turned)
        dU = CU - _symmetric(state.U @ dP @ P_inverse)
        dx = cx - ratio * dy[free:]
        return _Direction(y=dy, t=dt, m=dm, X=dX, U=dU, x=dx, Z=dZ, P=dP, turned=turned)

    return direction


def _steps(state: Iterate, d: _Direction, rough: bool = False) -> tuple[float, float]:
    """Return the primal and the dual step length, a fixed share of the way to the boundary; `rough`: untested."""
    X, U, Z, P = state.halves
    of = state.problem.arrays
    primal = min(1.0, SHARE * _ratio(of, state.x, d.x))
    dual = min(1.0, SHARE * _ratio(of, state.s, d.y[state.problem.free :]))
    for M, half, dM in ((state.X, X, d.X), (state.U, U, d.U)):
        primal = _inside(of, M, half, dM, primal, rough)
    for M, half, dM in ((state.Z, Z, d.Z), (state.P, P, d.P)):
        dual = _inside(of, M, half, dM, dual, rough)
    return primal, dual


def _inside(of: Arrays, M: Array, half: Array, dM: Array, a: float, rough: bool) -> float:
    """Return a step of at most a that keeps M + a dM positive definite, and tests that it does unless it is rough."""
    a = min(a, SHARE * _to_boundary(of, half, dM, ROUGHLY if rough else CLOSELY))
    if rough or not M.shape[0]:
        return a
    for _ in range(20):
        if of.is_positive(M + a * dM):
            return a
        a *= 0.7
    return 0.0


def _ratio(of: Arrays, v: Array, dv: Array) -> float:
    """Return the largest a with v + a dv >= 0, v > 0."""
    fastest = _largest(of.xp, -dv / v)
    return 1 / fastest if fastest else np.inf


def _to_boundary(of: Arrays, half: Array, dM: Array, tolerance: float = CLOSELY) -> float:
    """Return the largest a with M + a dM >= 0, to a tolerance: from L^-1 dM L^-T, half = L^-1, M = L L'."""
    if not half.shape[0]:
        return np.inf
    smallest = _smallest(of, dM, tolerance, half)
    return -1 / smallest if smallest < 0 else np.inf


def _smallest(of: Arrays, M: Array, tolerance: float, half: Array | None = None) -> float:
    """Return the smallest eigenvalue of M, or of L^-1 M L^-T, and for a large M a lower estimate of it."""
    if M.shape[0] <= LANCZOS_ORDER:
        return of.smallest(M if half is None else half @ M @ half.T)
    product = (lambda v: M @ v) if half is None else (lambda v: half @ (M @ (half.T @ v)))
    return _lanczos_smallest(of, product, M.shape[0], tolerance)


def _lanczos_smallest(
    of: Arrays, product: Callable[[Array], Array], order: int, tolerance: float, steps: int = 30
) -> float:
    """Return a lower estimate of the smallest eigenvalue: the Ritz value less its residual (Toh 2002).

    The tridiagonal matrix, T[0] beside T[1], stays where the arrays live and is looked at in every third step.
    """
    T, Q = of.empty(2, steps), of.empty(steps + 1, order)
    Q[0, :] = of.put(_start(order))
    for k in range(steps):
        known, w = Q[: k + 1, :], product(Q[k, :])
        overlaps = known @ w
        w = w - known.T @ overlaps
        w = w - known.T @ (known @ w)
        norm = of.xp.linalg.vector_norm(w)
        T[0, k], T[1, k] = overlaps[k], norm
        if k % 3 == 2 or k == steps - 1:
            value, residual = _ritz(*of.get(T[:, : k + 1]))
            if residual <= tolerance * abs(value) + 1e-9:
                break
        Q[k + 1, :] = w / (norm + TINY)
    return value - residual


@lru_cache(maxsize=64)
def _start(order: int) -> Float[ndarray, " N"]:
    v = np.random.default_rng(0).normal(size=order)
    return np.asarray(v / np.linalg.norm(v))


def _ritz(alphas: Float[ndarray, " k"], betas: Float[ndarray, " k"]) -> tuple[float, float]:
    """Return the smallest Ritz value and its residual, from as many steps as led to something new."""
    ended = np.flatnonzero(betas < NOTHING_NEW)
    size = int(ended[0]) + 1 if len(ended) else len(betas)
    values, vectors, _ = sla.lapack.dstev(alphas[:size], betas[: max(size - 1, 1)])
    return float(values[0]), float(betas[size - 1] * abs(vectors[-1, 0]))
