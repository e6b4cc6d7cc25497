"""Readers: measurements in files and tables -> Trajectories, with every repair noted and every doubt an error."""

import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from persid.errors import DataError, FolderError
from persid.measurements.tables import TIME_NAMES, Columns, Paths, Table, _assemble, _header
from persid.measurements.trajectories import Trajectories


def read_csv(
    paths: Paths,
    *,
    states: Sequence[str],
    inputs: Sequence[str] = (),
    time: str | None = None,
    dt: float | int | None = None,
    gap: float | int | None = None,
    missing: str = "error",
) -> Trajectories:
    """Read one CSV file, or several as several trajectories.

    Time in s is the column `time`, or the step `dt`, or a column named t or time. A step in time above `gap` s
    (default: ten median steps) starts a new trajectory. `missing="split"` does the same at empty cells and NaN, which
    are an error otherwise. What was repaired stands in `notes`.

    Raises:
        DataError: a column is missing, a cell is no finite number, times do not increase, or rows are too few; the
            message names file, row (the line of the file; the header is row 1) and column, and what to try.

    Examples:
        >>> data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> data[0].x.shape, data.states
        ((1000, 2), ('x1', 'x2'))
    """
    columns = Columns(tuple(states), tuple(inputs), time, dt, gap, missing)
    return _assemble((csv_table(file, columns) for file in files_of(paths)), columns)


def read_parquet(
    paths: Paths,
    *,
    states: Sequence[str],
    inputs: Sequence[str] = (),
    time: str | None = None,
    dt: float | int | None = None,
    gap: float | int | None = None,
    missing: str = "error",
) -> Trajectories:
    """Read Parquet files (needs pyarrow), by the rules of `read_csv`; rows are counted from 1 without a header.

    Raises:
        DataError: as for `read_csv`.

    Examples:
        >>> import pandas as pd
        >>> pd.DataFrame({"t": [0.0, 0.1, 0.2], "x": [1.0, 0.9, 0.8]}).to_parquet("run.parquet")
        >>> len(ps.read_parquet("run.parquet", time="t", states=["x"])[0].t)
        3
    """
    columns = Columns(tuple(states), tuple(inputs), time, dt, gap, missing)
    return _assemble((_parquet_table(file) for file in files_of(paths)), columns)


def files_of(paths: Paths) -> list[Path]:
    return [Path(paths)] if isinstance(paths, str | Path) else [Path(path) for path in paths]


def _parquet_table(path: Path) -> Table:
    try:
        return Table(str(path), pd.read_parquet(path), lambda k: f"row {k + 1}")
    except (OSError, ValueError, ImportError) as error:
        raise DataError(f"{path}: cannot be read as Parquet: {error}") from None


def csv_table(path: Path, columns: Columns) -> Table:
    header = _header(path)
    wanted = {*columns.names, *([columns.time] if columns.time else []), *(TIME_NAMES if columns.dt is None else ())}
    places = [k for k, name in enumerate(header) if name.strip() in wanted or name.strip().lower() in wanted]
    frame = _numeric_frame(path, header, places)
    return Table(str(path), frame, lambda k: f"row {k + 2}")


def _numeric_frame(path: Path, header: list[str], places: list[int]) -> pd.DataFrame:
    """Read the wanted columns as exact binary64; cells that are no numbers stay text, for the error to show."""
    options: dict[str, Any] = {
        "header": None, "skiprows": 1, "names": range(len(header)), "index_col": False,
        "skip_blank_lines": False, "encoding": "utf-8-sig", "low_memory": False,
        "skipinitialspace": True,
    }  # fmt: skip
    if int(pd.__version__.split(".")[0]) < 3:  # pandas 3 always rounds to the nearest binary64
        options["float_precision"] = "round_trip"
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            frame = pd.read_csv(path, **options)
    except pd.errors.EmptyDataError:
        frame = pd.DataFrame(columns=places)
    except (pd.errors.ParserError, pd.errors.ParserWarning, UnicodeDecodeError) as error:
        raise DataError(f"{path}: the rows do not fit the header's {len(header)} columns: {error}") from None
    frame = frame[places].set_axis([header[k] for k in places], axis=1)
    while len(frame) and frame.iloc[-1].isna().all():  # blank lines at the end of the file
        frame = frame.iloc[:-1]
    return frame


def read_measurements(paths: Sequence[str | Path], **options: Any) -> Trajectories:
    """Read CSV files, or Parquet files by their ending."""
    parquet = [Path(path).suffix == ".parquet" for path in paths]
    if any(parquet) and not all(parquet):
        raise FolderError("CSV and Parquet files cannot be mixed in one run; convert one kind")
    return (read_parquet if any(parquet) else read_csv)(list(paths), **options)
