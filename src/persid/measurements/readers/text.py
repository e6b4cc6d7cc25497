"""Text files: CSV in any dialect, with every cell read to the nearest binary64."""

import re
import warnings
from collections.abc import Callable
from typing import Any

import pandas as pd

from persid.errors import DataError
from persid.measurements.readers.dialects import Dialect, find_dialect
from persid.measurements.readers.sources import HEAD, Content, Source, beginning, stream, unpacked
from persid.measurements.tables import Columns, Table
from persid.measurements.times import is_hour, looks_dated

GROUPED = r"[+-]?\d{{1,3}}(?:{mark}\d{{3}})+(?:{point}\d*)?(?:[eE][+-]?\d+)?"


def text_table(source: Source, columns: Columns) -> Table:
    """Read the wanted columns of a text file.

    Raises:
        DataError: the file cannot be read as a table.
    """
    plain, packed = unpacked(source)
    head = beginning(plain)
    dialect = find_dialect(str(source), head, len(head) < HEAD, columns)
    frame, encoding = _frame(str(source), plain, dialect)
    notes = [*dialect.notes, *([f"text in {encoding}"] if encoding != dialect.encoding else [])]
    frame = frame[[k for k, name in enumerate(dialect.names) if name.strip() or frame[k].notna().any()]]
    frame = frame.set_axis([name or f"c{k + 1}" for k, name in enumerate(dialect.names) if k in frame.columns], axis=1)
    names = tuple(frame.columns)
    if frame.columns.is_unique:
        frame = frame[[name for name in names if columns.takes(name) or _tells_time(frame[name])] or list(names)]
    frame = frame.apply(_localised, decimal=dialect.decimal)
    label = _labels(plain, dialect, encoding)
    said = [packed] * bool(packed) + notes
    summary = ("found and undone: " + ", ".join(said),) if said else ()
    return Table(
        name=str(source),
        frame=frame,
        label=label,
        names=names,
        units=dialect.units,
        notes=summary,
        headed=dialect.headed,
    )


def _frame(name: str, plain: Source, dialect: Dialect) -> tuple[pd.DataFrame, str]:
    """Return all columns, numbered, and the encoding; cells that are no numbers stay text, for the error to show."""
    options: dict[str, Any] = {
        "header": None, "skiprows": dialect.skip, "names": range(len(dialect.names)), "index_col": False,
        "skip_blank_lines": False, "low_memory": False, "skipinitialspace": True, "comment": dialect.comment,
        "sep": r"\s+" if dialect.delimiter == " " else dialect.delimiter, "decimal": dialect.decimal,
    }  # fmt: skip
    if int(pd.__version__.split(".")[0]) < 3:  # pandas 3 always rounds to the nearest binary64
        options["float_precision"] = "round_trip"
    for encoding in (dialect.encoding, "cp1252", "latin-1"):
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("error", pd.errors.ParserWarning)
                frame = pd.read_csv(stream(plain), encoding=encoding, compression=None, **options)
        except pd.errors.EmptyDataError:
            return pd.DataFrame(columns=range(len(dialect.names))), encoding
        except UnicodeDecodeError:
            continue
        except (pd.errors.ParserError, pd.errors.ParserWarning) as error:
            count = len(dialect.names)
            raise DataError(f"{name}: the rows do not fit the header's {count} columns: {error}") from None
        while len(frame) and frame.iloc[-1].isna().all():  # blank lines at the end of the file
            frame = frame.iloc[:-1]
        return frame, encoding
    raise DataError(f"{name}: the file is no text; save it as UTF-8")


def _localised(cells: pd.Series, decimal: str) -> pd.Series:
    """Return a column with thousands separators undone, where at least one cell shows that they are no decimal marks.

    A column without any cell in the file's decimal mark may use the other one.
    """
    if pd.api.types.is_numeric_dtype(cells) or not cells.map(lambda cell: isinstance(cell, str)).any():
        return cells
    texts = cells.map(lambda cell: cell.strip() if isinstance(cell, str) else cell)
    point = re.escape(decimal)
    for mark in {",", ".", "'", " ", "\u00a0", "\u202f"} - {decimal}:
        pattern = GROUPED.format(mark=re.escape(mark), point=point)
        grouped = texts.map(lambda cell, p=pattern: isinstance(cell, str) and re.fullmatch(p, cell) is not None)
        sure = texts[grouped].map(lambda cell, m=mark: decimal in cell or cell.count(m) > 1 or m not in ".,")
        if sure.any():
            texts = texts.mask(grouped, texts[grouped].map(lambda cell, m=mark: cell.replace(m, "")))
            return _numbers(texts, decimal)
    other = "," if decimal == "." else "."
    return _numbers(texts, other) if decimal == "." and _all_commas(texts) else cells


def _all_commas(texts: pd.Series) -> bool:
    strings = texts[texts.map(lambda cell: isinstance(cell, str))]
    return bool(strings.map(lambda cell: re.fullmatch(r"[+-]?\d+(,\d+)?([eE][+-]?\d+)?", cell) is not None).all())


def _numbers(texts: pd.Series, decimal: str) -> pd.Series:
    """Return texts as numbers where they are some."""

    def number(cell: object) -> object:
        try:
            return float(cell.replace(decimal, ".")) if isinstance(cell, str) else cell
        except ValueError:
            return cell

    return texts.map(number)


def _labels(plain: Source, dialect: Dialect, encoding: str) -> Callable[[int], str]:
    """Return what names a row by its line in the file."""
    if dialect.comment is None:
        return lambda k: f"row {k + dialect.skip + 1}"

    def label(k: int) -> str:
        data = plain.data if isinstance(plain, Content) else plain.read_bytes()
        lines = re.split(r"\r\n|\n|\r", data.decode(encoding, "replace"))[dialect.skip :]
        places = [j for j, line in enumerate(lines) if not line.lstrip().startswith(str(dialect.comment))]
        return f"row {places[k] + dialect.skip + 1}"

    return label


def _tells_time(cells: pd.Series) -> bool:
    return looks_dated(cells) or is_hour(cells)
