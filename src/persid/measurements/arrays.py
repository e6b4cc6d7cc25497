"""Measurements in any form that scikit-learn's users have them in -> Trajectories."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.utils.validation import check_array

from persid.errors import DataError
from persid.measurements.trajectories import Trajectories, Trajectory


def as_trajectories(
    X: Any, u: Any = None, t: Any = None, dt: float | int | None = None
) -> tuple[Trajectories, tuple[str, ...]]:
    """Return data in any accepted form as Trajectories, with notes on what had to be assumed.

    Raises:
        DataError: (or scikit-learn's ValueError for a single array) the data cannot be used.
    """
    if isinstance(X, Trajectory):
        X = [X]
    if isinstance(X, Trajectories) or (isinstance(X, list | tuple) and X and isinstance(X[0], Trajectory)):
        if u is not None or t is not None or dt is not None:
            raise DataError("trajectories hold their own inputs and times; u, t and dt go with arrays and tables")
        return (X if isinstance(X, Trajectories) else _from_runs(X)), ()
    notes: tuple[str, ...] = ()
    frames = X if isinstance(X, list | tuple) else [X]
    if frames and all(hasattr(frame, "columns") for frame in frames):
        return _from_frames(list(frames), u, t, dt), notes
    if not (isinstance(X, list | tuple) and X and np.ndim(X[0]) == 2):
        X = check_array(X, dtype=np.float64, ensure_min_samples=2, input_name="X")
    if t is None and dt is None:
        dt, notes = 1.0, ("no times were given; samples are taken to be 1 s apart",)
    return Trajectories.from_arrays(X, u, t=t, dt=dt), notes


def _from_runs(runs: Sequence[Trajectory]) -> Trajectories:
    n, m = runs[0].x.shape[1], runs[0].u.shape[1]
    return Trajectories(tuple(runs), tuple(f"x{i + 1}" for i in range(n)), tuple(f"u{k + 1}" for k in range(m)))


def _from_frames(frames: list[Any], u: Any, t: Any, dt: float | int | None) -> Trajectories:
    import pandas as pd

    if any(column not in frames[0].columns for frame in frames for column in frame.columns):
        raise DataError("the tables of a list need the same columns")
    states = [str(column) for column in frames[0].columns]
    extra = [u] if len(frames) == 1 and not isinstance(u, list | tuple) else (u or [None] * len(frames))
    joined, inputs = [], []
    for k, (frame, more) in enumerate(zip(frames, extra, strict=True)):
        table = more if hasattr(more, "columns") else None if more is None else pd.DataFrame(np.asarray(more))
        if table is not None and len(table) != len(frame):
            raise DataError(f"u has {len(table)} rows but x has {len(frame)}; give one input per state sample")
        inputs = [] if table is None else [c if isinstance(c, str) else f"u{c + 1}" for c in table.columns]
        frame = frame.set_axis(states, axis=1)
        if t is not None:
            frame = frame.set_axis(pd.Index(np.asarray(t if len(frames) == 1 else t[k], float), name="t"), axis=0)
        joined.append(frame if table is None else frame.assign(**dict(zip(inputs, table.to_numpy().T, strict=True))))
    timed = t is not None or isinstance(frames[0].index, pd.MultiIndex) or frames[0].index.name in ("t", "time")
    return Trajectories.from_dataframe(joined, states, inputs, dt=None if timed else (dt or 1.0))
