"""Derivatives of measured signals by local polynomials, at any spacing; and states that were not measured."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.identification.koopman import sample_step
from persid.identification.windows import choose_window
from persid.measurements.boxes import box_of
from persid.measurements.moments import BLOCK
from persid.measurements.recordings import Measurements
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory

DEGREE = 3


def local_polynomial(
    t: Float[ndarray, " N"], x: Float[ndarray, "N n"], half_width: int
) -> tuple[Float[ndarray, "N n"], Float[ndarray, "N n"]]:
    """Return smoothed values and derivatives (per s): cubics fitted to 2 half_width + 1 samples around each sample.

    Raises:
        DataError: fewer than 5 samples.
    """
    if len(t) < DEGREE + 2:
        raise DataError(f"a run of {len(t)} samples; a smoothed derivative needs at least {DEGREE + 2}")
    width = min(2 * max(half_width, 2) + 1, len(t))
    first = np.clip(np.arange(len(t)) - width // 2, 0, len(t) - width)
    parts = [_fit(t, x, first[k : k + BLOCK], width, k) for k in range(0, len(t), BLOCK)]
    smooth, slope = (np.concatenate([part[i] for part in parts]) for i in (0, 1))
    return smooth, slope


def _fit(t: ndarray, x: ndarray, first: ndarray, width: int, offset: int) -> tuple[ndarray, ndarray]:
    rows = first[:, None] + np.arange(width)
    s = t[rows] - t[offset : offset + len(first), None]
    reach = np.abs(s).max(axis=1)
    V = (s / reach[:, None])[..., None] ** np.arange(DEGREE + 1)
    coefficients = np.linalg.solve(np.einsum("kwi,kwj->kij", V, V), np.einsum("kwi,kwn->kin", V, x[rows]))
    return coefficients[:, 0], coefficients[:, 1] / reach[:, None]


def embed(data: Trajectories, derivatives: int = 0, delays: int = 0, half_width: int = 2) -> Trajectories:
    """Append smoothed velocities (`derivatives=1`) and copies delayed by 1 ... `delays` samples to the states.

    The states are then named, for a state theta: theta, theta_dot, theta(t-1), theta(t-2) ... in samples.

    Raises:
        DataError: derivatives is neither 0 nor 1, delays is negative, or a run is too short.
    """
    if derivatives not in (0, 1) or delays < 0:
        raise DataError(f"derivatives={derivatives}, delays={delays}; needed are 0 or 1, and a number of samples")
    if not derivatives and not delays:
        return data
    runs = tuple(_embedded(run, derivatives, delays, half_width) for run in data)
    names = list(velocity_names(data.states).values()) if derivatives else []
    if doubled := [name for name in names if name in data.states]:
        raise DataError(
            f"derivatives=1 appends {', '.join(doubled)}, which is a state already; leave it out of the states, or "
            "leave derivatives out"
        )
    names += [f"{name}(t-{k})" for k in range(1, delays + 1) for name in data.states]
    return Trajectories(runs, (*data.states, *names), data.inputs, data.notes)


def embedded(data: Trajectories, derivatives: int = 0, delays: int = 0) -> Trajectories:
    """Return data with smoothed velocities and delayed copies among the states, as a fit appends them.

    Raises:
        DataError: delays need equal steps, or a run is too short.
    """
    if delays:
        sample_step(data)
    return embed(data, derivatives, delays, choose_window(data) if derivatives else 2)


def refuse_constant(data: Measurements, where: str = "") -> None:
    """Raise DataError where no state ever varies; `where` is the file, if it is known."""
    box = box_of(data)
    if (box[:, 0] == box[:, 1]).all():
        names = f"{', '.join(data.states)} never {'varies' if len(data.states) == 1 else 'vary'}"
        place = f"{where}: " if where else ""
        raise DataError(f"{place}{names}: there is nothing to identify; give other columns or data")


def velocity_names(states: Sequence[str]) -> dict[str, str]:
    """Return the names of the velocities that `embed` appends, by those of the states."""
    return {name: f"{name}_dot" for name in states}


def _embedded(run: Trajectory, derivatives: int, delays: int, half_width: int) -> Trajectory:
    if len(run) < delays + 2:
        raise DataError(f"a run of {len(run)} samples cannot hold {delays} delays; at least {delays + 2} are needed")
    parts = [run.x[delays:]]
    if derivatives:
        parts.append(local_polynomial(run.t, run.x, half_width)[1][delays:])
    parts += [run.x[delays - k : len(run) - k] for k in range(1, delays + 1)]
    return Trajectory(run.t[delays:], np.hstack(parts), run.u[delays:])
