"""Odd files: one table in every form that laboratories write, with the right values beside it."""

import bz2
import gzip
import io
import itertools
import lzma
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

COUNT = 60
STEP = 0.02  # s
T = np.arange(COUNT) * STEP
POSITION = np.round(1.25 + np.sin(T) * 3 + np.arange(COUNT) * 1e-3, 4)
FORCE = np.round(np.cos(5 * T), 3)
START = pd.Timestamp("2024-03-31T00:59:59.500")  # the clocks of Europe change half a second later


@dataclass(frozen=True)
class Odd:
    """A file, what is asked of it, and the name of its state."""

    name: str
    content: bytes
    state: str
    force: str
    time: str | None


SEPARATORS = {
    "commas": (",", "."), "semicolons": (";", "."), "german": (";", ","), "tabs": ("\t", "."), "french": ("\t", ","),
    "bars": ("|", "."), "blanks": (" ", "."),
}  # fmt: skip
HEADERS: dict[str, Callable[[str, str], tuple[list[str], str, str]]] = {
    "plain": lambda d, t: ([d.join([t, "Weg", "Kraft"])], "Weg", "Kraft"),
    "units in names": lambda d, t: ([d.join([t, "Weg[µm]", "Kraft[N]"])], "Weg", "Kraft"),
    "units below": lambda d, t: ([d.join([t, "Weg", "Kraft"]), d.join(["-", "[µm]", "[N]"])], "Weg", "Kraft"),
    "comment": lambda d, t: (["# Prüfstand 7", "# " + d.join([t, "Weg", "Kraft"])], "Weg", "Kraft"),
    "text above": lambda d, t: (["Prüfstand", "", d.join([t, "Weg", "Kraft"])], "Weg", "Kraft"),
    "none": lambda d, t: ([], "c2", "c3"),
}
ENCODINGS = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "cp1252")
PACKED: dict[str, Callable[[bytes], bytes]] = {
    "plain": lambda data: data, "gz": gzip.compress, "xz": lzma.compress, "bz2": bz2.compress,
    "zip": lambda data: _zipped(data),
}  # fmt: skip
TIMES: dict[str, tuple[str, Callable[[int], str], str | None]] = {
    "seconds": ("t", lambda k: f"{T[k]:.2f}", None),
    "milliseconds": ("Zeit[ms]", lambda k: f"{1000 * T[k]:.1f}", None),
    "microseconds": ("t_us", lambda k: f"{round(1e6 * T[k])}", None),
    "minutes": ("time", lambda k: repr(float(T[k] / 60)), "time [min]"),
    "since 1970": ("timestamp", lambda k: f"{START.value // 10**6 + 20 * k}", None),
    "nanoseconds since 1970": ("time", lambda k: f"{START.value + 20_000_000 * k}", None),
    "ISO": ("time", lambda k: _instant(k).isoformat(), None),
    "zones": (
        "Zeit", lambda k: _instant(k).tz_localize("UTC").tz_convert("Europe/Berlin").isoformat(),
        None,
    ),
    "german dates": ("Datum", lambda k: _german(_instant(k)), None),
}  # fmt: skip


def _instant(k: int) -> pd.Timestamp:
    return START + pd.Timedelta(20 * k, "ms")


def _german(time: pd.Timestamp) -> str:
    return time.strftime("%d.%m.%Y_%H:%M:%S.%f").replace("_", "T")


def _zipped(data: bytes) -> bytes:
    packed = io.BytesIO()
    with zipfile.ZipFile(packed, "w") as archive:
        archive.writestr("export.csv", data)
    return packed.getvalue()


def table(separators: str, header: str, times: str, encoding: str, packing: str) -> Odd:
    """Return the table in one form."""
    mark, point = SEPARATORS[separators]
    clock, write, asked = TIMES[times]
    lines, state, force = HEADERS[header](mark, clock)
    dated = times in ("ISO", "zones", "german dates")

    def number(text: str) -> str:
        return text.replace(".", point)

    for k in range(COUNT):
        t = write(k) if dated else number(write(k))
        lines.append(mark.join([t, number(f"{POSITION[k]:.4f}"), number(f"{FORCE[k]:.3f}")]))
    if header == "none":
        unit = {"milliseconds": "ms", "microseconds": "us", "minutes": "min"}.get(times)
        asked = "c1" if unit is None else f"c1 [{unit}]"
    content = PACKED[packing](("\r\n".join(lines) + "\r\n").encode(encoding))
    return Odd(f"{separators}, {header}, {times}, {encoding}, {packing}", content, state, force, asked)


def all_tables() -> Iterator[Odd]:
    """Yield every pair of forms of two kinds at least once: separators with headers and times, encodings, packings."""
    kinds = (list(SEPARATORS), list(HEADERS), list(TIMES))
    more = zip(itertools.cycle(ENCODINGS), itertools.cycle(PACKED), strict=False)
    for (separators, header, times), (encoding, packing) in zip(itertools.product(*kinds), more, strict=False):
        yield table(separators, header, times, encoding, packing)
