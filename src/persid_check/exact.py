"""Exact matrices of dyadic numbers.

Small ones are FLINT's, large ones digits in NumPy's arrays, where NumPy is at hand (specification: "Large matrices").
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from typing import TYPE_CHECKING

from flint import fmpz, fmpz_mat

from persid_check.results import NotProvedError

if TYPE_CHECKING:
    from persid_check.digits import Digits

MAX_EXPONENT = 5000  # of the common power of two; binary64 numbers need 1074
MAX_WORK = 10**12  # size**3 times bits of one matrix product
MAX_DIGIT_WORK = 5 * 10**11  # multiplications of one matrix product by digits
FREE_WORK = 10**6  # size**3 of a product that is small whatever its bits
TOO_LARGE = "a matrix product is too large: fewer bits or fewer entries are needed, or NumPy, if it is not installed"
LARGE = 2**16  # entries from which a matrix is held by digits

Number = Fraction | int | float
Entries = Iterable[tuple[int, int, Number]]  # of a sparse matrix: row, column, value; each place once at most


@dataclass(frozen=True)
class Matrix:
    """The matrix `entries` * 2**-`exponent`."""

    entries: "fmpz_mat | Digits"
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
        entries = self.entries
        return entries if isinstance(entries, fmpz_mat) else fmpz_mat(*entries.shape, entries.integers())

    @property
    def digits(self) -> "Digits":
        """The integers by digits."""
        return digits_of(self.entries)

    def __add__(self, other: "Matrix") -> "Matrix":
        k = max(self.exponent, other.exponent)
        first, second = self.raised(k), other.raised(k)
        if isinstance(first, fmpz_mat) and isinstance(second, fmpz_mat):
            return Matrix(first + second, k)
        return Matrix(digits_of(first) + digits_of(second), k)

    def __mul__(self, other: "Matrix") -> "Matrix":
        exponent = self.exponent + other.exponent
        if is_large(self.height, other.width) or is_large(*self.shape) or is_large(*other.shape):
            _refuse_long(self.digits.cost(other.digits))
            return Matrix(_held(self.digits * other.digits), exponent)
        left, right, steps = self.flint, other.flint, self.height * self.width * other.width
        if steps > FREE_WORK and steps * max(_bits(left), _bits(right)) > MAX_WORK:
            raise NotProvedError("numbers", TOO_LARGE)
        return Matrix(left * right, exponent)

    def squared(self) -> "Matrix":
        """Return X X'."""
        if not is_large(*self.shape):
            return self * self.T
        _refuse_long(self.digits.cost(self.digits.transpose()))
        return Matrix(_held(self.digits.squared()), 2 * self.exponent)

    def __neg__(self) -> "Matrix":
        return Matrix(-self.entries, self.exponent)

    @property
    def T(self) -> "Matrix":
        """The transpose."""
        return Matrix(self.entries.transpose(), self.exponent)

    def raised(self, exponent: int) -> "fmpz_mat | Digits":
        """Return the integer entries at a larger exponent."""
        if exponent > MAX_EXPONENT:
            raise NotProvedError("numbers", f"their exponents spread over more than {MAX_EXPONENT} bits")
        bits = exponent - self.exponent
        return self.entries * fmpz(1 << bits) if isinstance(self.entries, fmpz_mat) else self.entries.raised(bits)

    def kept(self, rows: Sequence[int], columns: Sequence[int]) -> "Matrix":
        """Return the submatrix of some rows and columns."""
        if isinstance(self.entries, fmpz_mat):
            flat = [self.entries[i, j] for i in rows for j in columns]
            return Matrix(fmpz_mat(len(rows), len(columns), flat), self.exponent)
        return Matrix(_held(self.entries.kept(rows, columns)), self.exponent)

    def placed(self, places: Sequence[int], height: int) -> "Matrix":
        """Return the rows at some places of a higher matrix, which is 0 elsewhere."""
        if is_large(height, self.width):
            return Matrix(self.digits.placed(places, height), self.exponent)
        found = fmpz_mat(height, self.width)
        for place, line in zip(places, self.flint.table(), strict=True):
            for j, value in enumerate(line):
                found[place, j] = value
        return Matrix(found, self.exponent)

    def entry(self, i: int, j: int) -> Fraction:
        """Return one entry."""
        return Fraction(int(self.entries[i, j]), 1 << self.exponent)

    def scaled(self, shifts: Sequence[int]) -> "Matrix":
        """Return each entry (i, j) times 2**(shift_i + shift_j); shifts >= 0."""
        if isinstance(self.entries, fmpz_mat):
            rows = enumerate(self.entries.table())
            flat = [int(v) << (shifts[i] + shift) for i, row in rows for v, shift in zip(row, shifts, strict=True)]
            return Matrix(fmpz_mat(self.height, self.width, flat), self.exponent)
        return Matrix(self.entries.scaled(shifts), self.exponent)

    def gaps(self, shifts: Sequence[int]) -> list[int]:
        """Return 2**(exponent) times 2**shift_i x_ii less the sum of all 2**shift_j |x_ij|, j != i, for each i.

        It is -1 where x_ii <= 0; shifts >= 0.
        """
        if not isinstance(self.entries, fmpz_mat):
            return self.entries.gaps(shifts)
        rows, size = self.entries.table(), self.height
        sizes = fmpz_mat(size, size, [abs(value) for row in rows for value in row])
        sums = (sizes * fmpz_mat(size, 1, [1 << shift for shift in shifts])).table()
        heads = [int(row[i]) for i, row in enumerate(rows)]
        return [(2 * h << t) - int(s[0]) if h > 0 else -1 for h, t, s in zip(heads, shifts, sums, strict=True)]


@cache
def _has_numpy() -> bool:
    """Whether NumPy is at hand. Without it all matrices are FLINT's, and large products are refused for their work."""
    try:
        import persid_check.digits  # noqa: F401
    except ImportError:
        return False
    return True


def is_large(height: int, width: int) -> bool:
    """Whether a matrix of this size is held by digits."""
    return height * width >= LARGE and _has_numpy()


def digits_of(entries: "fmpz_mat | Digits") -> "Digits":
    """Return a matrix by digits."""
    from persid_check.digits import Digits

    if isinstance(entries, Digits):
        return entries
    shape = (int(entries.nrows()), int(entries.ncols()))
    return Digits.of_integers(shape, [int(v) for v in entries.entries()])


def _held(found: "Digits") -> "fmpz_mat | Digits":
    """Return a matrix as one of its size is held."""
    return found if is_large(*found.shape) else fmpz_mat(*found.shape, found.integers())


def _refuse_long(work: int) -> None:
    if work > MAX_DIGIT_WORK:
        raise NotProvedError("numbers", TOO_LARGE)


def matrix(rows: Sequence[Sequence[Number]], width: int) -> Matrix:
    """Return the exact matrix of rows of dyadic numbers."""
    if is_large(len(rows), width):
        from persid_check.digits import of_numbers

        found = of_numbers(rows, width)
        if found is not None:
            return Matrix(*found)
    return _of_flat(len(rows), width, [value for row in rows for value in row])


def _of_flat(height: int, width: int, values: Sequence[Number]) -> Matrix:
    ratios = [value.as_integer_ratio() for value in values]
    exponent = max((den.bit_length() - 1 for _, den in ratios), default=0)
    if exponent > MAX_EXPONENT:
        raise NotProvedError("numbers", f"a number needs more than {MAX_EXPONENT} binary places")
    flat = [num << (exponent + 1 - den.bit_length()) if num else 0 for num, den in ratios]
    if is_large(height, width):
        from persid_check.digits import Digits

        return Matrix(Digits.of_integers((height, width), flat), exponent)
    return Matrix(fmpz_mat(height, width, flat), exponent)


def zeros(height: int, width: int) -> Matrix:
    """Return a matrix of zeros."""
    return scattered(height, width, ())


def scattered(height: int, width: int, entries: Entries) -> Matrix:
    """Return the matrix with some entries that are not zero."""
    listed = list(entries)
    column = _of_flat(len(listed), 1, [value for *_, value in listed])
    if is_large(height, width):
        from persid_check.digits import Digits

        places = [(i, j) for i, j, _ in listed]
        return Matrix(Digits.of_entries((height, width), places, digits_of(column.entries)), column.exponent)
    found = fmpz_mat(height, width)
    for k, (i, j, _) in enumerate(listed):
        found[i, j] = column.entries[k, 0]
    return Matrix(found, column.exponent)


def mirrored(lower: Mapping[tuple[int, int], Fraction]) -> list[tuple[int, int, Fraction]]:
    """Return all entries of a symmetric matrix, of those on and below its diagonal."""
    entries = [(i, j, value) for (i, j), value in lower.items()]
    return entries + [(j, i, value) for i, j, value in entries if i != j]


def blocks(parts: Sequence[Sequence[Matrix]]) -> Matrix:
    """Return the matrix of blocks."""
    exponent = max(part.exponent for row in parts for part in row)
    raised = [[Matrix(part.raised(exponent), exponent) for part in row] for row in parts]
    height, width = sum(row[0].height for row in parts), sum(part.width for part in parts[0])
    if is_large(height, width):
        from persid_check.digits import Digits

        return Matrix(Digits.of_blocks([[part.digits for part in row] for row in raised]), exponent)
    flat: list[fmpz] = []
    for row in raised:
        for lines in zip(*(part.flint.table() for part in row), strict=True):
            for line in lines:
                flat.extend(line)
    return Matrix(fmpz_mat(height, width, flat), exponent)


def beside(first: Matrix, second: Matrix) -> Matrix:
    """Return the matrix of two blocks on the diagonal."""
    above, below = zeros(first.height, second.width), zeros(second.height, first.width)
    return blocks([[first, above], [below, second]])


def diagonal(values: Sequence[Number]) -> Matrix:
    """Return a diagonal matrix."""
    return scattered(len(values), len(values), [(i, i, value) for i, value in enumerate(values)])


def _bits(entries: fmpz_mat) -> int:
    values = entries.entries()
    return int(max(max(values), -min(values))).bit_length()
