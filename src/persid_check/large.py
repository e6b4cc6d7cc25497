"""Large exact matrices, held by digits: what FLINT's are for fewer entries (specification: "Large matrices")."""

from collections.abc import Sequence

from flint import fmpz_mat

from persid_check.digits import Digits, of_numbers
from persid_check.flint_matrix import TOO_LARGE, Matrix, Number, has_many_entries, integers
from persid_check.results import NotProvedError
from persid_check.work import spend_multiplications

MAX_WORK = 5 * 10**11  # multiplications of one matrix product by digits


class Large(Matrix):
    """A matrix whose entries are `Digits`, as they are of every matrix that is large."""

    @property
    def flint(self) -> fmpz_mat:
        """The integers as FLINT's matrix."""
        return fmpz_mat(*self.shape, self.entries.integers())

    @classmethod
    def of_rows(cls, rows: Sequence[Sequence[Number]], width: int) -> Matrix:
        """Return the matrix of rows of dyadic numbers."""
        if (found := of_numbers(rows, width)) is not None:
            return cls(*found)
        flat, exponent = integers(value for row in rows for value in row)
        return cls(Digits.of_integers((len(rows), width), flat), exponent)

    @classmethod
    def of_entries(
        cls, shape: tuple[int, int], places: Sequence[tuple[int, int]], values: Sequence[int], exponent: int
    ) -> Matrix:
        """Return the matrix with integers at some places, over a power of two."""
        column = Digits.of_integers((len(values), 1), values)
        return cls(Digits.of_entries(shape, places, column), exponent)

    @classmethod
    def of_blocks(cls, parts: Sequence[Sequence[fmpz_mat | Digits]], exponent: int) -> Matrix:
        """Return the matrix of blocks of integers, over a power of two."""
        return cls(Digits.of_blocks([[_digits(part) for part in row] for row in parts]), exponent)

    @classmethod
    def placing(cls, part: Matrix, places: Sequence[int], height: int) -> Matrix:
        """Return rows at some places of a higher matrix, which is 0 elsewhere."""
        return cls(_digits(part.entries).placed(places, height), part.exponent)

    def __add__(self, other: Matrix) -> Matrix:
        k = max(self.exponent, other.exponent)
        return Large(_digits(self.raised(k)) + _digits(other.raised(k)), k)

    __radd__ = __add__

    def __mul__(self, other: Matrix) -> Matrix:
        return _product(self, other)

    def __rmul__(self, other: Matrix) -> Matrix:
        return _product(other, self)

    def squared(self) -> Matrix:
        """Return X X'."""
        _spend(self.entries.cost(self.entries.transpose()))
        return held(self.entries.squared(), 2 * self.exponent)

    def _moved(self, bits: int) -> Digits:
        raised: Digits = self.entries.raised(bits)
        return raised

    def kept(self, rows: Sequence[int], columns: Sequence[int]) -> Matrix:
        """Return the submatrix of some rows and columns."""
        return held(self.entries.kept(rows, columns), self.exponent)

    def scaled(self, shifts: Sequence[int]) -> Matrix:
        """Return each entry (i, j) times 2**(shift_i + shift_j); shifts >= 0."""
        return Large(self.entries.scaled(shifts), self.exponent)

    def gaps(self, shifts: Sequence[int]) -> list[int]:
        """Return 2**(exponent) times 2**shift_i x_ii less the sum of all 2**shift_j |x_ij|, j != i, for each i."""
        found: list[int] = self.entries.gaps(shifts)
        return found


def _product(first: Matrix, second: Matrix) -> Matrix:
    left, right = _digits(first.entries), _digits(second.entries)
    _spend(left.cost(right))
    return held(left * right, first.exponent + second.exponent)


def held(found: Digits, exponent: int) -> Matrix:
    """Return a matrix as one of its size is held."""
    large = Large(found, exponent)
    return large if has_many_entries(*found.shape) else Matrix(large.flint, exponent)


def _digits(entries: fmpz_mat | Digits) -> Digits:
    """Return integers by digits."""
    if isinstance(entries, Digits):
        return entries
    shape = (int(entries.nrows()), int(entries.ncols()))
    return Digits.of_integers(shape, [int(v) for v in entries.entries()])


def _spend(work: int) -> None:
    if work > MAX_WORK:
        raise NotProvedError("numbers", TOO_LARGE)
    spend_multiplications(work)
