"""measurements.tables."""

import csv
from collections.abc import Callable, Hashable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.trajectories import Trajectories, Trajectory

TIME_NAMES = ("t", "time")
GAP = 10.0  # a step longer than this many median steps is a gap, not an irregular sample

Paths = str | Path | Sequence[str | Path]


@dataclass(frozen=True)
class Columns:
    """What is taken from a table: names, where the time comes from (a column, or the step dt in s), what ends a run.

    Raises:
        DataError: the question contradicts itself.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    time: str | None
    dt: float | int | None
    gap: float | int | None
    missing: str

    def __post_init__(self) -> None:
        if self.missing not in ("error", "split"):
            raise DataError(f'missing={self.missing!r}; choose "error" or "split"')
        if self.time is not None and self.dt is not None:
            raise DataError("both a time column and a step dt were given; give one of them")
        if self.dt is not None and not (np.isfinite(self.dt) and self.dt > 0):
            raise DataError(f"dt = {self.dt}; needed is a positive step in s")
        if not self.states or len(set(self.names)) != len(self.names):
            given = f"states {list(self.states)} and inputs {list(self.inputs)}"
            raise DataError(f"{given}: at least one state, and no name twice, is needed")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states, then of the inputs."""
        return (*self.states, *self.inputs)


@dataclass(frozen=True)
class Table:
    """One table still as it was read: `label(k)` names data row k the way its owner counts."""

    name: str
    frame: pd.DataFrame
    label: Callable[[int], str]


def _header(path: Path) -> list[str]:
    try:
        with open(path, encoding="utf-8-sig", newline="") as file:
            header = next(csv.reader(file), [])
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise DataError(f"{path}: row 1 is not a header in UTF-8 text: {error}") from None
    if not any(name.strip() for name in header):
        raise DataError(f"{path}: the file is empty; needed is a header with the names of the columns, then the rows")
    if len(header) == 1 and any(mark in header[0] for mark in ";\t"):
        raise DataError(f"{path}: row 1 has no comma but {header[0]!r}; save the table with commas between the columns")
    return header


def _assemble(tables: Iterator[Table], columns: Columns) -> Trajectories:
    runs: list[Trajectory] = []
    notes: list[str] = []
    for table in tables:
        runs += _runs(table, columns, notes)
    return Trajectories(tuple(runs), columns.states, columns.inputs, tuple(notes))


def table_rows(table: Table, columns: Columns, notes: list[str]) -> tuple[ndarray | None, ndarray, ndarray]:
    """Return times in s (None where the step dt gives them), states and inputs, and which rows are complete.

    Raises:
        DataError: a column is missing, a cell is no finite number, or times do not increase.
    """
    time_name = None if columns.dt is not None else _time_name(table, columns)
    names = [*([time_name] if time_name else []), *columns.names]
    found = [_find(table, name) for name in names]
    repaired = [repr(column) for name, column in zip(names, found, strict=True) if column != name]
    if repaired:
        notes.append(f"{table.name}: blanks around the names of columns were ignored: {', '.join(repaired)}")
    values = np.column_stack([_column(table, column, columns.missing == "split") for column in found])
    good = np.isfinite(values).all(axis=1)
    if time_name is None:
        return None, values, good
    check_order(table, time_name, values[:, 0], good)
    return values[:, 0], values[:, 1:], good


def _runs(table: Table, columns: Columns, notes: list[str]) -> list[Trajectory]:
    if len(table.frame) < 2:
        raise DataError(f"{table.name}: {len(table.frame)} rows of data; at least 2 are needed")
    t, values, good = table_rows(table, columns, notes)
    if t is None:
        t = np.arange(len(values)) * float(columns.dt or 0)
    cuts = _cuts(table, t, good, columns.gap, notes)
    n = len(columns.states)
    runs = [Trajectory(t[a:b], values[a:b, :n], values[a:b, n:]) for a, b in cuts if b - a >= 2]
    if len(runs) < len(cuts):
        notes.append(f"{table.name}: {len(cuts) - len(runs)} single sample(s) between gaps were left out")
    if not runs:
        raise DataError(f"{table.name}: no two consecutive complete rows; at least 2 are needed")
    return runs


def _time_name(table: Table, columns: Columns) -> str:
    if columns.time is not None:
        return columns.time
    found = [str(c).strip() for c in table.frame.columns if str(c).strip().lower() in TIME_NAMES]
    found = [name for name in found if name not in columns.names]
    if not found:
        raise DataError(f"{table.name}: no time: name its column (time=, --time) or give the step in s (dt=, --dt)")
    return found[0]


def _column(table: Table, column: Hashable, allow_missing: bool) -> ndarray:
    """Return one column as floats, or raise the error that names its first bad cell."""
    series = table.frame[column]
    numbers = series if pd.api.types.is_numeric_dtype(series) and series.dtype != bool else _parsed(series)
    values = numbers.to_numpy(dtype=float, na_value=np.nan)
    bad = ~np.isfinite(values)
    if allow_missing:
        bad &= ~(pd.isna(series).to_numpy() | _blank(series))
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        raise DataError(f"{table.name}: {table.label(k)}, column {str(column).strip()!r}: {_complaint(series.iloc[k])}")
    return values


def _parsed(series: pd.Series) -> pd.Series:
    texts = series.where(series.map(lambda cell: not isinstance(cell, bool)), "")
    return pd.to_numeric(texts, errors="coerce")


def _blank(series: pd.Series) -> ndarray:
    return series.map(lambda cell: isinstance(cell, str) and not cell.strip()).to_numpy(dtype=bool)


def _complaint(cell: Any) -> str:
    if isinstance(cell, str) and cell.strip():
        return f"{cell!r} is not a number; correct the cell or leave the column out"
    if isinstance(cell, float) and np.isinf(cell):
        return f"{cell} is not finite; correct the cell or cut the row out"
    if pd.isna(cell) or isinstance(cell, str):
        return 'the cell is empty or NaN; fill it, or read with missing="split" to start a new trajectory there'
    return f"{cell!r} is not a finite number"


def _find(table: Table, name: str) -> Hashable:
    columns = list(table.frame.columns)
    matches = [column for column in columns if str(column).strip() == name.strip()]
    exact = [column for column in matches if column == name]
    if len(matches) > 1 and len(exact) != 1:
        raise DataError(
            f"{table.name}: row 1 has {len(matches)} columns named {name!r}; give every column its own name"
        )
    if not matches:
        raise DataError(f"{table.name}: there is no column {name!r}; {_offer(table)}")
    return (exact or matches)[0]


def _offer(table: Table) -> str:
    path = Path(table.name)
    is_csv = path.is_file() and path.suffix != ".parquet"
    return f"the columns are {', '.join(str(name).strip() for name in (_header(path) if is_csv else table.frame))}"


def check_order(table: Table, name: str, t: ndarray, good: ndarray) -> None:
    rows = np.flatnonzero(good)
    back = np.flatnonzero(np.diff(t[rows]) <= 0)
    if len(back):
        k, before = int(rows[back[0] + 1]), float(t[rows[back[0]]])
        what = "is repeated" if t[k] == before else f"comes after {before!r}"
        coarse = "keep one row for each time, or give the step dt where the steps are equal and the clock is too coarse"
        hint = coarse if t[k] == before else "sort the rows by time"
        raise DataError(f"{table.name}: {table.label(k)}, column {name!r}: time {float(t[k])!r} {what}; {hint}")


def _cuts(table: Table, t: ndarray, good: ndarray, gap: float | int | None, notes: list[str]) -> list[tuple[int, int]]:
    """Cut at incomplete rows and at gaps in time; return [start, end) of the pieces and note every cut."""
    steps = np.diff(t)
    both = good[:-1] & good[1:]
    limit = GAP * float(np.median(steps[both])) if gap is None and both.any() else (np.inf if gap is None else gap)
    far = both & (steps > limit)
    for k in np.flatnonzero(far):
        where = f"{table.label(int(k))} to {table.label(int(k) + 1)}"
        notes.append(f"{table.name}: a gap of {steps[k]:.6g} s from {where}; a new trajectory starts there")
    for k in np.flatnonzero(~good):
        notes.append(f"{table.name}: {table.label(int(k))} is incomplete; left out, a new trajectory starts after it")
    starts = np.flatnonzero(good & np.concatenate([[True], ~good[:-1] | far]))
    ends = np.flatnonzero(good & np.concatenate([~good[1:] | far, [True]])) + 1
    return [(int(a), int(b)) for a, b in zip(starts, ends, strict=True)]
