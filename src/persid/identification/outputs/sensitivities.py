"""Free runs of many pieces and many models side by side, and their exact derivatives by every parameter."""

from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.outputs.latent import Latent, activated, slope_of
from persid.identification.outputs.records import Pieces
from persid.models.steps import STAGES, runge_kutta

HUGE = 1e6  # standard units beyond which a run has diverged
JOINED = 1e-7  # standard units to which the end of a piece meets the start of the next
SWEEPS = 6  # corrections of the pieces' starts in one simulation
LANES = 256  # pieces (times models) whose sensitivities are computed at a time
CHUNK = 4096  # samples of them at a time


@dataclass(frozen=True, eq=False)
class Run:
    """Hold what K models did on all pieces: states at every substep, outputs before their map, whether it is joined.

    `start` are the states at the pieces' starts. An entry of `joined` is False where pieces do not meet or diverge.
    """

    states: Float[ndarray, "steps K n S"]
    y: Float[ndarray, "L K l S"]
    joined: ndarray

    @property
    def start(self) -> Float[ndarray, "K n S"]:
        """The states at the pieces' starts."""
        return np.asarray(self.states[0])


@dataclass(frozen=True, eq=False)
class Normal:
    """Hold J'J and J'r of K models over their parameters (W, V, O) and over every record's x0.

    `flow` is the derivative of a piece's end by its start; `reach` and `own` are those of a start by (W, V, O) and x0.
    """

    H: Float[ndarray, "K p p"]
    side: Float[ndarray, "K records p n"]
    corner: Float[ndarray, "K records n n"]
    g: Float[ndarray, "K p"]
    g0: Float[ndarray, "K records n"]
    flow: Float[ndarray, "K S n n"]
    reach: Float[ndarray, "K S n p"]
    own: Float[ndarray, "K S n n"]


def forced(latent: Latent, pieces: Pieces) -> tuple[Float[ndarray, "L K n S"], Float[ndarray, "L K n S"]]:
    """Return B u + b at the samples, and what is added to it up to the next one."""
    B = latent.B[None]
    return B @ pieces.u[:, None] + latent.b[None, :, :, None], B @ pieces.rise[:, None]


def swept(latent: Latent, pieces: Pieces, start: Float[ndarray, "K n S"], substeps: int) -> ndarray:
    """Return the states of all pieces at every substep, each from its own start."""
    K, n, S = start.shape
    G, R, beta = latent.W[:, :, : n + latent.q], latent.R, latent.V[:, :, -1:]
    inputs, rises = forced(latent, pieces)
    h, moving = 1 / substeps, bool(pieces.rise.any())
    states = np.empty((pieces.length * substeps + 1, K, n, S))
    states[0], both = start, np.empty((K, n + latent.q, S))

    def rate(x: ndarray, drive: ndarray) -> ndarray:
        both[:, :n] = x
        both[:, n:] = activated(latent.activation, R @ x + beta)
        return np.asarray(G @ both + drive)

    for k in range(len(states) - 1):
        sample, part = divmod(k, substeps)
        x, d0 = states[k], inputs[sample]
        a, b, c = (d0 + (part + c) * h * rises[sample] for c in (0, 0.5, 1)) if moving else (d0, d0, d0)
        states[k + 1] = runge_kutta(rate, x, h, (a, b, c))
        if k % 16 == 15:
            np.clip(states[k + 1], -HUGE, HUGE, out=states[k + 1])
    return states


def simulated(
    latent: Latent, pieces: Pieces, start: Float[ndarray, "K n S"], flow: ndarray, substeps: int, sweeps: int = SWEEPS
) -> Run:
    """Simulate from x0; pieces begin at a guess that is corrected with the pieces' flows until they join."""
    K, n, S = start.shape
    follows = np.diff(pieces.record, prepend=-1) == 0
    start = start.copy()
    start[:, :, ~follows] = np.swapaxes(latent.x0, 1, 2)
    states, size, open_ = np.empty((pieces.length * substeps + 1, K, n, S)), np.full(K, np.inf), np.arange(K)
    with np.errstate(all="ignore"):
        for _ in range(sweeps):
            found = swept(latent[open_], pieces, start[open_], substeps)
            states[:, open_] = found
            gap = np.zeros((len(open_), n, S))
            gap[:, :, 1:] = (found[-1][:, :, :-1] - start[open_, :, 1:]) * follows[1:]
            size[open_] = np.nan_to_num(np.abs(gap).max((1, 2)), nan=np.inf)
            left = (size[open_] > JOINED) & np.isfinite(size[open_])
            open_, gap = open_[left], gap[left]
            if not len(open_):
                break
            change = _corrections(gap, flow[open_], follows)
            start[open_] = np.clip(np.nan_to_num(start[open_] + change), -HUGE, HUGE)
    bounded = np.abs(states).max((0, 2, 3)) < HUGE
    y = latent.C[None] @ states[:-1:substeps] + latent.O[None, :, :, n:-1] @ pieces.u[:, None] + latent.O[:, :, -1:]
    return Run(states, y, bounded & (size <= 100 * JOINED))


def _corrections(gap: ndarray, flow: ndarray, follows: ndarray) -> ndarray:
    """Return Newton's changes of the starts: each is its gap and what the change before it flows into."""
    change = gap.copy()
    for s in range(1, gap.shape[2]):
        if follows[s]:
            change[:, :, s] += (flow[:, s - 1] @ change[:, :, s - 1, None])[:, :, 0]
    return change


def mapped_output(latent: Latent, y: ndarray) -> tuple[ndarray, ndarray | None]:
    """Return h(y) and its slope, None where there is no output map."""
    return (y, None) if latent.output_map is None else (np.abs(y), np.sign(y))


def normal(latent: Latent, pieces: Pieces, run: Run, substeps: int) -> Normal:
    """Return the Gauss-Newton sums over all fitted samples."""
    K, S = len(latent.W), run.states.shape[-1]
    models = max(1, LANES // S)
    found = [_some(latent[k : k + models], pieces, run, substeps, slice(k, k + models)) for k in range(0, K, models)]
    return Normal(*(np.concatenate([getattr(one, part.name) for one in found]) for part in fields(Normal)))


def _some(latent: Latent, pieces: Pieces, run: Run, substeps: int, models: slice) -> Normal:
    """Return the sums of some models: of blocks of pieces, then of all of them with their starts chained."""
    S = run.states.shape[-1]
    blocks = [_block(latent, pieces, run, substeps, models, slice(s, s + LANES)) for s in range(0, S, LANES)]
    H, g = (np.sum([block[part] for block in blocks], 0) for part in (0, 1))
    return _chained(
        pieces, _Sums(H, g, *(np.concatenate([block[part] for block in blocks], -1) for part in range(2, 7)))
    )


def _block(latent: Latent, pieces: Pieces, run: Run, substeps: int, models: slice, part: slice) -> "_Sums":
    """Return J'J, J'r of a block over (W, V, O), its blocks with every piece's start, the flows and the drifts."""
    u, rise, weight = pieces.u[..., part], pieces.rise[..., part], pieces.weight[:, part]
    states = run.states[:, models, :, part]
    n, m, l, L = latent.n, latent.m, latent.O.shape[1], pieces.length  # noqa: E741
    K, S, d, p = len(latent.W), states.shape[-1], latent.W[0].size + latent.V[0].size, latent.O[0].size
    y, slope = mapped_output(latent, run.y[:, models, :, part])
    seen = np.broadcast_to(weight[:, None, None], y.shape) * (1.0 if slope is None else slope)
    r = weight[:, None, None] * (y - pieces.y[:, None, :, part])
    J = np.zeros((K, d + p + n, L, l, S))
    S_now = np.zeros((K, n, d + n, S))
    S_now[:, np.arange(n), d + np.arange(n)] = 1.0
    chunk = max(1, CHUNK // (K * S))
    for first in range(0, L, chunk):
        samples = np.arange(first, min(first + chunk, L))
        x = states[samples[0] * substeps : (samples[-1] + 1) * substeps]
        flows, drifts = _steps(latent, x, u[samples], rise[samples], substeps)
        for k in samples:
            seen_now = (latent.C @ S_now.reshape(K, n, -1)).reshape(K, l, d + n, S) * seen[k][:, :, None]
            J[:, :d, k] = np.swapaxes(seen_now[:, :, :d], 1, 2)
            J[:, d + p :, k] = np.swapaxes(seen_now[:, :, d:], 1, 2)
            for step in range((k - first) * substeps, (k - first + 1) * substeps):
                S_now = np.einsum("kijs,kjps->kips", flows[step], S_now)
                S_now[:, :, :d] += drifts[step]
    direct = np.concatenate([states[:-1:substeps], np.broadcast_to(u[:, None], (L, K, m, S)), np.ones((L, K, 1, S))], 2)
    for i in range(l):
        place = d + i * (n + m + 1)
        J[:, place : place + n + m + 1, :, i] = np.moveaxis(direct * seen[:, :, i : i + 1], 0, 2)
    r = np.moveaxis(r, 0, 1)
    flat, body, start = J.reshape(K, d + p + n, -1), J[:, : d + p], J[:, d + p :]
    H = flat[:, : d + p] @ np.swapaxes(flat[:, : d + p], 1, 2)
    g = (flat[:, : d + p] @ r.reshape(K, -1, 1))[..., 0]
    side = np.einsum("kplis,knlis->kpns", body, start)
    corner = np.einsum("kalis,knlis->kans", start, start)
    g0 = np.einsum("knlis,klis->kns", start, r)
    return _Sums(H, g, side, corner, g0, S_now[:, :, d:], S_now[:, :, :d])


def _steps(
    latent: Latent, x: Float[ndarray, "t K n S"], u: ndarray, rise: ndarray, substeps: int
) -> tuple[Float[ndarray, "t K n n S"], Float[ndarray, "t K n d S"]]:
    """Return the derivatives of every Runge-Kutta step by its state and by (W, V).

    A step is x + sum h w_i k_i, so that d(step) = dx + sum M_i (J_i dx + F_i dtheta) with M_i the derivative by k_i:
    M_4 = h/6, M_i = h w_i + h c_(i+1) M_(i+1) J_(i+1).
    """
    n, q, h, (t, K, _, S) = latent.n, latent.q, 1 / substeps, x.shape
    A, A1, R = latent.A, latent.A1, latent.R
    G, products = latent.W[:, :, : n + q], (A1[:, :, None] * np.swapaxes(R, 1, 2)[:, None]).reshape(K, n * n, q)
    time = np.tile(np.arange(substeps) * h, t // substeps)[:, None, None]
    u, rise = np.repeat(u, substeps, 0), np.repeat(rise, substeps, 0)
    stages, k = [], 0.0
    for place, _ in STAGES:
        z = x + place * h * k if place else x
        s = R @ z + latent.V[:, :, -1:]
        f = activated(latent.activation, s)
        slope = slope_of(latent.activation, s, f)
        drive = (u + (time + place * h) * rise)[:, None]
        k = G @ np.concatenate([z, f], 2) + latent.B @ drive + latent.b[:, :, None]
        J = (products @ slope).reshape(t, K, n, n, S) + A[..., None]
        stages.append((z, f, slope, np.broadcast_to(drive, (t, K, latent.m, S)), J))
    unit = np.broadcast_to(np.eye(n)[..., None], (t, K, n, n, S))
    M = h / 6 * unit
    flow = unit
    drift_W = np.zeros((t, K, n, n, n + q + latent.m, S))
    drift_V = np.zeros((t, K, n, q, n + 1, S))
    for i in range(3, -1, -1):
        z, f, slope, drive, J = stages[i]
        MJ = np.einsum("tkias,tkajs->tkijs", M, J)
        flow = flow + MJ
        seen = np.concatenate([z, f, drive], 2)
        drift_W += M[:, :, :, :, None] * seen[:, :, None, None]
        MA = (np.swapaxes(A1, 1, 2)[:, None] @ M) * slope[:, :, None]
        rows = np.concatenate([z, np.ones((t, K, 1, S))], 2)
        drift_V += MA[:, :, :, :, None] * rows[:, :, None, None]
        if i:
            M = h * STAGES[i - 1][1] * unit + h * STAGES[i][0] * MJ
    drift = np.concatenate([drift_W.reshape(t, K, n, -1, S), drift_V.reshape(t, K, n, -1, S)], 3)
    return flow, drift


class _Sums(NamedTuple):
    """Gauss-Newton sums in which every piece has its own start: J'J and J'r over (W, V, O); blocks with the starts."""

    H: Float[ndarray, "K p p"]
    g: Float[ndarray, "K p"]
    side: Float[ndarray, "K p n S"]
    corner: Float[ndarray, "K n n S"]
    g0: Float[ndarray, "K n S"]
    flow: Float[ndarray, "K n n S"]
    drift: Float[ndarray, "K n d S"]


def _chained(pieces: Pieces, sums: _Sums) -> Normal:
    """Return the sums over the parameters and every record's first state, the pieces' starts being what they are.

    A start depends on (W, V) by E and on its record's first state by F: E, F are 0, 1 at the first piece and carried on
    by the flow of each piece, with its drift.
    """
    H, g, side, corner, g0, flow, drift = sums
    K, n, d, S = drift.shape
    p = H.shape[1]
    flow, drift, side, corner, g0 = (np.moveaxis(part, -1, 0) for part in (flow, drift, side, corner, g0))
    follows = np.diff(pieces.record, prepend=-1) == 0
    E, F = np.zeros((S, K, n, p)), np.zeros((S, K, n, n))
    for s in range(S):
        if follows[s]:
            E[s], F[s] = flow[s - 1] @ E[s - 1], flow[s - 1] @ F[s - 1]
            E[s, :, :, :d] += drift[s - 1]
        else:
            F[s] = np.eye(n)
    CE = corner @ E
    cross = (side @ E).sum(0)
    H = H + cross + np.swapaxes(cross, 1, 2) + (np.swapaxes(E, 2, 3) @ CE).sum(0)
    g = g + (np.swapaxes(E, 2, 3) @ g0[..., None]).sum(0)[..., 0]
    ends = (
        side @ F + np.swapaxes(CE, 2, 3) @ F,
        np.swapaxes(F, 2, 3) @ corner @ F,
        np.swapaxes(F, 2, 3) @ g0[..., None],
    )
    sides, corners, firsts = (np.moveaxis(np.add.reduceat(part, pieces.starts, 0), 0, 1) for part in ends)
    return Normal(
        H, sides, corners, g, firsts[..., 0], np.moveaxis(flow, 0, 1), np.moveaxis(E, 0, 1), np.moveaxis(F, 0, 1)
    )
