"""Estimates: what windows of measurements say about x' = theta' phi(x, u), with the covariance of what they say.

    y_k = x(t_{k+q}) - x(t_k) = theta' X_k + e_k,     X_k the integrals of the columns phi over the window

phi are the functions of the model: the states, the values of its channels, the inputs, and 1.

Least squares is biased where the columns of a window know its noise. So columns of windows that ended before this one
serve as *instruments* Z (`instruments`): with P = Z'X and H = Z'y of orthonormal Z, theta = P^+ H.

Overlapping windows and coloured noise make the residuals e_k dependent. So nothing is said of single ones: the record
is cut into blocks, and the spread of their scores psi_b = P^+ Z_b'(y_b - X_b theta) is the covariance (a sandwich). For
nb blocks and p columns the quantile of Scheffe's band is p (nb - 1) / (nb - p) F(p, nb - p).
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy import stats

from persid.errors import UnderdeterminedError
from persid.identification.estimators.weak import integrate
from persid.identification.instruments import earlier, lag
from persid.measurements.trajectory import Trajectory
from persid.models.model import PersidskiiModel

BLOCKS = 40  # at most, or three for each column; a block has several windows
LONGEST = 100_000  # samples of a run that are looked at
ROWS = 8  # windows, end to end, of a block at least
RESOLVED = 1e-9  # share of the largest singular value below which a direction is not resolved


@dataclass(frozen=True, eq=False)
class Dictionary:
    """The columns phi(x, u) of a model: x - x_ref, the values of its channels, u - u_ref, 1."""

    model: PersidskiiModel

    @property
    def size(self) -> int:
        """Number of columns."""
        return self.model.n + len(self.model.channels.functions) + self.model.m + 1

    def values(self, x: Float[ndarray, "N n"]) -> Float[ndarray, "N p"]:
        """Return the columns that depend on x."""
        dx = x - self.model.x_ref
        bent = (term.values(dx)[:, [not f.is_linear for f in term.f]] for term in self.model.terms)
        return np.hstack([dx, *bent])

    def columns(self, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"]) -> Float[ndarray, "N p"]:
        """Return all columns."""
        return np.hstack([self.values(x), u - self.model.u_ref, np.ones((len(x), 1))])

    def integrals(self, run: Trajectory, window: int, hold: str) -> Float[ndarray, "K p"]:
        """Return their integrals over every window of so many steps."""
        out = np.empty((len(run) - window, self.size))
        integrate(run.t, self.values(run.x), run.u - self.model.u_ref, window, hold, out[:, :-1])
        out[:, -1] = run.t[window:] - run.t[:-window]
        return out


@dataclass(frozen=True, eq=False)
class Windows:
    """Rows of windows: columns X, moves y, instruments Z, and the block (0, 1, ...) to which each belongs."""

    X: Float[ndarray, "K p"]
    y: Float[ndarray, "K n"]
    Z: Float[ndarray, "K z"]
    block: Int[ndarray, " K"]
    window: int

    @property
    def blocks(self) -> int:
        """Number of blocks."""
        return int(self.block.max(initial=-1)) + 1

    def sums(self, rows: Float[ndarray, "K c"]) -> Float[ndarray, "b c"]:
        """Return the sum of rows over each block."""
        total = np.zeros((self.blocks, rows.shape[1]))
        np.add.at(total, self.block, rows)
        return total


def windows_of(data: Sequence[Trajectory], phi: Dictionary, window: int, hold: str, instruments: bool) -> Windows:
    """Return all windows of some runs with their instruments, in blocks.

    Raises:
        UnderdeterminedError: there are too few of them for any estimate.
    """
    parts = []
    for run in (run[:LONGEST] for run in data if len(run) > window):
        X, y = phi.integrals(run, window, hold), run.x[window:] - run.x[:-window]
        if not instruments:
            parts.append((X, y, X))
        elif len(X) > 2 * lag(window):
            Z, own = earlier(X, range(phi.model.n), phi.model.m, window)
            parts.append((own, y[2 * lag(window) :], Z))
    count = sum(len(y) for _, y, _ in parts)
    blocks = min(max(BLOCKS, 3 * phi.size), count // (ROWS * window))
    if blocks < 4:
        raise UnderdeterminedError(
            f"{count} windows of {window} samples are too few to say how sure the coefficients are; measure longer"
        )
    X, y, Z = (np.concatenate(side) for side in zip(*parts, strict=True))
    return Windows(X, y, Z, np.arange(count) * blocks // count, window)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Coefficients theta (p, n), their covariance per equation, and the p-value of the instruments' agreement.

    `used` are the columns that each equation may have; `agreement` is 1 where no instrument is left over; `influence`
    is what each block moves theta by, psi_b. Where an equation is not `resolved`, some combination of its columns is
    the same in all data, such as a held input and 1: of that its coefficients, and their covariance, say nothing.
    """

    theta: Float[ndarray, "p n"]
    influence: Float[ndarray, "n b p"]
    used: Bool[ndarray, "p n"]
    blocks: int
    agreement: Float[ndarray, " n"]
    residual: Float[ndarray, "K n"]
    resolved: Bool[ndarray, " n"]

    @cached_property
    def covariance(self) -> Float[ndarray, "n p p"]:
        """The covariance of theta, an equation a matrix."""
        products = np.einsum("nbp,nbq->npq", self.influence, self.influence)
        return np.asarray(products * self.blocks / (self.blocks - 1))

    def quantile(self, confidence: float) -> Float[ndarray, " n"]:
        """Return, per equation, what theta'phi's squared error over its variance stays below, for all phi at once.

        The confidence is shared among the equations (Bonferroni).
        """
        shared = 1 - (1 - confidence) / max(int(self.used.any(axis=0).sum()), 1)
        p = np.maximum(self.used.sum(axis=0), 1)
        return np.array(p * (self.blocks - 1) / (self.blocks - p) * stats.f.ppf(shared, p, self.blocks - p))

    def band(self, phi: Float[ndarray, "K p"], confidence: float) -> Float[ndarray, "K n"]:
        """Return half the width of Scheffe's band of theta'phi, in state units per s."""
        variance = np.einsum("kp,npq,kq->kn", phi, self.covariance, phi)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0) * self.quantile(confidence)))

    def distance(
        self, phi: Float[ndarray, "K p"], F: Float[ndarray, "K n"], confidence: float, bias: Float[ndarray, "p n"]
    ) -> Float[ndarray, "K n"]:
        """Return how far x' may be from F, in state units per s: the band, about an estimate off by at most `bias`."""
        return np.asarray(np.abs(phi @ self.theta - F) + self.band(phi, confidence) + np.abs(phi @ bias))


def estimate(windows: Windows, used: Bool[ndarray, "p n"]) -> Estimate:
    """Return the estimate of the equations of which any column is used.

    Raises:
        UnderdeterminedError: an equation has too many columns for so many blocks.
    """
    p, n, nb = len(used), used.shape[1], windows.blocks
    most = int(used.sum(axis=0).max())
    if 2 * most > nb:
        raise UnderdeterminedError(
            f"{most} coefficients an equation and {nb} blocks of data: at least twice as many blocks are needed; "
            "measure longer, or give fewer functions"
        )
    theta, influence = np.zeros((p, n)), np.zeros((n, nb, p))
    agreement, residual, resolved = np.ones(n), np.zeros_like(windows.y), np.ones(n, bool)
    Z = np.linalg.qr(windows.Z / np.maximum(np.linalg.norm(windows.Z, axis=0), 1e-300))[0]
    for i in np.flatnonzero(used.any(axis=0)):
        X = windows.X[:, used[:, i]]
        scale = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
        P = Z.T @ (X / scale)
        inverse = np.linalg.pinv(P, rcond=RESOLVED)
        sizes = np.linalg.svd(P, compute_uv=False)
        resolved[i] = sizes[-1] > RESOLVED * sizes[0]
        own = inverse @ (Z.T @ windows.y[:, i]) / scale
        residual[:, i] = windows.y[:, i] - X @ own
        scores = windows.sums(Z * residual[:, i : i + 1])
        theta[used[:, i], i] = own
        influence[i][:, used[:, i]] = scores @ inverse.T / scale
        agreement[i] = _agreement(scores, P)
    return Estimate(
        theta=theta,
        influence=influence,
        used=used,
        blocks=nb,
        agreement=agreement,
        residual=residual,
        resolved=resolved,
    )


def _agreement(scores: Float[ndarray, "b z"], P: Float[ndarray, "z p"]) -> float:
    """Return the p-value of Hansen's test: instruments left over say the same as those that were needed."""
    over = P.shape[0] - P.shape[1]
    if over <= 0:
        return 1.0
    left = np.linalg.svd(P)[0][:, P.shape[1] :]  # directions of Z that the estimate has not used up
    mine = scores @ left
    nb, total = len(mine), mine.sum(axis=0)
    spread = (mine - mine.mean(axis=0)).T @ (mine - mine.mean(axis=0)) * nb / (nb - 1)
    if nb <= over:
        return 1.0
    statistic = float(total @ np.linalg.pinv(spread) @ total) * (nb - over) / (over * (nb - 1))
    return float(stats.f.sf(statistic, over, nb - over))


def every_second(data: Sequence[Trajectory]) -> Iterator[Trajectory]:
    """Yield runs with every second sample left out, inputs of both halves averaged: a coarser quadrature."""
    for run in data:
        last = len(run) - 1 - (len(run) - 1) % 2
        u = run.u[: last + 1].copy()
        u[:-1:2] = (u[:-1:2] + u[1::2]) / 2
        yield replace(run, t=run.t[: last + 1 : 2], x=run.x[: last + 1 : 2], u=u[::2])
