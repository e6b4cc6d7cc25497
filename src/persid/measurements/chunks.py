"""Chunks: the pieces of large tables that are read at once, and what one look at a piece tells.

Everything here runs where the data lie: on a worker, one chunk at a time.
"""

import hashlib
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Int
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.frames import is_index_a_clock
from persid.measurements.moments import Moments, Steps, row_moments, steps_of
from persid.measurements.readers import table_of
from persid.measurements.readers.sources import Source
from persid.measurements.runs import GAP, restarts
from persid.measurements.tables import Columns, Rows, Table, origin_of, rows_of

HEAD = 256  # first rows of every chunk that are kept: a window of the chunk before may reach so far
SUSPECT = GAP / 2  # a step longer than this many median steps of its chunk may be a gap


@dataclass(frozen=True)
class WholeFile:
    """A file that is read whole."""

    source: Source

    def table(self, columns: Columns) -> Table:
        """Read the wanted columns."""
        return table_of(self.source, columns)


@dataclass(frozen=True)
class RowGroups:
    """Consecutive row groups of a Parquet file, the first row of them being the file's row `first` (from 0)."""

    path: str
    groups: tuple[int, ...]
    first: int

    def table(self, columns: Columns) -> Table:
        """Read the wanted columns."""
        import pyarrow.parquet as pq  # type: ignore[import-untyped]

        try:
            with pq.ParquetFile(self.path) as file:
                names = file.schema_arrow.names
                taken = [name for name in names if columns.takes(name)] or names
                frame = file.read_row_groups(list(self.groups), columns=taken, use_threads=False).to_pandas(
                    ignore_metadata=True
                )
        except (OSError, ValueError) as error:
            raise DataError(f"{self.path}: cannot be read as Parquet: {error}") from None
        return Table(self.path, frame, lambda k: f"row {self.first + k + 1}", tuple(names))


@dataclass(frozen=True)
class Lazy:
    """How a partition that Dask hands over as a DataFrame is named in errors."""

    name: str

    def named(self, frame: pd.DataFrame, columns: Columns) -> Table:
        """Return the partition as a table; an index that is its time is a column of it."""
        if columns.dt is None and is_index_a_clock(frame, columns.time):
            frame = frame.rename_axis(str(frame.index.name or "t")).reset_index()
        return Table(self.name, frame.reset_index(drop=True), lambda k: f"row {k + 1}")


def read_rows(source: Any, lazy: Lazy | None, columns: Columns, notes: list[str]) -> tuple[str, Rows]:
    """Read a chunk: a file or a part of one, or the DataFrame of a partition; return its name and its rows.

    Raises:
        DataError: as for `persid.read_csv`.
    """
    table = source.table(columns) if lazy is None else lazy.named(source, columns)
    return table.name, rows_of(table, columns, notes)


def first_instant(source: Any, lazy: Lazy | None, columns: Columns) -> pd.Timestamp | float | None:
    """Return the instant that counts as 0 in all chunks, where times are dates or numbers since 1970; else None."""
    table = source.table(columns) if lazy is None else lazy.named(source, columns)
    return origin_of(table, columns)


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
    labels: tuple[object, ...]
    far: tuple[tuple[int, float], ...]
    median: float
    steps: Steps
    moments: Moments | None
    head: tuple[ndarray | None, ndarray]
    first: float
    last: float
    digest: bytes
    notes: tuple[str, ...]


def survey(source: Any, lazy: Lazy | None, columns: Columns) -> Survey:
    """Look at a chunk once: cuts, ranges, means, steps, the first rows and a hash."""
    notes: list[str] = []
    name, found = read_rows(source, lazy, columns, notes)
    t, good = found.t, found.good
    h = np.full(max(len(good) - 1, 0), float(columns.dt or 0)) if t is None else np.diff(t)
    joined = good[:-1] & good[1:]
    if found.runs is not None:
        joined &= found.runs[1:] == found.runs[:-1]
    again = _again(name, found, joined, notes)
    joined &= ~again
    median = float(np.median(h[joined])) if joined.any() else 0.0
    limit = SUSPECT * median if columns.gap is None else float(columns.gap)
    far = joined & (h > limit) & (t is not None)
    spans = _spans(good, joined)
    complete = np.flatnonzero(good)
    ends = (np.nan, np.nan) if t is None or not len(complete) else tuple(map(float, t[complete[[0, -1]]]))
    return Survey(
        name=name,
        rows=len(good),
        spans=spans,
        labels=() if found.runs is None else tuple(found.runs[spans[:, 0]].tolist()),
        far=tuple((int(k), float(h[k])) for k in np.flatnonzero(far)),
        median=median,
        steps=steps_of(h[joined & ~far]),
        moments=row_moments(found.values[good]) if len(complete) else None,
        head=(None if t is None else t[:HEAD].copy(), found.values[:HEAD].copy()),
        first=ends[0],
        last=ends[1],
        digest=_digest(found),
        notes=(*notes, *_lost(name, found)),
    )


def _again(name: str, rows: Rows, joined: ndarray, notes: list[str]) -> ndarray:
    """Whether the clock starts again between two rows of one run.

    Raises:
        DataError: a time is repeated, or rows are out of order.
    """
    again = np.zeros(len(joined), dtype=bool)
    if rows.t is None:
        return again
    edges = [0, *(np.flatnonzero(rows.runs[1:] != rows.runs[:-1]) + 1)] if rows.runs is not None else [0]
    for a, b in pairwise([*map(int, edges), len(rows.good)]):
        part = Rows(rows.t[a:b], rows.values[a:b], rows.good[a:b], None, partial(_label, rows, a), rows.clock)
        for k in restarts(name, part, rows.t[a:b]):
            again[a + k - 1] = True
            notes.append(f"{name}: the clock starts again at {rows.label(a + k)}; a new trajectory starts there")
    return again


def _label(rows: Rows, offset: int, k: int) -> str:
    return rows.label(offset + k)


def _spans(good: ndarray, joined: ndarray) -> Int[ndarray, "k 2"]:
    """Return the stretches [a, b) of complete rows that are joined to each other."""
    starts = np.flatnonzero(good & np.concatenate([[True], ~joined])[: len(good)])
    ends = np.flatnonzero(good & np.concatenate([~joined, [True]])[-len(good) :]) + 1 if len(good) else starts
    return np.column_stack([starts, ends])


def _digest(rows: Rows) -> bytes:
    digest = hashlib.sha256(b"" if rows.t is None else np.ascontiguousarray(rows.t).data)
    digest.update(np.ascontiguousarray(rows.values).data)
    return digest.digest()


def _lost(name: str, rows: Rows) -> list[str]:
    bad = np.flatnonzero(~rows.good)
    if not len(bad):
        return []
    first = rows.label(int(bad[0]))
    return [f"{name}: {len(bad)} incomplete row(s), the first at {first}; left out, the runs end there"]
