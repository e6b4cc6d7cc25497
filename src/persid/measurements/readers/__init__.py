"""Readers: measurements in files -> Trajectories, with every repair noted and every doubt an error.

A format is one file here: what reads it into a `Table`, and the bytes it begins with.
"""

from collections.abc import Callable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Unpack

from persid.measurements.options import ReadingOf
from persid.measurements.readers.sources import Source, beginning, files_of, unpacked
from persid.measurements.runs import runs_of_tables
from persid.measurements.tables import Columns, Table
from persid.measurements.trajectories import Trajectories

FORMATS = {  # the first bytes of a file -> its reader; everything else is text
    b"PAR1": ("parquet", "parquet_table"),
    b"PK\x03\x04": ("excel", "excel_table"),
    b"MATLAB": ("matlab", "matlab_table"),
    b"\x89HDF": ("matlab", "matlab_table"),
}


def read_measurements(
    paths: object,
    *,
    states: Sequence[str],
    inputs: Sequence[str] = (),
    time: str | None = None,
    dt: float | int | None = None,
    gap: float | int | None = None,
    missing: str = "error",
    na: Sequence[object] = (),
    run: str | None = None,
    delay: Mapping[str, float | int] | None = None,
) -> Trajectories:
    """Read files of measurements in any form: text, Parquet, xlsx, MATLAB, compressed by gz, zip, xz or bz2.

    `paths` is a path, a pattern, a folder, "-" for the standard input, an open file, or a list of these; every file is
    a run of its own, or several. Of text the mark between the columns, decimal commas, thousands, encoding, comments,
    a missing row of names (columns are then c1, c2, ...) and a row of units are found. What was done stands in `notes`.

    Args:
        paths: where the measurements are.
        states, inputs: names of columns; a unit in a column's name, as in "x [mm]", may be left out.
        time: the column of the times, by default one that is named like a time or holds dates. A unit in its name is
            read ("t [ms]"); dates and numbers since 1970 become s since the first; the unit of a column that does not
            tell its own stands in the argument: time="t [h]".
        dt: the step in s, where there is no such column.
        gap: a step in time above so many s starts a new run (default: ten median steps); so does a clock that
            starts again.
        missing: what empty cells and NaN do: "error"; "split", they end a run; "drop", the row is left out; or
            "interpolate", states are filled by straight lines and inputs held.
        na: values that mean missing, too, such as -9999.
        run: the column that tells runs apart.
        delay: dead times of inputs in s, such as {"u": 2.0}: u(t - 2 s) then stands beside x(t).

    Raises:
        DataError: a column is missing, a cell is no finite number, times are repeated, or rows are too few; the
            message names file, row (the line of the file) and column, and what to try.
        ImportError: a format needs a library that is not installed.

    Examples:
        >>> import io
        >>> export = io.StringIO("Zeit [ms];Weg [mm]\\n0;1,5\\n20;1,25\\n")
        >>> data = ps.read_measurements(export, states=["Weg"])
        >>> data[0].t.tolist(), data[0].x[:, 0].tolist()
        ([0.0, 0.02], [1.5, 1.25])
    """
    columns = Columns.of(
        states=states, inputs=inputs, time=time, dt=dt, gap=gap, missing=missing, na=na, run=run, delay=delay
    )
    return Trajectories.of(runs_of_tables((table_of(source, columns) for source in files_of(paths)), columns))


def read_csv(paths: object, **options: Unpack[ReadingOf]) -> Trajectories:
    """Read text files in any dialect: `read_measurements` under its best-known name.

    Raises:
        DataError: as for `read_measurements`.

    Examples:
        >>> data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> data[0].x.shape, data.states
        ((1000, 2), ('x1', 'x2'))
    """
    return read_measurements(paths, **options)


def read_parquet(paths: object, **options: Unpack[ReadingOf]) -> Trajectories:
    """Read Parquet files (needs pyarrow): `read_measurements`, rows counted from 1 without a header.

    Raises:
        DataError: as for `read_measurements`.

    Examples:
        >>> import pandas as pd
        >>> pd.DataFrame({"t": [0.0, 0.1, 0.2], "x": [1.0, 0.9, 0.8]}).to_parquet("run.parquet")
        >>> len(ps.read_parquet("run.parquet", time="t", states=["x"])[0].t)
        3
    """
    return read_measurements(paths, **options)


def table_of(source: Source, columns: Columns) -> Table:
    """Read one file into a table by the reader of its format.

    Raises:
        DataError: as for `read_measurements`.
    """
    plain, _ = unpacked(source)
    start = beginning(plain, 8)
    for mark, (module, name) in FORMATS.items():
        if start.startswith(mark):
            reader: Callable[[Source, Columns], Table] = getattr(
                import_module(f"persid.measurements.readers.{module}"), name
            )
            return reader(plain, columns)
    from persid.measurements.readers.text import text_table

    return text_table(source, columns)


def is_parquet(source: Source) -> bool:
    """Whether a file is one of Parquet, which is read by groups of rows."""
    return isinstance(source, Path) and beginning(source, 4) == b"PAR1"
