"""Sparse matrices of large models: compressed columns, and the companion file that holds them beside a JSON file."""

import hashlib
import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray
from scipy import sparse
from scipy.sparse import csc_array

from persid._files import Json, write_atomically
from persid.errors import ModelError
from persid_check.results import FormatError
from persid_check.sparse import FILLED_STATES as FILLED_STATES
from persid_check.sparse import Columns, SparseModel, gathered, read_sparse

if TYPE_CHECKING:
    Sparse = ndarray  # to the type checker: what works on matrices is given a model with its matrices filled in
else:
    Sparse = csc_array

LISTED = 10_000  # entries that a JSON file lists; more go to a companion

Arrays = dict[str, ndarray]


def refuse_shape(name: str, found: tuple[int, ...], shape: tuple[int | None, ...]) -> None:
    """Refuse an array of another shape than is needed (None: any size)."""
    if len(found) != len(shape) or any(k is not None and k != size for k, size in zip(shape, found, strict=True)):
        raise ModelError(f"{name} has shape {found}; needed is {tuple('m' if k is None else k for k in shape)}")


def compressed(name: str, value: Any, shape: tuple[int | None, ...]) -> csc_array:
    """Return a SciPy sparse matrix as canonical compressed columns: sorted, no duplicates, no zeros.

    Raises:
        ModelError: it has another shape, or a number is not finite.
    """
    refuse_shape(name, value.shape, shape)
    matrix = csc_array(value, dtype=float, copy=True)
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    if not np.isfinite(matrix.data).all():
        raise ModelError(f"{name} holds a number that is not finite")
    for part in (matrix.data, matrix.indices, matrix.indptr):
        part.setflags(write=False)
    return matrix


def triplets(matrix: csc_array) -> Json:
    """Return a sparse matrix as `model.json` lists it."""
    found = matrix.tocoo()
    return {"shape": list(matrix.shape), "coo": [found.row.tolist(), found.col.tolist(), found.data.tolist()]}


def archive(arrays: Mapping[str, ndarray]) -> bytes:
    """Return the bytes of a companion: an uncompressed zip of one-dimensional arrays."""
    buffer = io.BytesIO()
    np.savez(buffer, **{name: np.ascontiguousarray(values) for name, values in arrays.items()})  # type: ignore[arg-type]
    return buffer.getvalue()


@dataclass(frozen=True, eq=False)
class Compressed:
    """A model's object with only the shapes of its matrices, and their arrays by their names in a companion."""

    content: Json
    arrays: Arrays

    @classmethod
    def of(
        cls, content: Json, matrices: Mapping[str, ndarray | Sparse], vectors: Mapping[str, ndarray]
    ) -> "Compressed":
        """Compress matrices, by their names; the terms of the content are the texts of their functions."""
        arrays: Arrays = {}
        for name, matrix in matrices.items():
            arrays |= _parts(name, csc_array(matrix))
        arrays |= {name: vector.ravel() for name, vector in vectors.items()}

        def shape(name: str) -> Json | None:
            return {"shape": list(matrices[name].shape)} if f"{name}.values" in arrays else None

        terms = [
            {"f": f, "R": shape(f"terms.{t}.R"), "A": shape(f"terms.{t}.A")} for t, f in enumerate(content["terms"])
        ]
        shapes = {name: {"shape": list(vector.shape)} for name, vector in vectors.items()}
        return cls(content | {name: shape(name) for name in ("A0", "B")} | {"terms": terms} | shapes, arrays)

    @property
    def exact(self) -> SparseModel:
        """The checker's reading of the model."""
        return read_sparse(self.content, self.arrays)

    def save(self, path: Path, provenance: Mapping[str, object]) -> Json:
        """Write the companion of a model file beside it, and return the object of the file."""
        data, name = archive(self.arrays), f"{path.stem}.npz"
        write_atomically(path.with_name(name), data)
        stored = {"npz": name, "sha256": hashlib.sha256(data).hexdigest()}

        def located(entry: object, place: str) -> object:
            return {**entry, **stored, "name": place} if isinstance(entry, dict) else entry

        content = dict(self.content)
        for field in ("A0", "B", "x_ref", "b", "domain"):
            content[field] = located(content.get(field), field)
        content["terms"] = [
            term | {part: located(term[part], f"terms.{t}.{part}") for part in "AR"}
            for t, term in enumerate(content["terms"])
        ]
        return {**content, "provenance": provenance}


def load(data: Mapping[str, object], folder: Path | None) -> Json:
    """Return the constructor's arguments for an object of `model.json` with sparse matrices.

    Raises:
        ModelError: a matrix, or its companion, is not as specified.
    """
    try:
        found = read_sparse(data, gathered(data, folder))
    except FormatError as error:
        raise ModelError(str(error)) from None
    return arguments(found) | {"provenance": data.get("provenance")}


def arguments(found: SparseModel) -> Json:
    """Return the constructor's arguments for a model that the checker has read."""
    n, m = found.n, len(found.inputs)
    terms = [
        (
            term.texts[0] if len(term.texts) == 1 else list(term.texts),
            None if term.R is None else _matrix(term.R, (term.size, n)),
            _matrix(term.A, (n, term.size)),
        )
        for term in found.terms
    ]
    return {
        "A0": _matrix(found.A0, (n, n)),
        "terms": terms,
        "B": _matrix(found.B, (n, m)),
        "b": found.b,
        "x_ref": found.x_ref,
        "u_ref": [float.fromhex(value) for value in found.u_ref],
        "states": found.states,
        "inputs": found.inputs,
        "domain": None if found.domain is None else found.domain.reshape(n, 2),
    }


def is_sparse(value: object) -> bool:
    """Whether a value is a SciPy sparse matrix or array."""
    return sparse.issparse(value)


def _matrix(columns: Columns | None, shape: tuple[int, int]) -> csc_array:
    if columns is None:
        return csc_array(shape)
    return csc_array((columns.values, columns.rows, columns.starts), shape=shape)


def _parts(name: str, matrix: csc_array) -> Arrays:
    if not matrix.nnz:
        return {}
    return {f"{name}.starts": matrix.indptr, f"{name}.rows": matrix.indices, f"{name}.values": matrix.data}
