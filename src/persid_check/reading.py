"""The entries of a certificate's JSON: each is read strictly, and what is not specified is refused with its place.

A number is an integer or a dyadic [mantissa, exponent]. Nothing is expanded: what is read is as long as the file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import TYPE_CHECKING, Any

from persid_check.definite import Root
from persid_check.json_text import Json
from persid_check.model import Model, canonical_model, model_of
from persid_check.results import FormatError

if TYPE_CHECKING:
    from persid_check.companion import Arrays
    from persid_check.digits import Digits

MAX_BITS = 2048  # of a mantissa
MAX_EXPONENT = 2000
MAX_FORMS = 128  # of a curve, a group or a kind
MAX_ENTRIES = 2500  # of states and channels
MAX_FILLED = 3 * 10**6  # numbers of one matrix of a model in a companion
MAX_FACTOR_BITS = 512  # of an entry of T or L
MAX_SHIFT = 2000  # of a row of a matrix whose root is given

Factor = tuple[tuple[int, ...], ...]
Lower = tuple[tuple[Fraction, ...], ...]  # lower rows of a symmetric matrix


@dataclass(frozen=True)
class Ball:
    """The ball |x* - x|_inf <= radius in which exactly one equilibrium for the constant input u is claimed."""

    x: tuple[Fraction, ...]
    radius: Fraction
    u: tuple[Fraction, ...]


def require_fields(where: str, data: Mapping[str, object], known: Sequence[str]) -> None:
    """Refuse an object that lacks a known field or has another one."""
    for name in data:
        if name not in known:
            raise FormatError(where, f"unknown field {name[:60]!r}; known: {', '.join(known)}")
    for name in known:
        if name not in data:
            raise FormatError(where, f"the field {name!r} is missing")


def read_text(where: str, value: object, longest: int) -> str:
    """Return a text that is not too long."""
    if not isinstance(value, str) or len(value) > longest:
        raise FormatError(where, f"text of at most {longest} characters is needed")
    return value


def read_list(where: str, value: object, size: int | None = None) -> list[Any]:
    """Return a list, of a given length where one is given."""
    if not isinstance(value, list) or (size is not None and len(value) != size):
        raise FormatError(where, "a list is needed" if size is None else f"a list of {size} is needed")
    return value


def read_object(where: str, value: object, known: Sequence[str]) -> Json:
    """Return an object of exactly the known fields."""
    if not isinstance(value, dict):
        raise FormatError(where, f"an object with {', '.join(known)} is needed")
    require_fields(where, value, known)
    return value


def read_integer(where: str, value: object, bits: int) -> int:
    """Return an integer of at most so many bits."""
    if isinstance(value, bool) or not isinstance(value, int):
        raise FormatError(where, f"an integer is needed, not {str(value)[:40]!r}")
    if value.bit_length() > bits:
        raise FormatError(where, f"an integer of at most {bits} bits is needed")
    return value


def read_index(where: str, value: object, size: int) -> int:
    """Return an index into so many entries."""
    index = read_integer(where, value, 64)
    if not 0 <= index < size:
        raise FormatError(where, f"an index from 0 to {size - 1} is needed, not {index}")
    return index


def read_row(where: str, value: object, size: int) -> dict[int, Fraction]:
    """Return a list of [entry, dyadic], entries rising, as a row of so many; zeros are left out."""
    found: dict[int, Fraction] = {}
    last = -1
    for k, pair in enumerate(read_list(where, value)):
        i, number = read_list(f"{where}[{k}]", pair, 2)
        index = read_index(f"{where}[{k}]", i, size)
        if index <= last:
            raise FormatError(f"{where}[{k}]", "indices rise")
        last, found[index] = index, read_dyadic(f"{where}[{k}]", number)
    return {i: value for i, value in found.items() if value}


def read_dyadic(where: str, value: object) -> Fraction:
    """Return the number mantissa * 2**exponent of a pair."""
    pair = read_list(where, value, 2)
    mantissa, exponent = read_integer(where, pair[0], MAX_BITS), read_integer(where, pair[1], 64)
    if abs(exponent) > MAX_EXPONENT:
        raise FormatError(where, f"an exponent of at most {MAX_EXPONENT} is needed")
    return Fraction(mantissa << exponent) if exponent >= 0 else Fraction(mantissa, 1 << -exponent)


def read_dyadics(where: str, values: object, size: int | None) -> tuple[Fraction, ...]:
    """Return a list of such numbers."""
    return tuple(read_dyadic(f"{where}[{i}]", value) for i, value in enumerate(read_list(where, values, size)))


def read_nonnegative(where: str, value: object) -> Fraction:
    """Return a dyadic that is at least 0."""
    number = read_dyadic(where, value)
    if number < 0:
        raise FormatError(where, "a number that is not negative is needed")
    return number


def read_lower(where: str, rows: object, size: int) -> Lower:
    """Return the lower rows of a symmetric matrix."""
    return tuple(read_dyadics(f"{where}[{i}]", row, i + 1) for i, row in enumerate(read_list(where, rows, size)))


def read_P(value: object, n: int) -> tuple[bool, Lower]:
    """Return whether P is diagonal, and its lower rows, of one entry where it is."""
    if isinstance(value, dict) and set(value) == {"diagonal"}:
        return True, tuple((entry,) for entry in read_dyadics("P.diagonal", value["diagonal"], n))
    return False, read_lower("P.lower", read_object("P", value, ("lower",))["lower"], n)


def read_gamma(value: object, width: int) -> Fraction | Lower:
    """Return gamma, or the lower rows of Gamma."""
    if isinstance(value, dict):
        return read_lower("gamma.lower", read_object("gamma", value, ("lower",))["lower"], width)
    return read_dyadic("gamma", value)


def read_dropped(value: object, size: int) -> tuple[int, ...]:
    """Return indices of entries, each once."""
    entries = tuple(read_index(f"dropped[{i}]", entry, size) for i, entry in enumerate(read_list("dropped", value)))
    if len(set(entries)) != len(entries):
        raise FormatError("dropped", "an entry stands twice")
    return entries


def read_integers(where: str, values: object, size: int) -> tuple[int, ...]:
    """Return a row of a factor."""
    return tuple(read_integer(where, value, MAX_FACTOR_BITS) for value in read_list(where, values, size))


def read_factor(where: str, value: object) -> Factor:
    """Return a square lower triangular matrix of integers, by its rows."""
    return tuple(read_integers(f"{where}[{i}]", row, i + 1) for i, row in enumerate(read_list(where, value)))


def read_root(where: str, value: object, arrays: "Arrays") -> Root:
    """Return a root: its L by rows, or the name of an array of all its rows in a companion."""
    root = read_object(where, value, ("shifts", "bits", "L"))
    listed = enumerate(read_list(f"{where}.shifts", root["shifts"]))
    shifts = tuple(_shift(f"{where}.shifts[{i}]", shift) for i, shift in listed)
    L = root["L"]
    rows = read_lower_array(f"{where}.L", L, arrays, len(shifts)) if isinstance(L, str) else read_factor(where, L)
    return Root(shifts, _shift(f"{where}.bits", root["bits"]), rows)


def _shift(where: str, value: object) -> int:
    shift = read_integer(where, value, 64)
    if abs(shift) > MAX_SHIFT:
        raise FormatError(where, f"an integer of at most {MAX_SHIFT} in size is needed")
    return shift


def read_lower_array(where: str, name: str, arrays: "Arrays", size: int) -> "Digits":
    """Return the lower triangular matrix whose rows are one array of a companion: 1 integer, 2 integers, and so on."""
    from persid_check.digits import Digits

    if name not in arrays:
        raise FormatError(where, f"the companion has no array {name[:60]!r}")
    found = arrays[name]
    if found.dtype != "<i8" or len(found) != size * (size + 1) // 2:
        raise FormatError(where, f"an array of {size * (size + 1) // 2} integers (<i8) is needed")
    return Digits.of_lower(size, found)


def read_ball(where: str, value: object, model: Model, u: tuple[Fraction, ...] | None = None) -> Ball:
    """Return a ball with its input, or one for an input that is given."""
    ball = read_object(where, value, ("x", "radius", "u") if u is None else ("x", "radius"))
    x = read_dyadics(f"{where}.x", ball["x"], model.n)
    radius = read_nonnegative(f"{where}.radius", ball["radius"])
    return Ball(x, radius, read_dyadics(f"{where}.u", ball["u"], model.m) if u is None else u)


def read_written(form: Any, *, discrete: bool = False, algebraic: bool = False) -> Model:
    """Return a model that stands in canonical form, every number written out: nothing else is expanded.

    One in discrete time, or with algebraic variables, only to callers that know what to do with it.
    """
    _refuse_unwritten(form)
    if canonical_model(form) != form:
        raise FormatError("model", "not in canonical form")
    return model_of(form, discrete=discrete, algebraic=algebraic)


def read_model(form: object, *, discrete: bool = False, algebraic: bool = False) -> Model:
    """Return such a model, of a size that a file of version 1 may have."""
    model = read_written(form, discrete=discrete, algebraic=algebraic)
    if model.n + len(model.channels) > MAX_ENTRIES:
        raise FormatError("model", f"more than {MAX_ENTRIES} states and channels")
    return model


def filled(form: object, arrays: "Arrays") -> object:
    """Return a model's form with its matrices written out, where it has names of arrays of a companion in their place.

    Each array stands for one matrix, all numbers of its rows: what is written out is as long as the companion.
    """
    if not (isinstance(form, dict) and all(isinstance(form.get(name), list) for name in ("states", "inputs", "terms"))):
        return form
    n, left = len(form["states"]), dict(arrays)
    found = {**form, "terms": [dict(term) if isinstance(term, dict) else term for term in form["terms"]]}
    _fill("model", found, "A0", n, left)
    _fill("model", found, "B", len(form["inputs"]), left)
    for i, term in enumerate(found["terms"]):
        if isinstance(term, dict):
            _fill(f"model.terms[{i}]", term, "R", n, left)
            _fill(f"model.terms[{i}]", term, "A", len(term["R"]) if isinstance(term.get("R"), list) else n, left)
    return found


def _fill(where: str, part: Json, name: str, width: int, left: Json) -> None:
    """Write out the matrix whose array a part names; no other part can name it then."""
    key = part.get(name)
    if not isinstance(key, str):
        return
    array = left.pop(key, None)
    if array is None or array.dtype != "<f8" or not width or len(array) % width or len(array) > MAX_FILLED:
        raise FormatError(f"{where}.{name}", f"the companion has no array {key[:60]!r}, once, of <f8 rows of {width}")
    part[name] = _rows(f"{where}.{name}", array.reshape(-1, width))


def _rows(where: str, table: Any) -> list[list[str]]:
    """Return rows of finite numbers as canonical text."""
    text = [[value.hex() for value in row] for row in (table + 0.0).tolist()]
    if any(not value[-1].isdigit() for row in text for value in row):  # inf, nan
        raise FormatError(where, "a number is not finite")
    return text


def _refuse_unwritten(form: object) -> None:
    """Refuse null, sparse matrices and companions where a list of numbers belongs."""
    form = form if isinstance(form, dict) else {}
    terms = form.get("terms")
    places = [("model", form, name) for name in ("x_ref", "u_ref", "A0", "B", "b", "terms")]
    places += [(f"model.terms[{i}]", term, "A") for i, term in enumerate(terms if isinstance(terms, list) else [])]
    for where, part, name in places:
        if not isinstance(part, dict) or not isinstance(part.get(name), list):
            raise FormatError(f"{where}.{name}", "it stands in the file as a list")
