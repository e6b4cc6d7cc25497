"""The latent state at the start of a run, from the outputs measured at its first samples.

What is sought is the most likely x0: with r the difference of simulated and measured outputs,

    minimise  sum |r_k / noise|^2 + (x0 - x_mean)' x_cov^-1 (x0 - x_mean)

where x_mean and x_cov tell how the states were spread when the model was identified. The second part decides only what
the first samples do not tell. Gauss-Newton: the model is linearised about each estimate.
"""

from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import ModelError
from persid.models.drift import drift
from persid.models.steps import forcing, substeps, swept

if TYPE_CHECKING:
    from persid.models.outputs import OutputModel

UNKNOWN_NOISE = 1e-3  # of the size of the outputs, where a model does not say what is measured about it
FAR = 1e12  # what a run that left all bounds counts as, in units of the noise
DIFFERENCE = 1e-5  # of the units of the states, for the linearisation
STARTS = 8  # about x_mean, where the output map may hide a sign


def estimate(
    model: "OutputModel", t: Float[ndarray, " N"], u: Float[ndarray, "N m"] | None, y: Any
) -> Float[ndarray, " n"]:
    """Return the state at t[0]; see `OutputModel.estimate_state`."""
    from scipy.optimize import least_squares

    y = _measured(model, t, y)
    root, noise, mean = _spread(model, y.size), _noise(model, y), _mean(model)
    prior = np.eye(len(mean)) if model.x_cov is not None else np.zeros((0, len(mean)))

    def misses(v: ndarray) -> ndarray:
        return residuals(v[None])[0]

    def residuals(V: ndarray) -> ndarray:
        """Return one row for each of many candidates x_mean + root v."""
        apart = (_outputs(model, mean + V @ root.T, t[: len(y)], u) - y) / noise
        return np.hstack([np.clip(np.nan_to_num(apart, nan=FAR), -FAR, FAR).reshape(len(V), -1), V @ prior.T])

    def slopes(v: ndarray) -> ndarray:
        found = residuals(v + DIFFERENCE * np.vstack([np.eye(len(v)), -np.eye(len(v))]))
        return (found[: len(v)] - found[len(v) :]).T / (2 * DIFFERENCE)

    found = [least_squares(misses, v, slopes) for v in _starts(model)]
    return mean + root @ min(found, key=lambda result: float(result.cost)).x


def _outputs(model: "OutputModel", X: Float[ndarray, "S n"], t: ndarray, u: ndarray | None) -> Float[ndarray, "S k l"]:
    """Return what many states at t[0] give at the times t."""
    dt = np.diff(t)
    first, last = forcing(model.dynamics, u, model.hold, len(t))
    steps = substeps(model.dynamics, float(dt.max(initial=0.0)))
    with np.errstate(all="ignore"):
        states = swept(drift(model.dynamics), X, dt[:, None, None], (first[:, None], last[:, None]), steps)
        inputs = None if u is None else np.broadcast_to(u[: len(t), None], (len(t), len(X), model.dynamics.m))
        return model.output(states, inputs).swapaxes(0, 1)


def _measured(model: "OutputModel", t: ndarray, y: Any) -> ndarray:
    y, count = np.asarray(y, float), len(model.outputs)
    y = y[:, None] if y.ndim == 1 and count == 1 else y
    if y.ndim != 2 or y.shape[1] != count or not 1 <= len(y) <= len(t) or not np.isfinite(y).all():
        raise ModelError(
            f"y_init has shape {y.shape}; needed are finite outputs (k, {count}) at the first k of {len(t)} times"
        )
    return y


def _mean(model: "OutputModel") -> ndarray:
    return model.dynamics.x_ref if model.x_mean is None else model.x_mean


def _spread(model: "OutputModel", given: int) -> Float[ndarray, "n n"]:
    """Return a root of x_cov: what a unit of v means; 1 where nothing is known of the states."""
    n = model.dynamics.n
    if model.x_cov is None:
        if given < n:
            raise ModelError(
                f"y_init holds {given} numbers and the model has {n} latent states and no x_cov; give at least {n}"
            )
        return np.eye(n)
    sizes, directions = np.linalg.eigh(model.x_cov)
    return directions * np.sqrt(np.maximum(sizes, 1e-9 * sizes.max()))


def _noise(model: "OutputModel", y: ndarray) -> ndarray:
    size = np.abs(y - y.mean(axis=0)).max(axis=0) + 1e-3 * np.abs(y).max(axis=0)
    floor = np.where(size > 0, size, 1.0) * 1e-6  # a noise of zero would leave nothing but the outputs
    return np.maximum(UNKNOWN_NOISE * 1e6 * floor if model.noise is None else model.noise, floor)


def _starts(model: "OutputModel") -> list[ndarray]:
    """Return where Gauss-Newton sets out: x_mean and, behind an output map, states about it as well."""
    n = model.dynamics.n
    more = 0 if model.output_map is None else STARTS
    return [np.zeros(n), *np.random.default_rng(0).normal(size=(more, n))]
