"""From a linear model to the points at which the nonlinear fits begin."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.linalg import solve_continuous_lyapunov

from persid.identification.outputs.curves import Curves, first_slopes
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.least_squares import Batch, Free, Stable
from persid.identification.outputs.parametrisation import (
    NEAR,
    SLACK,
    Multiplied,
    Shape,
    parameters_beside,
    parameters_of,
)
from persid.identification.outputs.subspace import Linear

GIVING = (NEAR, 0.97)  # norm of U at most, for what makes room for one neuron more
SHIFTS = 1.5  # beta is drawn from +- so many standard deviations of its argument


@dataclass(frozen=True)
class Freedom:
    """Say whether D is fitted, and offsets b: they tell more than d where a mode outlasts the records; and whether
    neurons share one learned curve.
    """

    through: bool
    offset: bool = False
    one_curve: bool = False

    def curves(self, latent: Latent) -> Curves:
        """Return which curves are learnt of these models."""
        return Curves(latent.q, int(latent.F.shape[2]), self.one_curve)

    def mask(self, size: int, latent: Latent, start: int, width: int) -> Bool[ndarray, " size"]:
        """Return which of `size` parameters are free; b is the last column of n rows of that width, from `start`."""
        n, m, l = latent.n, latent.m, latent.O.shape[1]  # noqa: E741
        free = np.asarray(self.through | ~entries_of_feedthrough(size, n, m, l))
        free[start + width * np.arange(1, n + 1) - 1] = self.offset
        return free


def latent_of(linear: Linear, output_map: str | None = None) -> Latent:
    """Return a linear model as a batch of one without neurons."""
    n = len(linear.A)
    W = np.hstack([linear.A, linear.B, linear.b[:, None]])[None]
    O = np.hstack([linear.C, linear.D, linear.d[:, None]])[None]  # noqa: E741
    return Latent(
        W=W,
        V=np.zeros((1, 0, n + 1)),
        O=O,
        x0=linear.x0[None],
        F=np.zeros((1, 0, 0)),
        activation="tanh",
        output_map=output_map,
    )


def stacked(latents: list[Latent]) -> Latent:
    """Return one batch of several."""
    names = ("W", "V", "O", "x0", "F")
    W, V, O, x0, F = (np.concatenate([getattr(latent, name) for latent in latents]) for name in names)  # noqa: E741
    return Latent(W, V, O, x0, F, *latents[0].kind)


def whitened(latent: Latent, mean: Float[ndarray, " n"], cov: Float[ndarray, "n n"]) -> Latent:
    """Return one model in coordinates in which its own states, of this mean and covariance, have mean 0 and unit
    covariance.
    """
    return latent.mapped(_whitening(cov), mean)


def _whitening(cov: Float[ndarray, "n n"]) -> Float[ndarray, "n n"]:
    w, V = np.linalg.eigh(cov)
    return np.asarray((V / np.sqrt(np.maximum(w, 1e-9 * w.max()))) @ V.T)


def with_neurons(
    latent: Latent, q: int, seeds: list[int], effect: float, *, activation: str, hardening: int = 0, pieces: int = 0
) -> Latent:
    """Return a linear model with q random neurons, once for every seed: rows of length 1, effects of that size.

    Learned curves begin as that of tanh.
    """
    n, found = latent.n, []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        R = rng.normal(size=(q, n))
        R /= np.linalg.norm(R, axis=1, keepdims=True)
        V = np.hstack([R, rng.uniform(-SHIFTS, SHIFTS, (q, 1))])[None]
        A1 = effect * rng.normal(size=(1, n, q))
        W = np.concatenate([latent.A, A1, latent.W[:, :, n:]], 2)
        found.append(
            Latent(
                W=W,
                V=V,
                O=latent.O,
                x0=latent.x0,
                F=np.tile(first_slopes(pieces), (1, q, 1)),
                activation=activation,
                output_map=latent.output_map,
                hardening=hardening,
            )
        )
    return stacked(found)


def free_batch(latent: Latent, freedom: Freedom) -> tuple[Free, Batch]:
    """Return the free parametrisation and the point in it of a batch of models."""
    n, q, m, l = latent.n, latent.q, latent.m, latent.O.shape[1]  # noqa: E741
    curves = freedom.curves(latent)
    parts = (latent.W, latent.V, curves.parameters(latent.F), latent.O)
    w = np.concatenate([part.reshape(len(part), -1) for part in parts], 1)
    free = freedom.mask(w.shape[1], latent, 0, n + q + m + 1)
    return Free(n, q, m, l, free, curves), Batch(w, latent.x0.copy(), *latent.kind)


def stable_batch(latent: Latent, freedom: Freedom, kappa: float = 0.0) -> tuple[Stable, Batch, Latent]:
    """Return the stable parametrisation, and the point of models with stable A, their neurons without effect.

    Coordinates are those of the Lyapunov equation of A + kappa/2, in which A + A' + kappa is negative: for each model.

    Raises:
        ValueError: A is not stable, or slower than asked.
    """
    mapped = stacked([_lyapunov_coordinates(latent[k : k + 1], kappa) for k in range(len(latent.W))])
    shape = Shape(latent.n, latent.q, kappa, slack(mapped.A, kappa))
    v = np.array([parameters_of(shape, A, R) for A, R in zip(mapped.A, mapped.R, strict=True)])
    return *stable_point(shape, v, mapped, freedom), mapped


def grown(
    parameters: Free | Stable,
    batch: Batch,
    *,
    mean: Float[ndarray, " n"],
    cov: Float[ndarray, "n n"],
    seeds: Sequence[int],
    hardens: bool,
    freedom: Freedom,
) -> tuple[Free | Stable, Batch]:
    """Return one fitted point with one more random neuron of no effect, for every seed with less and more room for it.

    It is the first where it hardens, else the last. Its row has length 1 where the states, of this mean and covariance,
    are white.
    """
    latent, place = parameters.latent(batch)[0], 0 if hardens else parameters.q
    points = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        row = rng.normal(size=latent.n)
        row = row / np.linalg.norm(row) @ _whitening(cov)
        V = np.insert(latent.V, place, np.append(row, rng.uniform(-SHIFTS, SHIFTS) - row @ mean), 1)
        W = np.insert(latent.W, latent.n + place, 0.0, 2)
        F = np.insert(latent.F, place, latent.F[:, 0], 1)
        points.append(replace(latent, W=W, V=V, F=F, hardening=latent.hardening + hardens))
    if isinstance(parameters, Free):
        return free_batch(stacked(points), freedom)
    shape, had = replace(parameters.shape, q=parameters.q + 1), parameters.proved(batch)
    M, T, idle = np.insert(had.M[0], place, 0.0), np.insert(had.T[0], place, 0.0), np.arange(shape.q) == place
    pairs = [(one, most) for most in GIVING for one in points]
    v = [parameters_beside(shape, Multiplied(one.A[0], one.A1[0], one.R[0], M, T), idle, most) for one, most in pairs]
    return stable_point(shape, np.array(v), stacked([one for one, _ in pairs]), freedom)


def stable_point(shape: Shape, v: Float[ndarray, "K p"], latent: Latent, freedom: Freedom) -> tuple[Stable, Batch]:
    """Return the parametrisation, and the point with parameters v and the other entries of the models."""
    n, m, l = latent.n, latent.m, latent.O.shape[1]  # noqa: E741
    forces = latent.W[:, :, n + latent.q :]
    curves = freedom.curves(latent)
    parts = (forces, latent.V[:, :, -1], curves.parameters(latent.F), latent.O)
    w = np.concatenate([v, *(part.reshape(len(v), -1) for part in parts)], 1)
    free = freedom.mask(w.shape[1], latent, shape.size, m + 1)
    return Stable(shape, m, l, free, curves), Batch(w, latent.x0.copy(), *latent.kind)


def slack(A: Float[ndarray, "K n n"], kappa: float) -> float:
    """Return the multiple of the unit matrix that A gives away: a share of |A|, and less than a slow A has."""
    room = -np.linalg.eigvalsh(A + np.swapaxes(A, 1, 2))[:, -1] - kappa
    return float(min(SLACK * np.abs(np.linalg.eigvals(A)).max(1).min(), room.min() / 4))


def _lyapunov_coordinates(latent: Latent, kappa: float) -> Latent:
    n = latent.n
    A = latent.A[0] + kappa / 2 * np.eye(n)
    if np.linalg.eigvals(A).real.max() >= 0:
        raise ValueError("the linear model is not stable, or slower than the rate that is asked for")
    P = solve_continuous_lyapunov(A.T, -np.eye(n))
    return latent.mapped(np.linalg.cholesky(P * n / np.trace(P)).T, np.zeros(n))


def entries_of_feedthrough(size: int, n: int, m: int, l: int) -> Bool[ndarray, " size"]:  # noqa: E741
    """Return which of `size` parameters are entries of D; (C, D, d) are the last of them."""
    rows = np.zeros((l, n + m + 1), bool)
    rows[:, n : n + m] = True
    return np.concatenate([np.zeros(size - rows.size, bool), rows.ravel()])
