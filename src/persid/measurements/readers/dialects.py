"""Dialects: how a text file is written, found in its first lines; clevercsv finds the mark between the columns."""

import codecs
import csv
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from persid.errors import DataError
from persid.measurements.tables import Columns
from persid.measurements.times import base_and_unit

MARKS = {b"\xef\xbb\xbf": "utf-8-sig", b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
COMMENTS = ("#", "%", "//")
LOOKED_AT = 200  # lines
WORDS = {",": "commas", ";": "semicolons", "\t": "tabs", " ": "blanks", "|": "bars"}
NUMBER = re.compile(
    r"[+-]?(\d[\d.,' \u00a0\u202f]*|[.,]\d+)([eEdD][+-]?\d+)?|[+-]?(nan|inf|infinity|na|n/a|null)", re.I
)
DATE = re.compile(r"\d{1,4}[-./:]\d{1,2}[-./:]?[\d.:TZ+, /-]*")
COMMA = re.compile(r"[+-]?(\d*|\d{1,3}([.' \u00a0\u202f]\d{3})+),\d+([eE][+-]?\d+)?")
POINT = re.compile(r"[+-]?(\d*|\d{1,3}([,' \u00a0\u202f]\d{3})+)\.\d+([eE][+-]?\d+)?")


@dataclass(frozen=True)
class Dialect:
    """How a text file is written: `skip` lines stand before the first row of numbers, `comment` begins others."""

    encoding: str
    delimiter: str
    decimal: str
    comment: str | None
    names: tuple[str, ...]
    units: dict[str, str]
    headed: bool
    skip: int
    notes: tuple[str, ...]


def find_dialect(name: str, head: bytes, whole: bool, columns: Columns) -> Dialect:
    """Return the dialect of a text that begins so; `whole` says that nothing follows.

    Raises:
        DataError: the text is empty, or no text.
    """
    encoding, text = _decoded(name, head, whole)
    lines = re.split(r"\r\n|\n|\r", text)[: LOOKED_AT if whole else -1][:LOOKED_AT]
    notes = [] if encoding in ("utf-8", "utf-8-sig") else [f"text in {encoding}"]
    comment = next((mark for mark in COMMENTS if any(line.lstrip().startswith(mark) for line in lines)), None)
    said = next((m[1] for line in lines[:3] if (m := re.fullmatch(r'"?sep=(.)"?[,;\t]*', line.strip(), re.I))), None)
    plain = {
        k: line for k, line in enumerate(lines)
        if line.strip() and not _is_comment(line, comment) and not (k < 3 and re.match(r'"?sep=.', line, re.I))
    }  # fmt: skip
    if not plain:
        raise DataError(f"{name}: the file is empty; needed is a row with the names of the columns, then the rows")
    delimiter = said or _delimiter(list(plain.values()))
    rows = {k: split(line, delimiter) for k, line in plain.items()}
    remarks = {k: split(line.lstrip().lstrip(comment or "").strip(), delimiter)
               for k, line in enumerate(lines) if _is_comment(line, comment)}  # fmt: skip
    header, units, first = _header(rows, remarks, columns)
    data = [row for k, row in rows.items() if k >= first]
    names = header if header is not None else [f"c{k + 1}" for k in range(max(map(len, data), default=1))]
    decimal = _decimal(data, delimiter)
    notes += [f"{WORDS.get(delimiter, repr(delimiter))} between the columns"] if delimiter != "," else []
    notes += ["decimal commas"] if decimal == "," else []
    notes += ["no row of names (the columns are called c1, c2, ...)"] if header is None else []
    notes += ["a row of units under the names"] if units else []
    raw = next((lines[k] for k, row in rows.items() if row is header), "")
    if delimiter != " " and any(cell != cell.strip() for cell in next(csv.reader([raw], delimiter=delimiter), [])):
        notes.append("blanks around the names")
    above = [k for k in rows if k < first and rows[k] not in (header, units)]
    notes += [f"{len(above)} line(s) above the table"] if above else []
    named = dict(zip(names, (unit.strip(" []()") for unit in units or ()), strict=False))
    single = comment if comment is not None and len(comment) == 1 else None
    return Dialect(
        encoding=encoding,
        delimiter=delimiter,
        decimal=decimal,
        comment=single,
        names=tuple(names),
        units=named,
        headed=header is not None,
        skip=first,
        notes=tuple(notes),
    )


def _is_comment(line: str, comment: str | None) -> bool:
    return comment is not None and line.lstrip().startswith(comment)


def _decoded(name: str, head: bytes, whole: bool) -> tuple[str, str]:
    """Return the encoding and the text: by a mark at the beginning, as UTF-8, or else as the code page of Windows."""
    encoding = next((found for mark, found in MARKS.items() if head.startswith(mark)), None)
    if encoding is None and head[1:400:2].count(0) > len(head[:400]) // 4:
        encoding = "utf-16-le"
    if encoding is None and head[:400:2].count(0) > len(head[:400]) // 4:
        encoding = "utf-16-be"
    if encoding is None and 0 in head:
        raise DataError(f"{name}: this is no text; readable are text, Parquet, xlsx and MATLAB files")
    for candidate in [encoding] if encoding else ["utf-8", "cp1252", "latin-1"]:
        try:
            return candidate, codecs.getincrementaldecoder(candidate)().decode(head, whole)
        except UnicodeDecodeError:
            continue
    raise DataError(f"{name}: the file is no {encoding} text; save it as UTF-8")


def _delimiter(lines: Sequence[str]) -> str:
    """Return the mark between the columns."""
    import clevercsv

    body = lines[len(lines) // 3 :] if len(lines) > 30 else lines
    try:
        found = clevercsv.Detector().detect("\n".join(body[:60]) + "\n", delimiters=list(WORDS))
    except (clevercsv.exceptions.Error, IndexError):
        found = None
    one_column = "," not in lines[0] and len(lines) > 1 and all(COMMA.fullmatch(line.strip()) for line in lines[1:])
    return ";" if one_column else found.delimiter if found is not None and found.delimiter else ","


def split(line: str, delimiter: str) -> list[str]:
    """Return the cells of a line."""
    if delimiter == " ":
        return next(csv.reader([re.sub(r"\s+", " ", line.strip())], delimiter=" "), [])
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])]


def _is_data(row: Sequence[str]) -> bool:
    """Whether at least half of the cells that hold something are numbers or dates, and one is."""
    full = [cell for cell in row if cell]
    known = [cell for cell in full if NUMBER.fullmatch(cell) or DATE.fullmatch(cell)]
    return bool(known) and 2 * len(known) >= len(full)


def _header(
    rows: dict[int, list[str]], remarks: dict[int, list[str]], columns: Columns
) -> tuple[list[str] | None, list[str] | None, int]:
    """Return the names, the units, and the number of the first line of data; the names may stand in a comment."""
    asked = columns.wanted
    everything = dict(sorted((rows | remarks).items()))
    named = [k for k, row in everything.items() if asked & ({*row} | {base_and_unit(cell)[0] for cell in row})]
    width = Counter(len(row) for row in rows.values() if _is_data(row)).most_common(1)
    wide = width[0][0] if width else max(map(len, rows.values()))
    data = [k for k, row in rows.items() if _is_data(row) and len(row) == wide and k not in named[:1]]
    first = next((k for k in data if not named or k > named[0]), None)
    above = [k for k, row in rows.items() if (first is None or k < first) and len(row) == wide and not _is_data(row)]
    beside = [k for k, row in remarks.items() if (first is None or k < first) and len(row) == wide]
    place = named[0] if named else above[0] if above else beside[-1] if beside else None
    if place is None:
        return None, None, min(rows) if first is None else first
    under = [k for k in above if k > place]
    end = first if first is not None else max(under, default=place) + 1
    if under and not all(not cell or len(cell) <= 12 for cell in rows[under[0]]):
        end, under = under[0], []
    return everything[place], rows[under[0]] if under else None, max(end if under else _next(rows, place), place + 1)


def _next(rows: dict[int, list[str]], place: int) -> int:
    """Return the number of the line after the names at which rows begin."""
    return min((k for k in rows if k > place), default=place + 1)


def _decimal(rows: Sequence[Sequence[str]], delimiter: str) -> str:
    cells = [cell for row in rows for cell in row]
    commas = sum(COMMA.fullmatch(cell) is not None for cell in cells)
    points = sum(POINT.fullmatch(cell) is not None for cell in cells)
    return "," if commas > points else "."
