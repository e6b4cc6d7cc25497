"""Sources: where measurements stand, in files, folders, pipes and open files, compressed or not."""

import bz2
import glob
import gzip
import hashlib
import io
import lzma
import sys
import zipfile
import zlib
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from persid.errors import DataError

HEAD = 1 << 18  # bytes in which the form of a file is found


@dataclass(frozen=True)
class Content:
    """What was read once and cannot be read again: the bytes of a pipe or of an open file, under its name."""

    name: str
    data: bytes = field(repr=False)

    def __str__(self) -> str:
        return self.name


Source = Path | Content


def files_of(source: Any) -> list[Source]:
    """Return what a path, a pattern, a folder, "-", an open file, or a list of these names, in order.

    Pipes, devices and open files are read here, once.

    Raises:
        DataError: there is no such file.
    """
    if isinstance(source, list | tuple):
        return [path for item in source for path in files_of(item)]
    if isinstance(source, Content):
        return [source]
    if hasattr(source, "read"):
        return [_taken(source)]
    if str(source) == "-":
        return [Content("standard input", sys.stdin.buffer.read())]
    path = Path(source)
    if path.is_dir():
        found = sorted(path.rglob("*.parquet")) or sorted(path.glob("*.csv"))
    elif path.is_file():
        found = [path]
    elif path.exists():
        return [Content(str(path), _read(path))]
    else:
        found = [Path(name) for name in sorted(glob.glob(str(path), recursive=True))]
    if not found:
        raise DataError(f"{source}: no such file, no folder with Parquet or CSV files, and no pattern that fits any")
    return list(found)


def _taken(file: Any) -> Content:
    data = file.read()
    name = getattr(file, "name", None)
    return Content(
        name if isinstance(name, str) else "the open file", data.encode("utf-8") if isinstance(data, str) else data
    )


def sha256(source: Source) -> str:
    """Return the SHA-256 of what stands there."""
    if isinstance(source, Content):
        return hashlib.sha256(source.data).hexdigest()
    with source.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def beginning(source: Source, count: int = HEAD) -> bytes:
    """Return the first bytes as they stand there.

    Raises:
        DataError: it cannot be read.
    """
    if isinstance(source, Content):
        return source.data[:count]
    try:
        with source.open("rb") as file:
            return file.read(count)
    except OSError as error:
        raise DataError(f"{source}: cannot be read: {error.strerror or error}") from None


def unpacked(source: Source) -> tuple[Source, str]:
    """Return a source with its compression undone, and the name of the compression, or "".

    Raises:
        DataError: it cannot be read, or is no whole compressed file.
    """
    start = beginning(source, 8)
    for mark, (name, undo) in PACKED.items():
        if start.startswith(mark) and not (name == "zip" and _is_workbook(source)):
            data = source.data if isinstance(source, Content) else _read(source)
            try:
                return Content(str(source), undo(data)), name
            except (OSError, EOFError, ValueError, lzma.LZMAError, zlib.error, zipfile.BadZipFile) as error:
                raise DataError(f"{source}: cannot be unpacked as {name}: {error}") from None
    return source, ""


def stream(source: Source) -> Any:
    """Return what libraries read from: the path, or a file in memory."""
    return io.BytesIO(source.data) if isinstance(source, Content) else source


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read: {error.strerror or error}") from None


def _is_workbook(source: Source) -> bool:
    try:
        with zipfile.ZipFile(stream(source)) as archive:
            return "xl/workbook.xml" in archive.namelist()
    except (OSError, zipfile.BadZipFile):
        return False


def _only_member(data: bytes) -> bytes:
    """Return the one file of an archive."""
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        names = [name for name in archive.namelist() if not name.endswith("/") and not name.startswith("__MACOSX")]
        if len(names) != 1:
            raise ValueError(f"it holds {len(names)} files ({', '.join(names[:5])}); unpack it and name one")
        return archive.read(names[0])


PACKED: dict[bytes, tuple[str, Callable[[bytes], bytes]]] = {
    b"\x1f\x8b": ("gz", gzip.decompress),
    b"PK\x03\x04": ("zip", _only_member),
    b"\xfd7zXZ\x00": ("xz", lzma.decompress),
    b"BZh": ("bz2", bz2.decompress),
}
