"""Surveys: one look through all chunks of measurements, which cuts them into runs and joins what continues.

Cuts are those of `persid.read_csv`: incomplete rows, and steps in time above ten median steps.
"""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial, reduce
from itertools import accumulate, groupby, pairwise
from operator import add
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from persid._libraries import library
from persid.errors import DataError
from persid.measurements.chunks import SUSPECT, Lazy, RowGroups, Survey, WholeFile, first_instant, survey
from persid.measurements.engines import Engine, Progress, make_engine
from persid.measurements.moments import NO_STEPS, Steps, steps_of
from persid.measurements.readers import is_parquet
from persid.measurements.readers.sources import files_of as files_of
from persid.measurements.recordings import Chunk, Recordings, Run
from persid.measurements.runs import GAP, shortened
from persid.measurements.tables import Columns
from persid.measurements.times import holds_dates, is_clock

CHUNK = 131_072  # rows of small row groups that are read together


def open_recordings(
    source: object,
    *,
    states: Sequence[str],
    inputs: Sequence[str] = (),
    time: str | None = None,
    dt: float | int | None = None,
    run: str | None = None,
    delay: Mapping[str, float | int] | None = None,
    gap: float | int | None = None,
    missing: str = "error",
    na: Sequence[object] = (),
    engine: object = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
) -> Recordings:
    """Look through measurements once, where they are, and return them for a fit that reads them chunk by chunk.

    `source` is a file, a pattern such as "data/*.parquet", a folder of Parquet (or else CSV) files, a list of these, or
    a Dask DataFrame. Every file is one run or several, by the rules of `persid.read_csv`; a Dask DataFrame is one long
    run in partitions in the order of time. With `run`, a column, a new run starts where it changes. A chunk is a file,
    some row groups of a Parquet file, or a partition: so much memory a
    worker needs, whatever the number of rows.

    Args:
        source: where the measurements are.
        states, inputs, time, dt, gap, missing, na: as for `persid.read_measurements` (dt and gap in s).
        run: the column that tells runs apart.  delay: refused; dead times need the data in memory.
        engine: None (this process), "dask" or a `distributed.Client`.  scheduler: the address of a Dask scheduler.
        progress: is called with a line of text.

    Raises:
        DataError: as for `persid.read_csv`; or `gap` is needed, because steps differ too much from chunk to chunk.

    Examples:
        >>> there = ps.open_recordings("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> ps.PersidskiiIdentifier(["x"], ridge=1e-4).fit(there).model_.states
        ('x1', 'x2')
    """
    columns = Columns.of(states=states, inputs=inputs, time=time, dt=dt, gap=gap, missing=missing, na=na, run=run)
    if delay:
        raise DataError(
            "delay= needs the data in memory, since what acts at the beginning of a chunk lies in the chunk before it; "
            "read them whole, or write the file anew with its inputs moved down"
        )
    if missing == "drop" and dt is not None:
        raise DataError(
            'missing="drop" chunk by chunk needs a column of times (time=), not a step (dt=): a chunk does not know '
            "how many rows went before it; name that column, or read the data whole"
        )
    return look_through(list(_chunks_of(source)), columns, make_engine(engine, scheduler, progress))


def look_through(chunks: list[Chunk], columns: Columns, engine: Engine) -> Recordings:
    """Survey all chunks and join what continues from one to the next."""
    if columns.dt is None:
        begin = engine.each(first_instant, [(c.source, c.lazy, columns) for c in chunks[:1]], "looking at the times")
        columns = replace(columns, origin=begin[0])
    found: list[Survey] = engine.each(survey, [(c.source, c.lazy, columns) for c in chunks], "looking through")
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
    return Recordings(
        states=columns.states,
        inputs=columns.inputs,
        notes=shortened(notes),
        moments=together,
        steps=total,
        digest=digest,
        engine=engine,
        _columns=columns,
        _chunks=tuple(placed),
        _runs=tuple(runs),
        _first=first,
    )


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
            if same and step == 0:
                raise DataError(f"{one.name}: its first time repeats the last one of the chunk before it")
            if same and step < 0:
                notes.append(f"{one.name}: the clock starts again; a new trajectory starts there")
                same = False
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


def _split(one: Survey, cuts: list[int]) -> Iterator[tuple[int, int, object]]:
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


def _chunks_of(source: object) -> Iterator[Chunk]:
    """Yield the chunks of files or of a Dask DataFrame."""
    if hasattr(source, "to_delayed"):
        for k, part in enumerate(source.to_delayed()):
            yield Chunk(part, Lazy(f"partition {k + 1}"), 0)
        return
    for table, path in enumerate(files_of(source)):
        if isinstance(path, Path) and is_parquet(path):
            for groups in _row_groups(path):
                yield Chunk(groups, None, table)
        else:
            yield Chunk(WholeFile(path), None, table)


def recordings_of(X: object, u: object = None, t: object = None, dt: float | int | None = None) -> Recordings:
    """Return recordings, or those of Dask arrays or DataFrames of states and inputs cut alike: one long run.

    Raises:
        DataError: the data cannot be used.
    """
    if isinstance(X, Recordings):
        if u is not None or t is not None or dt is not None:
            raise DataError("recordings hold their own inputs and times; u, t and dt go with arrays and tables")
        return X
    if t is not None and dt is not None:
        raise DataError("both times t and a step dt were given; give one of them")
    indexed = hasattr(X, "index") and (holds_dates(X.index) or (X.index.name is not None and is_clock(X.index.name)))
    clocks = _clocks(X)
    if t is None and dt is None and not indexed and not clocks:
        raise DataError("X has no times; give the step dt=..., the times t=..., or a column or an index named t")
    states, inputs = _names_of(X, "x", clocks), () if u is None else _names_of(u, "u", _clocks(u))
    kept = [X if t is None and dt is None else _without(X, clocks), None if u is None else _without(u, _clocks(u)), t]
    parts = [_partitions(part, X) for part in kept if part is not None]
    if len({len(part) for part in parts}) != 1:
        raise DataError(f"X, u and t have {[len(part) for part in parts]} chunks; cut them alike")
    import dask

    names = (*_names_of(kept[0], "x", ()), *inputs)
    join = dask.delayed(partial(_joined_frame, names=names, timed=t is not None), pure=False)
    chunks = [Chunk(join(*row), Lazy(f"chunk {k + 1}"), 0) for k, row in enumerate(zip(*parts, strict=True))]
    columns = Columns.of(states=states, inputs=inputs, dt=dt)
    return look_through(chunks, columns, make_engine("dask"))


def _clocks(X: Any) -> list[Any]:
    """Return the columns of a Dask DataFrame that are times."""
    return [name for name in X.columns if is_clock(name) or holds_dates(X[name])] if hasattr(X, "columns") else []


def _without(X: Any, columns: list[Any]) -> Any:
    return X.drop(columns=columns) if columns else X


def _names_of(X: Any, letter: str, clocks: Sequence[Any]) -> tuple[str, ...]:
    if hasattr(X, "columns"):
        return tuple(str(name) for name in X.columns if name not in clocks)
    return tuple(f"{letter}{k + 1}" for k in range(1 if X.ndim == 1 else X.shape[1]))


def _partitions(X: Any, like: Any = None) -> list[Any]:
    """Return the pieces of a Dask collection along its rows, an array cut like another one."""
    if hasattr(X, "rechunk"):
        rows = like.chunks[0] if hasattr(like, "chunks") else X.chunks[0]
        X = X.rechunk((rows,) if X.ndim == 1 else (rows, -1))
    return list(np.ravel(X.to_delayed()))


def _joined_frame(x: Any, *more: Any, names: tuple[str, ...], timed: bool) -> pd.DataFrame:
    """Put states, inputs and times side by side."""
    parts = [pd.DataFrame(np.asarray(part) if not hasattr(part, "columns") else part) for part in (x, *more)]
    frame = pd.concat([part.reset_index(drop=True) for part in parts], axis=1)
    frame.columns = [*names, *(["t"] if timed else [])]
    index = getattr(x, "index", None)
    kept = index is not None and not timed and (holds_dates(index) or index.name is not None)
    return frame.set_index(index) if kept else frame


def _row_groups(path: Path) -> Iterator[RowGroups]:
    """Yield the row groups of a Parquet file, small ones together."""
    pq = library("pyarrow.parquet", "dask")
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
