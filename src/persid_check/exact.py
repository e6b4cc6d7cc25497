"""Exact matrices of dyadic numbers, made of their entries or of blocks.

They are FLINT's. Large ones are held by digits in NumPy's arrays, where NumPy is at hand (large.py, specification:
"Large matrices"): the same numbers, with the same methods.
"""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING

from flint import fmpz_mat

from persid_check.flint_matrix import Matrix as Matrix
from persid_check.flint_matrix import Number as Number
from persid_check.flint_matrix import has_many_entries, integers

if TYPE_CHECKING:
    from persid_check.large import Large

Entries = Iterable[tuple[int, int, Number]]  # of a sparse matrix: row, column, value; each place once at most


@cache
def _has_numpy() -> bool:
    """Whether NumPy is at hand. Without it all matrices are FLINT's, and large products are refused for their work."""
    try:
        import persid_check.large  # noqa: F401
    except ImportError:
        return False
    return True


def is_large(height: int, width: int) -> bool:
    """Whether a matrix of this size is held by digits."""
    return has_many_entries(height, width) and _has_numpy()


def _large(height: int, width: int) -> "type[Large] | None":
    """Return what makes matrices of this size, where they are large."""
    if not is_large(height, width):
        return None
    from persid_check.large import Large

    return Large


def matrix(rows: Sequence[Sequence[Number]], width: int) -> Matrix:
    """Return the exact matrix of rows of dyadic numbers."""
    if large := _large(len(rows), width):
        return large.of_rows(rows, width)
    flat, exponent = integers(value for row in rows for value in row)
    return Matrix(fmpz_mat(len(rows), width, flat), exponent)


def zeros(height: int, width: int) -> Matrix:
    """Return a matrix of zeros."""
    return scattered(height, width, ())


def scattered(height: int, width: int, entries: Entries) -> Matrix:
    """Return the matrix with some entries that are not zero."""
    listed = list(entries)
    values, exponent = integers(value for *_, value in listed)
    if large := _large(height, width):
        return large.of_entries((height, width), [(i, j) for i, j, _ in listed], values, exponent)
    found = fmpz_mat(height, width)
    for (i, j, _), value in zip(listed, values, strict=True):
        found[i, j] = value
    return Matrix(found, exponent)


def placed(part: Matrix, places: Sequence[int], height: int) -> Matrix:
    """Return rows at some places of a higher matrix, which is 0 elsewhere."""
    if large := _large(height, part.width):
        return large.placing(part, places, height)
    found = fmpz_mat(height, part.width)
    for place, line in zip(places, part.entries.table(), strict=True):
        for j, value in enumerate(line):
            found[place, j] = value
    return Matrix(found, part.exponent)


def mirrored(lower: Mapping[tuple[int, int], Fraction]) -> list[tuple[int, int, Fraction]]:
    """Return all entries of a symmetric matrix, of those on and below its diagonal."""
    entries = [(i, j, value) for (i, j), value in lower.items()]
    return entries + [(j, i, value) for i, j, value in entries if i != j]


def blocks(parts: Sequence[Sequence[Matrix]]) -> Matrix:
    """Return the matrix of blocks."""
    exponent = max(part.exponent for row in parts for part in row)
    raised = [[part.raised(exponent) for part in row] for row in parts]
    height, width = sum(row[0].height for row in parts), sum(part.width for part in parts[0])
    if large := _large(height, width):
        return large.of_blocks(raised, exponent)
    lines = (line for row in raised for lines in zip(*(part.table() for part in row), strict=True) for line in lines)
    return Matrix(fmpz_mat(height, width, [value for line in lines for value in line]), exponent)


def beside(first: Matrix, second: Matrix) -> Matrix:
    """Return the matrix of two blocks on the diagonal."""
    above, below = zeros(first.height, second.width), zeros(second.height, first.width)
    return blocks([[first, above], [below, second]])


def diagonal(values: Sequence[Number]) -> Matrix:
    """Return a diagonal matrix."""
    return scattered(len(values), len(values), [(i, i, value) for i, value in enumerate(values)])
