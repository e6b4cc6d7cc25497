"""The outputs y = h(C (x - x_ref) + D (u - u_ref) + d) of a model, in canonical form, and the hash of both."""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from persid_check.expression import ExpressionError, parse
from persid_check.fields import read_names, read_vector, refuse_fields
from persid_check.json_text import Json, Stated
from persid_check.model import canonical_model, sha256_of
from persid_check.results import FormatError, NotProvedError

FORMAT = "persid-output-model-1"
FIELDS = ("outputs", "C", "D", "d", "output_map")
UNHASHED = ("hold", "noise", "x_mean", "x_cov", "provenance")  # of a model's file; no claim speaks of them
MAX_OUTPUTS = 1000


def read_stated(block: Mapping[str, object], model: Stated) -> str:
    """Return the hash that a certificate's block of outputs states: its five fields are in canonical form and have it.

    Raises:
        FormatError: they are not; the message names the place.
        NotProvedError: it is another hash.
    """
    stated = block["sha256"]
    if not isinstance(stated, str):
        raise FormatError("outputs.sha256", "text is needed")
    given = {name: block[name] for name in FIELDS}
    if not isinstance(given["C"], list) or not isinstance(given["D"], list) or not isinstance(given["d"], list):
        raise FormatError("outputs", "C, D and d stand in the file as lists")
    if canonical_outputs(given, len(model["states"]), len(model["inputs"])) != given:
        raise FormatError("outputs", "not in canonical form")
    if sha256_of({"format": FORMAT, "dynamics": model, **given}) != stated:
        raise NotProvedError("outputs.sha256", "it is not the hash of the outputs in the file and their model")
    return stated


def rows_of(rows: Sequence[Sequence[str]]) -> tuple[tuple[Fraction, ...], ...]:
    """Return the numbers of C or D."""
    return tuple(tuple(Fraction(float.fromhex(text)) for text in row) for row in rows)


def output_sha256(data: object, folder: Path | None = None) -> str:
    """Return the hash of an output model, plain or canonical: of its dynamics and outputs.

    Raises:
        FormatError: it is not as specified; the message names the place.
    """
    if not isinstance(data, Mapping):
        raise FormatError("model", "an object is needed")
    refuse_fields("model", data, ("format", "dynamics", *FIELDS, *UNHASHED), {"format", "dynamics", "outputs", "C"})
    if data["format"] != FORMAT:
        raise FormatError("model.format", f'"{FORMAT}" is needed')
    dynamics = canonical_model(data["dynamics"], folder)
    form = canonical_outputs(data, len(dynamics["states"]), len(dynamics["inputs"]))
    return sha256_of({"format": FORMAT, "dynamics": dynamics, **form})


def canonical_outputs(data: Mapping[str, object], n: int, m: int) -> Json:
    """Return the outputs of an output model in canonical form: all fields, every number a float.hex() string.

    Raises:
        FormatError: a field is of the wrong type or shape; the message names the place.
    """
    names = read_names("outputs.outputs", data["outputs"])
    count = len(names)
    if not 1 <= count <= MAX_OUTPUTS:
        raise FormatError("outputs.outputs", f"1 to {MAX_OUTPUTS} outputs are read")
    return {
        "outputs": names,
        "C": _rows("outputs.C", data["C"], count, n),
        "D": _rows("outputs.D", data.get("D"), count, m),
        "d": read_vector("outputs.d", data.get("d"), count),
        "output_map": _maps(data.get("output_map"), count),
    }


def _rows(where: str, value: object, height: int, width: int) -> list[list[str]]:
    rows = [None] * height if value is None else _listed(where, value, height)
    return [read_vector(f"{where}[{i}]", row, width) for i, row in enumerate(rows)]


def _listed(where: str, value: object, size: int) -> list[Any]:
    if not isinstance(value, list) or len(value) != size:
        raise FormatError(where, f"a list of {size} is needed")
    return value


def _maps(value: object, count: int) -> list[str] | None:
    if value is None:
        return None
    texts = _listed("outputs.output_map", value, count)
    for i, text in enumerate(texts):
        if not isinstance(text, str) or not text.isprintable():
            raise FormatError(f"outputs.output_map[{i}]", "an expression is printable text")
        try:
            parse(text)
        except ExpressionError as error:
            raise FormatError(f"outputs.output_map[{i}]", str(error)) from None
    return texts
