"""Trajectories with labels: to and from pandas DataFrames and xarray Datasets."""

from collections.abc import Hashable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from persid._libraries import library
from persid.errors import DataError
from persid.measurements.runs import runs_of_tables
from persid.measurements.tables import Columns, Table
from persid.measurements.times import holds_dates, is_clock
from persid.measurements.trajectory import Runs, Trajectory

if TYPE_CHECKING:
    from xarray import Dataset


def runs_of_frames(
    frame: pd.DataFrame | Sequence[pd.DataFrame],
    states: Sequence[Hashable] | None,
    inputs: Sequence[Hashable],
    *,
    time: str | None = None,
    dt: float | int | None = None,
    gap: float | int | None = None,
    missing: str = "error",
    na: Sequence[object] = (),
    run: str | None = None,
    delay: Mapping[str, float | int] | None = None,
) -> Runs:
    """Return the runs of DataFrames; see `Trajectories.from_dataframe`."""
    frames = [frame] if isinstance(frame, pd.DataFrame) else list(frame)
    if not frames or not all(isinstance(item, pd.DataFrame) for item in frames):
        raise DataError("a DataFrame, or a list of them, is needed")
    known = [_known_names(item) for item in frames]
    wanted = None if states is None else [known[0].get(name, str(name)) for name in states]
    acting, frames = [known[0].get(name, str(name)) for name in inputs], [_flat(item) for item in frames]
    tables = [table for i, item in enumerate(frames) for table in _episodes(f"table {i + 1}", item, time, dt)]
    notes: tuple[str, ...] = ()
    if wanted is None:
        table = tables[0].frame
        free = [name for name in table if str(name) not in (*acting, time, run)]
        clocks = [name for name in free if is_clock(name) or holds_dates(table[name])]
        wanted = [str(name) for name in free if name not in clocks]
        notes = tuple(
            f"the column {str(name)!r} is taken as a time, not as a state"
            for name in clocks if name in frames[0].columns
        )  # fmt: skip
    columns = Columns.of(
        states=wanted, inputs=acting, time=time, dt=dt, gap=gap, missing=missing, na=na, run=run, delay=delay
    )
    data = runs_of_tables(iter(tables), columns)
    return replace(data, notes=(*data.notes, *notes))


def _flat(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a table whose columns have names of one level: the last one where it tells them apart, else all."""
    if not isinstance(frame.columns, pd.MultiIndex):
        return frame
    parts = [[str(level) for level in column if str(level)] for column in frame.columns]
    last = [part[-1] for part in parts]
    names = last if len(set(last)) == len(last) else [".".join(part) for part in parts]
    return frame.set_axis(names, axis=1)


def _known_names(frame: pd.DataFrame) -> dict[Hashable, str]:
    """Return the names of columns of several levels, by their levels and by these joined with points."""
    if not isinstance(frame.columns, pd.MultiIndex):
        return {}
    named = dict(zip(frame.columns, _flat(frame).columns, strict=True))
    return named | {".".join(str(level) for level in column if str(level)): name for column, name in named.items()}


def beside(frames: Sequence[Any], u: Any, t: Any, dt: float | int | None) -> Runs:
    """Return the runs of frames of states, with inputs u (frames or arrays) and times t or a step dt in s.

    Inputs with an index of their own are put beside the states by it. A column or an index named t or time is the time.

    Raises:
        DataError: tables do not fit together, or there are no times.
    """
    frames = [_as_frame(frame, "x") for frame in frames]
    if any(list(frame.columns) != list(frames[0].columns) for frame in frames):
        raise DataError("the tables of a list need the same columns")
    many = isinstance(u, list | tuple) and len(frames) > 1
    extra = list(u) if many else [u] * (1 if len(frames) == 1 else 0) or [None] * len(frames)
    clocks = list(t) if len(frames) > 1 and t is not None else [t] * len(frames)
    if not len(frames) == len(extra) == len(clocks):
        raise DataError(f"X has {len(frames)} tables, u {len(extra)} and t {len(clocks)}; give one of each for each")
    notes: list[str] = []
    inputs: list[str] = []
    joined = []
    for frame, more, clock in zip(frames, extra, clocks, strict=True):
        if more is not None:
            table = _aligned(_timed(frame), _timed(_as_frame(more, "u")), notes)
            inputs = [str(column) for column in table.columns if not is_clock(column)]
            frame = frame.assign(**dict(zip(inputs, table[inputs].to_numpy().T, strict=True)))
        if clock is not None:
            frame = frame.drop(columns=[c for c in frame.columns if is_clock(c)])
            frame = frame.set_axis(pd.Index(clock, name="t"), axis=0)
        joined.append(frame)
    data = runs_of_frames(joined, None, inputs, dt=dt)
    return replace(data, notes=(*data.notes, *dict.fromkeys(notes)))


def _as_frame(value: object, letter: str) -> pd.DataFrame:
    """Return a table of a frame, a series or an array, columns without a name called x1, x2, ... or u1, u2, ..."""
    if isinstance(value, pd.Series):
        value = value.to_frame(None if value.name is None else str(value.name))
    if not isinstance(value, pd.DataFrame):
        value = value.to_pandas() if hasattr(value, "to_pandas") else pd.DataFrame(np.asarray(value))
    frame = _flat(value)
    names = [c if isinstance(c, str) else f"{letter}{k + 1}" for k, c in enumerate(frame.columns)]
    return frame.set_axis(names, axis=1)


def _timed(frame: pd.DataFrame) -> pd.DataFrame:
    """Return a table whose column of times is its index, where it has no other."""
    clocks = [column for column in frame.columns if is_clock(column)]
    return frame.set_index(clocks[0]) if clocks and isinstance(frame.index, pd.RangeIndex) else frame


def _aligned(frame: pd.DataFrame, inputs: pd.DataFrame, notes: list[str]) -> pd.DataFrame:
    """Return the inputs in the order of the states: by their index, by position where they have none."""
    if len(inputs) != len(frame):
        raise DataError(f"u has {len(inputs)} rows but x has {len(frame)}; give one input per state sample")
    if inputs.index.equals(frame.index) or any(isinstance(one.index, pd.RangeIndex) for one in (frame, inputs)):
        return inputs
    if set(inputs.index) == set(frame.index) and inputs.index.is_unique:
        notes.append("the rows of u were put in the order of those of x, by their index")
        return inputs.reindex(frame.index)
    raise DataError(
        f"u and x have different indexes (u begins at {inputs.index[0]}, x at {frame.index[0]}); give both the same, "
        "or u.to_numpy() where the rows match by position"
    )


def _episodes(name: str, frame: pd.DataFrame, time: str | None, dt: float | int | None) -> Iterator[Table]:
    """One table per episode of an (episode, time) index; an index that is a time becomes a column."""
    if isinstance(frame.index, pd.MultiIndex):
        if frame.index.nlevels != 2:
            raise DataError(f"{name}: an index of {frame.index.nlevels} levels; needed are two, (episode, time)")
        for episode in frame.index.get_level_values(0).unique():
            part = frame.loc[[episode]].droplevel(0)
            yield _frame_table(f"{name}, episode {episode}", part.rename_axis(time or "t"), dt is None)
    else:
        yield _frame_table(name, frame, dt is None and is_index_a_clock(frame, time))


def is_index_a_clock(frame: pd.DataFrame, time: str | None) -> bool:
    """Whether the index of a table is its time: the one that was named, or one named like a time, or of dates."""
    index = frame.index
    if time is not None:
        return index.name == time and time not in frame.columns
    return holds_dates(index) or (index.name is not None and is_clock(index.name))


def _frame_table(name: str, frame: pd.DataFrame, use_index: bool) -> Table:
    index = frame.index
    flat = frame.rename_axis(str(index.name or "t")).reset_index() if use_index else frame.reset_index(drop=True)
    return Table(name, flat, lambda k: f"row {_short(index[k])}")


def _short(label: object) -> object:
    """Return a label of a row without the last digits of what was added up: 5.8, not 5.800000000000001."""
    return float(f"{label:.12g}") if isinstance(label, float) else label


def to_dataframe(runs: Sequence[Trajectory], names: list[str]) -> pd.DataFrame:
    """Return one table with the index (run, t); see `Trajectories.to_dataframe`."""
    frames = [_frame(run, names) for run in runs]
    return pd.concat(frames, keys=range(len(frames)), names=["run", "t"])


def _frame(run: Trajectory, names: list[str]) -> pd.DataFrame:
    return pd.DataFrame(np.hstack([run.x, run.u]), index=pd.Index(run.t, name="t"), columns=names)


def to_xarray(runs: Sequence[Trajectory], names: list[str]) -> "Dataset":
    """Return a Dataset over (run, t); see `Trajectories.to_xarray`."""
    library("xarray", "interop")
    dataset = to_dataframe(runs, names).to_xarray()
    dataset["t"].attrs["units"] = "s"
    return dataset


def from_xarray(
    dataset: object, states: Sequence[str] | None, inputs: Sequence[str], time: str | None, run: str | None
) -> Runs:
    """Return the runs of a Dataset; see `Trajectories.from_xarray`."""
    xarray = library("xarray", "interop")
    if not isinstance(dataset, xarray.Dataset):
        raise DataError("an xarray.Dataset is needed; a DataArray becomes one by .to_dataset(dim=...)")
    inputs = list(inputs)
    states = [str(name) for name in dataset.data_vars if name not in inputs] if states is None else list(states)
    absent = [name for name in [*states, *inputs] if name not in dataset.data_vars]
    if absent:
        raise DataError(f"there is no variable {absent[0]!r}; the variables are {', '.join(map(str, dataset))}")
    table = dataset[[*states, *inputs]]
    time = _time(table, time)
    frames, notes = [], []
    for k, part in enumerate(_parts(table, time, run)):
        frame = part.to_dataframe()[[*states, *inputs]]
        frames.append(frame.dropna(how="all") if len(table.dims) > 1 else frame)
        if len(frames[-1]) < len(frame):
            notes.append(f"table {k + 1}: {len(frame) - len(frames[-1])} times without any number were left out")
    data = runs_of_frames(frames, states, inputs, time=time)
    return replace(data, notes=(*data.notes, *notes))


def _time(table: "Dataset", time: str | None) -> str:
    dated = [str(name) for name in table.dims if name in table.coords and table.coords[name].dtype.kind in "mM"]
    names = [time] if time is not None else [str(name) for name in table.dims if is_clock(name)] or dated
    if len(names) != 1 or names[0] not in table.dims or names[0] not in table.coords:
        given = ", ".join(map(str, table.dims))
        raise DataError(f"the dimensions are {given}; needed is one with coordinates in s named t or time, or time=...")
    return names[0]


def _parts(table: "Dataset", time: str, run: str | None) -> "Iterator[Dataset]":
    """Yield one Dataset over time a run."""
    others = [str(name) for name in table.dims if name != time]
    if others not in ([], [run] if run else others[:1]):
        raise DataError(f"the dimensions beside {time} are {others}; at most one, that of the runs, can be used")
    yield from (table.isel({others[0]: k}, drop=True) for k in range(table.sizes[others[0]])) if others else [table]
