"""Strict JSON: every limit is tested before the parser runs, and nothing is guessed."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any, NoReturn

from persid_check.results import FormatError

Json = dict[str, Any]  # an object of JSON: what a name holds is known once it has been read
Stated = Mapping[str, Any]  # the same, as something to read from
MAX_BYTES = 64 * 2**20
MAX_DEPTH = 16
MAX_LISTS = 4_000_000  # opening brackets, those in texts counted: a list takes far more memory than it has bytes
MAX_DIGITS = 700  # of an integer: a binary64 or a dyadic mantissa needs fewer

_STRING = re.compile(r'"[^"\\]*+(?:\\.[^"\\]*+)*+"?', re.DOTALL)  # closed or not
_BRACKET = re.compile(r"[\[\]{}]")


def read(data: bytes, *, floats: bool, longest: int = MAX_BYTES) -> Any:
    """Return the JSON value of at most `longest` UTF-8 bytes; without `floats`, every number must be an integer.

    Raises:
        FormatError: too large, too deep, not UTF-8, not JSON, a duplicate key, a number that may not stand there.
    """
    if len(data) > longest:
        raise FormatError("file", f"more than {longest} bytes")
    try:
        text = data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise FormatError("file", f"not UTF-8 at byte {error.start}") from None
    _refuse_depth(text)
    number = _float if floats else _refuse_float
    try:
        return json.loads(
            text, object_pairs_hook=_object, parse_int=_integer, parse_float=number, parse_constant=_refuse_constant
        )
    except json.JSONDecodeError as error:
        raise FormatError("file", f"not JSON: {error.msg} at line {error.lineno} column {error.colno}") from None
    except RecursionError:
        raise FormatError("file", "nested too deeply") from None


def _refuse_depth(text: str) -> None:
    if text.count("[") + text.count("{") > MAX_LISTS:
        raise FormatError("file", f"more than {MAX_LISTS} lists and objects")
    depth = 0
    for bracket in _BRACKET.finditer(_STRING.sub("", text)):
        depth += 1 if bracket[0] in "[{" else -1
        if depth > MAX_DEPTH:
            raise FormatError("file", f"nested more than {MAX_DEPTH} deep")


def _object(pairs: list[tuple[str, object]]) -> dict[str, object]:
    found: dict[str, object] = {}
    for name, value in pairs:
        if name in found:
            raise FormatError("file", f"the field {name[:60]!r} stands twice in one object")
        found[name] = value
    return found


def _integer(text: str) -> int:
    if len(text) > MAX_DIGITS:
        raise FormatError("file", f"an integer of {len(text)} digits; at most {MAX_DIGITS} are read")
    return int(text)


def _float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise FormatError("file", f"{text[:40]} is too large for a binary64")
    return value


def _refuse_float(text: str) -> NoReturn:
    raise FormatError("file", f"{text[:40]} stands where only integers may stand")


def _refuse_constant(text: str) -> NoReturn:
    raise FormatError("file", f"{text} is not a number")
