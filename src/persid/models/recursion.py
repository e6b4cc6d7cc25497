"""Runs of models in discrete time: one evaluation of the right side a step, stopped at a divergence."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import ModelError
from persid.measurements.trajectory import Trajectory
from persid.models.integration import STATE_CAP
from persid.models.vector_field import VectorField

SPREAD = 1e-6  # of a step, by which given times may miss the model's steps


def refuse_other_steps(t: Float[ndarray, " N"], dt: float) -> None:
    """Refuse times that are not one step of the model apart.

    Raises:
        ModelError: they are not; the message names the first.
    """
    steps = np.diff(t)
    k = int(np.argmax(np.abs(steps - dt)))
    if abs(steps[k] - dt) > SPREAD * dt + np.spacing(np.abs(t).max()) * 4:
        raise ModelError(
            f"t goes from {t[k]:.9g} to {t[k + 1]:.9g} s; the model goes in steps of {dt:.9g} s: give t = t0 + k dt"
        )


def iterate(
    field: VectorField, x0: Float[ndarray, " n"], t: Float[ndarray, " N"], u: Callable[[float], object] | ndarray | None
) -> Trajectory:
    """Return the run from x0, one sample a step; see `PersidskiiModel.simulate`."""
    held = field.sampled(t, u)
    force, step = field.b + (held - field.u_ref) @ field.B.T, field.drift()
    cap = STATE_CAP * (1 + float(np.abs(x0).max() + np.abs(field.x_ref).max()))
    states = np.empty((len(t), field.n))
    states[0] = x0
    with np.errstate(all="ignore"):
        for k in range(1, len(t)):
            states[k] = step(states[k - 1]) + force[k - 1]
            if not np.abs(states[k]).max() < cap:
                return Trajectory(t[:k], states[:k], held[:k], diverged_at=float(t[k]))
    return Trajectory(t, states, held)
