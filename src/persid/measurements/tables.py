"""Tables: what is taken from one, and how its cells become numbers; the same for files, frames and chunks."""

import difflib
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Unpack

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.options import ReadingOf
from persid.measurements.times import (
    STEPS,
    Clock,
    base_and_unit,
    holds_dates,
    is_clock,
    is_day,
    is_hour,
    joined,
    looks_dated,
)

MISSING = ("error", "split", "drop", "interpolate")
TRUTHS = (("false", "true"), ("off", "on"), ("no", "yes"), ("falsch", "wahr"), ("aus", "ein"), ("aus", "an"),
          ("nein", "ja"))  # fmt: skip
MOST_NAMES = 40  # columns that an error lists


@dataclass(frozen=True)
class Columns:
    """What is taken from a table: names, where the time comes from (a column, or the step dt in s), what ends a run.

    `missing` says what becomes of empty cells and NaN, `na` lists further values that mean the same, `run` is the
    column that tells runs apart, `origin` the instant that counts as 0 where dates are read chunk by chunk; `delay`
    holds how many s later inputs act than they are recorded.

    Raises:
        DataError: the question contradicts itself.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    time: str | None
    dt: float | int | None
    gap: float | int | None
    missing: str
    na: tuple[object, ...] = ()
    run: str | None = None
    origin: pd.Timestamp | float | None = None
    delay: Mapping[str, float] = field(default_factory=dict)

    @classmethod
    def of(cls, **asked: Unpack[ReadingOf]) -> "Columns":
        """Return what the arguments of `persid.read_measurements` ask for."""
        return cls(
            states=tuple(asked["states"]), inputs=tuple(asked.get("inputs", ())), time=asked.get("time"),
            dt=asked.get("dt"), gap=asked.get("gap"), missing=asked.get("missing", "error"),
            na=tuple(asked.get("na", ())), run=asked.get("run"), delay=dict(asked.get("delay") or {}),
        )  # fmt: skip

    def __post_init__(self) -> None:
        if self.missing not in MISSING:
            raise DataError(f"missing={self.missing!r}; choose one of {', '.join(MISSING)}")
        if self.time is not None and self.dt is not None:
            raise DataError("both a time column (time=) and a step (dt=) were given; give one of them")
        if self.dt is not None and not (np.isfinite(self.dt) and self.dt > 0):
            raise DataError(f"dt={self.dt} is no step; needed is a positive number in s")
        if not self.states or len(set(self.names)) != len(self.names):
            given = f"states {list(self.states)} and inputs {list(self.inputs)}"
            raise DataError(f"{given}: at least one state, and no name twice, is needed")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the states, then of the inputs."""
        return (*self.states, *self.inputs)

    @property
    def asked(self) -> tuple[str, ...]:
        """All columns that were asked for by name."""
        return (*self.names, *(name for name in (self.time, self.run) if name is not None))

    @property
    def wanted(self) -> set[str]:
        """The names that were asked for, as they are and without their units."""
        return {part.strip() for part in self.asked} | {base_and_unit(part)[0] for part in self.asked}

    def takes(self, name: object) -> bool:
        """Whether a column may be wanted: by its name, by its name without a unit, or as a time."""
        text = str(name).strip()
        return text in self.wanted or base_and_unit(text)[0] in self.wanted or (
            self.dt is None and self.time is None and (is_clock(text) or base_and_unit(text)[0].lower() in STEPS)
        )  # fmt: skip


@dataclass(frozen=True)
class Table:
    """One table still as it was read: `label(k)` names data row k the way its owner counts.

    `names` are those of all columns of the file, `units` what a row of units says of them, `notes` what was repaired;
    `headed` is false where the file has no names and the columns are called c1, c2, ...
    """

    name: str
    frame: pd.DataFrame
    label: Callable[[int], str]
    names: tuple[str, ...] = ()
    units: Mapping[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    headed: bool = True

    @property
    def offer(self) -> str:
        """The columns that there are, as an error lists them."""
        names = [str(name).strip() for name in (self.names or self.frame.columns)]
        more = f", ... ({len(names)} in all)" if len(names) > MOST_NAMES else ""
        why = "" if self.headed else "the file has no row of names; "
        return f"{why}the columns are {', '.join(names[:MOST_NAMES])}{more}"


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows of a table: times in s (None: from the step), states and inputs, which are complete, the run's label.

    `clock` names the column of the times.
    """

    t: Float[ndarray, " N"] | None
    values: Float[ndarray, "N k"]
    good: ndarray
    runs: ndarray | None
    label: Callable[[int], str]
    clock: str = ""


def rows_of(table: Table, columns: Columns, notes: list[str]) -> Rows:
    """Return the numbers of a table; what was repaired is added to the notes.

    Raises:
        DataError: a column is missing, or a cell is no finite number.
    """
    notes += [f"{table.name}: {note}" for note in table.notes]
    table = _without_blank_lines(table, columns, notes)
    found = [find(table, name, notes) for name in columns.names]
    if len(table.frame) < 2:
        raise DataError(f"{table.name}: {len(table.frame)} rows of data; at least 2 are needed")
    runs = None if columns.run is None else table.frame[find(table, columns.run, notes)].to_numpy()
    clock = None if columns.dt is not None else clock_column(table, columns, notes)
    t = None if clock is None else _times(table, clock, columns, notes)
    values = np.column_stack([_numbers(table, column, columns, notes) for column in found])
    good = np.isfinite(values).all(axis=1) & (True if t is None else np.isfinite(t))
    rows = _said_once(Rows(t, values, good, runs, table.label, str(clock).strip()), table, notes)
    if columns.missing == "drop":
        return _dropped(rows, table, columns, notes)
    if columns.missing == "interpolate":
        return _filled(rows, table, columns, notes)
    return rows


def _without_blank_lines(table: Table, columns: Columns, notes: list[str]) -> Table:
    """Return a table without the rows that hold nothing, not even a time; with a step in place of times they count."""
    blank = table.frame.isna().all(axis=1).to_numpy()
    if columns.dt is not None or not blank.any() or blank.all():
        return table
    _note(notes, f"{table.name}: blank lines were left out")
    kept = np.flatnonzero(~blank)
    return replace(table, frame=table.frame.iloc[kept], label=lambda k: table.label(int(kept[k])))


def find(table: Table, name: str, notes: list[str]) -> Hashable:
    """Return the column of that name, written exactly so, with blanks around it, or with its unit left out.

    Raises:
        DataError: there is none, or more than one.
    """
    columns = list(table.frame.columns)
    matches = [column for column in columns if str(column).strip() == name.strip()]
    exact = [column for column in matches if column == name]
    if len(matches) > 1 and len(exact) != 1:
        raise DataError(f"{table.name}: there are {len(matches)} columns named {name!r}; give every column its own")
    if matches:
        chosen = (exact or matches)[0]
        if chosen != name:
            _note(notes, f"{table.name}: blanks around the names of columns were ignored: {chosen!r}")
        return chosen
    bare = [column for column in columns if base_and_unit(column)[0] == base_and_unit(name)[0]]
    if len(bare) == 1:
        _note(notes, f"{table.name}: {name!r} is the column {str(bare[0]).strip()!r}")
        return bare[0]
    names = [str(column).strip() for column in table.names or columns]
    near = difflib.get_close_matches(name, names, 1)
    hint = f"did you mean {near[0]!r}? " if near else ""
    raise DataError(f"{table.name}: there is no column {name!r}; {hint}{table.offer}")


def _note(notes: list[str], note: str) -> None:
    if note not in notes:
        notes.append(note)


def _times(table: Table, column: Hashable, columns: Columns, notes: list[str]) -> Float[ndarray, " N"]:
    """Return the times in s."""
    cells = _instants(table, column, columns, notes)
    step = _lone_step(cells)
    if step is not None:
        _note(notes, f"{table.name}: {str(column).strip()!r} holds one step, {step:g} s, in its first row")
        return np.arange(len(cells)) * step
    t, said = _clock(table, column, columns).seconds(cells)
    bad = np.flatnonzero(~np.isfinite(t))
    if len(bad) and columns.missing != "error":
        bad = bad[(cells.notna().to_numpy() & ~_blank(cells))[bad]]
    if len(bad):
        place = f"{table.label(int(bad[0]))}, column {str(column).strip()!r}"
        hint = _hint(cells, int(bad[0]))
        raise DataError(f"{table.name}: {place}: {_complaint(table.frame[column].iloc[bad[0]], 'time')}{hint}")
    if said:
        _note(notes, f"{table.name}: time {str(column).strip()!r}: {said}")
    return t


def origin_of(table: Table, columns: Columns) -> pd.Timestamp | float | None:
    """Return the first instant of a table whose times are dates or numbers since 1970, and None of any other."""
    if columns.dt is not None or not len(table.frame):
        return None
    column = clock_column(table, columns, [])
    return _clock(table, column, columns).first_instant(_instants(table, column, columns, []))


def _instants(table: Table, column: Hashable, columns: Columns, notes: list[str]) -> pd.Series:
    """Return the cells of the times; a column of dates and one of times of day are joined."""
    cells = _known(table.frame[column], columns.na)
    wanted = is_hour if is_day(cells) else is_day if is_hour(cells) else None
    free = [(c, v) for c, v in table.frame.items() if c != column and str(c).strip() not in columns.asked]
    other = next((c for c, values in free if wanted is not None and wanted(values)), None)
    if other is None:
        return cells
    days, hours = (column, other) if wanted is is_hour else (other, column)
    _note(notes, f"{table.name}: {str(days).strip()!r} and {str(hours).strip()!r} are joined to one time")
    return joined(*(_known(table.frame[c], columns.na) for c in (days, hours)))


def _clock(table: Table, column: Hashable, columns: Columns) -> Clock:
    """Return how a column counts: by the unit in its name, in the argument that named it, or in the row of units."""
    asked = None if columns.time is None else base_and_unit(columns.time)[1]
    below = base_and_unit(f"t [{table.units.get(str(column), '')}]")[1]
    return Clock(base_and_unit(column)[1] or asked or below, columns.origin)


def clock_column(table: Table, columns: Columns, notes: list[str]) -> Hashable:
    """Return the column of the times: the one that was named, or one that is named like a time or holds dates.

    Raises:
        DataError: there is none.
    """
    if columns.time is not None:
        return find(table, columns.time, notes)
    free = [(name, cells) for name, cells in table.frame.items() if str(name).strip() not in columns.names]
    plain = [name for name, _ in free if str(name).strip().lower() in ("t", "time")]
    named = [name for name, _ in free if is_clock(name)]
    dated = [name for name, cells in free if looks_dated(cells)]
    steps = [c for c, cells in free if base_and_unit(c)[0].lower() in STEPS and _lone_step(cells) is not None]
    found = [*plain, *named, *dated, *steps]
    if not found:
        hint = "name its column (time=) or give the step in s (dt=)"
        raise DataError(f"{table.name}: no time: {hint}; {table.offer}")
    if not plain:
        _note(notes, f"{table.name}: the column {str(found[0]).strip()!r} is taken as the time")
    return find(table, str(found[0]), notes)


def _lone_step(cells: pd.Series) -> float | None:
    """Return the step that stands alone in the first row of a column."""
    if len(cells) < 2 or holds_dates(cells) or cells.iloc[1:].notna().any():
        return None
    step = pd.to_numeric(cells.iloc[:1], errors="coerce").iloc[0]
    return float(step) if pd.notna(step) and 0 < step < np.inf else None


def _known(cells: pd.Series, na: Sequence[object]) -> pd.Series:
    """Return cells without the values that mean "missing"."""
    if not na:
        return cells
    wanted = {str(value).strip() for value in na}
    numbers = [number for number in (_number(value) for value in na) if number is not None]
    coded = pd.to_numeric(cells, errors="coerce").isin(numbers) if not holds_dates(cells) else False
    return cells.mask(coded | cells.map(lambda cell: str(cell).strip() in wanted))


def _number(value: Any) -> float | None:
    try:
        return float(value)
    except (TypeError, ValueError):
        return None


def _numbers(table: Table, column: Hashable, columns: Columns, notes: list[str]) -> Float[ndarray, " N"]:
    """Return one column as floats, NaN where a cell is missing, or raise the error that names its first bad cell."""
    series = _known(table.frame[column], columns.na)
    if holds_dates(series):
        raise DataError(f"{table.name}: the column {str(column).strip()!r} holds dates, not numbers; name it as time=")
    if not pd.api.types.is_numeric_dtype(series) or series.dtype == bool:
        series = _truths(series, table, column, notes)
    values = pd.to_numeric(series, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
    bad = ~np.isfinite(values)
    if columns.missing != "error":
        bad &= ~(pd.isna(series).to_numpy() | _blank(series))
    if bad.any():
        k = int(np.flatnonzero(bad)[0])
        where = f"{table.name}: {table.label(k)}, column {str(column).strip()!r}"
        raise DataError(f"{where}: {_complaint(series.iloc[k])}{_hint(series, k)}")
    return values


def _hint(series: pd.Series, k: int) -> str:
    """Name the way with missing cells that fits, where the first bad cell is one."""
    empty = pd.isna(series).to_numpy() | _blank(series)
    if not empty[k]:
        return ""
    full = int((~empty).sum())
    if not full:
        return "; the column holds nothing: leave it out"
    if 10 * full < 9 * len(empty):
        return (
            f'; {full} of {len(empty)} rows have a value (a slower channel?): missing="drop" takes these rows alone, '
            'missing="interpolate" fills the others'
        )
    return '; missing="split" starts a new trajectory there, missing="interpolate" fills it'


def _truths(series: pd.Series, table: Table, column: Hashable, notes: list[str]) -> pd.Series:
    """Return a column of truth values as 0 and 1; any other one as it is, truth values among numbers made texts."""
    known = series.dropna()
    words = known.map(lambda cell: str(cell).strip().lower())
    pair = next((pair for pair in TRUTHS if len(known) and words.isin(pair).all()), None)
    if pair is not None:
        said = "truth values" if pair == TRUTHS[0] else f"{pair[0]} and {pair[1]}"
        _note(notes, f"{table.name}: {str(column).strip()!r} holds {said}, taken as 0 and 1")
        return words.map({pair[0]: 0.0, pair[1]: 1.0}).reindex(series.index)
    return series.map(lambda cell: str(cell) if isinstance(cell, bool) else cell)


def _blank(series: pd.Series) -> ndarray:
    return series.map(lambda cell: isinstance(cell, str) and not cell.strip()).to_numpy(dtype=bool)


def _complaint(cell: Any, what: str = "number") -> str:
    if isinstance(cell, str) and cell.strip():
        return f"{cell!r} is not a {what}; correct the cell, leave the column out, or name it as missing (na=)"
    if isinstance(cell, float) and np.isinf(cell):
        return f"{cell} is not finite; correct the cell or cut the row out"
    if pd.isna(cell) or isinstance(cell, str):
        return "the cell is empty or NaN"
    return f"{cell!r} is not a finite number"


def _said_once(rows: Rows, table: Table, notes: list[str]) -> Rows:
    """Leave out rows that say what the row before them says, its time included: a logger that wrote them twice."""
    if rows.t is None:
        return rows
    said = np.column_stack([rows.t, rows.values])
    again = rows.good & np.concatenate([[False], (said[1:] == said[:-1]).all(axis=1)])
    if rows.runs is not None:
        again[1:] &= rows.runs[1:] == rows.runs[:-1]
    if not again.any():
        return rows
    first = rows.label(int(np.flatnonzero(again)[0]))
    notes.append(f"{table.name}: {again.sum()} row(s) that repeat the row before them, the first {first}, are left out")
    return _kept(rows, np.flatnonzero(~again))


def _kept(rows: Rows, kept: ndarray) -> Rows:
    """Return some of the rows, which keep their labels."""
    t, runs = (None if part is None else part[kept] for part in (rows.t, rows.runs))
    return Rows(t, rows.values[kept], rows.good[kept], runs, lambda k: rows.label(int(kept[k])), rows.clock)


def _dropped(rows: Rows, table: Table, columns: Columns, notes: list[str]) -> Rows:
    """Leave incomplete rows out, without an end of a run there."""
    kept = np.flatnonzero(rows.good)
    lost = len(rows.good) - len(kept)
    if not lost:
        return rows
    notes.append(f"{table.name}: {lost} of {len(rows.good)} rows are incomplete and left out")
    t = rows.t if rows.t is not None else np.arange(len(rows.good)) * float(columns.dt or 0)
    return _kept(replace(rows, t=t), kept)


def _filled(rows: Rows, table: Table, columns: Columns, notes: list[str]) -> Rows:
    """Fill states by straight lines in time, and hold inputs; what lies outside stays missing."""
    clock = np.arange(len(rows.good)) * 1.0 if rows.t is None else rows.t
    values = rows.values.copy()
    for k in range(values.shape[1]):
        known = np.flatnonzero(np.isfinite(values[:, k]) & np.isfinite(clock))
        inner = np.flatnonzero(~np.isfinite(values[:, k]) & np.isfinite(clock))
        inner = inner[(inner > known[0]) & (inner < known[-1])] if len(known) else inner[:0]
        if not len(inner):
            continue
        name = columns.names[k]
        if k < len(columns.states):
            values[inner, k] = np.interp(clock[inner], clock[known], values[known, k])
            notes.append(f"{table.name}: {len(inner)} missing cells of {name} were filled by straight lines in time")
        else:
            values[inner, k] = values[known[np.searchsorted(known, inner) - 1], k]
            notes.append(f"{table.name}: {len(inner)} missing cells of {name} hold the value before them")
    good = np.isfinite(values).all(axis=1) & np.isfinite(clock)
    return replace(rows, values=values, good=good)
