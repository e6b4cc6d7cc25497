"""Free runs of many pieces and many models side by side; states are held for a block of pieces at a time."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid.identification.outputs.latent import Latent
from persid.identification.outputs.records import Pieces
from persid.models.steps import corrections, runge_kutta

HUGE = 1e6  # standard units beyond which a run has diverged
JOINED = 1e-7  # standard units to which the end of a piece meets the start of the next
SWEEPS = 6  # corrections of the pieces' starts in one simulation
BLOCK = 2**20  # numbers that hold states at a time


@dataclass(frozen=True, eq=False)
class Run:
    """Hold what K models did on all pieces: states at their starts, sums of squared errors, whether they are joined.

    `square` is over fitted samples, `held` over those held out. An entry of `joined` is False where pieces do not meet
    or diverge.
    """

    start: Float[ndarray, "K n S"]
    square: Float[ndarray, " K"]
    held: Float[ndarray, " K"]
    joined: Bool[ndarray, " K"]


@dataclass(frozen=True, eq=False)
class Moments:
    """Hold mean and covariance of a model's states at all samples, and mean squared errors of its outputs there."""

    mean: Float[ndarray, " n"]
    cov: Float[ndarray, "n n"]
    noise: Float[ndarray, " l"]


def blocks(latent: Latent, pieces: Pieces, substeps: int, least: int = 1) -> Iterator[slice]:
    """Yield which pieces are run together, in multiples of `least`, so that their states fill a block."""
    lanes = BLOCK // (len(latent.W) * latent.n * pieces.length * substeps)
    lanes = max(least, lanes // least * least)
    return (slice(s, s + lanes) for s in range(0, pieces.count, lanes))


def swept(latent: Latent, pieces: Pieces, start: Float[ndarray, "K n S"], substeps: int) -> ndarray:
    """Return the states of all pieces at every substep, each from its own start."""
    K, n, S = start.shape
    G, R, beta = latent.W[:, :, : n + latent.q], latent.R, latent.V[:, :, -1:]
    B, h = latent.B[None], 1 / substeps
    inputs = B @ pieces.u[:, None] + latent.b[None, :, :, None]
    rises = None if pieces.rise is None else B @ pieces.rise[:, None]
    states = np.empty((pieces.length * substeps + 1, K, n, S))
    states[0], both = start, np.empty((K, n + latent.q, S))

    def rate(x: ndarray, drive: ndarray) -> ndarray:
        both[:, :n] = x
        both[:, n:] = latent.activated(R @ x + beta)
        return np.asarray(G @ both + drive)

    for k in range(len(states) - 1):
        sample, part = divmod(k, substeps)
        d = inputs[sample]
        drives = (d, d, d) if rises is None else tuple(d + (part + c) * h * rises[sample] for c in (0, 0.5, 1))
        states[k + 1] = runge_kutta(rate, states[k], h, drives)
        if k % 16 == 15:
            np.clip(states[k + 1], -HUGE, HUGE, out=states[k + 1])
    return states


class Guess(NamedTuple):
    """Where pieces begin, and the derivatives of their ends by that."""

    start: Float[ndarray, "K n S"]
    flow: Float[ndarray, "K S n n"]


def simulated(
    latent: Latent, pieces: Pieces, guess: Guess, substeps: int, sweeps: int = SWEEPS, most: ndarray | float = np.inf
) -> Run:
    """Simulate from x0; pieces begin at a guess that is corrected with the pieces' flows until they join.

    A model whose sum of squares goes beyond `most` is left as it is.
    """
    start, flow = guess.start.copy(), guess.flow
    (K, n, S), follows = start.shape, pieces.follows
    start[:, :, ~follows] = np.swapaxes(latent.x0, 1, 2)
    open_, size, square, held = np.arange(K), *(np.full(K, np.inf) for _ in range(3))
    most = np.broadcast_to(most, K)
    with np.errstate(all="ignore"):
        for _ in range(sweeps):
            end, square[open_], held[open_] = _ends(latent[open_], pieces, start[open_], substeps)
            gap = np.zeros((len(open_), n, S))
            gap[:, :, 1:] = (end[:, :, :-1] - start[open_, :, 1:]) * follows[1:]
            size[open_] = np.nan_to_num(np.abs(gap).max((1, 2)), nan=np.inf)
            left = (size[open_] > JOINED) & np.isfinite(size[open_]) & (square[open_] <= most[open_])
            open_, gap = open_[left], gap[left]
            if not len(open_):
                break
            change = np.swapaxes(corrections(np.swapaxes(gap, 1, 2), flow[open_], follows), 1, 2)
            start[open_] = np.clip(np.nan_to_num(start[open_] + change), -HUGE, HUGE)
    return Run(start, square, held, (size <= 100 * JOINED) & np.isfinite(square))


def _ends(latent: Latent, pieces: Pieces, start: ndarray, substeps: int) -> tuple[ndarray, ndarray, ndarray]:
    """Return where the pieces end, and sums of squared errors: infinite where a run diverges."""
    end, sums = np.empty_like(start), np.zeros((2, len(start)))
    for part in blocks(latent, pieces, substeps):
        some = pieces[part]
        states = swept(latent, some, start[..., part], substeps)
        end[..., part] = states[-1]
        square = errors(latent, some, states[:-1:substeps]) ** 2
        for row, seen in zip(sums, (some.weight, some.held), strict=True):
            row += (square * seen[:, None, None]).sum((0, 2, 3))
        sums[0] += np.where(np.abs(states).max((0, 2, 3)) < HUGE, 0.0, np.inf)
    return end, sums[0], sums[1]


def errors(latent: Latent, pieces: Pieces, x: Float[ndarray, "L K n S"]) -> Float[ndarray, "L K l S"]:
    """Return outputs less what was measured, for the states at the samples."""
    return np.asarray(mapped_output(latent, output(latent, pieces, x))[0] - pieces.y[:, None])


def output(latent: Latent, pieces: Pieces, x: Float[ndarray, "L K n S"]) -> Float[ndarray, "L K l S"]:
    """Return the outputs before their map."""
    direct = latent.O[None, :, :, latent.n : -1] @ pieces.u[:, None]
    return np.asarray(latent.C[None] @ x + direct + latent.O[:, :, -1:])


def mapped_output(latent: Latent, y: ndarray) -> tuple[ndarray, ndarray | None]:
    """Return h(y) and its slope, None where there is no output map."""
    return (y, None) if latent.output_map is None else (np.abs(y), np.sign(y))


def moments(latent: Latent, pieces: Pieces, start: Float[ndarray, "1 n S"], substeps: int) -> Moments:
    """Return the moments of one model's states from the starts of its pieces, over fitted and held-out samples."""
    n, count = latent.n, 0.0
    first, second, square = np.zeros(n), np.zeros((n, n)), np.zeros(pieces.y.shape[1])
    for part in blocks(latent, pieces, substeps):
        some = pieces[part]
        x = swept(latent, some, start[..., part], substeps)[:-1:substeps]
        seen = (some.weight | some.held).astype(float)
        z = x[:, 0] - start[0, :, :1]
        first += np.einsum("lns,ls->n", z, seen)
        second += np.einsum("lns,lms->nm", z * seen[:, None], z)
        square += np.einsum("lis,ls->i", errors(latent, some, x)[:, 0] ** 2, seen)
        count += float(seen.sum())
    mean = first / count
    return Moments(mean + start[0, :, 0], second / count - np.outer(mean, mean), square / count)
