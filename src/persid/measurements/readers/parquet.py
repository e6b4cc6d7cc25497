"""Parquet files."""

import pandas as pd

from persid._libraries import library
from persid.errors import DataError
from persid.measurements.readers.sources import Source, stream
from persid.measurements.tables import Columns, Table
from persid.measurements.times import holds_dates, is_clock


def parquet_table(source: Source, columns: Columns) -> Table:
    """Read a Parquet file; an index that is named like a time, or holds dates, is a column.

    Raises:
        DataError: it cannot be read.
        ImportError: pyarrow is not installed; the message says which extra brings it.
    """
    library("pyarrow", "dask")
    try:
        frame = pd.read_parquet(stream(source))
    except (OSError, ValueError) as error:
        raise DataError(f"{source}: cannot be read as Parquet: {error}") from None
    index = frame.index
    if index.nlevels == 1 and (holds_dates(index) or (index.name is not None and is_clock(index.name))):
        frame = frame.rename_axis(str(index.name or "time")).reset_index()
    return Table(str(source), frame, lambda k: f"row {k + 1}")
