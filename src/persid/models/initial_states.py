"""The latent state at the start of a run, from the outputs measured at its first samples.

What is sought is the most likely x0: with r the difference of simulated and measured outputs,

    minimise  sum |r_k / noise|^2 + (x0 - x_mean)' x_cov^-1 (x0 - x_mean)

where x_mean and x_cov tell how the states were spread when the model was identified. The second part decides only what
the first samples do not tell. Gauss-Newton: the model is linearised about each estimate.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import ModelError
from persid.models.output_equation import OutputEquation
from persid.models.steps import forcing, substeps, swept

UNKNOWN_NOISE = 1e-3  # of the size of the outputs, where a model does not say what is measured about it
FAR = 1e12  # what a run that left all bounds counts as, in units of the noise
DIFFERENCE = 1e-5  # of the units of the states, for the linearisation
STARTS = 8  # about x_mean, where the output map may hide a sign


@dataclass(frozen=True, eq=False)
class Known:
    """What is known before: how outputs come about and are measured, how inputs run, how the states were spread."""

    equation: OutputEquation
    hold: str
    noise: Float[ndarray, " l"] | None
    x_mean: Float[ndarray, " n"] | None
    x_cov: Float[ndarray, "n n"] | None


def estimate(known: Known, t: Float[ndarray, " N"], u: Float[ndarray, "N m"] | None, y: object) -> Float[ndarray, " n"]:
    """Return the state at t[0]; see `OutputModel.estimate_state`."""
    from scipy.optimize import least_squares

    y = _measured(known, t, y)
    root, noise, mean = _spread(known, y.size), _noise(known, y), _mean(known)
    prior = np.eye(len(mean)) if known.x_cov is not None else np.zeros((0, len(mean)))

    def misses(v: ndarray) -> ndarray:
        return np.asarray(residuals(v[None])[0])

    def residuals(V: ndarray) -> ndarray:
        """Return one row for each of many candidates x_mean + root v."""
        apart = (_outputs(known, mean + V @ root.T, t[: len(y)], u) - y) / noise
        return np.hstack([np.clip(np.nan_to_num(apart, nan=FAR), -FAR, FAR).reshape(len(V), -1), V @ prior.T])

    def slopes(v: ndarray) -> ndarray:
        found = residuals(v + DIFFERENCE * np.vstack([np.eye(len(v)), -np.eye(len(v))]))
        return np.asarray((found[: len(v)] - found[len(v) :]).T / (2 * DIFFERENCE))

    found = [least_squares(misses, v, slopes) for v in _starts(known)]
    return mean + root @ min(found, key=lambda result: float(result.cost)).x


def _outputs(known: Known, X: Float[ndarray, "S n"], t: ndarray, u: ndarray | None) -> Float[ndarray, "S k l"]:
    """Return what many states at t[0] give at the times t."""
    dt = np.diff(t)
    first, last = forcing(known.equation.field, u, known.hold, len(t))
    steps = substeps(known.equation.field, float(dt.max(initial=0.0)))
    with np.errstate(all="ignore"):
        states = swept(known.equation.field.drift(), X, dt[:, None, None], (first[:, None], last[:, None]), steps)
        inputs = None if u is None else np.broadcast_to(u[: len(t), None], (len(t), len(X), known.equation.field.m))
        return known.equation.values(states, inputs).swapaxes(0, 1)


def _measured(known: Known, t: ndarray, y: object) -> ndarray:
    found, count = np.asarray(y, float), len(known.equation.outputs)
    found = found[:, None] if found.ndim == 1 and count == 1 else found
    shape = found.shape
    if found.ndim != 2 or shape[1] != count or not 1 <= shape[0] <= len(t) or not np.isfinite(found).all():
        raise ModelError(
            f"y_init has shape {shape}; needed are finite outputs (k, {count}) at the first k of {len(t)} times"
        )
    return found


def _mean(known: Known) -> ndarray:
    return known.equation.field.x_ref if known.x_mean is None else known.x_mean


def _spread(known: Known, given: int) -> Float[ndarray, "n n"]:
    """Return a root of x_cov: what a unit of v means; 1 where nothing is known of the states."""
    n = known.equation.field.n
    if known.x_cov is None:
        if given < n:
            raise ModelError(
                f"y_init holds {given} numbers and the model has {n} latent states and no x_cov; give at least {n}"
            )
        return np.eye(n)
    sizes, directions = np.linalg.eigh(known.x_cov)
    return np.asarray(directions * np.sqrt(np.maximum(sizes, 1e-9 * sizes.max())))


def _noise(known: Known, y: ndarray) -> ndarray:
    size = np.abs(y - y.mean(axis=0)).max(axis=0) + 1e-3 * np.abs(y).max(axis=0)
    floor = np.where(size > 0, size, 1.0) * 1e-6  # a noise of zero would leave nothing but the outputs
    return np.maximum(UNKNOWN_NOISE * 1e6 * floor if known.noise is None else known.noise, floor)


def _starts(known: Known) -> list[ndarray]:
    """Return where Gauss-Newton sets out: x_mean and, behind an output map, states about it as well."""
    n = known.equation.field.n
    more = 0 if known.equation.output_map is None else STARTS
    return [np.zeros(n), *np.random.default_rng(0).normal(size=(more, n))]
