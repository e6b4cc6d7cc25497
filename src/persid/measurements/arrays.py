"""Measurements in any form that scikit-learn's users have them in -> Trajectories."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from sklearn.utils.validation import check_array

from persid.errors import DataError
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory


def as_trajectories(X: Any, u: object = None, t: object = None, dt: float | int | None = None) -> Trajectories:
    """Return data in any accepted form as Trajectories.

    Raises:
        DataError: (or scikit-learn's ValueError for a single array) the data cannot be used, or have no times.
    """
    if isinstance(X, Trajectory):
        X = [X]
    if isinstance(X, Trajectories) or (isinstance(X, list | tuple) and X and isinstance(X[0], Trajectory)):
        if u is not None or t is not None or dt is not None:
            raise DataError("trajectories hold their own inputs and times; u, t and dt go with arrays and tables")
        return X if isinstance(X, Trajectories) else _from_runs(X)
    if t is not None and dt is not None:
        raise DataError("both times t and a step dt were given; give one of them")
    if hasattr(X, "data_vars"):
        if u is not None or t is not None or dt is not None:
            raise DataError(
                "a Dataset holds its times; Trajectories.from_xarray(dataset, inputs=[...]) names its inputs"
            )
        return Trajectories.from_xarray(X)
    frames = X if isinstance(X, list | tuple) else [X]
    if frames and all(any(hasattr(one, name) for name in ("columns", "iloc", "dims")) for one in frames):
        from persid.measurements.frames import beside

        return Trajectories.of(beside(list(frames), u, t, dt))
    X, u = (_unmasked(part) for part in (X, u))
    if not (isinstance(X, list | tuple) and X and np.ndim(X[0]) == 2):
        X = check_array(X, dtype=np.float64, ensure_min_samples=2, input_name="X")
    if t is None and dt is None:
        raise DataError("X is an array without times; give the step dt=... or the times t=..., in s")
    return Trajectories.from_arrays(X, u, t=t, dt=dt)


def _unmasked(value: object) -> object:
    """Return a masked array as a plain one, NaN where it is masked: its numbers there are none."""
    if isinstance(value, list | tuple):
        return [_unmasked(part) for part in value]
    if not isinstance(value, np.ma.MaskedArray):
        return value
    return np.ma.filled(np.ma.array(value, dtype=float), np.nan)


def refuse_target(y: object) -> None:
    """Raise DataError where a second argument was given that would be ignored.

    Raises:
        DataError: y is not None.
    """
    if y is not None:
        raise DataError(
            "the second argument, y, would be ignored: X holds the states, and inputs go by name, "
            'fit(X, u=u, dt=0.01); y is the derivative x\', for method="derivative" alone'
        )


def _from_runs(runs: Sequence[Trajectory]) -> Trajectories:
    n, m = runs[0].x.shape[1], runs[0].u.shape[1]
    return Trajectories(tuple(runs), tuple(f"x{i + 1}" for i in range(n)), tuple(f"u{k + 1}" for k in range(m)))
