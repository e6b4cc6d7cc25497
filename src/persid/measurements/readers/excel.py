"""Excel workbooks (xlsx), by openpyxl: the first sheet with numbers is written as text and read like any other."""

import csv
import io
from dataclasses import replace

from persid._libraries import library
from persid.errors import DataError
from persid.measurements.readers.sources import Content, Source, stream
from persid.measurements.readers.text import text_table
from persid.measurements.tables import Columns, Table


def excel_table(source: Source, columns: Columns) -> Table:
    """Read the first sheet that holds two rows.

    Raises:
        DataError: it cannot be read, or holds no table.
        ImportError: openpyxl is not installed.
    """
    openpyxl = library("openpyxl", "files")
    try:
        book = openpyxl.load_workbook(stream(source), read_only=True, data_only=True)
    except (OSError, KeyError, ValueError) as error:
        raise DataError(f"{source}: cannot be read as a workbook: {error}") from None
    for sheet in book.worksheets:
        rows = [[_text(cell) for cell in row] for row in sheet.iter_rows(values_only=True)]
        if sum(any(row) for row in rows) >= 2:
            text = io.StringIO()
            csv.writer(text).writerows(rows)
            table = text_table(Content(str(source), text.getvalue().encode("utf-8")), columns)
            note = f"the sheet {sheet.title!r} of {len(book.worksheets)} was read"
            notes = table.notes if len(book.worksheets) == 1 else (note, *table.notes)
            return replace(table, notes=notes)
    raise DataError(f"{source}: no sheet holds two rows")


def _text(cell: object) -> str:
    """Return a cell as text that reads back as the same number."""
    if cell is None:
        return ""
    return cell.isoformat(" ") if hasattr(cell, "isoformat") else repr(cell) if isinstance(cell, float) else str(cell)
