"""Descent: the best fit under a bilinear matrix inequality, by Newton's method on the centres of its barrier.

Each Newton step takes the bilinear block of the Hessian whole where it stays positive definite, else the part of it
that does, and bends: along d = (dw, dy) Z also changes by -(dE dF + dF'dE'), and the step follows the arc
a d + a^2 s on which s makes up for that to first order. Without it, iterates creep along the valleys where E grows as F
shrinks.

Points that do not yet satisfy the inequality get a slack, whose price rises until it is gone (an exact penalty).
References: Fares, Noll & Apkarian (2002), SIAM J. Control Optim. 40(6); Transtrum & Sethna (2012), arXiv:1201.5885 (the
second-order correction).
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

import numpy as np
import scipy.linalg as sla
from numpy import ndarray

from persid.certified_fits.barrier import State, derivatives, pairings, with_slack
from persid.certified_fits.bilinear import Fit, Inequality, Point

SHRINK = 0.2  # of the barrier's weight from one centre to the next
NEAR = 1.0  # Newton decrement, in units of the barrier's weight, at which a centre is near enough
PATIENCE = 12  # steps towards one centre before the next is aimed at all the same
LAST_PATIENCE = 80  # steps towards the last centre
SHARES = (1.0, 0.5, 0.0)  # of the bilinear block that are tried in the Hessian
SHORT = 0.3  # length of a joint step below which model and Lyapunov function also move one at a time
SHORTEST = 1e-8  # a step length below which a search along the Newton direction gives up
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
    state = State.at(inequality, start)
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
            state = State.at(inequality, Point(state.point.w, state.point.y)) or state
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


def _by_blocks(inequality: Inequality, fit: Fit, state: State, aim: Aim, seeking: bool) -> State:
    """Move the model with V held, then V with the model held: each a convex problem, whatever the joint one is."""
    K = inequality.coefficients
    numbers = K + np.unique(inequality.gradient.owner)
    for frozen in (numbers, np.arange(K)):
        moved = _step(inequality, fit, state, aim, seeking, frozen)
        state = state if moved is None else moved[0]
    return state


def _step(
    inequality: Inequality, fit: Fit, state: State, aim: Aim, seeking: bool, frozen: ndarray | None = None
) -> tuple[State, float, float] | None:
    """Take one damped Newton step for pull f + beta barrier (+ slack): state, decrement over beta, length."""
    K, point, beta, pull = inequality.coefficients, state.point, aim.beta, aim.pull
    g, Gauss, bilinear = derivatives(inequality, state)
    g *= beta
    g[:K] += pull * (fit.M @ (point.w - fit.w0))
    H = beta * Gauss
    H[:K, :K] += pull * fit.M
    c = np.concatenate([np.zeros(K), inequality.cost])
    if seeking:
        g, H, c = with_slack(inequality, state, g, H, c, beta)
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
    found = _search(inequality, fit, state, Arc(d, second, slope), aim, seeking)
    return None if found is None else (found[0], -slope / beta, found[1])


def _factor(H: ndarray, bilinear: ndarray, K: int) -> Callable[[ndarray], ndarray] | None:
    """Return the solution operator of the Hessian, or None where it is not positive definite."""
    A = H.copy()
    J = bilinear.shape[1]
    A[:K, K : K + J] += bilinear
    A[K : K + J, :K] += bilinear.T
    diagonal = np.diag(A)
    if not (diagonal > 0).all():
        return None
    scale = 1 / np.sqrt(diagonal)
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
    return np.asarray(-a + b * (c @ a) / (c @ b))


def _bend(inequality: Inequality, state: State, d: ndarray, beta: float, seeking: bool) -> ndarray:
    """Return the gradient that the second-order change of Z along d, -(dE dF + dF'dE'), adds at a unit step."""
    K, J = inequality.coefficients, len(inequality.cost)
    half = inequality.slopes(d[K : K + J]) @ (inequality.flows(d[:K]) - inequality.base)
    inverse = state.inverse
    middle = inverse @ (half + half.T) @ inverse
    bend = beta * pairings(inequality, state.D @ middle @ state.D.T)
    return np.append(bend, -beta * np.trace(middle)) if seeking else bend


@dataclass(frozen=True, eq=False)
class Arc:
    """A way a `first` + a^2 `second` from a point, along which the aim falls by a `slope` at first."""

    first: ndarray
    second: ndarray
    slope: float

    def __call__(self, a: float) -> ndarray:
        """Return the change of the unknowns at a."""
        return a * self.first + a**2 * self.second


def _search(
    inequality: Inequality, fit: Fit, state: State, arc: Arc, aim: Aim, seeking: bool
) -> tuple[State, float] | None:
    """Return the first point on an arc that is strictly inside and descends (Armijo), and its a."""
    d, beta, pull = arc.first, aim.beta, aim.pull
    K, J, point = inequality.coefficients, len(inequality.cost), state.point
    falling = d[K : K + J] < 0
    falling[: inequality.free] = False
    a = min(1.0, 0.95 * float((-point.y[falling] / d[K : K + J][falling]).min(initial=np.inf)))
    here = pull * fit(point.w) + beta * state.barrier + point.slack * seeking
    while a > SHORTEST:
        change = arc(a)
        slack = point.slack + (float(change[-1]) if seeking else 0.0)
        moved = Point(point.w + change[:K], point.y + change[K : K + J], slack)
        following = State.at(inequality, moved)
        if following is not None:
            value = pull * fit(moved.w) + beta * following.barrier + moved.slack * seeking
            if value <= here + 0.1 * a * arc.slope + 1e-12 * abs(here):
                return following, a
        a *= 0.6
    return None
