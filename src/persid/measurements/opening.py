"""Surveys: one look through all chunks of measurements, which cuts them into runs and joins what continues.

Cuts are those of `persid.read_csv`: incomplete rows, and steps in time above ten median steps.
"""

import glob
import hashlib
from collections.abc import Iterator, Sequence
from functools import partial, reduce
from itertools import accumulate, groupby, pairwise
from operator import add
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from persid.errors import DataError
from persid.measurements.chunks import SUSPECT, CsvFile, Lazy, RowGroups, Survey, survey
from persid.measurements.engines import Engine, Progress, make_engine
from persid.measurements.moments import NO_STEPS, Steps, steps_of
from persid.measurements.recordings import Chunk, Recordings, Run
from persid.measurements.tables import GAP, TIME_NAMES, Columns

CHUNK = 131_072  # rows of small row groups that are read together
MOST_NOTES = 20  # gaps that are named one by one


def open_recordings(
    source: Any,
    *,
    states: Sequence[str],
    inputs: Sequence[str] = (),
    time: str | None = None,
    dt: float | int | None = None,
    run: str | None = None,
    gap: float | int | None = None,
    missing: str = "error",
    engine: Any = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Recordings:
    """Look through measurements once, where they are, and return them for a fit that reads them chunk by chunk.

    `source` is a file, a pattern such as "data/*.parquet", a folder of Parquet (or else CSV) files, a list of these, or
    a Dask DataFrame. Every file is one run or several, by the rules of `persid.read_csv`; a Dask DataFrame is one long
    run in partitions in the order of time. With `run`, a column of Parquet files or of a Dask DataFrame, a new run
    starts where it changes. A chunk is a CSV file, some row groups of a Parquet file, or a partition: so much memory a
    worker needs, whatever the number of rows.

    Args:
        source: where the measurements are.
        states, inputs, time, dt, gap, missing: as for `persid.read_csv` (dt and gap in s).
        run: the column that tells runs apart.
        engine: None (this process), "dask" or a `distributed.Client`.  scheduler: the address of a Dask scheduler.
        progress: is called with a line of text.

    Raises:
        DataError: as for `persid.read_csv`; or `gap` is needed, because steps differ too much from chunk to chunk.

    Examples:
        >>> there = ps.open_recordings("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> ps.PersidskiiIdentifier(["x"], ridge=1e-4).fit(there).model_.states
        ('x1', 'x2')
    """
    columns = Columns(tuple(states), tuple(inputs), time, dt, gap, missing)
    return look_through(list(_chunks_of(source, run)), columns, run, make_engine(engine, scheduler, progress))


def look_through(chunks: list[Chunk], columns: Columns, run: str | None, engine: Engine) -> Recordings:
    """Survey all chunks and join what continues from one to the next."""
    found: list[Survey] = engine.each(survey, [(c.source, c.lazy, columns, run) for c in chunks], "looking through")
    runs: list[Run] = []
    notes = [note for one in found for note in one.notes]
    total, placed, first = NO_STEPS, [], {}
    for table, group in groupby(range(len(chunks)), key=lambda k: chunks[k].table):
        numbers = list(group)
        first[table] = numbers[0]
        surveys = [found[k] for k in numbers]
        offsets = [0, *accumulate(one.rows for one in surveys)]
        for k, offset in zip(numbers, offsets[:-1], strict=True):
            one = chunks[k]
            placed.append(Chunk(one.source, one.lazy, table, offset, found[k].rows, found[k].head))
        spans, steps_here = _joined(surveys, offsets, columns, notes)
        runs += [Run(table, a, b) for a, b in spans]
        total = total + steps_here
    digest = hashlib.sha256(b"".join(one.digest for one in found)).hexdigest()
    together = reduce(add, (one.moments for one in found if one.moments is not None))
    facts = (tuple(_shortened(notes)), together, total, digest)
    return Recordings(columns.states, columns.inputs, *facts, engine, columns, run, tuple(placed), tuple(runs), first)


def _joined(
    surveys: list[Survey], offsets: list[int], columns: Columns, notes: list[str]
) -> tuple[list[tuple[int, int]], Steps]:
    """Return the runs of a table as rows [a, b), and their steps: spans, cut at gaps, joined across chunks."""
    limit = _gap_limit(surveys, columns)
    total = reduce(add, (one.steps for one in surveys))
    spans: list[list[Any]] = []  # [first row, end, label]
    last_time = np.nan
    for one, offset in zip(surveys, offsets[:-1], strict=True):
        cuts = [k for k, step in one.far if step > limit]
        total = reduce(add, (steps_of(np.array([step])) for _, step in one.far if step <= limit), total)
        for step in (step for _, step in one.far if step > limit):
            notes.append(f"{one.name}: a gap of {step:.6g} s; a new trajectory starts there")
        pieces = list(_split(one, cuts))
        if spans and pieces:
            step = one.first - last_time if columns.dt is None else float(columns.dt)
            same = spans[-1][2] == pieces[0][2]
            if same and not step > 0:
                raise DataError(f"{one.name}: its times begin before those of the chunk before it end; sort by time")
            if same and spans[-1][1] == offset and pieces[0][0] == 0 and step <= limit:
                total = total + steps_of(np.array([step]))
                spans[-1][1] = offset + pieces.pop(0)[1]
            elif same and spans[-1][1] == offset and pieces[0][0] == 0:
                notes.append(f"{one.name}: a gap of {step:.6g} s before it; a new trajectory starts there")
        spans += [[offset + a, offset + b, label] for a, b, label in pieces]
        last_time = one.last if one.spans.size else last_time
    labels = [label for label, after in pairwise([*(s[2] for s in spans), object()]) if label != after]
    if len(set(labels)) < len(labels):
        raise DataError("rows of one run are not together; sort by the column of run=, then by time")
    runs = [(a, b) for a, b, _ in spans if b - a >= 2]
    if len(runs) < len(spans):
        notes.append(f"{surveys[0].name}: {len(spans) - len(runs)} single sample(s) between gaps were left out")
    if not runs:
        raise DataError(f"{surveys[0].name}: no two consecutive complete rows; at least 2 are needed")
    return runs, total


def _split(one: Survey, cuts: list[int]) -> Iterator[tuple[int, int, Any]]:
    """Yield the spans of a chunk with their labels, cut behind the rows of `cuts`."""
    ends = np.array(cuts, int) + 1
    for k, (a, b) in enumerate(one.spans.tolist()):
        inner = ends[(ends > a) & (ends < b)].tolist()
        for start, stop in pairwise([a, *inner, b]):
            yield start, stop, one.labels[k] if one.labels else None


def _gap_limit(surveys: list[Survey], columns: Columns) -> float:
    """Return the step in s above which a run ends: ten median steps, the median of the chunks' medians."""
    if columns.gap is not None or columns.dt is not None:
        return np.inf if columns.gap is None else float(columns.gap)
    known = sorted((one.median, one.rows) for one in surveys if one.median > 0)
    if not known:
        return np.inf
    weights = np.cumsum([rows for _, rows in known])
    median = known[int(np.searchsorted(weights, weights[-1] / 2))][0]
    if SUSPECT * known[-1][0] > GAP * median:
        raise DataError(
            f"{surveys[0].name}: the median step is {known[0][0]:.6g} s in one chunk and {known[-1][0]:.6g} s in "
            "another; give the step in s above which a run ends (gap=)"
        )
    return GAP * median


def _shortened(notes: list[str]) -> list[str]:
    different = list(dict.fromkeys(notes))
    more = len(different) - MOST_NOTES
    return [*different[:MOST_NOTES], *([f"and {more} more such notes"] if more > 0 else [])]


def _chunks_of(source: Any, run: str | None) -> Iterator[Chunk]:
    """Yield the chunks of files or of a Dask DataFrame."""
    if hasattr(source, "to_delayed"):
        for k, part in enumerate(source.to_delayed()):
            yield Chunk(part, Lazy(f"partition {k + 1}"), 0)
        return
    for table, path in enumerate(files_of(source)):
        if path.suffix.lower() in (".parquet", ".pq"):
            for groups in _row_groups(path):
                yield Chunk(groups, None, table)
        elif run is not None:
            raise DataError(f"{path}: run= is for Parquet files and Dask DataFrames; a CSV file is a run by itself")
        else:
            yield Chunk(CsvFile(str(path)), None, table)


def recordings_of(X: Any, u: Any = None, t: Any = None, dt: float | int | None = None) -> Recordings:
    """Return recordings, or those of Dask arrays or DataFrames of states and inputs cut alike: one long run.

    Raises:
        DataError: the data cannot be used.
    """
    if isinstance(X, Recordings):
        if u is not None or t is not None or dt is not None:
            raise DataError("recordings hold their own inputs and times; u, t and dt go with arrays and tables")
        return X
    states, inputs = _names_of(X, "x"), () if u is None else _names_of(u, "u")
    parts = [_partitions(part, X) for part in (X, u, t) if part is not None]
    if len({len(part) for part in parts}) != 1:
        raise DataError(f"X, u and t have {[len(part) for part in parts]} chunks; cut them alike")
    import dask

    join = dask.delayed(partial(_joined_frame, names=(*states, *inputs), timed=t is not None), pure=False)
    chunks = [Chunk(join(*row), Lazy(f"chunk {k + 1}"), 0) for k, row in enumerate(zip(*parts, strict=True))]
    timed = t is not None or (hasattr(X, "index") and X.index.name in TIME_NAMES)
    columns = Columns(states, inputs, None, None if timed else (dt or 1.0), None, "error")
    return look_through(chunks, columns, None, make_engine("dask"))


def _names_of(X: Any, letter: str) -> tuple[str, ...]:
    if hasattr(X, "columns"):
        return tuple(str(name) for name in X.columns)
    return tuple(f"{letter}{k + 1}" for k in range(1 if X.ndim == 1 else X.shape[1]))


def _partitions(X: Any, like: Any = None) -> list[Any]:
    """Return the pieces of a Dask collection along its rows, an array cut like another one."""
    if hasattr(X, "rechunk"):
        rows = like.chunks[0] if hasattr(like, "chunks") else X.chunks[0]
        X = X.rechunk((rows,) if X.ndim == 1 else (rows, -1))
    return list(np.ravel(X.to_delayed()))


def _joined_frame(x: Any, *more: Any, names: tuple[str, ...], timed: bool) -> pd.DataFrame:
    """Put states, inputs and times side by side."""
    parts = [np.asarray(part, float).reshape(len(x), -1) for part in (x, *more)]
    frame = pd.DataFrame(np.hstack(parts), columns=[*names, *(["t"] if timed else [])])
    return frame.set_index(x.index) if getattr(x, "index", None) is not None and x.index.name is not None else frame


def files_of(source: Any) -> list[Path]:
    """Return the files that a path, a pattern, a folder, or a list of these names, in order.

    Raises:
        DataError: there is no such file.
    """
    if isinstance(source, list | tuple):
        return [path for item in source for path in files_of(item)]
    path = Path(source)
    if path.is_dir():
        found = sorted(path.rglob("*.parquet")) or sorted(path.glob("*.csv"))
    else:
        found = [path] if path.is_file() else [Path(name) for name in sorted(glob.glob(str(path), recursive=True))]
    if not found:
        raise DataError(f"{source}: no such file, no folder with Parquet or CSV files, and no pattern that fits any")
    return found


def _row_groups(path: Path) -> Iterator[RowGroups]:
    """Yield the row groups of a Parquet file, small ones together."""
    try:
        import pyarrow.parquet as pq  # type: ignore[import-untyped]
    except ImportError:
        raise ImportError('Parquet files need pyarrow; pip install "persid[dask]"') from None
    try:
        with pq.ParquetFile(path) as file:
            counts = [file.metadata.row_group(k).num_rows for k in range(file.num_row_groups)]
    except (OSError, ValueError) as error:
        raise DataError(f"{path}: cannot be read as Parquet: {error}") from None
    groups: list[int] = []
    first, rows = 0, 0
    for k, count in enumerate(counts):
        if groups and rows + count > CHUNK:
            yield RowGroups(str(path), tuple(groups), first)
            first, groups, rows = first + rows, [], 0
        groups.append(k)
        rows += count
    yield RowGroups(str(path), tuple(groups), first)
