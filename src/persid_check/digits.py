"""Large integer matrices as digits of 21 bits, whose products NumPy makes exactly.

X = sum_k 2**(21 k) X_k with integers -2**20 <= X_k < 2**20, written in one way only. A product of two digits is an
integer of at most 2**40, and a sum of at most 2**12 such products, in any order and with any partial sums, is one of at
most 2**52: binary64 holds each exactly, so that a matrix product of digits has no rounding. Longer sums are cut.
Every such product is compared with one modulo 2**64, in integers, on a vector: a faulty library is found out.
"""

from collections.abc import Callable, Iterable, Sequence
from fractions import Fraction

import numpy as np

from persid_check.work import spend, spend_digits

BITS = 21  # of a digit
HALF = 1 << (BITS - 1)
LENGTH = 1 << 12  # of a sum of products of digits
MAX_SIZE = 2**28  # digits of one matrix: 1 GiB
WIDEST = 2**22  # products of digits that are added up without a carry
ONE_BY_ONE = 40  # times as long as in a product of BLAS takes a multiplication that is not in one
BLOCK = 2**22  # entries that are worked on at a time
DIGITS_OF_A_STEP = 16  # of one entry that is read

Array = np.ndarray
Places = Sequence[int] | Array


class Digits:
    """An integer matrix with the operations of an `fmpz_mat` that exact matrices need."""

    __slots__ = ("parts", "shape")

    def __init__(self, shape: tuple[int, int], parts: Iterable[Array]) -> None:
        self.shape, self.parts = shape, list(parts)
        while self.parts and not self.parts[-1].any():
            self.parts.pop()
        _allow(len(self.parts), shape)

    @classmethod
    def of_sums(cls, shape: tuple[int, int], sums: Iterable[Array]) -> "Digits":
        """Return sum_k 2**(21 k) sums_k for integers of less than 2**62 in size, one after another."""
        parts: list[Array] = []
        carry, given = np.zeros(shape, np.int64), iter(sums)
        while (found := next(given, None)) is not None or carry.any():
            if found is not None:
                carry += found
            carry += HALF
            part = (carry & ((1 << BITS) - 1)).astype(np.int32)
            part -= HALF
            carry >>= BITS  # (carry - part) / 2**21 of the carry that was
            parts.append(part)
        return cls(shape, parts)

    @classmethod
    def of_integers(cls, shape: tuple[int, int], values: Sequence[int]) -> "Digits":
        """Return the matrix of Python's integers, row by row."""
        _allow(max(map(int.bit_length, values), default=0) // BITS + 1, shape)  # before they are cut
        chunks, low = [], (1 << 2 * BITS) - 1
        rest: Sequence[int] = values
        while True:
            try:
                chunks.append(_whole(rest, shape))
                break
            except OverflowError:
                chunks += [_whole([v & low for v in rest], shape), np.zeros(shape, np.int64)]
                rest = [v >> 2 * BITS for v in rest]
        return cls.of_sums(shape, chunks)

    @classmethod
    def of_floats(cls, values: Array, exponent: int) -> "Digits":
        """Return values * 2**exponent, which are integers."""
        fractions, exponents = np.frexp(values)
        mantissas = np.ldexp(fractions, 53).astype(np.int64)
        shifts = exponents.astype(np.int64) + (exponent - 53)
        low = np.minimum(shifts, 0)
        mantissas, shifts = mantissas >> -low, np.where(mantissas == 0, 0, shifts - low)
        whole = cls.of_sums(values.shape, [mantissas])
        return whole.moved(shifts)

    @classmethod
    def of_lower(cls, size: int, values: Array) -> "Digits":
        """Return the lower triangular matrix of the 64-bit integers of its rows, one row after another."""
        parts = []
        for part in cls.of_long((1, len(values)), values[None, :]).parts:
            full = np.zeros((size, size), np.int32)
            for i in range(size):
                full[i, : i + 1] = part[0, i * (i + 1) // 2 : (i + 1) * (i + 2) // 2]
            parts.append(full)
        return cls((size, size), parts)

    @classmethod
    def of_long(cls, shape: tuple[int, int], values: Array) -> "Digits":
        """Return any 64-bit integers."""
        low = values & ((1 << BITS) - 1)
        return cls.of_sums(shape, [low, values >> BITS])

    @classmethod
    def of_entries(cls, shape: tuple[int, int], places: Sequence[tuple[int, int]], column: "Digits") -> "Digits":
        """Return a matrix of zeros but for the entries at some places, each place once at most."""
        parts = [np.zeros(shape, np.int32) for _ in column.parts]
        at = np.array(places, int).reshape(-1, 2)
        for part, values in zip(parts, column.parts, strict=True):
            part[at[:, 0], at[:, 1]] = values[:, 0]
        return cls(shape, parts)

    @classmethod
    def of_blocks(cls, rows: Sequence[Sequence["Digits"]]) -> "Digits":
        """Return the matrix of blocks."""
        count = max(len(block.parts) for row in rows for block in row)
        height, width = sum(row[0].shape[0] for row in rows), sum(block.shape[1] for block in rows[0])
        lines = [[[_full(block, k) for block in row] for row in rows] for k in range(count)]
        return cls((height, width), [np.block(line) for line in lines])

    def moved(self, shifts: Array) -> "Digits":
        """Return each entry times 2**shift; shifts >= 0 of the shape of the matrix, or of one row or column."""
        height = len(self.parts) + int(shifts.max(initial=0)) // BITS + 1
        _allow(height, self.shape)
        places, factors = shifts // BITS, (1 << (shifts % BITS)).astype(np.int32)
        found = np.unique(places)
        if len(found) > 1:  # each entry is touched once for each of its digits, however many places there are
            flat = np.broadcast_to(places, self.shape).ravel()
            order = np.argsort(flat, kind="stable")
            starts = np.searchsorted(flat[order], found).tolist()
            groups = dict(zip(found.tolist(), np.split(order, starts[1:]), strict=True))
            factors = np.broadcast_to(factors, self.shape).ravel()

        def total(k: int) -> Array:
            if len(found) <= 1:
                return np.asarray(_part(self, k - int(found[0])).astype(np.int64) * factors)
            summed = np.zeros(flat.shape, np.int64)
            for i in range(max(0, k - int(found[-1])), min(k + 1, len(self.parts))):
                if (at := groups.get(k - i)) is not None:
                    summed[at] = self.parts[i].ravel()[at].astype(np.int64) * factors[at]
            return summed.reshape(self.shape)

        return Digits.of_sums(self.shape, (total(k) for k in range(height)))

    def scaled(self, shifts: Sequence[int]) -> "Digits":
        """Return each entry (i, j) times 2**(shift_i + shift_j); shifts >= 0."""
        powers = np.array(shifts, np.int64)
        return self.moved(powers[:, None] + powers)

    def nrows(self) -> int:
        """Number of rows."""
        return self.shape[0]

    def ncols(self) -> int:
        """Number of columns."""
        return self.shape[1]

    def __add__(self, other: "Digits") -> "Digits":
        return self._joined(other, np.add)

    def __sub__(self, other: "Digits") -> "Digits":
        return self._joined(other, np.subtract)

    def _joined(self, other: "Digits", operation: Callable[..., Array]) -> "Digits":
        count = max(len(self.parts), len(other.parts))
        pairs = ((_part(self, k), _part(other, k)) for k in range(count))
        return Digits.of_sums(self.shape, (operation(a, b, dtype=np.int32) for a, b in pairs))

    def __neg__(self) -> "Digits":
        return Digits.of_sums(self.shape, (-part for part in self.parts))

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Digits) or self.shape != other.shape or len(self.parts) != len(other.parts):
            return False
        return all(bool((a == b).all()) for a, b in zip(self.parts, other.parts, strict=True))

    __hash__ = None  # type: ignore[assignment]

    def transpose(self) -> "Digits":
        """Return the transpose."""
        return Digits(self.shape[::-1], [part.T for part in self.parts])

    def raised(self, bits: int) -> "Digits":
        """Return the matrix times 2**bits."""
        return self.moved(np.full((1, 1), bits, np.int64)) if bits else self

    def kept(self, rows: Places, columns: Places) -> "Digits":
        """Return the submatrix of some rows and columns."""
        if len(rows) == self.shape[0] and len(columns) == self.shape[1] and _is_all(rows) and _is_all(columns):
            return self
        places = np.ix_(np.asarray(rows, int), np.asarray(columns, int))
        return Digits((len(rows), len(columns)), [part[places] for part in self.parts])

    def placed(self, places: Places, height: int) -> "Digits":
        """Return the rows at some places of a higher matrix, which is 0 elsewhere."""
        parts = [np.zeros((height, self.shape[1]), np.int32) for _ in self.parts]
        for found, part in zip(parts, self.parts, strict=True):
            found[np.asarray(places, int)] = part
        return Digits((height, self.shape[1]), parts)

    def __getitem__(self, place: tuple[int, int]) -> int:
        spend(len(self.parts) // DIGITS_OF_A_STEP)
        return sum(int(part[place]) << (BITS * k) for k, part in enumerate(self.parts))

    def integers(self) -> list[int]:
        """Return the entries as Python's integers, row by row."""
        total = [0] * (self.shape[0] * self.shape[1])
        for k in range(0, len(self.parts), 2):
            pair = self.parts[k].astype(np.int64)
            if k + 1 < len(self.parts):
                pair += self.parts[k + 1].astype(np.int64) << BITS
            shift = BITS * k
            total = [t + (v << shift) for t, v in zip(total, pair.ravel().tolist(), strict=True)]
        return total

    def floats(self, exponent: int) -> Array:
        """Return the entries times 2**-exponent in floating point, rounded; it proves nothing."""
        total = np.zeros(self.shape)
        for k, part in enumerate(self.parts):
            total += np.ldexp(part.astype(float), BITS * k - exponent)
        return total

    def cost(self, other: "Digits") -> int:
        """Return the number of multiplications that a product takes; those made one by one count as many."""
        pairs, width = len(self.parts) * len(other.parts), self._width()
        width = width if width == self.shape[1] else ONE_BY_ONE * width
        return pairs * width * self.shape[0] * other.shape[1]

    def __mul__(self, other: "Digits") -> "Digits":
        shape, width = (self.shape[0], other.shape[1]), self._width()
        _allow(len(self.parts) + len(other.parts), shape)
        _refuse_wide(min(len(self.parts), len(other.parts)), width)
        if width < self.shape[1]:
            return self._few(other, width)
        return Digits.of_sums(shape, (self._sum(other, k) for k in range(len(self.parts) + len(other.parts) - 1)))

    def _sum(self, other: "Digits", k: int) -> Array:
        """Return the sum of the products of digits i and k - i."""
        total = np.zeros((self.shape[0], other.shape[1]), np.int64)
        for i in range(max(0, k + 1 - len(other.parts)), min(k + 1, len(self.parts))):
            total += _product(self.parts[i], other.parts[k - i])
        return total

    def squared(self) -> "Digits":
        """Return X X'."""
        shape = (self.shape[0], self.shape[0])
        _allow(2 * len(self.parts), shape)
        _refuse_wide(len(self.parts), self.shape[1])
        return Digits.of_sums(shape, (self._square(k) for k in range(2 * len(self.parts) - 1)))

    def _square(self, k: int) -> Array:
        """Return the sum of the products of digits i and k - i, each pair made once."""
        total = np.zeros((self.shape[0], self.shape[0]), np.int64)
        for i in range(max(0, k + 1 - len(self.parts)), (k + 1) // 2):
            mixed = _product(self.parts[i], self.parts[k - i].T)
            total += mixed
            total += mixed.T
        if k % 2 == 0:
            total += _product(self.parts[k // 2], self.parts[k // 2].T)
        return total

    def _width(self) -> int:
        """The longest row's number of entries that are not zero, where that is small; else the width."""
        most = int(self._present().sum(1).max(initial=0))
        return most if ONE_BY_ONE * most < self.shape[1] else self.shape[1]

    def _present(self) -> Array:
        present = np.zeros(self.shape, bool)
        for part in self.parts:
            present |= part != 0
        return present

    def _few(self, other: "Digits", width: int) -> "Digits":
        """Return the product where each row has few entries, a column of them at a time."""
        shape = (self.shape[0], other.shape[1])
        order = np.argsort(~self._present(), axis=1, kind="stable")[:, :width]

        def total(k: int) -> Array:
            found, rows = np.zeros(shape, np.int64), np.arange(shape[0])
            for i in range(max(0, k + 1 - len(other.parts)), min(k + 1, len(self.parts))):
                for at in order.T:
                    values = self.parts[i][rows, at].astype(np.int64)[:, None]
                    found += values * other.parts[k - i][at] if values.any() else 0
            return found

        return Digits.of_sums(shape, (total(k) for k in range(len(self.parts) + len(other.parts) - 1)))

    def gaps(self, shifts: Sequence[int]) -> list[int]:
        """Return 2**shift_i |x_ii| less the sum of all 2**shift_j |x_ij|, j != i, for each i; -1 where x_ii <= 0."""
        size, least = self.shape[0], min(shifts)
        moved = self.moved(np.array([[shift - least for shift in shifts]], np.int64))
        sign = np.zeros(self.shape, np.int32)
        for part in moved.parts:
            sign = np.where(part != 0, np.sign(part), sign)
        sums = [0] * size
        heads = [0] * size
        for k, part in enumerate(moved.parts):
            along = (part * sign).sum(1, dtype=np.int64).tolist()
            heads = [head + (int(v) << (BITS * k)) for head, v in zip(heads, np.diagonal(part), strict=True)]
            sums = [total + (v << (BITS * k)) for total, v in zip(sums, along, strict=True)]
        return [(2 * h - s) << least if h > 0 else -1 for h, s in zip(heads, sums, strict=True)]


def _allow(count: int, shape: tuple[int, int]) -> None:
    """Refuse so many digits an entry where they are too many for a matrix, or for the length of a file."""
    if count * shape[0] * shape[1] > MAX_SIZE:
        raise ArithmeticError("the numbers of a large matrix are too long: fewer bits are needed")
    spend_digits(count * shape[0] * shape[1])


def _refuse_wide(digits: int, width: int) -> None:
    """The sum of so many products of digits, of at most 2**40 each, stays below 2**62."""
    if digits * width >= WIDEST:
        raise ArithmeticError("the rows of a large matrix are too long for its numbers: fewer bits are needed")


def _part(of: Digits, k: int) -> Array:
    return of.parts[k] if 0 <= k < len(of.parts) else np.zeros((1, 1), np.int32)


def _full(of: Digits, k: int) -> Array:
    return of.parts[k] if k < len(of.parts) else np.zeros(of.shape, np.int32)


def _whole(values: Sequence[int], shape: tuple[int, int]) -> Array:
    """Return integers that are small enough for the sums of digits."""
    if values and not -(1 << 61) < min(values) <= max(values) < 1 << 61:
        raise OverflowError
    return np.array(values, np.int64).reshape(shape)


def _is_all(places: Places) -> bool:
    return bool((np.asarray(places) == np.arange(len(places))).all())


def _product(A: Array, B: Array) -> Array:
    """Return the product of two matrices of digits, exactly."""
    total = np.zeros((A.shape[0], B.shape[1]), np.int64)
    if not (A.any() and B.any()):
        return total
    for start in range(0, A.shape[1], LENGTH):
        left, right = A[:, start : start + LENGTH], B[start : start + LENGTH]
        first = left.astype(float)
        second = first.T if right.T is left or _same(left, right.T) else right.astype(float)
        total += (first @ second).astype(np.int64)
    _compare(A, B, total)
    return total


def _same(A: Array, B: Array) -> bool:
    """Whether two arrays are the same numbers in memory."""
    return A.__array_interface__["data"] == B.__array_interface__["data"] and A.strides == B.strides


def _compare(A: Array, B: Array, found: Array) -> None:
    """Refuse a product that differs from A B, on a vector, modulo 2**64."""
    vector = (2 * np.arange(B.shape[1], dtype=np.uint64) + 1) * np.uint64(0x9E3779B97F4A7C15)
    vector ^= vector >> np.uint64(29)
    whole = vector.view(np.int64)
    if not (_times(found, whole) == _times(A, _times(B, whole))).all():
        raise ArithmeticError("this machine's matrix product is not exact: the proof cannot be checked here")


def _times(A: Array, vector: Array) -> Array:
    """Return A vector modulo 2**64."""
    step = max(1, BLOCK // max(1, A.shape[1]))
    blocks = [A[i : i + step].astype(np.int64) @ vector for i in range(0, A.shape[0], step)]
    return np.concatenate(blocks) if blocks else np.zeros(0, np.int64)


def of_numbers(rows: Sequence[Sequence[Fraction | int | float]], width: int) -> tuple[Digits, int] | None:
    """Return integers or binary64 numbers as digits and their common power of two, None where one is neither."""
    shape, kinds = (len(rows), width), set().union(*(map(type, row) for row in rows))
    if kinds <= {int}:
        return Digits.of_integers(shape, [int(v) for row in rows for v in row]), 0
    try:
        values = np.array([list(map(float, row)) for row in rows], float).reshape(shape)
    except OverflowError:
        return None
    if not np.isfinite(values).all() or (kinds != {float} and not _are_exact(rows, values)):
        return None
    exponent = places_of(values)
    return Digits.of_floats(values, exponent), exponent


def _are_exact(rows: Sequence[Sequence[Fraction | int | float]], values: Array) -> bool:
    """Whether numbers are those in floating point."""
    pairs = (pair for row, floats in zip(rows, values.tolist(), strict=True) for pair in zip(row, floats, strict=True))
    return all(v.as_integer_ratio() == f.as_integer_ratio() for v, f in pairs)


def places_of(values: Array) -> int:
    """Return how many binary places finite numbers need."""
    fractions, exponents = np.frexp(values)
    mantissas = np.ldexp(fractions, 53).astype(np.int64)
    lowest = np.frexp((mantissas & -mantissas).astype(float))[1] - 1
    return int(np.where(mantissas == 0, 0, 53 - exponents - lowest).max(initial=0))
