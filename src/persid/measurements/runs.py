"""Runs: the rows of a table cut where a run ends, at a new label, a restart of the clock, a gap, an incomplete row."""

from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np
import pandas as pd
from numpy import ndarray

from persid.errors import DataError
from persid.measurements.delays import late_runs
from persid.measurements.tables import Columns, Rows, Table, find, rows_of
from persid.measurements.trajectory import Runs, Trajectory

GAP = 10.0  # a step longer than this many median steps is a gap, not an irregular sample
SHORTEST = 4  # samples of a run, on average, where a clock that goes back is a restart and not disorder
MOST_OF_A_KIND = 3  # cuts of one kind in one table that are named one by one
MOST_NOTES = 20  # notes in all


def runs_of_tables(tables: Iterable[Table], columns: Columns) -> Runs:
    """Return all runs of some tables, with the notes on what was repaired.

    Raises:
        DataError: as for `persid.read_csv`.
    """
    runs: list[Trajectory] = []
    notes: list[str] = []
    for table in tables:
        runs += _runs(table, columns, notes)
    late, told = late_runs(runs, columns.inputs, columns.delay)
    return Runs(late, columns.states, columns.inputs, (*shortened(notes), *told))


def shortened(notes: list[str]) -> tuple[str, ...]:
    """Return the notes once each, and not more of them than a person reads."""
    different = list(dict.fromkeys(notes))
    more = len(different) - MOST_NOTES
    return (*different[:MOST_NOTES], *([f"and {more} more such notes"] if more > 0 else []))


def _runs(table: Table, columns: Columns, notes: list[str]) -> list[Trajectory]:
    rows = rows_of(table, columns, notes)
    n = len(columns.states)
    runs, single = [], 0
    for part in _by_label(rows):
        t = np.arange(len(part.good)) * float(columns.dt or 0) if part.t is None else part.t
        for a, b in _cuts(table, part, t, columns.gap, notes):
            single += b - a < 2
            if b - a >= 2:
                runs.append(Trajectory(t[a:b], part.values[a:b, :n], part.values[a:b, n:]))
    if single:
        notes.append(f"{table.name}: {single} single sample(s) between gaps were left out")
    if not runs:
        raise DataError(
            f"{table.name}: no two consecutive complete rows; at least 2 are needed{_hint(table, rows, columns)}"
        )
    return runs


def _by_label(rows: Rows) -> Iterator[Rows]:
    """Yield the rows of every run, which may stand apart."""
    if rows.runs is None:
        yield rows
        return
    codes, names = pd.factorize(rows.runs)
    for code in range(len(names)):
        k = np.flatnonzero(codes == code)
        t = None if rows.t is None else rows.t[k]
        label = partial(_label_at, rows, k)
        yield Rows(t, rows.values[k], rows.good[k], None, label, rows.clock)


def _label_at(rows: Rows, places: ndarray, k: int) -> str:
    return rows.label(int(places[k]))


def restarts(name: str, rows: Rows, t: ndarray) -> ndarray:
    """Return the rows at which the clock starts again: it goes back to where the run began, or by more than a gap.

    Raises:
        DataError: a time is repeated, or rows are out of order.
    """
    places = np.flatnonzero(rows.good)
    steps = np.diff(t[places])
    same, back = np.flatnonzero(steps == 0), np.flatnonzero(steps < 0)
    if len(same):
        raise _disorder(name, rows, t, places[same[0] : same[0] + 2], "is repeated", _REPEATED)
    if not len(back):
        return back
    usual = float(np.median(steps[steps > 0])) if (steps > 0).any() else 0.0
    begins = t[places[np.concatenate([[0], back[:-1] + 1])]]
    little = back[(t[places[back + 1]] > begins + usual) & (-steps[back] <= GAP * usual)]
    if len(little) or len(places) / (len(back) + 1) < SHORTEST:
        k = int((little if len(little) else back)[0])
        before = float(t[places[k]])
        raise _disorder(name, rows, t, places[k : k + 2], f"comes after {before:.12g}", _UNSORTED)
    return places[back + 1]


_RUNS = "several runs in one table: name the column that tells them apart (run=)"
_REPEATED = (
    "keep one row for each time, or give the step (dt=) where the steps are equal and the clock is too coarse; " + _RUNS
)
_UNSORTED = f"sort the rows by time; {_RUNS}"


def _disorder(name: str, rows: Rows, t: ndarray, pair: ndarray, what: str, hint: str) -> DataError:
    """Return the error that names the second of two rows that are out of order."""
    k = int(pair[1])
    column = f", column {rows.clock!r}" if rows.clock else ""
    return DataError(f"{name}: {rows.label(k)}{column}: time {float(t[k]):.12g} {what}; {hint}")


def _cuts(table: Table, rows: Rows, t: ndarray, gap: float | int | None, notes: list[str]) -> list[tuple[int, int]]:
    """Cut where the clock starts again, at incomplete rows and at gaps; return [start, end) and note every cut."""
    good = rows.good
    again = np.zeros(len(good), dtype=bool)
    again[restarts(table.name, rows, t)] = True
    steps = np.diff(t)
    both = good[:-1] & good[1:] & ~again[1:]
    limit = GAP * float(np.median(steps[both])) if gap is None and both.any() else (np.inf if gap is None else gap)
    far = both & (steps > limit)
    label = rows.label
    begun = [
        f"the clock starts again at {label(k)}; a new trajectory starts there" for k in np.flatnonzero(again).tolist()
    ]
    gaps = [f"a gap of {steps[k]:.6g} s from {label(k)} to {label(k + 1)}; a new trajectory starts there"
            for k in np.flatnonzero(far).tolist()]  # fmt: skip
    left_out = [
        f"{label(k)} is incomplete; left out, a new trajectory starts after it" for k in np.flatnonzero(~good).tolist()
    ]
    for told in (begun, gaps, left_out):
        notes += [f"{table.name}: {note}" for note in _first_few(told)]
    ends = far | again[1:]
    starts = np.flatnonzero(good & np.concatenate([[True], ~good[:-1] | ends]))
    stops = np.flatnonzero(good & np.concatenate([~good[1:] | ends, [True]])) + 1
    return [(int(a), int(b)) for a, b in zip(starts, stops, strict=True)]


def _first_few(told: list[str]) -> list[str]:
    """Return the first of many notes of one kind, and how many more there are."""
    more = len(told) - MOST_OF_A_KIND
    return told if more <= 1 else [*told[:MOST_OF_A_KIND], f"and {more} more times, the last: {told[-1]}"]


def _hint(table: Table, rows: Rows, columns: Columns) -> str:
    """Say what to try where no two rows in sequence are complete."""
    hollow = [name for name in columns.names if table.frame[find(table, name, [])].isna().all()]
    if hollow:
        return f"; {', '.join(hollow)} {'holds' if len(hollow) == 1 else 'hold'} no number at all: leave it out"
    return "" if rows.good.all() and columns.missing != "drop" else '; try missing="drop" or missing="interpolate"'
