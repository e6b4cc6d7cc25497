"""The text of proofs: how a file begins, readable JSON, and integer factors of matrices."""

import json
from typing import Any

import numpy as np
import scipy.linalg as sla
from flint import fmpq, fmpz_mat
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json
from persid.errors import RoundingError
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid_check.plain import numbers

FORMAT = "persid-certificate-1"
MARGIN = 8.0  # by which what is subtracted for a root's sake exceeds what rounding it adds to a row
LONGEST = 50  # bits of a root's entries
POWERS = 30
FINE = 100  # bits of a factor that is found in fractions
BESIDE = 500_000  # numbers of the matrices of a file from which the large ones stand in a companion
LISTED = 10_000  # numbers of a matrix that is large then


def heading(model: PersidskiiModel | DescriptorModel, claim: str, statement: str) -> Json:
    """Return how the file of a claim about a model begins."""
    return {
        "format": FORMAT,
        "claim": claim,
        "statement": statement,
        "model_sha256": model.sha256,
        "model": model.canonical,
    }


def factor(M: Float[ndarray, "k k"], accuracy: float = 10.0) -> list[list[int]]:
    """Return an integer inverse Cholesky factor T of M: T M T' is nearly diagonal, the untrusted half of a proof.

    Off its diagonal it is smaller by about `accuracy`.

    Raises:
        RoundingError: M is not positive definite in floating point.
    """
    size = len(M)
    if not size:
        return []
    exponents, scaled = _scaled(M)
    L = _cholesky(scaled)
    T: ndarray = sla.lapack.dtrtri(L, lower=1)[0]
    condition = np.linalg.norm(T, np.inf) * np.linalg.norm(L, np.inf)
    bits = int(np.clip(np.ceil(np.log2(accuracy * size * condition)), 12, 50))
    shifts = [int(e) for e in exponents - exponents.min()]
    entries = np.round(np.ldexp(T, bits)).tolist()
    return [[int(v) << s for v, s in zip(row[: i + 1], shifts, strict=False)] for i, row in enumerate(entries)]


def eliminated(M: fmpz_mat) -> list[list[int]]:
    """Return an integer inverse Cholesky factor of M, by elimination in fractions, each row rounded to some bits.

    Raises:
        RoundingError: M is not positive definite.
    """
    size = M.nrows()
    A = [[fmpq(M[i, j]) for j in range(size)] for i in range(size)]
    T = [[fmpq(i == j) for j in range(size)] for i in range(size)]
    for k in range(size):
        if A[k][k] <= 0:
            raise RoundingError("a matrix of the proof is not positive definite")
        for i in range(k + 1, size):
            share = A[i][k] / A[k][k]
            for rows in (A, T):
                rows[i] = [a - share * b if b else a for a, b in zip(rows[i], rows[k], strict=True)]
    return [[int((v.p << FINE) // v.q) for v in row[: i + 1]] for i, row in enumerate(T)]


def root(M: Float[ndarray, "k k"]) -> Json:
    """Return an integer root of M: 2**bits H M H - L L', H = diag(2**shift), is nearly a positive multiple of 1.

    It is the untrusted half of a proof that takes one product of short numbers, for large matrices.

    Raises:
        RoundingError: M is not positive definite in floating point.
    """
    shifts, scaled = _scaled(M)
    least = _least_eigenvalue(scaled)
    bits = int(np.ceil(np.log2(MARGIN * len(M) / least)))
    if bits > LONGEST:
        raise RoundingError("a matrix of the proof is too nearly singular to be proved positive definite")
    L = np.rint(np.ldexp(_cholesky(scaled - least / 2 * np.eye(len(M))), bits)).astype(np.int64)
    return {"shifts": shifts.tolist(), "bits": 2 * bits, "L": [row[: i + 1].tolist() for i, row in enumerate(L)]}


def _scaled(M: Float[ndarray, "k k"]) -> tuple[ndarray, ndarray]:
    """Return integers s and the matrix 2**(s_i + s_j) M_ij, whose diagonal is near 1."""
    diagonal = np.diag(M)
    if not (np.isfinite(M).all() and (diagonal > 0).all()):
        raise RoundingError("a matrix of the proof has no positive diagonal")
    shifts = -np.round(np.log2(diagonal) / 2).astype(int)
    return shifts, np.ldexp(np.ldexp(M, shifts), shifts[:, None])


def _cholesky(M: Float[ndarray, "k k"]) -> Float[ndarray, "k k"]:
    try:
        return np.linalg.cholesky(M)
    except np.linalg.LinAlgError:
        raise RoundingError("a matrix of the proof is not positive definite in floating point") from None


def _least_eigenvalue(M: Float[ndarray, "k k"]) -> float:
    """Return about the least eigenvalue, not much less, by powers of the inverse."""
    L, vector = _cholesky(M), np.random.default_rng(0).normal(size=len(M))
    for _ in range(POWERS):
        vector = sla.cho_solve((L, True), vector / np.linalg.norm(vector), check_finite=False)
    return float(0.9 / np.linalg.norm(vector))


def separated(content: Json) -> tuple[Json, dict[str, ndarray]]:
    """Return a content whose large matrices are names, and the arrays of a companion that they name.

    Nothing is separated of a content of which people can read the numbers.
    """
    model, proof, arrays = content["model"], content["proof"], dict[str, ndarray]()
    if sum(_length(entry) for entry in proof.values()) + sum(map(_length, _matrices(model))) < BESIDE:
        return content, arrays
    model = {**model, "terms": [{**term} for term in model["terms"]]}
    proof = {name: {**entry} if isinstance(entry, dict) else entry for name, entry in proof.items()}
    parts = [(model, "A0", "A0"), (model, "B", "B")]
    parts += [(t, name, f"terms.{i}.{name}") for i, t in enumerate(model["terms"]) for name in ("R", "A")]
    for part, name, key in parts:
        if _length(part[name]) >= LISTED:
            arrays[key] = np.array([numbers(row) for row in part[name]]).ravel()
            part[name] = key
    for name, entry in proof.items():
        if isinstance(entry, dict) and _length(entry) >= LISTED:
            arrays[f"proof.{name}"] = np.concatenate([np.array(row, np.int64) for row in entry["L"]])
            entry["L"] = f"proof.{name}"
    return content | {"model": model, "proof": proof}, arrays


def _matrices(model: Json) -> list[list[list[str]] | None]:
    return [model["A0"], model["B"], *(term[name] for term in model["terms"] for name in ("R", "A"))]


def _length(rows: Any) -> int:
    """How many numbers a matrix, a root or a factor has."""
    return sum(map(len, rows["L"] if isinstance(rows, dict) else rows or ()))


def encode(content: Json) -> bytes:
    """Write a certificate's object as readable JSON: one line for a row of numbers."""
    lines = [f"{json.dumps(name)}: {_lines(entry)}" for name, entry in content.items()]
    return ("{\n" + ",\n".join(lines) + "\n}\n").encode("utf-8")


def _lines(entry: object, depth: int = 1) -> str:
    compact = json.dumps(entry)
    if len(compact) < 100 or depth > 3 or not isinstance(entry, list | dict):
        return compact
    pad = " " * depth
    if isinstance(entry, list):
        return "[\n" + ",\n".join(pad + _lines(part, depth + 1) for part in entry) + "]"
    return (
        "{\n" + ",\n".join(f"{pad}{json.dumps(name)}: {_lines(part, depth + 1)}" for name, part in entry.items()) + "}"
    )
