"""Trajectories with labels: to and from pandas DataFrames and xarray Datasets."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from persid._libraries import library
from persid.errors import DataError
from persid.measurements.tables import TIME_NAMES
from persid.measurements.trajectories import Trajectories, Trajectory

if TYPE_CHECKING:
    from xarray import Dataset
from persid.measurements.tables import Columns, Table, _assemble


def trajectories_of_frames(
    frame: pd.DataFrame | Sequence[pd.DataFrame],
    states: Sequence[str] | None,
    inputs: Sequence[str],
    time: str | None,
    dt: float | int | None,
) -> Trajectories:
    """Return the trajectories of DataFrames; see `Trajectories.from_dataframe`."""
    frames = [frame] if isinstance(frame, pd.DataFrame) else list(frame)
    if not frames or not all(isinstance(item, pd.DataFrame) for item in frames):
        raise DataError("a DataFrame, or a list of them, is needed")
    tables = [table for i, item in enumerate(frames) for table in _episodes(f"table {i + 1}", item, time, dt)]
    if states is None:
        taken = {*inputs, time, *(() if dt is not None else TIME_NAMES)}
        states = [str(column) for column in tables[0].frame.columns if str(column).strip() not in taken]
    return _assemble(iter(tables), Columns(tuple(states), tuple(inputs), time, dt, np.inf, "error"))


def _episodes(name: str, frame: pd.DataFrame, time: str | None, dt: float | int | None) -> Iterator[Table]:
    """One table per episode of an (episode, time) index; an index named like a time becomes a column."""
    if isinstance(frame.index, pd.MultiIndex):
        if frame.index.nlevels != 2:
            raise DataError(f"{name}: an index of {frame.index.nlevels} levels; needed are two, (episode, time)")
        for episode in frame.index.get_level_values(0).unique():
            part = frame.loc[[episode]].droplevel(0)
            yield _frame_table(f"{name}, episode {episode}", part.rename_axis(time or "t"), dt is None)
    else:
        named = frame.index.name is not None and frame.index.name in ((time,) if time else TIME_NAMES)
        yield _frame_table(name, frame, named and dt is None)


def _frame_table(name: str, frame: pd.DataFrame, use_index: bool) -> Table:
    index = frame.index
    flat = frame.reset_index() if use_index else frame.reset_index(drop=True)
    return Table(name, flat, lambda k: f"row {index[k]}")


def to_dataframe(data: Trajectories) -> pd.DataFrame:
    """Return one table with the index (run, t); see `Trajectories.to_dataframe`."""
    frames = [_frame(run, [*data.states, *data.inputs]) for run in data]
    return pd.concat(frames, keys=range(len(frames)), names=["run", "t"])


def _frame(run: Trajectory, names: list[str]) -> pd.DataFrame:
    return pd.DataFrame(np.hstack([run.x, run.u]), index=pd.Index(run.t, name="t"), columns=names)


def to_xarray(data: Trajectories) -> "Dataset":
    """Return a Dataset over (run, t); see `Trajectories.to_xarray`."""
    library("xarray", "interop")
    dataset = to_dataframe(data).to_xarray()
    dataset["t"].attrs["units"] = "s"
    return dataset


def from_xarray(
    dataset: Any, states: Sequence[str] | None, inputs: Sequence[str], time: str | None, run: str | None
) -> Trajectories:
    """Return the trajectories of a Dataset; see `Trajectories.from_xarray`."""
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
    data = trajectories_of_frames(frames, states, inputs, time, None)
    return replace(data, notes=(*data.notes, *notes))


def _time(table: "Dataset", time: str | None) -> str:
    names = [time] if time is not None else [str(name) for name in table.dims if str(name).lower() in TIME_NAMES]
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
