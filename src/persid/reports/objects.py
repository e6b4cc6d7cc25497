"""Values as objects of JSON files, and back: dataclasses of numbers, texts and tuples, odd floats included."""

import json
import math
from collections.abc import Mapping
from dataclasses import is_dataclass
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

from persid._files import Json, write_atomically
from persid.errors import FolderError


def write_object(path: Path, content: Mapping[str, object]) -> None:
    """Write an object, numbers that JSON has no word for as {"float": "inf"}."""
    write_atomically(path, json.dumps(_finite(content), indent=1, allow_nan=False) + "\n")


def read_object(path: Path, form: str) -> Json:
    """Return the object that a file holds.

    Raises:
        FolderError: the file is not JSON, or its "format" is another one.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"), object_hook=_number_or_object)
    except (ValueError, RecursionError) as error:
        raise FolderError(f"{path}: not JSON: {error}") from None
    if not isinstance(content, dict) or content.get("format") != form:
        raise FolderError(f'{path}: "format" should be "{form}"')
    return content


def restored(kind: object, entry: Any) -> Any:
    """Return the value of a type from what `dataclasses.asdict` and JSON made of it; the type says how.

    Raises:
        KeyError, TypeError, ValueError: the entry is no such value.
    """
    if entry is None:
        return None
    if isinstance(kind, type) and is_dataclass(kind):
        kinds = get_type_hints(kind)
        return kind(**{name: restored(kinds[name], part) for name, part in entry.items()})
    origin, parts = get_origin(kind), get_args(kind)
    if origin in (Union, UnionType):
        return restored(next(part for part in parts if part is not NoneType), entry)
    if origin is not tuple:
        return entry
    inner = parts[:1] * len(entry) if parts[-1] is Ellipsis else parts
    return tuple(restored(*pair) for pair in zip(inner, entry, strict=True))


def _finite(entry: object) -> object:
    """Write numbers that JSON has no word for as {"float": "inf"}."""
    if isinstance(entry, Mapping):
        return {name: _finite(part) for name, part in entry.items()}
    if isinstance(entry, list | tuple):
        return [_finite(part) for part in entry]
    odd = isinstance(entry, float) and not math.isfinite(entry)
    return {"float": str(entry)} if odd else entry


def _number_or_object(content: Json) -> object:
    return float(content["float"]) if set(content) == {"float"} else content
