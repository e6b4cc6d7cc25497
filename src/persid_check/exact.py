"""Exact matrices of dyadic numbers."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import fmpz, fmpz_mat

from persid_check.results import NotProvedError

MAX_EXPONENT = 5000  # of the common power of two; binary64 numbers need 1074
MAX_WORK = 10**12  # size**3 times bits of one matrix product
FREE_WORK = 10**6  # size**3 of a product that is small whatever its bits

Number = Fraction | int | float


@dataclass(frozen=True)
class Matrix:
    """The matrix `entries` * 2**-`exponent`."""

    entries: fmpz_mat
    exponent: int

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.entries.nrows())

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.entries.ncols())

    def __add__(self, other: "Matrix") -> "Matrix":
        k = max(self.exponent, other.exponent)
        return Matrix(self.raised(k) + other.raised(k), k)

    def __mul__(self, other: "Matrix") -> "Matrix":
        steps = self.height * self.width * other.width
        if steps > FREE_WORK and steps * max(_bits(self.entries), _bits(other.entries)) > MAX_WORK:
            raise NotProvedError("numbers", "a matrix product is too large: fewer bits or fewer entries are needed")
        return Matrix(self.entries * other.entries, self.exponent + other.exponent)

    def __neg__(self) -> "Matrix":
        return Matrix(-self.entries, self.exponent)

    @property
    def T(self) -> "Matrix":
        """The transpose."""
        return Matrix(self.entries.transpose(), self.exponent)

    def raised(self, exponent: int) -> fmpz_mat:
        """Return the integer entries at a larger exponent."""
        if exponent > MAX_EXPONENT:
            raise NotProvedError("numbers", f"their exponents spread over more than {MAX_EXPONENT} bits")
        return self.entries * fmpz(1 << (exponent - self.exponent))

    def kept(self, rows: Sequence[int], columns: Sequence[int]) -> "Matrix":
        """Return the submatrix of some rows and columns."""
        flat = [self.entries[i, j] for i in rows for j in columns]
        return Matrix(fmpz_mat(len(rows), len(columns), flat), self.exponent)

    def entry(self, i: int, j: int) -> Fraction:
        """Return one entry."""
        return Fraction(int(self.entries[i, j]), 1 << self.exponent)


def matrix(rows: Sequence[Sequence[Number]], width: int) -> Matrix:
    """Return the exact matrix of rows of dyadic numbers."""
    ratios = [value.as_integer_ratio() for row in rows for value in row]
    exponent = max((den.bit_length() - 1 for _, den in ratios), default=0)
    if exponent > MAX_EXPONENT:
        raise NotProvedError("numbers", f"a number needs more than {MAX_EXPONENT} binary places")
    flat = [num << (exponent + 1 - den.bit_length()) if num else 0 for num, den in ratios]
    return Matrix(fmpz_mat(len(rows), width, flat), exponent)


def blocks(parts: Sequence[Sequence[Matrix]]) -> Matrix:
    """Return the matrix of blocks."""
    exponent = max(part.exponent for row in parts for part in row)
    flat: list[fmpz] = []
    for row in parts:
        tables = [part.raised(exponent).table() for part in row]
        for lines in zip(*tables, strict=True):
            for line in lines:
                flat.extend(line)
    height, width = sum(row[0].height for row in parts), sum(part.width for part in parts[0])
    return Matrix(fmpz_mat(height, width, flat), exponent)


def diagonal(values: Sequence[Number]) -> Matrix:
    """Return a diagonal matrix."""
    size = len(values)
    return matrix([[values[i] if i == j else 0 for j in range(size)] for i in range(size)], size)


def _bits(entries: fmpz_mat) -> int:
    values = entries.entries()
    return int(max(max(values), -min(values))).bit_length()
