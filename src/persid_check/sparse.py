"""Models of networks: sparse matrices as compressed columns, their digests, and the network form of a model."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from persid_check.companion import Arrays, load
from persid_check.entry import Entry
from persid_check.expression import ExpressionError, parse
from persid_check.json_text import Json, Stated
from persid_check.model import FIELDS, FORMAT
from persid_check.plain import texts
from persid_check.results import FormatError

if TYPE_CHECKING:
    from numpy import ndarray

FILLED_STATES = 400  # up to this many states a sparse matrix is filled in, and the model's form is the plain one
REQUIRED = ("format", "states", "terms", "B")
MAX_NODES = 4_000_000
MAX_ENTRIES = 64_000_000  # of one matrix
MAX_TERMS = 64
MAX_INPUTS = 1000
FREE_COLUMNS = 100_000  # of triplets, and more for each of them: memory follows the file's size
COLUMNS_A_TRIPLET = 100


@dataclass(frozen=True, eq=False)
class Columns:
    """A sparse matrix by columns: column c has `values[starts[c]:starts[c+1]]` in strictly increasing `rows`."""

    shape: tuple[int, int]
    starts: "ndarray"
    rows: "ndarray"
    values: "ndarray"

    def form(self) -> Json:
        """Return shape, number of entries and digest."""
        head = f"matrix {self.shape[0]} {self.shape[1]}\n"
        digest = _digest(head, self.starts.astype("<i8"), self.rows.astype("<i8"), self.values)
        return {"shape": list(self.shape), "entries": len(self.values), "sha256": digest}


@dataclass(frozen=True, eq=False)
class SparseTerm:
    """A f(R (x - x_ref)), one function text a row of R; R = None is the identity, A = None is zero."""

    texts: tuple[str, ...]  # one for all rows, or one a row
    R: Columns | None
    A: Columns | None
    size: int


@dataclass(frozen=True, eq=False)
class SparseModel:
    """A model in sparse matrices; None stands for zero (vectors, matrices) and for the names x1 … xn."""

    n: int
    states: tuple[str, ...] | None
    inputs: tuple[str, ...]
    u_ref: tuple[str, ...]
    A0: Columns | None
    terms: tuple[SparseTerm, ...]
    B: Columns | None
    x_ref: "ndarray | None"
    b: "ndarray | None"
    domain: "ndarray | None"

    def form(self) -> Json:
        """Return the network form: every large array by its digest."""
        return {
            "format": FORMAT,
            "states": self.n if self.states is None else list(self.states),
            "inputs": list(self.inputs),
            "x_ref": _vector_form(self.x_ref, [self.n]),
            "u_ref": list(self.u_ref),
            "A0": _form(self.A0),
            "terms": [_term_form(term) for term in self.terms],
            "B": _form(self.B),
            "b": _vector_form(self.b, [self.n]),
            "domain": _vector_form(self.domain, [self.n, 2]),
        }


def gathered(data: Mapping[str, object], folder: Path | None) -> Arrays:
    """Return the arrays that a `model.json` object names or lists, under the names of the specification.

    Raises:
        FormatError: a matrix or a vector is not as specified; the message names the place.
    """
    _refuse_many_terms(data.get("terms"))
    companions: dict[str, Arrays] = {}
    arrays: dict[str, ndarray] = {}
    for name, entry in _parts(data):
        if isinstance(entry, Mapping) and "npz" in entry:
            stored = companions.setdefault(str(entry["npz"]), {})
            stored = stored or load(entry, f"model.{name}", folder)
            companions[str(entry["npz"])] = stored
            own = entry.get("name")
            suffixes = ("",) if name in _VECTORS else _SUFFIXES
            for suffix in suffixes:
                if f"{own}{suffix}" not in stored:
                    raise FormatError(f"model.{name}", f"{entry['npz']} has no array {str(own)[:60] + suffix!r}")
                arrays[f"{name}{suffix}"] = stored[f"{own}{suffix}"]
        elif isinstance(entry, Mapping) and name in _VECTORS:
            raise FormatError(f"model.{name}", "a vector is written out, or stands in a companion")
        elif isinstance(entry, Mapping):
            arrays |= _from_triplets(name, entry)
        elif entry is not None:
            arrays |= _from_lists(name, entry)
    return arrays


def read_sparse(data: Stated, arrays: Arrays) -> SparseModel:
    """Return the model of an object whose large arrays stand in `arrays`, strictly validated.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    given = Entry(data, "model").fields(REQUIRED, (*(name for name in FIELDS if name not in REQUIRED), "provenance"))
    if given["format"].value != FORMAT:
        given["format"].refuse(f'"{FORMAT}" is needed')
    n = data["states"] if isinstance(data["states"], int) else len(given["states"].names())
    inputs = Entry(data.get("inputs") or [], "model.inputs").names()
    if isinstance(n, bool) or not 1 <= n <= MAX_NODES or len(inputs) > MAX_INPUTS:
        raise FormatError("model.states", f"1 to {MAX_NODES} states and at most {MAX_INPUTS} inputs are read")
    u_ref = Entry(texts(data.get("u_ref"), len(inputs)), "model.u_ref")
    terms = data["terms"]
    _refuse_many_terms(terms)
    plain = data["states"] if isinstance(data["states"], list) else None
    default = plain is None or plain == [f"x{i + 1}" for i in range(n)]
    return SparseModel(
        n=n,
        states=None if default else tuple(plain or ()),
        inputs=tuple(inputs),
        u_ref=tuple(number.hex() for number in u_ref.vector(len(inputs))),
        A0=_columns("A0", arrays, (n, n)),
        terms=tuple(_term(f"terms.{i}", term, n, arrays) for i, term in enumerate(terms)),
        B=_columns("B", arrays, (n, len(inputs))),
        **{name: _floats(name, arrays, n * (1 + (name == "domain"))) for name in _VECTORS},
    )


def _refuse_many_terms(terms: object) -> None:
    if not isinstance(terms, list) or len(terms) > MAX_TERMS:
        raise FormatError("model.terms", f"a list of at most {MAX_TERMS} terms is needed")


_VECTORS = ("x_ref", "b", "domain")
_SUFFIXES = (".starts", ".rows", ".values")


def _parts(data: Stated) -> list[tuple[str, object]]:
    terms = data["terms"] if isinstance(data.get("terms"), list) else []
    known = [(i, term) for i, term in enumerate(terms) if isinstance(term, Mapping)]
    inside = [(f"terms.{i}.{name}", term.get(name)) for i, term in known for name in "AR"]
    return [*((name, data.get(name)) for name in ("A0", "B", *_VECTORS)), *inside]


def _term(name: str, term: object, n: int, arrays: Arrays) -> SparseTerm:
    if not isinstance(term, Mapping) or not set(term) <= {"f", "R", "A"} or not {"f", "A"} <= set(term):
        raise FormatError(f"model.{name}", "an object with f, R and A is needed")
    R, f = term.get("R"), term["f"]
    size = n if R is None else _height(f"model.{name}.R", R)
    texts = (f,) if isinstance(f, str) else tuple(f) if isinstance(f, list) else ()
    if not (isinstance(f, str) or len(texts) == size):
        raise FormatError(f"model.{name}.f", f"one expression, or one per row of R ({size}), is needed")
    if not all(isinstance(text, str) and text.isprintable() for text in texts):
        raise FormatError(f"model.{name}.f", "an expression is printable text")
    for text in dict.fromkeys(texts):
        try:
            parse(text)
        except ExpressionError as error:
            raise FormatError(f"model.{name}.f", str(error)) from None
    texts = texts[:1] if len(set(texts)) == 1 else texts
    rows = None if R is None else _columns(f"{name}.R", arrays, (size, n))
    if R is not None and rows is None:
        raise FormatError(f"model.{name}.R", "it has no entry")
    return SparseTerm(texts, rows, _columns(f"{name}.A", arrays, (n, size)), size)


def _height(where: str, R: object) -> int:
    shape = R.get("shape") if isinstance(R, Mapping) else [len(R), 0] if isinstance(R, list) else None
    if not (isinstance(shape, list) and len(shape) == 2 and type(shape[0]) is int and 1 <= shape[0] <= 8 * MAX_NODES):
        raise FormatError(where, "a matrix with its shape is needed")
    return shape[0]


def _columns(name: str, arrays: Arrays, shape: tuple[int, int]) -> Columns | None:
    """Return a matrix from its three arrays, None if it has no entry."""
    import numpy as np

    where = f"model.{name}"
    given = [arrays.get(f"{name}{suffix}") for suffix in _SUFFIXES]
    if all(part is None for part in given):
        return None
    starts, rows, values = given
    if starts is None or rows is None or values is None or starts.dtype.kind != "i" or rows.dtype.kind != "i":
        raise FormatError(where, "integer starts and rows, and values, are needed")
    starts = starts.astype(np.int64)
    if len(starts) != shape[1] + 1 or starts[0] != 0 or starts[-1] != len(rows) or (np.diff(starts) < 0).any():
        raise FormatError(where, f"its column starts are not those of a matrix of shape {list(shape)}")
    if len(rows) != len(values) or len(rows) > MAX_ENTRIES:
        raise FormatError(where, f"as many rows as values are needed, at most {MAX_ENTRIES}")
    if len(rows) and not (rows.min() >= 0 and rows.max() < shape[0]):
        raise FormatError(where, "a row index is negative or too large")
    rising = rows[1:] > rows[:-1]
    first = starts[1:-1]
    rising[first[(first > 0) & (first < len(rows))] - 1] = True
    if not rising.all():
        raise FormatError(where, "row indices must increase strictly within a column")
    _refuse_values(where, values)
    if not (values != 0).all():
        raise FormatError(where, "an entry is zero; leave it out")
    return Columns(shape, starts, rows, values) if len(values) else None


def _floats(name: str, arrays: Arrays, size: int) -> "ndarray | None":
    values = arrays.get(name)
    if values is None:
        return None
    if len(values) != size:
        raise FormatError(f"model.{name}", f"{size} numbers are needed")
    _refuse_values(f"model.{name}", values)
    return values + 0.0 if values.any() or name == "domain" else None


def _refuse_values(where: str, values: "ndarray") -> None:
    import numpy as np

    if values.dtype != np.dtype("<f8") or not np.isfinite(values).all():
        raise FormatError(where, "finite binary64 numbers are needed")


def _from_triplets(name: str, entry: Mapping[str, object]) -> dict[str, "ndarray"]:
    """Return the three arrays of {"shape": [r, c], "coo": [[rows], [columns], [values]]}."""
    import numpy as np

    where, lists, shape = f"model.{name}", entry.get("coo"), entry.get("shape")
    if set(entry) != {"shape", "coo"} or not (isinstance(lists, list) and len(lists) == 3 and isinstance(shape, list)):
        raise FormatError(where, 'an object with "shape" and "coo", or "npz", "name" and "sha256", is needed')
    if not all(isinstance(part, list) and len(part) == len(lists[0]) for part in lists):
        raise FormatError(where, "three lists of the same length are needed")
    if not all(type(k) is int for part in (*lists[:2], shape) for k in part) or len(shape) != 2:
        raise FormatError(where, "indices and shape are integers")
    if not all(0 <= size <= 8 * MAX_NODES for size in shape):
        raise FormatError(where, f"a shape has sides from 0 to {8 * MAX_NODES}, not {str(shape)[:40]}")
    if shape[1] > FREE_COLUMNS + COLUMNS_A_TRIPLET * len(lists[0]):
        raise FormatError(where, f"{shape[1]} columns are too many for {len(lists[0])} entries; give it in a companion")
    if any(isinstance(v, bool) or not isinstance(v, int | float) for v in lists[2]):
        raise FormatError(where, "values are numbers")
    if any(not 0 <= k < size for part, size in zip(lists, shape, strict=False) for k in part):
        raise FormatError(where, "an index is negative or too large")
    rows, columns = (np.array(part, np.int64) for part in lists[:2])
    try:
        values = np.array(lists[2], float)
    except OverflowError:
        raise FormatError(where, "an integer is too large for a binary64") from None
    order = np.lexsort((rows, columns))
    starts = np.searchsorted(columns[order], np.arange(shape[1] + 1))
    return {f"{name}.starts": starts, f"{name}.rows": rows[order], f"{name}.values": values[order]}


def _from_lists(name: str, entry: object) -> dict[str, "ndarray"]:
    """Return the arrays of a vector or a matrix that is written out."""
    import numpy as np

    try:
        values = np.array(entry, float)
    except (TypeError, ValueError, OverflowError):
        raise FormatError(f"model.{name}", "numbers are needed") from None
    if name in _VECTORS:
        return {name: values.ravel()}
    if values.ndim != 2:
        raise FormatError(f"model.{name}", "a matrix is needed")
    columns, rows = np.nonzero(values.T)
    starts = np.searchsorted(columns, np.arange(values.shape[1] + 1))
    return {f"{name}.starts": starts, f"{name}.rows": rows, f"{name}.values": values[rows, columns]}


def _form(matrix: Columns | None) -> dict[str, object] | None:
    return None if matrix is None else matrix.form()


def _vector_form(values: "ndarray | None", shape: list[int]) -> dict[str, object] | None:
    if values is None:
        return None
    return {"shape": shape, "sha256": _digest(f"vector {len(values)}\n", values)}


def _term_form(term: SparseTerm) -> dict[str, object]:
    f = term.texts[0] if len(term.texts) == 1 else list(term.texts)
    return {"f": f, "R": _form(term.R), "A": _form(term.A)}


def _digest(head: str, *arrays: "ndarray") -> str:
    import numpy as np

    found = hashlib.sha256(head.encode("ascii"))
    for values in arrays:
        found.update(memoryview(np.ascontiguousarray(values)).cast("B"))
    return found.hexdigest()


def filled(model: SparseModel) -> Json:
    """Return a small model as a plain object with its matrices filled in."""
    n, m = model.n, len(model.inputs)
    states = [f"x{i + 1}" for i in range(n)] if model.states is None else list(model.states)
    return {
        "format": FORMAT,
        "states": states,
        "inputs": list(model.inputs),
        "x_ref": None if model.x_ref is None else model.x_ref.tolist(),
        "u_ref": list(model.u_ref),
        "A0": _dense(model.A0, n, n),
        "terms": [_dense_term(term, n) for term in model.terms],
        "B": _dense(model.B, n, m),
        "b": None if model.b is None else model.b.tolist(),
        "domain": None if model.domain is None else model.domain.reshape(n, 2).tolist(),
    }


def _dense_term(term: SparseTerm, n: int) -> dict[str, object]:
    f = term.texts[0] if len(term.texts) == 1 else list(term.texts)
    R = None if term.R is None else _dense(term.R, term.size, n)
    return {"f": f, "R": R, "A": _dense(term.A, n, term.size)}


def _dense(matrix: Columns | None, height: int, width: int) -> list[list[float]]:
    rows = [[0.0] * width for _ in range(height)]
    if matrix is not None:
        for c in range(width):
            for p in range(matrix.starts[c], matrix.starts[c + 1]):
                rows[matrix.rows[p]][c] = float(matrix.values[p])
    return rows
