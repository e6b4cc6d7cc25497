"""Objects of JSON read; results written: a good file is never replaced by a broken one, nor what is no file by one."""

import json
import os
import re
import stat
import sys
import tempfile
from contextlib import suppress
from pathlib import Path
from typing import Any

Json = dict[str, Any]  # an object as the JSON module gives it: what a key holds is known only to who wrote it
DESCRIPTORS = {"/dev/stdout": 1, "/dev/stderr": 2}


def json_object(text: str | bytes) -> Json:
    """Return the object that a text of JSON is.

    Raises:
        ValueError: it is no JSON, or no object.
    """
    found: Any = json.loads(text)
    if not isinstance(found, dict):
        raise ValueError(f"a {type(found).__name__} where an object belongs")
    return found


def readable(entry: object, line: str = "\n") -> str:
    """Write JSON with a line for each list of plain values, such as a row of a matrix; NaN and infinity are refused."""
    inner = line + " "
    if isinstance(entry, dict) and entry:
        fields = [f"{json.dumps(name)}: {readable(value, inner)}" for name, value in entry.items()]
        return "{" + inner + f",{inner}".join(fields) + line + "}"
    if isinstance(entry, list) and any(isinstance(item, list | dict) for item in entry):
        return "[" + inner + f",{inner}".join(readable(item, inner) for item in entry) + line + "]"
    return json.dumps(entry, allow_nan=False)


def write_atomically(path: str | Path, content: str | bytes) -> None:
    """Write beside, flush to disk, then rename; on any failure the old file stays and nothing is left behind.

    A link is written through; a device, a pipe and an output that is already open are written in place.

    Raises:
        OSError: it cannot be written; the error names the path that was given.
    """
    data = content.encode("utf-8") if isinstance(content, str) else content
    try:
        if in_place(path):
            _write_in_place(Path(path), data)
        else:
            _replace(Path(os.path.realpath(path)), data)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from None


def in_place(path: str | Path) -> bool:
    """Whether something stands there that is no regular file, or an output that is already open."""
    if _descriptor(Path(path)) is not None:
        return True
    try:
        return not stat.S_ISREG(os.stat(path).st_mode)
    except OSError:  # it is not there yet
        return False


def move(file: Path, target: Path) -> None:
    """Move a finished file to its place: by a rename, or, where a link or a device stands there, by writing through."""
    if target.is_symlink() or in_place(target):
        write_atomically(target, file.read_bytes())
        file.unlink()
    else:
        os.replace(file, target)


def _descriptor(path: Path) -> int | None:
    """Return the number of an output of this process that a path means."""
    text = os.path.abspath(path)
    found = re.fullmatch(r"/(?:dev|proc/self)/fd/(\d+)", text)
    return DESCRIPTORS.get(text) if found is None else int(found[1])


def _write_in_place(path: Path, data: bytes) -> None:
    """Write to what is there; an output that is open goes on behind what was printed to it."""
    number = _descriptor(path)
    if number == 1:
        sys.stdout.flush()
    with open(path, "wb") if number is None else os.fdopen(os.dup(number), "wb") as file:
        file.write(data)


def _replace(path: Path, data: bytes) -> None:
    """Write a new file and give it the name, and the permissions, of the old one."""
    mode = stat.S_IMODE(path.stat().st_mode) if path.exists() else 0o644
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.chmod(name, mode)
        os.replace(name, path)
    except BaseException:
        with suppress(OSError):
            os.unlink(name)
        raise
