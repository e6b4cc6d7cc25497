r"""Least squares under a matrix inequality that is bilinear in the model and its Lyapunov function: a barrier method.

    minimise  f(w) = 1/2 (w - w0)'M (w - w0)   subject to   Z(w, y) >= 0,   P(y) >= 0,   y_k >= 0,   c'y = 1

w are the coefficients of the flow F = [G, B] (affine in w), y the numbers of the Lyapunov function and the multipliers,

    Z = -(E F + F'E') - kappa W - S - delta I,      E = E(y) half the gradient of V,  S = S(y) the products of forms.

Every unknown enters the derivative of Z through pairs of rows of one matrix D = [S; rho F; E'], those of the model
too: the coefficient at place (i, c) of F has the pair (e_c, E'_i). So with V = D Z^-1 D' the Hessian of -log det Z is
made of elementwise products of blocks of V, as in `interior_point`, and what the bilinearity adds is one block of V:

    d2(E F + F'E') = rho_i (l e_c' + e_c l')   for a number of V with the pair (l, rho F) and the coefficient (i, c).

Each Newton step takes that block whole where the Hessian stays positive definite, else the part of it that does, and
bends: along d = (dw, dy) Z also changes by -(dE dF + dF'dE'), and the step follows the arc a d + a^2 s on which s makes
up for that to first order. Without it, iterates creep along the valleys where E grows as F shrinks. Points that do not
yet satisfy the inequality get a slack, whose price rises until it is gone (an exact penalty).
References: Nesterov & Nemirovskii (1994), ch. 2; Fares, Noll & Apkarian (2002), SIAM J. Control Optim. 40(6);
Transtrum & Sethna (2012), arXiv:1201.5885 (the second-order correction).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse

BLOCK = 64  # rows of the Hessian made at once: what they gather from stays in the cache
SHRINK = 0.2  # of the barrier's weight from one centre to the next
NEAR = 1.0  # Newton decrement, in units of the barrier's weight, at which a centre is near enough
PATIENCE = 12  # steps towards one centre before the next is aimed at all the same
LAST_PATIENCE = 80  # steps towards the last centre
SHARES = (1.0, 0.5, 0.0)  # of the bilinear block that are tried in the Hessian
SHORT = 0.3  # length of a joint step below which model and Lyapunov function also move one at a time
SHORTEST = 1e-8  # a step length below which a search along the Newton direction gives up
HOLD = 1.0  # weight of |F|^2 / 2 in the barrier: models whose coefficients the data do not hold stay near the others
SEEK = 10.0  # weight of the slack, in units of the fit's, when a feasible point is first sought
LEAST_PULL = 1e-12  # weight of the fit at which seeking gives up


class Stop(Enum):
    """Why a descent stopped, as a full sentence."""

    OPTIMAL = "The fit is as good as the certificate allows near this start."
    STALLED = "Steps became too short; the best point so far is kept."
    INFEASIBLE = "No point that satisfies the matrix inequality was found from this start."
    STEPS = "The number of steps was used up; the best point so far is kept."
    TIME = "The time limit was reached; the best point so far is kept."


@dataclass(frozen=True, eq=False)
class Pairs:
    """Terms p q' + q p' of Z's derivative: rows of D by number, the unknown each belongs to, and its weight in it."""

    p: Int[ndarray, " K"]
    q: Int[ndarray, " K"]
    owner: Int[ndarray, " K"]
    weight: Float[ndarray, " K"]


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
        return self.S.shape[1] + self.symmetric + len(self.cost) - self.free

    def flows(self, w: Float[ndarray, " K"]) -> Float[ndarray, "n W"]:
        """Return F."""
        F = self.base.copy()
        np.add.at(F, (self.flow.q, self.flow.p), self.flow.weight * w[self.flow.owner])
        return F

    def slopes(self, y: Float[ndarray, " J"]) -> Float[ndarray, "W n"]:
        """Return E."""
        g = self.gradient
        return self.S[g.p].T @ ((g.weight * y[g.owner])[:, None] * self.rho[g.q])

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
        return -(half + half.T) - self.delta * np.eye(self.S.shape[1])

    def P(self, y: Float[ndarray, " J"]) -> Float[ndarray, "k k"]:
        """Return the full matrix P(y), of order 0 where P is diagonal."""
        P = np.zeros((self.symmetric, self.symmetric))
        P[np.triu_indices(self.symmetric)] = y[: self.free]
        return P + P.T


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


@dataclass(frozen=True, eq=False)
class Descent:
    """How a descent ended: the last strictly feasible point (None: there was none), its fit, a log line per centre."""

    stop: Stop
    point: Point | None
    fit: float
    steps: int
    log: tuple[str, ...]


def descend(
    inequality: Inequality,
    fit: Fit,
    start: Point,
    *,
    tolerance: float = 1e-3,
    time_limit: float = np.inf,
    steps: int = 200,
) -> Descent:
    """Follow the centres of f + beta barrier from a start down to the fit's best value, to within `tolerance`.

    A start with slack is first led into the feasible region, near where f is small.
    """
    started, log = time.perf_counter(), []
    state = _State.at(inequality, start)
    if state is None:
        return Descent(Stop.INFEASIBLE, None, np.inf, 0, ())
    last = tolerance / inequality.barriers
    seeking, aim = start.slack > 0, _first_aim(inequality, fit, start, last)
    count, aimed, stop = 0, 0, Stop.OPTIMAL
    while True:
        moved = _step(inequality, fit, state, aim, seeking)
        count += 1
        if moved is not None:
            state, decrement, length = moved
        near = moved is None or decrement < NEAR
        if not near and length < SHORT:
            state, count = _by_blocks(inequality, fit, state, aim, seeking), count + 2
        if seeking and state.point.slack <= 0:
            log.append(f"{count:3d}  feasible, fit {fit(state.point.w):.4g}")
            state = _State.at(inequality, Point(state.point.w, state.point.y)) or state
            seeking, aim, aimed = False, _first_aim(inequality, fit, state.point, last), count
        elif time.perf_counter() - started > time_limit or count >= steps:
            stop = Stop.STEPS if count >= steps else Stop.TIME
            break
        elif not seeking and aim.beta <= last and not near and count - aimed >= LAST_PATIENCE:
            stop = Stop.STALLED
            break
        elif near or (aim.beta > last and count - aimed >= PATIENCE):
            log.append(f"{count:3d}  beta {aim.beta:.1e}  fit {fit(state.point.w):.6g}  slack {state.point.slack:.1e}")
            if near and aim.beta <= last and (not seeking or aim.pull < LEAST_PULL):
                stop = Stop.STALLED if moved is None else Stop.OPTIMAL
                break
            floor = last * 1e-3 if seeking else last
            aim = Aim(max(aim.beta * SHRINK, floor), aim.pull * SHRINK if seeking else 1.0)
            aimed = count
    if seeking:
        return Descent(Stop.TIME if stop is Stop.TIME else Stop.INFEASIBLE, None, np.inf, count, tuple(log))
    return Descent(stop, state.point, fit(state.point.w), count, tuple(log))


@dataclass(frozen=True)
class Aim:
    """What the next centre minimises: pull f + beta barrier, and the slack where there is one."""

    beta: float
    pull: float


def _first_aim(inequality: Inequality, fit: Fit, start: Point, last: float) -> Aim:
    """Balance the terms at a start; while the slack is positive it counts SEEK times as much as the fit."""
    value = fit(start.w)
    if start.slack > 0:
        return Aim(start.slack / inequality.barriers, start.slack / (SEEK * max(value, 1.0)))
    return Aim(max(value / inequality.barriers, last), 1.0)


@dataclass(frozen=True, eq=False)
class _State:
    """A point with what its barrier needs: D, the Cholesky factor of Z + slack I, and P."""

    point: Point
    F: ndarray
    D: ndarray
    L: ndarray
    P: ndarray
    barrier: float

    @classmethod
    def at(cls, inequality: Inequality, point: Point) -> "_State | None":
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


def _by_blocks(inequality: Inequality, fit: Fit, state: "_State", aim: Aim, seeking: bool) -> "_State":
    """Move the model with V held, then V with the model held: each a convex problem, whatever the joint one is."""
    K = inequality.coefficients
    numbers = K + np.unique(inequality.gradient.owner)
    for frozen in (numbers, np.arange(K)):
        moved = _step(inequality, fit, state, aim, seeking, frozen)
        state = state if moved is None else moved[0]
    return state


def _step(
    inequality: Inequality, fit: Fit, state: "_State", aim: Aim, seeking: bool, frozen: ndarray | None = None
) -> "tuple[_State, float, float] | None":
    """Take one damped Newton step for pull f + beta barrier (+ slack): state, decrement over beta, length."""
    K, point, beta, pull = inequality.coefficients, state.point, aim.beta, aim.pull
    g, Gauss, bilinear = _derivatives(inequality, state)
    g *= beta
    g[:K] += pull * (fit.M @ (point.w - fit.w0))
    H = beta * Gauss
    H[:K, :K] += pull * fit.M
    c = np.concatenate([np.zeros(K), inequality.cost])
    if seeking:
        g, H, c = _with_slack(inequality, state, g, H, c, beta)
    if frozen is not None:
        g[frozen], c[frozen], H[frozen], H[:, frozen] = 0.0, 0.0, 0.0, 0.0
        H[frozen, frozen] = 1.0
    solver = None
    for share in SHARES if frozen is None else (0.0,):
        solver = _factor(H, beta * share * bilinear, K)
        if solver is not None:
            break
    if solver is None:
        return None
    d = _keeping(solver, g, c)
    slope = float(g @ d)
    if not slope < 0:
        return None
    second = np.zeros(len(d))
    if frozen is None:
        second = _keeping(solver, _bend(inequality, state, d, beta, seeking), c)
    found = _search(inequality, fit, state, d, second, slope, beta, pull, seeking)
    return None if found is None else (found[0], -slope / beta, found[1])


def _factor(H: ndarray, bilinear: ndarray, K: int) -> Callable[[ndarray], ndarray] | None:
    """Return the solution operator of the Hessian, or None where it is not positive definite."""
    A = H.copy()
    J = bilinear.shape[1]
    A[:K, K : K + J] += bilinear
    A[K : K + J, :K] += bilinear.T
    scale = 1 / np.sqrt(np.diag(A))
    A *= scale
    A *= scale[:, None]
    A[np.diag_indices_from(A)] += 1e-13
    L, failed = sla.lapack.dpotrf(A, lower=1, overwrite_a=1, clean=0)
    if failed:
        return None
    return lambda v: scale * sla.lapack.dpotrs(L, scale * v, lower=1)[0]


def _keeping(solver: Callable[[ndarray], ndarray], g: ndarray, c: ndarray) -> ndarray:
    """Return the minimiser d of g'd + d'H d / 2 with c'd = 0."""
    a = solver(g)
    if not c.any():
        return -a
    b = solver(c)
    return -a + b * (c @ a) / (c @ b)


def _bend(inequality: Inequality, state: _State, d: ndarray, beta: float, seeking: bool) -> ndarray:
    """Return the gradient that the second-order change of Z along d, -(dE dF + dF'dE'), adds at a unit step."""
    K, J = inequality.coefficients, len(inequality.cost)
    half = inequality.slopes(d[K : K + J]) @ (inequality.flows(d[:K]) - inequality.base)
    inverse = _inverse(state.L)
    middle = inverse @ (half + half.T) @ inverse
    bend = beta * _pairings(inequality, state.D @ middle @ state.D.T)
    return np.append(bend, -beta * np.trace(middle)) if seeking else bend


def _search(
    inequality: Inequality,
    fit: Fit,
    state: _State,
    d: ndarray,
    second: ndarray,
    slope: float,
    beta: float,
    pull: float,
    seeking: bool,
) -> tuple[_State, float] | None:
    """Return the first point on the arc a d + a^2 second that is strictly inside and descends (Armijo), and a."""
    K, J, point = inequality.coefficients, len(inequality.cost), state.point
    falling = d[K : K + J] < 0
    falling[: inequality.free] = False
    a = min(1.0, 0.95 * float((-point.y[falling] / d[K : K + J][falling]).min(initial=np.inf)))
    here = pull * fit(point.w) + beta * state.barrier + point.slack * seeking
    while a > SHORTEST:
        arc = a * d + a**2 * second
        moved = Point(point.w + arc[:K], point.y + arc[K : K + J], point.slack + (float(arc[-1]) if seeking else 0.0))
        following = _State.at(inequality, moved)
        if following is not None:
            value = pull * fit(moved.w) + beta * following.barrier + moved.slack * seeking
            if value <= here + 0.1 * a * slope + 1e-12 * abs(here):
                return following, a
        a *= 0.6
    return None


def _with_slack(
    inequality: Inequality, state: _State, g: ndarray, H: ndarray, c: ndarray, beta: float
) -> tuple[ndarray, ndarray, ndarray]:
    """Border gradient and Hessian by the slack s: Z + s I, objective s."""
    inverse = _inverse(state.L)
    border = -beta * _pairings(inequality, state.D @ inverse @ inverse @ state.D.T)
    corner = beta * float((inverse**2).sum())
    H = np.block([[H, border[:, None]], [border[None], np.array([[corner]])]])
    return np.append(g, 1.0 - beta * np.trace(inverse)), H, np.append(c, 0.0)


def _inverse(L: ndarray) -> ndarray:
    half = sla.solve_triangular(L, np.eye(len(L)), lower=True, check_finite=False)
    return half.T @ half


def _all_pairs(inequality: Inequality) -> Pairs:
    """Return the pairs of all unknowns u = (w, y), as rows of D."""
    s, h, K = len(inequality.S), len(inequality.rho), inequality.coefficients
    flow, gradient, product = inequality.flow, inequality.gradient, inequality.product
    return Pairs(
        np.concatenate([flow.p, gradient.p, product.p]),
        np.concatenate([s + h + flow.q, s + gradient.q, product.q]),
        np.concatenate([flow.owner, K + gradient.owner, K + product.owner]),
        np.concatenate([flow.weight, gradient.weight, product.weight]),
    )


def _tie(inequality: Inequality, pairs: Pairs) -> sparse.csr_array:
    shape = (len(pairs.p), inequality.coefficients + len(inequality.cost))
    return sparse.csr_array((pairs.weight, (np.arange(len(pairs.p)), pairs.owner)), shape=shape)


def _pairings(inequality: Inequality, V: ndarray) -> ndarray:
    """Return the sum of 2 V[p, q] over the pairs of every unknown."""
    pairs = _all_pairs(inequality)
    found = np.zeros(inequality.coefficients + len(inequality.cost))
    np.add.at(found, pairs.owner, 2 * pairs.weight * V[pairs.p, pairs.q])
    return found


def _derivatives(inequality: Inequality, state: _State) -> tuple[ndarray, ndarray, ndarray]:
    """Return the barrier's gradient, its Hessian without the bilinear block, and that block (coefficients x y)."""
    half = sla.solve_triangular(state.L, state.D.T, lower=True, check_finite=False)
    V = half.T @ half
    pairs, K, free = _all_pairs(inequality), inequality.coefficients, inequality.free
    tie = _tie(inequality, pairs)
    g = _pairings(inequality, V)
    M = _products(V, pairs)
    H = np.asarray(tie.T @ np.ascontiguousarray((tie.T @ M).T))
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
        i, j = np.triu_indices(inequality.symmetric)
        g[K : K + free] -= 2 * inverse[i, j]
        H[K : K + free, K : K + free] += 2 * (
            inverse[np.ix_(i, i)] * inverse[np.ix_(j, j)] + inverse[np.ix_(i, j)] * inverse[np.ix_(j, i)]
        )
    return g, H, _bilinear(inequality, V, tie)


def _products(V: ndarray, pairs: Pairs) -> ndarray:
    """Return tr(F_k Z^-1 F_l Z^-1) of all pairs."""
    p, q = pairs.p, pairs.q
    M = np.empty((len(p), len(p)))
    for start in range(0, len(p), BLOCK):
        rows = slice(start, start + BLOCK)
        Vp, Vq = V[p[rows]], V[q[rows]]
        block = Vq.take(p, 1) * Vp.take(q, 1)
        block += Vq.take(q, 1) * Vp.take(p, 1)
        M[rows] = 2 * block
    return M


def _bilinear(inequality: Inequality, V: ndarray, tie: sparse.csr_array) -> ndarray:
    """Return tr(Z^-1 d2Q) of every coefficient with every number of V."""
    flow, gradient, K = inequality.flow, inequality.gradient, inequality.coefficients
    block = 2 * inequality.rho[gradient.q][:, flow.q].T * V[np.ix_(flow.p, gradient.p)]
    f, e = len(flow.p), len(gradient.p)
    left, right = tie[:f, :K], tie[f : f + e, K:]
    return np.asarray(left.T @ np.ascontiguousarray((right.T @ block.T).T))
