"""The canonical form of a model, and of its outputs: all fields, every number a float.hex() string, no provenance.

What is left out is filled in and numbers are written as text; all else stays as it is, for the strict reader to refuse.
"""

from collections.abc import Mapping
from pathlib import Path

from persid_check.entry import Entry
from persid_check.identity import Meant
from persid_check.json_text import Json
from persid_check.model import ALGEBRAIC, CLOCK, FIELDS, MAX_CHANNELS, MAX_STATES, read_model, sha256_of
from persid_check.outputs import FIELDS as OUTPUT_FIELDS
from persid_check.outputs import FORMAT as OUTPUT_FORMAT
from persid_check.outputs import read_outputs
from persid_check.plain import ZERO, text, texts
from persid_check.results import FormatError

UNHASHED = ("hold", "noise", "x_mean", "x_cov", "provenance")  # of an output model's file; no claim speaks of them


def canonical_model(data: object, folder: Path | None = None) -> Json:
    """Return the canonical form. A canonical form is returned unchanged.

    A large model with sparse matrices, whose companions stand in `folder`, has its arrays' digests instead of numbers
    (the network form).

    Raises:
        FormatError: a field is unknown, missing, of the wrong type or shape; the message names the place.
    """
    if not isinstance(data, Mapping):
        raise FormatError("model", "an object is needed")
    if holds_objects(data):  # a large network: what reads it is not needed elsewhere
        from persid_check import sparse

        model = sparse.read_sparse(data, sparse.gathered(data, folder))
        if model.n > sparse.FILLED_STATES:
            return model.form()
        channels = sum(term.size for term in model.terms)
        Entry(data["terms"], "model.terms").require(channels <= MAX_CHANNELS, f"more than {MAX_CHANNELS} channels")
        data = sparse.filled(model)
    form = _written(data)
    read_model(Entry(form, "model"), discrete=True, algebraic=True)
    return {name: form[name] for name in (*FIELDS, *CLOCK, ALGEBRAIC) if name in form}


def model_sha256(data: object, folder: Path | None = None) -> str:
    """Return the SHA-256 of the canonical form, written as JSON with sorted keys and no spaces.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])
        >>> persid_check.model_sha256(model.to_dict()) == model.sha256
        True
    """
    return sha256_of(canonical_model(data, folder))


def meant(data: object, folder: Path | None) -> Meant:
    """Return the hashes of a `model.json`, which may have outputs.

    Raises:
        FormatError: it is not as specified; the message names the place.
    """
    if isinstance(data, dict) and data.get("format") == OUTPUT_FORMAT:
        outputs = output_sha256(data, folder)
        return Meant(model_sha256(data["dynamics"], folder), outputs)
    return Meant(model_sha256(data, folder))


def canonical_outputs(data: Mapping[str, object], n: int, m: int) -> Json:
    """Return the outputs of an output model in canonical form.

    Raises:
        FormatError: a field is of the wrong type or shape; the message names the place.
    """
    count = _length(data.get("outputs"))
    form = {
        "outputs": data.get("outputs"),
        "C": _rows(data.get("C"), count, n, null=n),
        "D": _rows(data.get("D"), count, m, null=m),
        "d": texts(data.get("d"), count),
        "output_map": data.get("output_map"),
    }
    read_outputs(Entry(form, "outputs").fields(OUTPUT_FIELDS), n, m)
    return form


def output_sha256(data: object, folder: Path | None = None) -> str:
    """Return the hash of an output model, plain or canonical: of its dynamics and outputs.

    Raises:
        FormatError: it is not as specified; the message names the place.
    """
    known = ("format", "dynamics", "outputs", "C")
    given = Entry(data, "model").fields(known, ("D", "d", "output_map", *UNHASHED))
    if given["format"].value != OUTPUT_FORMAT:
        given["format"].refuse(f'"{OUTPUT_FORMAT}" is needed')
    dynamics = canonical_model(given["dynamics"].value, folder)
    outputs = {name: entry.value for name, entry in given.items()}
    form = canonical_outputs(outputs, len(dynamics["states"]), len(dynamics["inputs"]))
    return sha256_of({"format": OUTPUT_FORMAT, "dynamics": dynamics, **form})


def holds_objects(data: Mapping[str, object]) -> bool:
    """Whether a matrix or a vector is given as an object: sparse, or in a companion."""
    terms = data.get("terms")
    parts = [data.get(name) for name in ("A0", "B", "x_ref", "b", "domain")]
    for term in terms if isinstance(terms, list) else []:
        parts += [term.get("A"), term.get("R")] if isinstance(term, Mapping) else []
    return any(isinstance(part, Mapping) for part in parts)


def _written(data: Mapping[str, object]) -> Json:
    """Return a plain model with what is left out, and numbers as text."""
    n, m = _length(data.get("states")) + _length(data.get(ALGEBRAIC)), _length(data.get("inputs"))
    n, m = (0, 0) if max(n, m) > MAX_STATES else (n, m)  # which is refused
    form = {name: data[name] for name in data if name not in ("provenance", *CLOCK)} | _clock(data)
    form |= {
        "inputs": data.get("inputs") or [],
        "x_ref": texts(data.get("x_ref"), n),
        "u_ref": texts(data.get("u_ref"), m),
        "A0": _rows(data.get("A0"), n, n),
        "b": texts(data.get("b"), n),
        "domain": None if data.get("domain") is None else _rows(data["domain"], n, 2),
    }
    if "B" in data:
        form["B"] = _rows(None if m == 0 and data["B"] == [] else data["B"], n, m)
    if isinstance(terms := data.get("terms"), list) and len(terms) <= MAX_CHANNELS:
        form["terms"] = [_term(term, n) for term in terms]
    return form


def _clock(data: Mapping[str, object]) -> Json:
    """Return the fields of discrete time; those of continuous time are left out."""
    found = {name: data[name] for name in CLOCK if name in data}
    if found.get("time") == "continuous":
        del found["time"]
    if "dt" in found:
        found["dt"] = text(found["dt"])
    return {name: value for name, value in found.items() if (name, value) != ("dt", None)}


def _term(term: object, n: int) -> object:
    if not isinstance(term, Mapping):
        return term
    R, f = term.get("R"), term.get("f")
    k = n if R is None else _length(R)
    found = {**term, "R": None if R is None else _rows(R, k, n)}
    if isinstance(f, list) and len(f) == k > 0 and all(each == f[0] for each in f):
        found["f"] = f[0]
    found |= {"A": _rows(term["A"], n, k)} if "A" in term else {}
    return {name: found[name] for name in ("f", "R", "A") if name in found} | found


def _length(value: object) -> int:
    return len(value) if isinstance(value, list) else 0


def _rows(value: object, height: int, width: int, null: int = 0) -> object:
    """Return rows of numbers, of zeros where none are given (one row, many times); `null` is the length of null."""
    if value is None:
        return [[ZERO] * width] * height
    return [texts(row, null) for row in value] if isinstance(value, list) else value
