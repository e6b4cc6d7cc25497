"""Levenberg-Marquardt on the error of free runs, for many models of one size at once."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid.identification.outputs.curves import NONE, Curves
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.parametrisation import Proved, Shape, proved
from persid.identification.outputs.records import Pieces
from persid.identification.outputs.runs import SWEEPS, Guess, simulated
from persid.identification.outputs.sensitivities import normal

TOLERANCE = 1e-4  # relative gain of the cost in one step, over PATIENCE steps in a row
PATIENCE = 3
DIFFERENCE = 1e-6  # of a parameter, for the slopes of gains
RETRIES = 7  # damped trials without a gain after which a model is left
FAR, NEAR = 1e-2, 1e-4  # damping at a random start, and where a fit goes on from one
LEAST = 0.2  # to which the damping falls in one step, at most
HOPELESS = 2.0  # times its cost before, beyond which a trial is given up before its pieces join


@dataclass(frozen=True, eq=False)
class Batch:
    """Hold K points of one parametrisation: parameters w, first states x0, and their kind."""

    w: Float[ndarray, "K p"]
    x0: Float[ndarray, "K records n"]
    activation: str = "tanh"
    output_map: str | None = None
    hardening: int = 0

    @property
    def kind(self) -> tuple[str, str | None, int]:
        """The activation, the output map, and how many neurons harden."""
        return self.activation, self.output_map, self.hardening

    def __getitem__(self, chosen: ndarray | slice) -> "Batch":
        return replace(self, w=self.w[chosen], x0=self.x0[chosen])


@dataclass(frozen=True, eq=False)
class Free:
    """w is (W, V, parameters of the learned curves, O)."""

    n: int
    q: int
    m: int
    l: int  # noqa: E741
    free: Bool[ndarray, " p"]
    curves: Curves = NONE

    @property
    def learned(self) -> slice:
        """Where the parameters of the curves stand in w."""
        first = self.n * (self.n + self.q + self.m + 1) + self.q * (self.n + 1)
        return slice(first, first + self.curves.size)

    def latent(self, batch: Batch) -> tuple[Latent, Float[ndarray, "K p d"], Bool[ndarray, " K"]]:
        """Return the models as they stand."""
        at, K = self.learned, len(batch.w)
        F, dF = self.curves.slopes(batch.w[:, at])
        theta = np.hstack([batch.w[:, : at.start], F.reshape(K, -1), batch.w[:, at.stop :]])
        W, V, F, O = split(theta, self.n, self.q, self.m, self.l)  # noqa: E741
        last = at.start + F[0].size
        D = np.zeros((K, batch.w.shape[1], theta.shape[1]))
        D[:, : at.start, : at.start] = np.eye(at.start)
        D[:, at, at.start : last] = dF
        D[:, at.stop :, last:] = np.eye(theta.shape[1] - last)
        return Latent(W, V, O, batch.x0, F, *batch.kind), D, np.ones(K, bool)


@dataclass(frozen=True, eq=False)
class Stable:
    """w is (the stable parameters, [B b], beta, parameters of the learned curves, O)."""

    shape: Shape
    m: int
    l: int  # noqa: E741
    free: Bool[ndarray, " p"]
    curves: Curves = NONE

    @property
    def n(self) -> int:
        """Number of states."""
        return self.shape.n

    @property
    def q(self) -> int:
        """Number of neurons."""
        return self.shape.q

    @property
    def learned(self) -> slice:
        """Where the parameters of the curves stand in w."""
        first = self.shape.size + self.n * (self.m + 1) + self.q
        return slice(first, first + self.curves.size)

    @property
    def width(self) -> int:
        """Number of entries of (W, V, F, O)."""
        n, q, m = self.shape.n, self.shape.q, self.m
        return n * (n + q + m + 1) + q * (n + 1) + q * self.curves.pieces + self.l * (n + m + 1)

    def proved(self, batch: Batch) -> Proved:
        """Return the models with their multipliers."""
        return proved(self.shape, batch.w[:, : self.shape.size])[0]

    def latent(self, batch: Batch) -> tuple[Latent, Float[ndarray, "K p d"], Bool[ndarray, " K"]]:
        """Return the models, by the chain rule through the parametrisation."""
        n, q, m, l, p = self.shape.n, self.shape.q, self.m, self.l, self.shape.size  # noqa: E741
        found, slopes = proved(self.shape, batch.w[:, :p])
        at, K = self.learned, len(batch.w)
        forces, beta, c, outputs = np.split(batch.w[:, p:], [n * (m + 1), at.start - p, at.stop - p], 1)
        F, dF = self.curves.slopes(c)
        W = np.concatenate([found.A, found.A1, forces.reshape(K, n, m + 1)], 2)
        V = np.concatenate([found.R, beta[:, :, None]], 2)
        places = np.arange(W[0].size + V[0].size + F[0].size + outputs.shape[1])
        iW, iV, iF, iO = split(places[None], n, q, m, l)
        stable = np.concatenate([iW[0, :, :n].ravel(), iW[0, :, n : n + q].ravel(), iV[0, :, :n].ravel()])
        plain = np.concatenate([iW[0, :, n + q :].ravel(), iV[0, :, n].ravel(), iO[0].ravel()])
        D = np.zeros((K, batch.w.shape[1], len(places)))
        D[:, :p, stable] = slopes
        D[:, np.r_[p : at.start, at.stop : batch.w.shape[1]], plain] = 1.0
        D[:, at, iF.ravel()] = dF
        latent = Latent(W, V, outputs.reshape(K, l, -1), batch.x0, F, *batch.kind)
        return latent, D, found.valid


Parameters = Free | Stable


def split(theta: ndarray, n: int, q: int, m: int, l: int) -> tuple[ndarray, ndarray, ndarray, ndarray]:  # noqa: E741
    """Return the arrays W, V, F, O of flat entries."""
    K, last = len(theta), theta.shape[1] - l * (n + m + 1)
    W, V, F, O = np.split(theta, [*np.cumsum([n * (n + q + m + 1), q * (n + 1)]), last], 1)  # noqa: E741
    k = F.shape[1] // max(q, 1)
    return W.reshape(K, n, n + q + m + 1), V.reshape(K, q, n + 1), F.reshape(K, q, k), O.reshape(K, l, n + m + 1)


@dataclass(eq=False)
class Fit:
    """Hold where K models stand: starts of all pieces and derivatives of their ends by them, cost, root-mean-square
    errors on fitted and held-out samples, damping, gains.

    `ended` says which of them need no more steps.
    """

    batch: Batch
    start: Float[ndarray, "K n S"]
    flow: Float[ndarray, "K S n n"]
    cost: Float[ndarray, " K"]
    error: Float[ndarray, " K"]
    held_out: Float[ndarray, " K"]
    damping: Float[ndarray, " K"]
    small: ndarray
    failed: ndarray
    ended: Bool[ndarray, " K"]
    steps: int = 0


@dataclass(frozen=True, eq=False)
class Task:
    """Say what is fitted to what: pieces, parametrisation, ridge on entries of W and V, substeps, further terms."""

    pieces: Pieces
    parameters: Parameters
    ridge: Float[ndarray, "K d"]
    substeps: int = 2
    tolerance: float = TOLERANCE
    terms: "tuple[Term, ...]" = ()

    @np.errstate(over="ignore", invalid="ignore")  # a step too far is refused, whatever it costs
    def penalty(self, latent: Latent, ridge: ndarray) -> Float[ndarray, " K"]:
        """Return what the ridge adds to the cost."""
        return np.asarray(0.5 * (ridge * theta_of(latent) ** 2).sum(1))


class Term(Protocol):
    """Say what a fit has to pay beside its error: a limit of gains, say, or what is known of the model."""

    def cost(self, parameters: Parameters, batch: Batch) -> Float[ndarray, " K"]:
        """Return what every model pays."""

    def pull(self, parameters: Parameters, batch: Batch) -> tuple[Float[ndarray, "K p"], Float[ndarray, "K p p"]]:
        """Return the gradient of the cost and its Gauss-Newton form."""


def beside(batch: Batch, k: int) -> tuple[Batch, Float[ndarray, " p"]]:
    """Return points at a step above one of the batch in each parameter, then those below, and the steps."""
    h = DIFFERENCE * np.maximum(1.0, np.abs(batch.w[k]))
    moved = batch[np.full(2 * len(h), k)]
    return replace(moved, w=moved.w + np.concatenate([np.diag(h), -np.diag(h)])), h


def slopes_of(values: Float[ndarray, "two_p e"], h: Float[ndarray, " p"]) -> Float[ndarray, "p e"]:
    """Return the derivatives of values at the points of `beside`."""
    p = len(h)
    return np.asarray(np.nan_to_num((values[:p] - values[p:]) / (2 * h[:, None]), posinf=0.0, neginf=0.0))


def theta_of(latent: Latent) -> Float[ndarray, "K d"]:
    """Return (W, V, F, O) of every model in one row."""
    return np.concatenate([part.reshape(len(part), -1) for part in (latent.W, latent.V, latent.F, latent.O)], 1)


def evaluated(
    task: Task, batch: Batch, ridge: ndarray, guess: Guess, sweeps: int = SWEEPS, limit: ndarray | float = np.inf
) -> tuple[ndarray, ndarray, ndarray, Float[ndarray, "K n S"]]:
    """Return cost, error, held-out error and starts of pieces by simulation; infinite where one is not valid.

    A model whose costs go beyond `limit` before its pieces join is given up: its cost is infinite.
    """
    latent, _, valid = task.parameters.latent(batch)
    most = np.broadcast_to(2 * task.pieces.values * np.asarray(limit), len(valid))
    run = simulated(latent, task.pieces, guess, task.substeps, sweeps, most)
    good = valid & run.joined
    square = np.where(good, run.square, np.inf) / task.pieces.values
    held = np.where(good, run.held, np.inf) / max(float(task.pieces.held.sum()) * task.pieces.y.shape[1], 1.0)
    cost = np.where(good, 0.5 * square + task.penalty(latent, ridge), np.inf)
    for term in task.terms:
        cost = cost + term.cost(task.parameters, batch)
    return cost, np.sqrt(square), np.sqrt(held), run.start


def begun(task: Task, batch: Batch, damping: float = FAR, near: tuple[ndarray, ndarray] | None = None) -> Fit:
    """Return the fit before its first step: pieces start at zero, and meet after as many sweeps as that takes.

    `near` are starts (1, n, S) and flows (1, S, n, n) of a model from which all of these differ little.
    """
    K, n, S = len(batch.w), batch.x0.shape[2], len(task.pieces.record)
    first, flows = near or (np.zeros((1, n, S)), np.zeros((1, S, n, n)))
    start, flow = np.repeat(first, K, 0), np.repeat(flows, K, 0)
    for _ in range(4):
        latent, _, _ = task.parameters.latent(batch)
        run = simulated(latent, task.pieces, Guess(start, flow), task.substeps, 4)
        if run.joined.all():
            break
        start = np.clip(np.nan_to_num(run.start), -100, 100)
        with np.errstate(all="ignore"):
            flow = np.nan_to_num(normal(latent, task.pieces, start, task.substeps).flow)
    cost, error, held, start = evaluated(task, batch, task.ridge, Guess(run.start, flow), 30)
    zero = np.zeros(K, int)
    return Fit(
        batch=batch,
        start=start,
        flow=flow,
        cost=cost,
        error=error,
        held_out=held,
        damping=np.full(K, damping),
        small=zero,
        failed=zero.copy(),
        ended=~np.isfinite(cost),
    )


class _Arrow(NamedTuple):
    """The Gauss-Newton sums of models over parameters and every record's x0: blocks H, side, corner; sums g, g0."""

    H: Float[ndarray, "*K p p"]
    side: Float[ndarray, "*K records p n"]
    corner: Float[ndarray, "*K records n n"]
    g: Float[ndarray, "*K p"]
    g0: Float[ndarray, "*K records n"]


class _Linear(NamedTuple):
    """What one model's step needs: its sums, theta = (W, V, F, O) by its parameters, the pieces' starts by both."""

    sums: _Arrow
    D: Float[ndarray, "p d"]
    reach: Float[ndarray, "S n d"]
    own: Float[ndarray, "S n n"]


def fitted(task: Task, fit: Fit, steps: int, tell: Callable[[Fit], None] | None = None) -> Fit:
    """Take Levenberg-Marquardt steps, at most so many for each model; `fit` is updated in place and returned."""
    fresh: dict[int, _Linear] = {}
    for _ in range(steps):
        active = np.flatnonzero(~fit.ended)
        if not len(active):
            break
        _linearised(task, fit, np.array([k for k in active if k not in fresh], int), fresh)
        moved = _moved(task, fit, active, fresh)
        for k in active[moved]:
            fresh.pop(int(k))
        fit.steps += 1
        if tell:
            tell(fit)
    return fit


def _linearised(task: Task, fit: Fit, chosen: ndarray, fresh: dict[int, _Linear]) -> None:
    """Compute the normal equations in w of the chosen models."""
    if not len(chosen):
        return
    batch = fit.batch[chosen]
    latent, D, _ = task.parameters.latent(batch)
    found = normal(latent, task.pieces, fit.start[chosen], task.substeps)
    fit.flow[chosen] = found.flow
    count, ridge, theta = task.pieces.values, task.ridge[chosen], theta_of(latent)
    H = found.H / count
    H[:, np.arange(H.shape[1]), np.arange(H.shape[1])] += ridge
    g = found.g / count + ridge * theta
    H, g = D @ H @ np.swapaxes(D, 1, 2), (D @ g[..., None])[..., 0]
    side = D[:, None] @ found.side / count
    for drawn, form in (term.pull(task.parameters, batch) for term in task.terms):
        g, H = g + drawn, H + form
    for i, k in enumerate(chosen):
        sums = _Arrow(H[i], side[i], found.corner[i] / count, g[i], found.g0[i] / count)
        fresh[int(k)] = _Linear(sums, D[i], found.reach[i], found.own[i])


def _moved(task: Task, fit: Fit, active: ndarray, fresh: dict[int, _Linear]) -> Bool[ndarray, " active"]:
    """Try one damped step of every active model; return which of them were taken."""
    known = [fresh[int(k)] for k in active]
    sums = _Arrow(*(np.array(part) for part in zip(*(one.sums for one in known), strict=True)))
    D, reach, own = (np.array([getattr(one, name) for one in known]) for name in ("D", "reach", "own"))
    dw, dx0, foretold = _steps(sums, fit.damping[active], task.parameters.free)
    batch = replace(fit.batch[active], w=fit.batch.w[active] + dw, x0=fit.batch.x0[active] + dx0)
    dtheta = (dw[:, None] @ D)[:, 0]
    shift = (reach @ dtheta[:, None, :, None])[..., 0] + (own @ dx0[:, task.pieces.record, :, None])[..., 0]
    guess = Guess(fit.start[active] + np.swapaxes(shift, 1, 2), fit.flow[active])
    before = fit.cost[active]
    cost, error, held, start = evaluated(task, batch, task.ridge[active], guess, limit=HOPELESS * before)
    better: ndarray = cost < before
    taken, refused = active[better], active[~better]
    gain = 1 - cost[better] / fit.cost[taken]
    fit.batch.w[taken], fit.batch.x0[taken] = batch.w[better], batch.x0[better]
    fit.start[taken] = start[better]
    fit.cost[taken], fit.error[taken], fit.held_out[taken] = cost[better], error[better], held[better]
    share = (before - cost)[better] / foretold[better]
    fit.damping[taken] = np.maximum(fit.damping[taken] * np.clip(1 - (2 * share - 1) ** 3, LEAST, 2), 1e-9)
    fit.damping[refused] *= 2.0 ** (1 + fit.failed[refused])
    fit.small[taken] = np.where(gain < task.tolerance, fit.small[taken] + 1, 0)
    fit.failed[taken] = 0
    fit.failed[refused] += 1
    fit.ended |= (fit.small >= PATIENCE) | (fit.failed >= RETRIES)
    return better


def _steps(
    sums: _Arrow, damping: Float[ndarray, " K"], free: Bool[ndarray, " p"]
) -> tuple[Float[ndarray, "K p"], Float[ndarray, "K records n"], Float[ndarray, " K"]]:
    """Return the damped Gauss-Newton steps, and by how much they lower the cost of the linearised models.

    Every record's x0 is eliminated first (the matrix is an arrow). A step s solves (H + damping) s = -g, so that the
    cost g's + s'Hs/2 is (g's - damping s's)/2.
    """
    H, side, corner, g, g0 = sums
    K, R, n = g0.shape
    H, side, g = H[:, free][:, :, free], side[:, :, free], g[:, free]
    scale, scale0 = (
        _scale(np.einsum("kii->ki", H)),
        _scale(np.einsum("krii->kri", corner).reshape(K, -1)).reshape(K, R, n),
    )
    H = H * scale[:, :, None] * scale[:, None] + damping[:, None, None] * np.eye(H.shape[1])
    side = side * scale[:, None, :, None] * scale0[:, :, None]
    corner = corner * scale0[..., None] * scale0[:, :, None] + damping[:, None, None, None] * np.eye(n)
    g, g0 = g * scale, g0 * scale0
    inverse = np.linalg.inv(corner)
    through = side @ inverse
    reduced = H - (through @ np.swapaxes(side, 2, 3)).sum(1)
    right = g - (through @ g0[..., None]).sum(1)[..., 0]
    step = -np.linalg.solve(reduced, right[..., None])[..., 0]
    first = -(inverse @ (g0[..., None] + np.swapaxes(side, 2, 3) @ step[:, None, :, None]))[..., 0]
    full = np.zeros((K, len(free)))
    full[:, free] = step * scale
    gain = (damping[:, None] * step**2 - g * step).sum(1) + (damping[:, None, None] * first**2 - g0 * first).sum((1, 2))
    return full, first * scale0, gain / 2


def _scale(diagonal: Float[ndarray, "K p"]) -> Float[ndarray, "K p"]:
    return np.asarray(1 / np.sqrt(np.maximum(diagonal, 1e-8 * diagonal.max(1, keepdims=True) + 1e-300)))
