"""Exact derivatives of free runs by every parameter, summed to Gauss-Newton equations a few samples at a time."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.outputs.latent import Latent
from persid.identification.outputs.records import Pieces
from persid.identification.outputs.runs import blocks, mapped_output, output, swept
from persid.models.steps import STAGES

LANES = 256  # pieces (times models) whose sensitivities are computed at a time
CHUNK = 1024  # samples of them at a time: their derivatives stay in the cache


class Normal(NamedTuple):
    """Hold J'J and J'r of K models over their parameters (W, V, F, O) and over every record's x0.

    `flow` is the derivative of a piece's end by its start; `reach` and `own` are those of a start by those and x0.
    """

    H: Float[ndarray, "K p p"]
    side: Float[ndarray, "K records p n"]
    corner: Float[ndarray, "K records n n"]
    g: Float[ndarray, "K p"]
    g0: Float[ndarray, "K records n"]
    flow: Float[ndarray, "K S n n"]
    reach: Float[ndarray, "K S n p"]
    own: Float[ndarray, "K S n n"]


class _Sums(NamedTuple):
    """Gauss-Newton sums in which every piece has its own start: J'J, J'r over (W, V, F, O); blocks with the starts."""

    H: Float[ndarray, "K p p"]
    g: Float[ndarray, "K p"]
    side: Float[ndarray, "K p n S"]
    corner: Float[ndarray, "K n n S"]
    g0: Float[ndarray, "K n S"]
    flow: Float[ndarray, "K n n S"]
    drift: Float[ndarray, "K n d S"]


def normal(latent: Latent, pieces: Pieces, start: Float[ndarray, "K n S"], substeps: int) -> Normal:
    """Return the Gauss-Newton sums over all fitted samples, for pieces that begin at `start` and are joined."""
    K = len(latent.W)
    models = max(1, LANES // pieces.count)
    some = [slice(k, k + models) for k in range(0, K, models)]
    found: list[list[_Sums]] = [[] for _ in some]
    for part in blocks(latent, pieces, substeps, LANES):
        states, inside = swept(latent, pieces[part], start[..., part], substeps), pieces[part]
        for chosen, sums in zip(some, found, strict=True):
            lanes = (slice(s, s + LANES) for s in range(0, inside.count, LANES))
            sums += [_block(latent[chosen], inside[few], states[:, chosen, :, few], substeps) for few in lanes]
    return Normal(*map(np.concatenate, zip(*(_chained(pieces, _added(sums)) for sums in found), strict=True)))


def _added(found: Sequence["_Sums"]) -> "_Sums":
    """Return the sums of all pieces from those of blocks of them."""
    parts = list(zip(*found, strict=True))
    return _Sums._make([*(np.sum(part, 0) for part in parts[:2]), *(np.concatenate(part, -1) for part in parts[2:])])


def _block(latent: Latent, pieces: Pieces, states: Float[ndarray, "steps K n S"], substeps: int) -> "_Sums":
    """Return J'J, J'r of a block over (W, V, F, O), its blocks with every piece's start, the flows and the drifts."""
    n, L, K, S = latent.n, pieces.length, len(latent.W), states.shape[-1]
    d, p = latent.W[0].size + latent.V[0].size + latent.F[0].size, latent.O[0].size
    sums = [np.zeros(form) for form in ((K, d + p, d + p), (K, d + p), (K, d + p, n, S), (K, n, n, S), (K, n, S))]
    S_now = np.zeros((K, n, d + n, S))
    S_now[:, np.arange(n), d + np.arange(n)] = 1.0
    chunk = max(1, CHUNK // (K * S))
    for first in range(0, L, chunk):
        few = pieces.samples(slice(first, first + chunk))
        x = states[first * substeps : (first + few.length) * substeps]
        J, S_now, r = _seen(latent, few, x, S_now, substeps)
        flat, body, start = J[:, : d + p].reshape(K, d + p, -1), J[:, : d + p], J[:, d + p :]
        sums[0] += flat @ np.swapaxes(flat, 1, 2)
        sums[1] += (flat @ r.reshape(K, -1, 1))[..., 0]
        sums[2] += np.einsum("kplis,knlis->kpns", body, start)
        sums[3] += np.einsum("kalis,knlis->kans", start, start)
        sums[4] += np.einsum("knlis,klis->kns", start, r)
    return _Sums._make([*sums, S_now[:, :, d:], S_now[:, :, :d]])


def _seen(
    latent: Latent, pieces: Pieces, x: Float[ndarray, "t K n S"], S_now: Float[ndarray, "K n e S"], substeps: int
) -> tuple[Float[ndarray, "K p L l S"], Float[ndarray, "K n e S"], Float[ndarray, "K L l S"]]:
    """Return J over ((W, V, F), O, start) at some samples, the states' derivatives after them, and the errors."""
    (K, n, e, S), L, m, l = S_now.shape, pieces.length, latent.m, latent.O.shape[1]  # noqa: E741
    d, p = e - n, latent.O[0].size
    at = x[::substeps]
    y, slope = mapped_output(latent, output(latent, pieces, at))
    seen = np.broadcast_to(pieces.weight[:, None, None], y.shape) * (1.0 if slope is None else slope)
    r = pieces.weight[:, None, None] * (y - pieces.y[:, None])
    J = np.zeros((K, d + p + n, L, l, S))
    flows, drifts = _steps(latent, x, pieces, substeps)
    for k in range(L):
        seen_now = (latent.C @ S_now.reshape(K, n, -1)).reshape(K, l, e, S) * seen[k][:, :, None]
        J[:, :d, k] = np.swapaxes(seen_now[:, :, :d], 1, 2)
        J[:, d + p :, k] = np.swapaxes(seen_now[:, :, d:], 1, 2)
        for step in range(k * substeps, (k + 1) * substeps):
            S_now = np.einsum("kijs,kjps->kips", flows[step], S_now)
            S_now[:, :, :d] += drifts[step]
    u = np.broadcast_to(pieces.u[:, None], (L, K, m, S))
    direct = np.concatenate([at, u, np.ones((L, K, 1, S))], 2)
    for i in range(l):
        place = d + i * (n + m + 1)
        J[:, place : place + n + m + 1, :, i] = np.moveaxis(direct * seen[:, :, i : i + 1], 0, 2)
    return J, S_now, np.moveaxis(r, 0, 1)


def _steps(
    latent: Latent, x: Float[ndarray, "t K n S"], pieces: Pieces, substeps: int
) -> tuple[Float[ndarray, "t K n n S"], Float[ndarray, "t K n d S"]]:
    """Return the derivatives of every Runge-Kutta step by its state and by (W, V, F).

    A step is x + sum h w_i k_i, so that d(step) = dx + sum M_i (J_i dx + F_i dtheta) with M_i the derivative by k_i:
    M_4 = h/6, M_i = h w_i + h c_(i+1) M_(i+1) J_(i+1).
    """
    n, q, h, (t, K, _, S) = latent.n, latent.q, 1 / substeps, x.shape
    A, A1, R = latent.A, latent.A1, latent.R
    G, products = latent.W[:, :, : n + q], (A1[:, :, None] * np.swapaxes(R, 1, 2)[:, None]).reshape(K, n * n, q)
    time = np.tile(np.arange(substeps) * h, t // substeps)[:, None, None]
    u = np.repeat(pieces.u, substeps, 0)
    rise = 0.0 if pieces.rise is None else np.repeat(pieces.rise, substeps, 0)
    stages, k = [], 0.0
    for place, _ in STAGES:
        z = x + place * h * k if place else x
        s = R @ z + latent.V[:, :, -1:]
        f = latent.activated(s)
        slope = latent.slopes(s, f)
        drive = (u + (time + place * h) * rise)[:, None]
        k = G @ np.concatenate([z, f], 2) + latent.B @ drive + latent.b[:, :, None]
        J = (products @ slope).reshape(t, K, n, n, S) + A[..., None]
        stages.append((z, f, slope, np.broadcast_to(drive, (t, K, latent.m, S)), J, latent.by_slopes(s)))
    unit = np.broadcast_to(np.eye(n)[..., None], (t, K, n, n, S))
    M = h / 6 * unit
    flow = unit
    drift_W, one = np.zeros((t, K, n, n, n + q + latent.m + 1, S)), np.ones((t, K, 1, S))
    drift_V, drift_F = np.zeros((t, K, n, q, n + 1, S)), np.zeros((t, K, n, *latent.F.shape[1:], S))
    for i in range(3, -1, -1):
        z, f, slope, drive, J, ways = stages[i]
        MJ = np.einsum("tkias,tkajs->tkijs", M, J)
        flow = flow + MJ
        seen = np.concatenate([z, f, drive, one], 2)
        drift_W += M[:, :, :, :, None] * seen[:, :, None, None]
        MA = np.swapaxes(A1, 1, 2)[:, None] @ M
        rows = np.concatenate([z, one], 2)
        drift_V += (MA * slope[:, :, None])[:, :, :, :, None] * rows[:, :, None, None]
        drift_F += MA[:, :, :, :, None] * ways[:, :, None]
        if i:
            M = h * STAGES[i - 1][1] * unit + h * STAGES[i][0] * MJ
    return flow, np.concatenate([part.reshape(t, K, n, -1, S) for part in (drift_W, drift_V, drift_F)], 3)


def _chained(pieces: Pieces, sums: _Sums) -> Normal:
    """Return the sums over the parameters and every record's first state, the pieces' starts being what they are.

    A start depends on (W, V, F) by E and on its record's first state by G: E, G are 0, 1 at the first piece and carried
    by the flow of each piece, with its drift.
    """
    H, g, side, corner, g0, flow, drift = sums
    K, n, d, S = drift.shape
    p = H.shape[1]
    flow, drift, side, corner, g0 = (np.moveaxis(part, -1, 0) for part in (flow, drift, side, corner, g0))
    follows = pieces.follows
    E, G = np.zeros((S, K, n, p)), np.zeros((S, K, n, n))
    for s in range(S):
        if follows[s]:
            E[s], G[s] = flow[s - 1] @ E[s - 1], flow[s - 1] @ G[s - 1]
            E[s, :, :, :d] += drift[s - 1]
        else:
            G[s] = np.eye(n)
    CE = corner @ E
    cross = (side @ E).sum(0)
    H = H + cross + np.swapaxes(cross, 1, 2) + (np.swapaxes(E, 2, 3) @ CE).sum(0)
    g = g + (np.swapaxes(E, 2, 3) @ g0[..., None]).sum(0)[..., 0]
    ends = (
        side @ G + np.swapaxes(CE, 2, 3) @ G,
        np.swapaxes(G, 2, 3) @ corner @ G,
        np.swapaxes(G, 2, 3) @ g0[..., None],
    )
    sides, corners, firsts = (np.moveaxis(np.add.reduceat(part, pieces.starts, 0), 0, 1) for part in ends)
    return Normal(H, sides, corners, g, firsts[..., 0], *(np.moveaxis(part, 0, 1) for part in (flow, E, G)))
