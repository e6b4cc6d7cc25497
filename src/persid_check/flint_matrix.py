"""Exact matrices of dyadic numbers: FLINT's integers over a power of two."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from flint import fmpz, fmpz_mat

from persid_check.results import NotProvedError
from persid_check.work import spend_multiplications

MAX_EXPONENT = 5000  # of the common power of two; binary64 numbers need 1074
MAX_WORK = 10**12  # size**3 times bits of one matrix product
FREE_WORK = 2**15  # size**3 of a product that is small whatever its bits
DIGIT = 21  # bits: longer products count as many multiplications as by digits
TOO_LARGE = "a matrix product is too large: fewer bits or fewer entries are needed, or NumPy, if it is not installed"
LARGE = 2**12  # entries from which a matrix is held by digits

Number = Fraction | int | float
_ZERO = Fraction(0)


@dataclass(frozen=True)
class Matrix:
    """The matrix `entries` * 2**-`exponent`. Its entries are an fmpz_mat, of a large one digits."""

    entries: Any
    exponent: int

    @property
    def height(self) -> int:
        """Number of rows."""
        return int(self.entries.nrows())

    @property
    def width(self) -> int:
        """Number of columns."""
        return int(self.entries.ncols())

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width."""
        return self.height, self.width

    @property
    def flint(self) -> fmpz_mat:
        """The integers as FLINT's matrix."""
        entries: fmpz_mat = self.entries
        return entries

    def __add__(self, other: "Matrix") -> "Matrix":
        k = max(self.exponent, other.exponent)
        return Matrix(self.raised(k) + other.raised(k), k)

    def __mul__(self, other: "Matrix") -> "Matrix":
        left, right, steps = self.entries, other.entries, self.height * self.width * other.width
        if steps > FREE_WORK:
            bits = _bits(left), _bits(right)
            if steps * max(bits) > MAX_WORK:
                raise NotProvedError("numbers", TOO_LARGE)
            spend_multiplications(steps * (1 + bits[0] // DIGIT) * (1 + bits[1] // DIGIT))
        return Matrix(left * right, self.exponent + other.exponent)

    def squared(self) -> "Matrix":
        """Return X X'."""
        return self * self.T

    def __neg__(self) -> "Matrix":
        return type(self)(-self.entries, self.exponent)

    @property
    def T(self) -> "Matrix":
        """The transpose."""
        return type(self)(self.entries.transpose(), self.exponent)

    def raised(self, exponent: int) -> Any:
        """Return the integer entries at a larger exponent."""
        if exponent > MAX_EXPONENT:
            raise NotProvedError("numbers", f"their exponents spread over more than {MAX_EXPONENT} bits")
        return self._moved(exponent - self.exponent)

    def _moved(self, bits: int) -> Any:
        return self.entries * fmpz(1 << bits)

    def kept(self, rows: Sequence[int], columns: Sequence[int]) -> "Matrix":
        """Return the submatrix of some rows and columns."""
        flat = [self.entries[i, j] for i in rows for j in columns]
        return Matrix(fmpz_mat(len(rows), len(columns), flat), self.exponent)

    @property
    def rows(self) -> tuple[tuple[Fraction, ...], ...]:
        """All entries."""
        scale = 1 << self.exponent
        return tuple(tuple(Fraction(int(v), scale) if v else _ZERO for v in row) for row in self.flint.table())

    def entry(self, i: int, j: int) -> Fraction:
        """Return one entry."""
        return Fraction(int(self.entries[i, j]), 1 << self.exponent)

    def scaled(self, shifts: Sequence[int]) -> "Matrix":
        """Return each entry (i, j) times 2**(shift_i + shift_j); shifts >= 0."""
        rows = enumerate(self.entries.table())
        flat = [int(v) << (shifts[i] + shift) for i, row in rows for v, shift in zip(row, shifts, strict=True)]
        return Matrix(fmpz_mat(self.height, self.width, flat), self.exponent)

    def gaps(self, shifts: Sequence[int]) -> list[int]:
        """Return 2**(exponent) times 2**shift_i x_ii less the sum of all 2**shift_j |x_ij|, j != i, for each i.

        It is -1 where x_ii <= 0; shifts >= 0.
        """
        rows, size = self.entries.table(), self.height
        sizes = fmpz_mat(size, size, [abs(value) for row in rows for value in row])
        sums = (sizes * fmpz_mat(size, 1, [1 << shift for shift in shifts])).table()
        heads = [int(row[i]) for i, row in enumerate(rows)]
        return [(2 * h << t) - int(s[0]) if h > 0 else -1 for h, t, s in zip(heads, shifts, sums, strict=True)]


def integers(values: Iterable[Number]) -> tuple[list[int], int]:
    """Return dyadic numbers as integers over a common power of two."""
    ratios = [value.as_integer_ratio() for value in values]
    exponent = max((den.bit_length() - 1 for _, den in ratios), default=0)
    if exponent > MAX_EXPONENT:
        raise NotProvedError("numbers", f"a number needs more than {MAX_EXPONENT} binary places")
    return [num << (exponent + 1 - den.bit_length()) if num else 0 for num, den in ratios], exponent


def has_many_entries(height: int, width: int) -> bool:
    """Whether a matrix of this size is held by digits, where NumPy is at hand."""
    return height * width >= LARGE


def _bits(entries: fmpz_mat) -> int:
    values = entries.entries()
    return int(max(max(values), -min(values))).bit_length()
