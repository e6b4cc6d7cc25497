"""Recordings: measurements that stay where they are, in files or on a cluster, and are read chunk by chunk.

What a fit needs of measurements is little: lengths of the runs, moments, sums over parts, and a few short segments. The
functions below ask for these without saying where the data lie, so that every formula stands once.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TypeVar, cast

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.chunks import HEAD, Lazy, read_rows
from persid.measurements.engines import Engine, Sum, Task, summed
from persid.measurements.moments import Moments, Steps, run_steps
from persid.measurements.tables import Columns
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory


@dataclass(frozen=True)
class Part:
    """Samples [start, stop) of one run; fold -1 is the held-out tail, `block` the sum that the part goes into.

    `end` is where the part ends that this one was cut from (its own `stop` where it was not): pairs of samples reach
    so far.
    """

    run: int
    start: int
    stop: int
    fold: int
    block: int = 0
    end: int = 0


@dataclass(frozen=True, eq=False)
class Chunk:
    """A chunk of table `table` that begins at row `offset` of it; `source` is read on the worker."""

    source: object
    lazy: Lazy | None
    table: int
    offset: int = 0
    rows: int = 0
    head: tuple[ndarray | None, ndarray] | None = None


@dataclass(frozen=True)
class Run:
    """Rows [start, stop) of a table."""

    table: int
    start: int
    stop: int

    def __len__(self) -> int:
        return self.stop - self.start


@dataclass(frozen=True)
class _Job:
    """Rows [start, start + count) of a chunk, read as far as `reach` (rows of later chunks included)."""

    start: int
    count: int
    reach: int
    block: int


@dataclass(frozen=True, eq=False)
class Recordings:
    """Runs of one system in files or on a cluster. Make them with `persid.open_recordings`; `fit` takes them.

    `moments` are those of states and inputs side by side, over all complete rows (single ones between gaps included);
    `digest` is a SHA-256 over those of the chunks.

    Examples:
        >>> there = ps.open_recordings("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> there.states, there.inputs
        (('x1', 'x2'), ('u',))
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    notes: tuple[str, ...]
    moments: Moments
    steps: Steps
    digest: str
    engine: Engine
    _columns: Columns
    _chunks: tuple[Chunk, ...]
    _runs: tuple[Run, ...]
    _first: dict[int, int] = field(repr=False)  # of every table, the number of its first chunk
    _taken: tuple[int, ...] | None = None  # columns of the rows that are read, where it is not all of them

    def __len__(self) -> int:
        """Number of runs."""
        return len(self._runs)

    def __repr__(self) -> str:
        size = f"{self.samples:,} samples of {len(self.states)} states"
        return f"<{len(self)} runs, {size} in {len(self._chunks)} chunks>"

    def with_inputs(self, names: Sequence[str]) -> "Recordings":
        """Return the same runs with some of their inputs alone, in the order of `names`."""
        n = len(self.states)
        now = range(n + len(self.inputs)) if self._taken is None else self._taken
        places = [*range(n), *(n + self.inputs.index(name) for name in names)]
        taken = tuple(now[k] for k in places)
        return replace(self, inputs=tuple(names), moments=self.moments.of(places), _taken=taken)

    @property
    def samples(self) -> int:
        """Number of samples in all runs together."""
        return sum(map(len, self._runs))

    @property
    def lengths(self) -> list[int]:
        """Number of samples of every run."""
        return [len(run) for run in self._runs]

    def sums(
        self, parts: Iterable[Part], function: Callable[[Trajectory, int], Sum], overlap: int, within: bool
    ) -> dict[int, Sum]:
        """Return the sums of `function(segment, count)` block by block; see `block_sums`."""
        if overlap > HEAD:
            raise DataError(f"windows of {overlap} samples; at most {HEAD} reach from one chunk into the next")
        jobs: dict[int, list[_Job]] = {}
        for item in parts:
            for k, job in self._jobs(item, overlap, within):
                jobs.setdefault(k, []).append(job)
        work = partial(_chunk_sums, function=function, n=len(self.states))
        return self.engine.total(work, [self._task(k, jobs[k]) for k in sorted(jobs)], "summing")

    def segments(self, parts: Sequence[Part]) -> list[Trajectory]:
        """Read some parts into memory."""
        jobs: dict[int, list[_Job]] = {}
        for number, item in enumerate(parts):
            for k, job in self._jobs(Part(item.run, item.start, item.stop, 0, number), 0, False):
                jobs.setdefault(k, []).append(job)
        order = sorted(jobs)
        found = self.engine.each(_chunk_segments, [self._task(k, jobs[k]) for k in order], "reading segments")
        pieces: dict[int, list[tuple[ndarray, ndarray]]] = {}
        for answer in found:
            for number, rows in answer:
                pieces.setdefault(number, []).append(rows)
        n = len(self.states)
        joined = [[np.concatenate(part) for part in zip(*pieces[k], strict=True)] for k in range(len(parts))]
        return [Trajectory(t, values[:, :n], values[:, n:]) for t, values in joined]

    def _jobs(self, item: Part, overlap: int, within: bool) -> Iterator[tuple[int, _Job]]:
        """Yield what each chunk has to do for a part."""
        run = self._runs[item.run]
        start, stop = run.start + item.start, run.start + min(item.stop, len(run))
        limit = run.start + (item.end or item.stop) if within else run.stop
        k = self._first[run.table]
        while k < len(self._chunks) and (chunk := self._chunks[k]).table == run.table and chunk.offset < stop:
            a, b = max(start, chunk.offset), min(stop, chunk.offset + chunk.rows)
            if a < b:
                reach = min(b + overlap, limit)
                yield k, _Job(a - chunk.offset, b - a, reach - chunk.offset, item.block)
            k += 1

    def _task(self, k: int, jobs: list[_Job]) -> Task:
        chunk = self._chunks[k]
        ahead = self._ahead(k, max(job.reach for job in jobs) - chunk.rows)
        return chunk.source, chunk.lazy, _Reading(self._columns, chunk.offset, ahead, self._taken), jobs

    def _ahead(self, k: int, count: int) -> tuple[ndarray | None, ndarray]:
        """Return the `count` rows that follow a chunk, from the heads of those after it."""
        heads, table, left = [], self._chunks[k].table, count
        while left > 0:
            k += 1
            head = self._chunks[k].head
            if self._chunks[k].table != table or head is None:
                raise ValueError("a run reaches past its table")
            heads.append((None if head[0] is None else head[0][:left], head[1][:left]))
            left -= len(head[1][:left])
        if not heads:
            return None, np.zeros((0, len(self._columns.names)))
        clocks = [t for t, _ in heads if t is not None]
        return (np.concatenate(clocks) if clocks else None), np.concatenate([values for _, values in heads])


@dataclass(frozen=True, eq=False)
class _Reading:
    """How a chunk is read: which columns, where it begins in its table, the rows ahead of it, the columns taken."""

    columns: Columns
    offset: int
    ahead: tuple[ndarray | None, ndarray]
    taken: Sequence[int] | None


def _read(source: object, lazy: Lazy | None, how: _Reading) -> tuple[ndarray, ndarray]:
    """Read a chunk with the rows ahead of it; where the step is given, times count from the first row of the table."""
    columns, offset, ahead, taken = how.columns, how.offset, how.ahead, how.taken
    _, rows = read_rows(source, lazy, columns, [])
    values = np.concatenate([rows.values, ahead[1]]) if len(ahead[1]) else rows.values
    values = values if taken is None else values[:, list(taken)]
    if rows.t is None:
        return np.arange(offset, offset + len(values)) * float(columns.dt or 0), values
    return (rows.t if ahead[0] is None else np.concatenate([rows.t, ahead[0]])), values


def _chunk_sums(
    source: object,
    lazy: Lazy | None,
    how: _Reading,
    jobs: list[_Job],
    *,
    function: Callable[[Trajectory, int], Sum],
    n: int,
) -> dict[int, Sum]:
    """Return the sums of a function over the parts in one chunk."""
    t, values = _read(source, lazy, how)
    return summed(
        {job.block: function(Trajectory(t[rows], values[rows, :n], values[rows, n:]), job.count)}
        for job in jobs
        for rows in (slice(job.start, job.reach),)
    )


def _chunk_segments(
    source: object, lazy: Lazy | None, how: _Reading, jobs: list[_Job]
) -> list[tuple[int, tuple[ndarray, ndarray]]]:
    """Return the times and values of some parts of one chunk, copied: the chunk itself can go."""
    t, values = _read(source, lazy, how)
    rows = [(job.block, slice(job.start, job.reach)) for job in jobs]
    return [(number, (t[chosen].copy(), values[chosen].copy())) for number, chosen in rows]


Measurements = Trajectories | Recordings
Kind = TypeVar("Kind", bound=Trajectories | Recordings)


def is_large(X: object) -> bool:
    """Return whether data are recordings, or a Dask array or DataFrame."""
    return isinstance(X, Recordings) or (hasattr(X, "__dask_graph__") and not hasattr(X, "coords"))  # xarray has both


def lengths(data: Measurements) -> list[int]:
    """Return the number of samples of every run."""
    return data.lengths if isinstance(data, Recordings) else [len(run) for run in data]


def without_still_inputs(data: Kind) -> Kind:
    """Return data without the inputs that never vary: they tell nothing, so that a model has no such input.

    A note says which; what a constant input does is part of the constant term.
    """
    found = data.moments.of(slice(len(data.states), None))
    pairs = zip(data.inputs, found.high > found.low, strict=True)
    still = [name for name, moves in pairs if not moves]
    if not still:
        return data
    note = f"{', '.join(still)} never {'varies' if len(still) == 1 else 'vary'}: no input of the model"
    kept = data.with_inputs([name for name in data.inputs if name not in still])
    return cast("Kind", replace(kept, notes=(*data.notes, note)))


def steps(data: Measurements) -> Steps:
    """Return the steps in time."""
    return data.steps if isinstance(data, Recordings) else run_steps(data)


def segments(data: Measurements, parts: Sequence[Part]) -> list[Trajectory]:
    """Return some parts, in memory."""
    if isinstance(data, Recordings):
        return data.segments(parts)
    return [data[part.run][part.start : part.stop] for part in parts]


def evenly(count: int, most: int) -> Int[ndarray, " k"]:
    """Return at most `most` of the places 0 to count - 1, evenly chosen, the first and the last among them."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))


def beginnings(data: Measurements, longest: int, most: int = 20) -> Trajectories:
    """Return the first `longest` samples of at most `most` runs, evenly chosen, in memory."""
    counts = lengths(data)
    heads = segments(data, [Part(int(r), 0, min(counts[r], longest), 0) for r in evenly(len(counts), most)])
    return Trajectories(tuple(heads), data.states, data.inputs)


def block_sums(
    data: Measurements,
    parts: Iterable[Part],
    function: Callable[[Trajectory, int], Sum],
    overlap: int = 0,
    within: bool = False,
) -> dict[int, Sum]:
    """Return, for every block, the sum of `function(segment, count)` over its parts, in one pass.

    A segment holds the `count` samples of a part, or of a piece of one, and the `overlap` samples behind them as far
    as the run goes (`within`: as far as the part goes). So a sum over windows or pairs that begin in the piece does not
    depend on where a part was cut.
    """
    if isinstance(data, Recordings):
        return data.sums(parts, function, overlap, within)
    answers = []
    for part in parts:
        limit = (part.end or part.stop) if within else len(data[part.run])
        segment = data[part.run][part.start : min(part.stop + overlap, limit)]
        answers.append({part.block: function(segment, part.stop - part.start)})
    return summed(answers)
