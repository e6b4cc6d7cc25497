"""What of a ledger stands in a companion: matrices of its model, and roots. NumPy reads them.

Each array stands for one matrix, all numbers of its rows: what is written out is as long as the companion.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from persid_check.entry import Entry
from persid_check.json_text import Json
from persid_check.ledger import COMPANION
from persid_check.plain import texts
from persid_check.results import FormatError

if TYPE_CHECKING:
    from persid_check.companion import Arrays
    from persid_check.exact import Matrix

LONGEST = 2**28  # bytes
MAX_FILLED = 4 * 10**6  # numbers of one matrix of a model


def gathered(data: Mapping[str, object], folder: Path | None, content: bytes | None) -> "Arrays":
    """Return the arrays of the companion that a file names.

    Raises:
        FormatError: the companion is not as specified, or NumPy, which reads it, is not at hand.
    """
    Entry(data[COMPANION], COMPANION).fields(("npz", "sha256"))
    try:
        from persid_check.companion import load

        return load(data[COMPANION], COMPANION, folder, content, LONGEST)
    except ImportError:
        raise FormatError(COMPANION, "NumPy is needed to read it: pip install numpy") from None


def lower_array(entry: Entry, arrays: "Arrays", size: int) -> "Matrix":
    """Return the lower triangular matrix whose rows are one array of a companion: 1 integer, 2 integers, and so on."""
    from persid_check.digits import Digits
    from persid_check.large import held

    if entry.value not in arrays:
        entry.refuse(f"the companion has no array {entry.value[:60]!r}")
    found = arrays[entry.value]
    if found.dtype != "<i8" or len(found) != size * (size + 1) // 2:
        entry.refuse(f"an array of {size * (size + 1) // 2} integers (<i8) is needed")
    return held(Digits.of_lower(size, found), 0)


def filled(form: object, arrays: "Arrays") -> object:
    """Return a model's form with its matrices written out, where it has names of arrays in their place."""
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
    part[name] = [texts(row, width) for row in array.reshape(-1, width).tolist()]
