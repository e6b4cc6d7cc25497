"""Strides: every q-th sample of a record, as a model with steps of q samples sees it."""

import numpy as np
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory

SPREAD = 1e-3  # of a step, by which sampling steps may differ


def strided(data: Trajectories, stride: int) -> Trajectories:
    """Return every stride-th sample from the first on, with the mean of the inputs until the next one.

    Inputs that are held over whole strides are exact; of others the mean is what counts for a slow plant.

    Raises:
        DataError: no run is longer than a stride.
    """
    if stride == 1:
        return data
    runs = tuple(_strided(run, stride) for run in data if len(run) > stride)
    if not runs:
        longest = max(len(run) for run in data)
        raise DataError(f"stride={stride} needs a run of more than {stride} samples; the longest has {longest}")
    return Trajectories(runs, data.states, data.inputs, data.notes)


def at_steps(data: Trajectories, dt: float) -> Trajectories:
    """Return measurements at the steps of a model, dt in s: a whole number of samples each.

    Raises:
        DataError: dt is no multiple of the sampling step, or the samples are not equally spaced.
    """
    spacing = np.concatenate([np.diff(run.t) for run in data])
    ratio = dt / float(spacing.mean())
    stride = max(1, round(ratio))
    if abs(ratio - stride) > SPREAD * stride or np.ptp(spacing) > SPREAD * spacing.max():
        raise DataError(
            f"the model goes in steps of {dt:.6g} s and the samples are {spacing.min():.6g} to {spacing.max():.6g} s "
            "apart; needed are equal ones, a whole number of them in a step"
        )
    return strided(data, stride)


def _strided(run: Trajectory, stride: int) -> Trajectory:
    kept = slice(None, None, stride)
    return Trajectory(run.t[kept], run.x[kept], block_means(run.u, stride)[kept])


def block_means(u: ndarray, stride: int) -> ndarray:
    """Return the mean of each sample's input and the stride - 1 after it, of fewer at the end."""
    sums = np.vstack([np.zeros((1, u.shape[1])), np.cumsum(u, axis=0)])
    first = np.arange(len(u))
    last = np.minimum(first + stride, len(u))
    return np.asarray((sums[last] - sums[first]) / (last - first)[:, None])


def side_by_side(data: Trajectories, stride: int) -> Trajectories:
    """Return runs as `strided`, each sample beside the stride - 1 after it, with the mean inputs from each on.

    Rows of a sample that the end of a run cuts short end in NaN.
    """
    places = range(1, stride + 1)
    runs = tuple(_side_by_side(run, stride) for run in data if len(run) > stride or stride == 1)
    states, inputs = (tuple(f"{name}+{o}" for o in places for name in names) for names in (data.states, data.inputs))
    return Trajectories(runs, states, inputs, data.notes)


def _side_by_side(run: Trajectory, stride: int) -> Trajectory:
    t = run.t[::stride]
    more = stride * len(t) - len(run)
    wide = (np.pad(part, ((0, more), (0, 0)), constant_values=np.nan) for part in (run.x, block_means(run.u, stride)))
    x, u = (part.reshape(len(t), stride * part.shape[1]) for part in wide)
    return Trajectory(t, x, u)
