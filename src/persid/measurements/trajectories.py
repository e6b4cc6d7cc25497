"""Trajectories: sampled runs of a system, never paired across their ends."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING, Any, SupportsIndex, Unpack, overload

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.delays import late_runs
from persid.measurements.moments import Moments, run_moments
from persid.measurements.options import Reading
from persid.measurements.trajectory import Runs, Trajectory

if TYPE_CHECKING:
    from pandas import DataFrame
    from xarray import Dataset


@dataclass(frozen=True, eq=False)
class Trajectories(Sequence[Trajectory]):
    """A sequence of runs of one system, with the names of its states and inputs and the repairs made while reading.

    Examples:
        >>> data = ps.Trajectories.from_arrays(np.zeros((100, 2)), np.zeros((100, 1)), dt=0.1)
        >>> len(data), data.states, data.inputs
        (1, ('x1', 'x2'), ('u1',))
    """

    runs: tuple[Trajectory, ...]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())

    def __repr__(self) -> str:
        return f"Trajectories({len(self)} runs, {self.samples} samples, states {self.states}, inputs {self.inputs})"

    def __len__(self) -> int:
        return len(self.runs)

    def __iter__(self) -> Iterator[Trajectory]:
        return iter(self.runs)

    @overload
    def __getitem__(self, index: SupportsIndex) -> Trajectory: ...
    @overload
    def __getitem__(self, index: slice) -> "Trajectories": ...
    def __getitem__(self, index: SupportsIndex | slice) -> "Trajectory | Trajectories":
        if isinstance(index, slice):
            return Trajectories(self.runs[index], self.states, self.inputs, self.notes)
        return self.runs[index]

    def __post_init__(self) -> None:
        if not self.runs:
            raise DataError("no trajectory was given; at least one run of two samples is needed")
        if {(run.x.shape[1], run.u.shape[1]) for run in self.runs} != {(len(self.states), len(self.inputs))}:
            raise DataError(f"every run needs {len(self.states)} states and {len(self.inputs)} inputs, as named")

    @classmethod
    def of(cls, found: Runs) -> "Trajectories":
        """Return the trajectories of runs that were read from tables."""
        return cls(found.runs, found.states, found.inputs, found.notes)

    @property
    def samples(self) -> int:
        """Number of samples in all runs together."""
        return sum(len(run) for run in self.runs)

    @cached_property
    def moments(self) -> Moments:
        """Ranges, means, spreads and changes of states and inputs, side by side; counted when first asked for."""
        return run_moments(self.runs)

    def split(self, k: int) -> "Trajectories":
        """Cut every run into k consecutive runs of about equal length, so that cross-validation has runs to leave out.

        Raises:
            DataError: a run has fewer than 2 k samples.
        """
        shortest = min(len(run) for run in self.runs)
        if k < 1 or shortest < 2 * k:
            raise DataError(
                f"split({k}) needs k >= 1 and runs of at least {2 * k} samples; the shortest has {shortest}"
            )
        pieces = []
        for run in self.runs:
            ends = np.linspace(0, len(run), k + 1).astype(int)
            pieces += [run[a:b] for a, b in pairwise(ends)]
        return Trajectories(tuple(pieces), self.states, self.inputs, self.notes)

    def with_inputs(self, names: Sequence[str]) -> "Trajectories":
        """Return the same runs with some of their inputs alone, in the order of `names`.

        Raises:
            DataError: an input is not there.
        """
        if tuple(names) == self.inputs:
            return self
        absent = [name for name in names if name not in self.inputs]
        if absent:
            raise DataError(f"there is no input {absent[0]!r}; the inputs are {list(self.inputs)}")
        kept = [self.inputs.index(name) for name in names]
        runs = tuple(replace(run, u=run.u[:, kept]) for run in self)
        return Trajectories(runs, self.states, tuple(names), self.notes)

    def delayed(self, delay: Mapping[str, float | int]) -> "Trajectories":
        """Return data in which u(t - delay) stands beside x(t); delays in s, by the names of inputs.

        Every run loses its beginning, for which the earlier inputs are not known. Between samples the nearest counts.

        Raises:
            DataError: a name is no input, a delay is no number >= 0, or no run is longer than the delays.

        Examples:
            >>> data = ps.Trajectories.from_arrays(np.zeros((5, 1)), np.arange(5.0), dt=0.1)
            >>> data.delayed({"u1": 0.2})[0].u[:, 0].tolist()
            [0.0, 1.0, 2.0]
        """
        runs, notes = late_runs(self.runs, self.inputs, delay)
        return replace(self, runs=runs, notes=(*self.notes, *notes))

    @classmethod
    def from_arrays(
        cls,
        x: Any,
        u: Any = None,
        *,
        t: Any = None,
        dt: float | int | None = None,
        states: Sequence[str] | None = None,
        inputs: Sequence[str] | None = None,
    ) -> "Trajectories":
        """Return the trajectories of arrays x (N, n), u (N, m), t (N,) in s or a step dt in s; lists mean several runs.

        Times may be dates, too; they become s since the first.

        Raises:
            DataError: shapes do not fit, a number is not finite, or times do not increase; the message says which.
        """
        many = isinstance(x, list | tuple) and len(x) > 0 and np.ndim(x[0]) >= 1 and _is_run(x[0])
        xs, us, ts = (value if many else [value] for value in (x, u, t))
        us, ts = ([None] * len(xs) if value is None else list(value) for value in (us, ts))
        if not len(xs) == len(us) == len(ts):
            raise DataError(f"x has {len(xs)} runs, u {len(us)} and t {len(ts)}; give one of each for every run")
        ts, notes = _seconds(ts)
        runs = tuple(_run(f"run {i + 1}", *parts, dt) for i, parts in enumerate(zip(xs, us, ts, strict=True)))
        n, m = runs[0].x.shape[1], runs[0].u.shape[1] if runs else 0
        return cls(runs, _names("states", states, "x", n), _names("inputs", inputs, "u", m), notes)

    @classmethod
    def from_dataframe(
        cls,
        frame: "DataFrame | Sequence[DataFrame]",
        states: Sequence[Hashable] | None = None,
        inputs: Sequence[Hashable] = (),
        **reading: Unpack[Reading],
    ) -> "Trajectories":
        """Return the trajectories of one DataFrame or several; an index of two levels is (episode, time).

        Time is a column or an index that is named like one or holds dates. `states` defaults to all columns that are
        neither inputs nor time. `time`, `dt` (s), `gap` (s), `missing`, `na`, `run` and `delay` are those of
        `persid.read_measurements`.

        Raises:
            DataError: as for `persid.read_csv`, naming row and column.
        """
        from persid.measurements.frames import runs_of_frames

        return cls.of(runs_of_frames(frame, states, inputs, **reading))

    def to_dataframe(self) -> "DataFrame":
        """Return one table of states and inputs with the index (run, t), t in s; `from_dataframe` reads it back."""
        from persid.measurements.frames import to_dataframe

        return to_dataframe(self.runs, [*self.states, *self.inputs])

    @classmethod
    def from_xarray(
        cls,
        dataset: "Dataset",
        states: Sequence[str] | None = None,
        inputs: Sequence[str] = (),
        *,
        time: str | None = None,
        run: str | None = None,
    ) -> "Trajectories":
        """Return the trajectories of an xarray.Dataset with one variable a state and input.

        `time` names the dimension whose coordinates are times in s (default: the one named t or time), `run` the
        dimension of the runs where there are several. Then times at which a run holds no number at all are left out,
        and noted: runs of different times are filled up with them.

        Raises:
            DataError: dimensions or variables do not fit, or as for `persid.read_csv`.
            ImportError: xarray is not installed.
        """
        from persid.measurements.frames import from_xarray

        return cls.of(from_xarray(dataset, states, inputs, time, run))

    def to_xarray(self) -> "Dataset":
        """Return an xarray.Dataset over (run, t), t in s; where the runs have different times, the rest is NaN.

        Raises:
            ImportError: xarray is not installed.
        """
        from persid.measurements.frames import to_xarray

        return to_xarray(self.runs, [*self.states, *self.inputs])


def _seconds(ts: Sequence[object]) -> tuple[list[object], tuple[str, ...]]:
    """Return the times of all runs in s, and what was done to them."""
    if all(t is None for t in ts):
        return list(ts), ()
    from persid.measurements.times import in_seconds

    pairs = [in_seconds(t) for t in ts if t is not None]
    found = iter(t for t, _ in pairs)
    notes = tuple(dict.fromkeys(f"times: {said}" for _, said in pairs if said))
    return [None if t is None else next(found) for t in ts], notes


def _is_run(value: object) -> bool:
    return getattr(value, "ndim", None) == 2 or (isinstance(value, list) and np.ndim(value) == 2)


def _run(where: str, x: object, u: object, t: object, dt: float | int | None) -> Trajectory:
    x = _numbers(where, "x", x)
    if x.ndim != 2 or len(x) < 2:
        raise DataError(f"{where}: x has shape {x.shape}; needed is (N, n) with at least two samples, one a row")
    u = np.zeros((len(x), 0)) if u is None else _numbers(where, "u", u)
    u = u[:, None] if u.ndim == 1 else u
    if u.ndim != 2 or len(u) != len(x):
        hint = "give one input per state sample (the last one is unused)"
        raise DataError(f"{where}: u has {len(u)} rows but x has {len(x)}; {hint}")
    return Trajectory(sample_times(where, t, dt, len(x)), x, u)


def sample_times(where: str, t: object, dt: float | int | None, count: int) -> Float[ndarray, " N"]:
    """Return the sample times in s, given or k dt; raise DataError unless they increase."""
    if (t is None) == (dt is None):
        raise DataError(f"{where}: give either the times t or the step dt, in s")
    if dt is not None:
        if not (np.isfinite(dt) and dt > 0):
            raise DataError(f"{where}: dt = {dt}; needed is a positive step in s")
        return np.arange(count) * float(dt)
    times = _numbers(where, "t", t)
    if times.shape != (count,):
        raise DataError(f"{where}: t has shape {times.shape} but there are {count} samples; give one time per sample")
    back = np.flatnonzero(np.diff(times) <= 0)
    if len(back):
        k = int(back[0])
        now, before = float(times[k + 1]), float(times[k])
        what = "is repeated" if now == before else f"comes before {before!r}"
        raise DataError(f"{where}: sample {k + 1} has time {now!r}, which {what}; times in s must increase")
    return times


def _numbers(where: str, name: str, value: Any) -> ndarray:
    try:
        if np.iscomplexobj(value):
            raise TypeError
        array: ndarray = np.ma.filled(np.ma.array(value, dtype=float), np.nan)
    except (TypeError, ValueError):
        raise DataError(f"{where}: {name} is not an array of real numbers") from None
    bad = np.argwhere(~np.isfinite(array))
    if len(bad):
        place = ", ".join(str(int(k)) for k in bad[0])
        raise DataError(f"{where}: {name}[{place}] is {array[tuple(bad[0])]}; every number must be finite")
    array.setflags(write=False)
    return array


def _names(what: str, names: Sequence[str] | None, letter: str, count: int) -> tuple[str, ...]:
    names = [f"{letter}{i + 1}" for i in range(count)] if names is None else list(names)
    if len(names) != count or len(set(names)) != count:
        raise DataError(f"{what} needs {count} different names, not {names}")
    return tuple(str(name) for name in names)
