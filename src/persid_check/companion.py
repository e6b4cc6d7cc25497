"""Large arrays beside a JSON file: a zip of uncompressed .npy members, read strictly; no pickle, no guess, no bomb."""

import hashlib
import re
import zipfile
from collections.abc import Mapping, Sequence
from fractions import Fraction
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

from persid_check.results import FormatError, NotProvedError

if TYPE_CHECKING:
    from numpy import ndarray

MAX_BYTES = 4 * 2**30  # of the file
MAX_MEMBERS = 1000
MAX_ITEMS = 2**28  # numbers in one array
NAME = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.+ -]{0,199}\.npz")
_HEADER = re.compile(rb"\{'descr': '(<f8|<i4|<i8)', 'fortran_order': False, 'shape': \((\d{1,12}),\), \} *\n")
_PREFIX = b"\x93NUMPY\x01\x00"

Arrays = Mapping[str, "ndarray"]


def load(entry: object, where: str, folder: Path | None, data: bytes | None = None, longest: int = MAX_BYTES) -> Arrays:
    """Return the arrays of a companion {"npz": name, "sha256": digits}, from a folder or from its bytes.

    Raises:
        FormatError: the name is no plain file name, the hash is another one, or an array is not as specified.
    """
    if not (isinstance(entry, Mapping) and isinstance(entry.get("npz"), str) and isinstance(entry.get("sha256"), str)):
        raise FormatError(where, "a file name (npz) and its SHA-256 are needed")
    if not NAME.fullmatch(entry["npz"]):
        raise FormatError(where, "a plain file name that ends in .npz is needed, without folders")
    data = _bytes(where, folder, entry["npz"], longest) if data is None else data
    if len(data) > longest:
        raise FormatError(where, f"{entry['npz']} has more than {longest} bytes")
    if hashlib.sha256(data).hexdigest() != entry["sha256"]:
        raise FormatError(where, f"{entry['npz']} has another SHA-256 than the one given")
    return read(data, where)


def _bytes(where: str, folder: Path | None, name: str, longest: int) -> bytes:
    if folder is None:
        raise FormatError(where, f"{name} is needed; check the file by its path, or give the companion's bytes")
    try:
        with (folder / name).open("rb") as file:
            data = file.read(longest + 1)
    except OSError as error:
        raise FormatError(where, f"{name} cannot be read: {error.strerror}") from None
    return data


def read(data: bytes, where: str = "companion") -> Arrays:
    """Return the arrays of the bytes of a companion, each one-dimensional: <f8, <i4 or <i8."""
    try:
        with zipfile.ZipFile(BytesIO(data)) as archive:
            members = archive.infolist()
            if len(members) > MAX_MEMBERS:
                raise FormatError(where, f"more than {MAX_MEMBERS} arrays")
            if len({member.filename for member in members}) != len(members):
                raise FormatError(where, "an array stands twice")
            if sum(member.file_size for member in members) > len(data):
                raise FormatError(where, "its arrays overlap: together they are larger than the file")
            return {member.filename.removesuffix(".npy"): _array(where, archive, member) for member in members}
    except (zipfile.BadZipFile, ValueError, NotImplementedError, RuntimeError, EOFError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(where, f"not a zip file of arrays: {str(error)[:200]}") from None


def _array(where: str, archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> "ndarray":
    """Return one array; it is stored, not compressed, so that it cannot be larger than the file."""
    import numpy as np

    place = f"{where}.{member.filename[:80]!r}"
    if not member.filename.endswith(".npy") or member.compress_type != zipfile.ZIP_STORED or member.flag_bits & 1:
        raise FormatError(place, "an uncompressed .npy member is needed")
    if member.file_size != member.compress_size or member.file_size > MAX_BYTES:
        raise FormatError(place, "its sizes do not agree")
    content = archive.read(member)
    size = int.from_bytes(content[8:10], "little")
    header = _HEADER.fullmatch(content[10 : 10 + size])
    if content[:8] != _PREFIX or header is None:
        raise FormatError(place, "a one-dimensional array of <f8, <i4 or <i8 in .npy version 1.0 is needed")
    kind, count = np.dtype(header[1].decode()), int(header[2])
    if count > MAX_ITEMS or len(content) != 10 + size + count * kind.itemsize:
        raise FormatError(place, "its size is not the one that its header declares")
    return np.frombuffer(content, kind, count, 10 + size)


def binary64(values: "Sequence[Fraction] | ndarray") -> "ndarray":
    """Return weights as floats, which they are exactly."""
    import numpy as np

    floats = np.array([float(value) for value in values]) if isinstance(values, tuple) else np.asarray(values)
    if isinstance(values, tuple) and any(Fraction(f) != v for f, v in zip(floats.tolist(), values, strict=True)):
        raise NotProvedError("weights", "in a large network a weight must be a binary64")
    return floats
