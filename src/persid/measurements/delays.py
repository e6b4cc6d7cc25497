"""Dead times of inputs: what is recorded now acts later."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.trajectory import Trajectory


def late_runs(
    runs: Sequence[Trajectory], inputs: Sequence[str], delay: Mapping[str, float | int]
) -> tuple[tuple[Trajectory, ...], tuple[str, ...]]:
    """Return runs in which u(t - delay) stands beside x(t), delays in s by the names of inputs, and a note.

    Raises:
        DataError: a name is no input, a delay is no number >= 0, or no run is longer than the delays.
    """
    for name, seconds in delay.items():
        if name not in inputs:
            raise DataError(f"delay= names {name!r}; the inputs are {list(inputs)}")
        if not (np.isfinite(seconds) and seconds >= 0):
            raise DataError(f"delay={seconds!r} of {name}; needed is a number of s, 0 or more")
    late = np.array([float(delay.get(name, 0.0)) for name in inputs])
    if not late.any():
        return tuple(runs), ()
    cut = [_delayed(run, late) for run in runs]
    found = tuple(run for run in cut if len(run) >= 2)
    if not found:
        raise DataError(f"no run is longer than the delay of {late.max():g} s; give longer runs, or another delay=")
    said = ", ".join(f"{name} {seconds:g} s" for name, seconds in delay.items())
    lost = len(cut) - len(found)
    dropped = f"; {lost} shorter run{'s are' if lost > 1 else ' is'} left out" if lost else ""
    note = f"inputs act later than they are recorded: {said}; the first {late.max():g} s of every run go{dropped}"
    return found, (note,)


def _delayed(run: Trajectory, late: ndarray) -> Trajectory:
    """Return a run with late inputs, from the first time at which all of them are known."""
    # Half a step is added, less a little that rounding may cost: a delay of whole steps then meets its sample.
    ahead = 0.499 * float(np.median(np.diff(run.t)))
    kept = np.flatnonzero(run.t - late.max() + ahead >= run.t[0])
    places = [np.searchsorted(run.t, run.t[kept] - seconds + ahead, "right") - 1 for seconds in late]
    u = np.column_stack([run.u[place, k] for k, place in enumerate(places)])
    return Trajectory(run.t[kept], run.x[kept], u)
