"""Fields of a model's object: their names, and how each is read into canonical form."""

import math
from collections.abc import Mapping

from persid_check.results import FormatError

FORMAT = "persid-model-1"
FIELDS = ("format", "states", "inputs", "x_ref", "u_ref", "A0", "terms", "B", "b", "domain")
CLOCK = ("time", "dt")  # of a model in discrete time
ALGEBRAIC = "algebraic"  # of a model with equations: the names of its algebraic variables
REQUIRED = {"format", "states", "terms", "B"}
_ZERO = (0.0).hex()


def refuse_fields(where: str, data: Mapping[str, object], known: tuple[str, ...], required: set[str]) -> None:
    """Refuse an object with another field, or without a required one."""
    for name in data:
        if name not in known:
            raise FormatError(where, f"unknown field {str(name)[:60]!r}; known: {', '.join(known)}")
    for name in sorted(required):
        if name not in data:
            raise FormatError(where, f"the field {name!r} is missing")


def read_names(where: str, names: object) -> list[str]:
    """Return names, each once."""
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise FormatError(where, "a list of names is needed")
    if len(set(names)) != len(names) or any(not name or len(name) > 200 or not name.isprintable() for name in names):
        raise FormatError(where, "names are different, printable, and have 1 to 200 characters")
    return list(names)


def read_clock(data: Mapping[str, object]) -> dict[str, str]:
    """Return `time` and `dt` (s) of a model in discrete time in canonical form, nothing for one in continuous time."""
    time, dt = data.get("time", "continuous"), data.get("dt")
    if time not in ("continuous", "discrete"):
        raise FormatError("model.time", '"continuous" or "discrete" is needed')
    if time == "continuous":
        if dt is not None:
            raise FormatError("model.dt", "a model in continuous time has no step")
        return {}
    step = _hex("model.dt", dt)
    if float.fromhex(step) <= 0:
        raise FormatError("model.dt", "a step in s is positive")
    return {"time": "discrete", "dt": step}


def read_algebraic(data: Mapping[str, object], states: list[str]) -> dict[str, list[str]]:
    """Return `algebraic` of a model with equations in canonical form, nothing for one without."""
    if ALGEBRAIC not in data:
        return {}
    names = read_names("model.algebraic", data[ALGEBRAIC])
    if not names:
        raise FormatError("model.algebraic", "at least one name is needed; without equations the field is left out")
    read_names("model.algebraic", [*states, *names])
    if any(data.get(name) is not None for name in CLOCK):
        raise FormatError("model.time", "a model with algebraic variables is in continuous time")
    return {ALGEBRAIC: names}


def read_vector(where: str, values: object, size: int) -> list[str]:
    """Return numbers in canonical form, zeros where none are given."""
    if values is None:
        return [_ZERO] * size
    if not isinstance(values, list) or len(values) != size:
        raise FormatError(where, f"a list of {size} numbers is needed")
    return [_hex(where, value) for value in values]


def read_matrix(where: str, rows: object, height: int, width: int) -> list[list[str]]:
    """Return rows of numbers in canonical form, zeros where none are given."""
    if rows is None:
        return [[_ZERO] * width for _ in range(height)]
    if not isinstance(rows, list) or len(rows) != height:
        raise FormatError(where, f"a list of {height} rows is needed")
    return [read_vector(f"{where}[{i}]", [] if row is None else row, width) for i, row in enumerate(rows)]


def _hex(where: str, value: object) -> str:
    """One number as float.hex() text; minus zero becomes zero."""
    if isinstance(value, str):
        return _hex_text(where, value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise FormatError(where, f"{str(value)[:40]!r} is not a number")
    try:
        number = float(value)
    except OverflowError:
        raise FormatError(where, "an integer is too large for a binary64") from None
    if not math.isfinite(number):
        raise FormatError(where, f"{number} is not a finite number")
    return (number + 0.0).hex()


def _hex_text(where: str, text: str) -> str:
    try:
        number = float.fromhex(text)
    except (ValueError, OverflowError):
        number = math.nan
    if not math.isfinite(number) or number.hex() != text:
        raise FormatError(where, f"{text[:40]!r} is not a finite number as float.hex() writes it")
    return (number + 0.0).hex()
