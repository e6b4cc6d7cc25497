"""Chunks: the pieces of large tables that are read at once, and what one look at a piece tells.

Everything here runs where the data lie: on a worker, one chunk at a time.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float, Int
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.moments import Moments, Steps, row_moments, steps_of
from persid.measurements.readers import csv_table
from persid.measurements.tables import GAP, TIME_NAMES, Columns, Table, table_rows

HEAD = 256  # first rows of every chunk that are kept: a window of the chunk before may reach so far
SUSPECT = GAP / 2  # a step longer than this many median steps of its chunk may be a gap


@dataclass(frozen=True)
class CsvFile:
    """A CSV file, read whole."""

    path: str

    def table(self, columns: Columns, run: str | None) -> Table:
        """Read the wanted columns."""
        return csv_table(Path(self.path), columns)


@dataclass(frozen=True)
class RowGroups:
    """Consecutive row groups of a Parquet file, the first row of them being the file's row `first` (from 0)."""

    path: str
    groups: tuple[int, ...]
    first: int

    def table(self, columns: Columns, run: str | None) -> Table:
        """Read the wanted columns."""
        import pyarrow.parquet as pq  # type: ignore[import-untyped]

        try:
            with pq.ParquetFile(self.path) as file:
                names = _wanted(file.schema_arrow.names, columns, run)
                frame = file.read_row_groups(list(self.groups), columns=names, use_threads=False).to_pandas(
                    ignore_metadata=True
                )
        except (OSError, ValueError) as error:
            raise DataError(f"{self.path}: cannot be read as Parquet: {error}") from None
        return Table(self.path, frame, lambda k: f"row {self.first + k + 1}")


def _wanted(names: Sequence[str], columns: Columns, run: str | None) -> list[str]:
    """Names of a file's columns that a table needs, or all where one is missing, for the error to show."""
    wanted = {*columns.names, columns.time, run}
    clock = TIME_NAMES if columns.dt is None and columns.time is None else ()
    return [name for name in names if name.strip() in wanted or name.strip().lower() in clock] or list(names)


@dataclass(frozen=True)
class Lazy:
    """How a partition that Dask hands over as a DataFrame is named in errors."""

    name: str

    def named(self, frame: pd.DataFrame, columns: Columns) -> Table:
        """Return the partition as a table; an index named like the time is a column of it."""
        clock = (columns.time,) if columns.time else TIME_NAMES
        named = columns.dt is None and frame.index.name is not None and frame.index.name in clock
        return Table(self.name, frame.reset_index(drop=not named), lambda k: f"row {k + 1}")


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a chunk: times in s (None: from the step), states and inputs, which are complete, the run's label."""

    table: Table
    t: Float[ndarray, " N"] | None
    values: Float[ndarray, "N k"]
    good: ndarray
    label: ndarray | None
    notes: tuple[str, ...]


def read_rows(source: Any, lazy: Lazy | None, columns: Columns, run: str | None) -> Rows:
    """Read a chunk: a file or a part of one, or the DataFrame of a partition.

    Raises:
        DataError: as for `persid.read_csv`.
    """
    table = source.table(columns, run) if lazy is None else lazy.named(source, columns)
    notes: list[str] = []
    if run is None:
        t, values, good = table_rows(table, columns, notes)
        return Rows(table, t, values, good, None, tuple(notes))
    if run not in table.frame.columns:
        raise DataError(f"{table.name}: there is no column {run!r} to tell the runs apart (run=)")
    label = table.frame[run].to_numpy()
    edges = [0, *(np.flatnonzero(label[1:] != label[:-1]) + 1), len(label)]
    parts = [_slice_rows(table, int(a), int(b), columns, notes) for a, b in pairwise(edges)]
    t = None if parts[0][0] is None else np.concatenate([part[0] for part in parts])
    values, good = (np.concatenate([part[k] for part in parts]) for k in (1, 2))
    return Rows(table, t, values, good, label, tuple(dict.fromkeys(notes)))


def _slice_rows(table: Table, a: int, b: int, columns: Columns, notes: list[str]) -> tuple[Any, ndarray, ndarray]:
    """Rows [a, b) of one run, by the rules of a table of their own."""
    return table_rows(Table(table.name, table.frame.iloc[a:b], lambda k: table.label(a + k)), columns, notes)


@dataclass(frozen=True, eq=False)
class Survey:
    """What one look at a chunk tells.

    `spans` are stretches [a, b) of complete rows of one run, `labels` their runs, `far` the rows before a long step,
    with its length in s; `steps` are the other ones, `median` their median. `head` holds the first rows; `first` and
    `last` are the times of the first and last complete row.
    """

    name: str
    rows: int
    spans: Int[ndarray, "k 2"]
    labels: tuple[Any, ...]
    far: tuple[tuple[int, float], ...]
    median: float
    steps: Steps
    moments: Moments | None
    head: tuple[ndarray | None, ndarray]
    first: float
    last: float
    digest: bytes
    notes: tuple[str, ...]


def survey(source: Any, lazy: Lazy | None, columns: Columns, run: str | None) -> Survey:
    """Look at a chunk once: cuts, ranges, means, steps, the first rows and a hash."""
    found = read_rows(source, lazy, columns, run)
    t, good = found.t, found.good
    h = np.full(max(len(good) - 1, 0), float(columns.dt or 0)) if t is None else np.diff(t)
    joined = good[:-1] & good[1:]
    if found.label is not None:
        joined &= found.label[1:] == found.label[:-1]
    median = float(np.median(h[joined])) if joined.any() else 0.0
    limit = SUSPECT * median if columns.gap is None else float(columns.gap)
    far = joined & (h > limit) & (t is not None)
    spans = _spans(good, joined)
    complete = np.flatnonzero(good)
    ends = (np.nan, np.nan) if t is None or not len(complete) else tuple(map(float, t[complete[[0, -1]]]))
    return Survey(
        name=found.table.name,
        rows=len(good),
        spans=spans,
        labels=() if found.label is None else tuple(found.label[spans[:, 0]].tolist()),
        far=tuple((int(k), float(h[k])) for k in np.flatnonzero(far)),
        median=median,
        steps=steps_of(h[joined & ~far]),
        moments=row_moments(found.values[good]) if len(complete) else None,
        head=(None if t is None else t[:HEAD].copy(), found.values[:HEAD].copy()),
        first=ends[0],
        last=ends[1],
        digest=_digest(found),
        notes=(*found.notes, *_lost(found)),
    )


def _spans(good: ndarray, joined: ndarray) -> Int[ndarray, "k 2"]:
    """Return the stretches [a, b) of complete rows that are joined to each other."""
    starts = np.flatnonzero(good & np.concatenate([[True], ~joined])[: len(good)])
    ends = np.flatnonzero(good & np.concatenate([~joined, [True]])[-len(good) :]) + 1 if len(good) else starts
    return np.column_stack([starts, ends])


def _digest(rows: Rows) -> bytes:
    digest = hashlib.sha256(b"" if rows.t is None else np.ascontiguousarray(rows.t).data)
    digest.update(np.ascontiguousarray(rows.values).data)
    return digest.digest()


def _lost(rows: Rows) -> list[str]:
    bad = np.flatnonzero(~rows.good)
    if not len(bad):
        return []
    first = rows.table.label(int(bad[0]))
    return [f"{rows.table.name}: {len(bad)} incomplete row(s), the first at {first}; left out, the runs end there"]
