"""Times: which column holds them, in which unit, and how they become seconds."""

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from jaxtyping import Float
from numpy import ndarray

NAMES = ("t", "time", "zeit", "timestamp", "datetime", "zeitstempel", "elapsed", "date", "datum", "temps", "tiempo",
         "tempo", "tijd", "tid")  # fmt: skip
STEPS = ("ts", "dt", "step", "sampling")  # names of a column that may hold one step in its first row
SECONDS = {
    "s": ("s", "sec", "secs", "second", "seconds", "sekunde", "sekunden"),
    "ms": ("ms", "msec", "millisecond", "milliseconds", "millisekunden"),
    "us": ("us", "µs", "μs", "usec", "microsecond", "microseconds"),
    "ns": ("ns", "nsec", "nanosecond", "nanoseconds"),
    "min": ("min", "mins", "minute", "minutes", "minuten"),
    "h": ("h", "hr", "hrs", "hour", "hours", "std", "stunden"),
    "d": ("d", "day", "days", "tag", "tage"),
}
LONG = {"s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}  # s in a unit
PER_SECOND = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # units in a second
UNITS = {word: unit for unit, words in SECONDS.items() for word in words}
FIRST, LAST = 978_307_200.0, 4_102_444_800.0  # 2001 and 2100, in s since 1970: numbers between are dates


def base_and_unit(name: object) -> tuple[str, str | None]:
    """Return a name without its unit, and the unit of time in it, as in "Time (ms)", "t [min]", "time/s" and "t_us"."""
    text = str(name).strip()
    found = re.fullmatch(r"(.*?)\s*(?:\[(.*?)\]|\((.*?)\)|<(.*?)>|/\s*([^\s/]+)|\s+in\s+(\S+))", text)
    if found:
        unit = next(part for part in found.groups()[1:] if part is not None)
        return found[1].strip(), UNITS.get(unit.strip().lower())
    head, mark, tail = text.rpartition("_")
    known = mark and head.lower() in NAMES and tail.lower() in UNITS
    return (head, UNITS[tail.lower()]) if known else (text, None)


def is_clock(name: object) -> bool:
    """Whether a column or an index is named as a time is."""
    base = base_and_unit(name)[0].lower().strip(" .:")
    return base in NAMES or _LIKE_TIME.fullmatch(base) is not None


_LIKE_TIME = re.compile(
    r"(elapsed|relative|absolute|local|utc|log|recording|measurement|test|run)[ _-]?time"
    r"|(time|date)[ _-](stamp|time)|messzeit"
)


def holds_dates(values: Any) -> bool:
    """Whether a column or an index holds dates, periods or durations."""
    kind = values.dtype
    return getattr(kind, "kind", "") in "mM" or isinstance(kind, pd.PeriodDtype)


def looks_dated(cells: pd.Series) -> bool:
    """Whether a column holds dates, or begins with the text of one."""
    if holds_dates(cells):
        return True
    known = cells.dropna()
    first = known.iloc[0] if len(known) else None
    return isinstance(first, str) and _DATED.match(first.strip()) is not None


_DATED = re.compile(r"\d{4}-\d\d?-\d\d?|\d\d?[./]\d\d?[./]\d{4}\b")


_DAY = re.compile(r"\d{4}-\d\d?-\d\d?|\d\d?[./]\d\d?[./]\d{4}")
_HOUR = re.compile(r"\d{1,2}:\d\d(:\d\d([.,]\d+)?)?(\s?[AaPp][Mm])?")


def is_day(cells: pd.Series) -> bool:
    """Whether a column holds dates without times of day."""
    if cells.dtype.kind == "M":
        known = cells.dropna()
        return bool(len(known) and (known == known.dt.normalize()).all())
    return _begins(cells, _DAY)


def is_hour(cells: pd.Series) -> bool:
    """Whether a column holds times of day."""
    return cells.dtype.kind != "m" and not _is_number(cells) and _begins(cells, _HOUR)


def _begins(cells: pd.Series, form: re.Pattern[str]) -> bool:
    known = cells.dropna()
    return bool(len(known)) and form.fullmatch(str(known.iloc[0]).strip()) is not None


def joined(days: pd.Series, hours: pd.Series) -> pd.Series:
    """Return dates and times of day that stand in two columns as one; none where either is missing."""
    text = [part.map(lambda cell: str(cell).strip(), na_action="ignore") for part in (_day_text(days), hours)]
    return text[0].astype(object).str.cat(text[1].astype(object), sep=" ")


def _day_text(days: pd.Series) -> pd.Series:
    return days.dt.strftime("%Y-%m-%d") if days.dtype.kind == "M" else days


@dataclass(frozen=True)
class Clock:
    """How a column counts time: its unit where one is known, and the instant that counts as 0 where that is given."""

    unit: str | None = None
    origin: pd.Timestamp | float | None = None

    def seconds(self, cells: pd.Series) -> tuple[Float[ndarray, " N"], str]:
        """Return times in s (NaN where a cell holds none), and what was done to them, or ""."""
        numbers, dates = _read(cells)
        if dates is None:
            return self._counted(numbers)
        if dates.dtype.kind == "m":
            return _float_seconds(dates), "durations and times of day are taken in s"
        origin = self.origin if isinstance(self.origin, pd.Timestamp) else _first(dates)
        if origin is None:
            return numbers, ""
        return _float_seconds(dates - origin), f"dates are taken as s since {origin.isoformat()}"

    def first_instant(self, cells: pd.Series) -> pd.Timestamp | float | None:
        """Return the first of times that are dates or numbers since 1970, and None of any other."""
        numbers, dates = _read(cells)
        if dates is not None:
            return None if dates.dtype.kind == "m" else _first(dates)
        return float(numbers[np.isfinite(numbers)][0]) if self._since_1970(numbers) else None

    def _counted(self, numbers: Float[ndarray, " N"]) -> tuple[Float[ndarray, " N"], str]:
        """Numbers: since 1970 where they look like it, else in the unit that is known, else in s."""
        unit = self._since_1970(numbers)
        if unit is not None:
            origin = self.origin if isinstance(self.origin, float) else float(numbers[np.isfinite(numbers)][0])
            return (numbers - origin) / PER_SECOND[unit], f"numbers of {unit} since 1970 are taken as s since the first"
        if self.unit in PER_SECOND:
            numbers = numbers / PER_SECOND[self.unit]
        elif self.unit is not None:
            numbers = numbers * LONG[self.unit]
        return numbers, "" if self.unit in ("s", None) else f"its unit is {self.unit}; converted to s"

    def _since_1970(self, numbers: Float[ndarray, " N"]) -> str | None:
        """Return the unit in which numbers are dates between 2001 and 2100, if there is one."""
        finite = numbers[np.isfinite(numbers)]
        if not len(finite):
            return None
        for unit in [self.unit] if self.unit is not None else PER_SECOND:
            count = PER_SECOND.get(unit)
            if count is not None and FIRST * count <= finite.min() and finite.max() <= LAST * count:
                return unit
        return None


def in_seconds(t: object) -> tuple[object, str]:
    """Return times that stand in an array: numbers are s, unless they can only be ms, us or ns since 1970."""
    array = np.asarray(t)
    if array.dtype.kind in "fiu" and not (array.size and np.nanmin(array) > LAST):
        return t, ""
    return Clock().seconds(pd.Series(t))


def _read(cells: pd.Series) -> tuple[Float[ndarray, " N"], pd.Series | None]:
    """Return cells as numbers, or, where they are none, as dates without a zone, or as durations."""
    if isinstance(cells.dtype, pd.PeriodDtype):
        cells = cells.dt.to_timestamp()
    if not holds_dates(cells):
        numbers = cells if _is_number(cells) else pd.to_numeric(cells, errors="coerce")
        if 2 * numbers.notna().sum() >= cells.notna().sum():
            return numbers.to_numpy(dtype=float, na_value=np.nan), None
        cells = _parsed(cells)
    if cells.dtype.kind == "M" and cells.dt.tz is not None:
        cells = cells.dt.tz_convert("UTC").dt.tz_localize(None)
    return np.full(len(cells), np.nan), cells


def _is_number(values: pd.Series) -> bool:
    return pd.api.types.is_numeric_dtype(values) and values.dtype != bool


def _first(dates: pd.Series) -> pd.Timestamp | None:
    known = dates.dropna()
    return None if known.empty else known.iloc[0]


def _float_seconds(lengths: pd.Series) -> Float[ndarray, " N"]:
    """Return durations of any resolution in s, NaN for none."""
    return np.asarray(lengths.dt.total_seconds(), dtype=float)


def _parsed(texts: pd.Series) -> pd.Series:
    """Read dates or times of day; ISO 8601 first, then day before month where points say so or months do not fit, or
    where the times then lie closer together.

    Raises:
        DataError: a cell is none.
    """
    cells = texts.map(lambda cell: re.sub(r"(:\d\d),(\d)", r"\1.\2", str(cell).strip()), na_action="ignore")
    sample = str(cells.dropna().iloc[0])
    if re.fullmatch(r"\d{1,3}:\d\d(:\d\d(\.\d+)?)?", sample):
        full = cells.map(lambda cell: cell if cell.count(":") == 2 else f"{cell}:00", na_action="ignore")
        return pd.to_timedelta(full, errors="coerce")
    if re.match(r"\d{4}-", sample):
        return pd.to_datetime(cells, errors="coerce", utc=True, format="ISO8601")
    orders = (True, False) if "." in sample.split()[0] else (False, True)
    tried = [pd.to_datetime(cells, errors="coerce", utc=True, format="mixed", dayfirst=first) for first in orders]
    whole = [dates for dates in tried if dates.notna().sum() == cells.notna().sum()]
    growing = [dates for dates in whole if dates.dropna().is_monotonic_increasing]
    growing.sort(key=lambda dates: dates.max() - dates.min())  # where both can be meant, no gap of months is made
    return (growing or whole or tried)[0]
