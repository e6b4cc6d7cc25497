"""Large matrices by digits: every operation is FLINT's, and no product of binary64 is trusted unseen."""

import random
from fractions import Fraction

import numpy as np
import pytest
from flint import fmpz_mat

from persid_check import digits, exact, large
from persid_check.digits import Digits
from persid_check.results import NotProvedError
from persid_check.work import limited

EDGES = [0, 1, -1, 2**20, -(2**20), 2**20 - 1, 2**21, 2**41 - 2**20, 2**61, -(2**61), 2**62, -(2**63), 2**64 - 1]
BITS = (5, 21, 22, 42, 60, 63, 64, 65, 200, 600)


def drawn(choose: random.Random, count: int) -> list[int]:
    """Integers of random lengths, many of them zero or at an edge of a digit."""
    bits, zeros = choose.choice(BITS), choose.choice((0, 0.3, 0.97))

    def one() -> int:
        if choose.random() < zeros:
            return 0
        return choose.choice([*EDGES, choose.getrandbits(bits), -choose.getrandbits(bits), -choose.getrandbits(9)])

    return [one() for _ in range(count)]


def whole(matrix: fmpz_mat) -> list[int]:
    """The entries of FLINT's matrix."""
    return [int(v) for v in matrix.entries()]


@pytest.mark.parametrize("seed", range(60))
def test_operations_are_those_of_flint(seed: int) -> None:
    """Sums, products, squares, powers of two, parts and blocks of random and extreme integers agree, entry by entry."""
    choose = random.Random(seed)
    h, k, w = choose.randint(1, 12), choose.choice((1, 3, 9, 60)), choose.randint(1, 12)
    a, b, c = drawn(choose, h * k), drawn(choose, k * w), drawn(choose, h * k)
    A, B, C = Digits.of_integers((h, k), a), Digits.of_integers((k, w), b), Digits.of_integers((h, k), c)
    a_, b_, c_ = fmpz_mat(h, k, a), fmpz_mat(k, w, b), fmpz_mat(h, k, c)
    assert A.integers() == a
    assert [A[i, j] for i in range(h) for j in range(k)] == a
    assert (A * B).integers() == whole(a_ * b_)
    assert A.squared().integers() == whole(a_ * a_.transpose())
    assert (A + C).integers() == whole(a_ + c_)
    assert (A - C).integers() == whole(a_ - c_)
    assert (-A).integers() == [-v for v in a]
    assert (A == C) == (a == c)
    shift = choose.choice((0, 1, 20, 21, 77))
    assert A.raised(shift).integers() == [v << shift for v in a]
    assert A.transpose().integers() == whole(a_.transpose())
    rows, columns = choose.sample(range(h), choose.randint(1, h)), choose.sample(range(k), choose.randint(1, k))
    assert A.kept(rows, columns).integers() == [a[i * k + j] for i in rows for j in columns]
    lifted = fmpz_mat(h + 1, k, [0] * k + a)
    assert A.placed(range(1, h + 1), h + 1).integers() == whole(lifted)
    assert exact.placed(exact.Matrix(a_, 0), range(1, h + 1), h + 1).flint == lifted
    stacked = Digits.of_blocks([[A, C], [C, A]])
    assert stacked.kept(range(h, 2 * h), range(k, 2 * k)).integers() == a


@pytest.mark.parametrize("seed", range(20))
def test_gaps_of_rows_are_exact(seed: int) -> None:
    """What a diagonal exceeds its row by is the same by digits and by Python's integers, with any powers of two."""
    choose = random.Random(seed)
    n = choose.randint(1, 9)
    a, shifts = drawn(choose, n * n), [choose.randint(0, 60) for _ in range(n)]
    rows = [a[i * n : (i + 1) * n] for i in range(n)]
    expected = [
        (row[i] << shifts[i]) - sum(abs(v) << s for j, (v, s) in enumerate(zip(row, shifts, strict=True)) if j != i)
        if row[i] > 0
        else -1
        for i, row in enumerate(rows)
    ]
    assert Digits.of_integers((n, n), a).gaps(shifts) == expected
    assert exact.matrix(rows, n).gaps(shifts) == expected
    scaled = [v << (shifts[i] + s) for i, row in enumerate(rows) for v, s in zip(row, shifts, strict=True)]
    assert Digits.of_integers((n, n), a).scaled(shifts).integers() == scaled


def test_the_longest_sums_are_exact() -> None:
    """The largest products of digits, 9,000 of them with one sign, add up exactly: longer sums than 2^12 are cut."""
    most = Digits.of_integers((1, 9000), [-(2**20)] * 9000)
    assert (most * most.transpose()).integers() == [9000 << 40]
    assert most.squared().integers() == [9000 << 40]


def test_binary64_numbers_become_digits_exactly() -> None:
    """Numbers of every size, denormal ones too, are their integers over a common power of two."""
    rng = np.random.default_rng(0)
    values = np.ldexp(rng.normal(size=(40, 5)), rng.integers(-1000, 1000, (40, 5)))
    values[3], values[4, 4], values[5, 0] = 0, 3 * 5e-324, -1.7976931348623157e308
    exponent = digits.places_of(values)
    assert exponent == 1074
    found = Digits.of_floats(values, exponent).integers()
    assert found == [int(v.as_integer_ratio()[0] * 2**1074 // v.as_integer_ratio()[1]) for v in values.ravel().tolist()]
    assert digits.of_numbers([[np.inf]], 1) is None
    assert digits.of_numbers([[np.nan]], 1) is None


def test_integers_of_64_bits_are_read_whole() -> None:
    """The rows of a companion's array, its extreme integers among them, are the lower triangular matrix."""
    values = np.array([-(2**63), 2**63 - 1, 5], "<i8")
    assert Digits.of_lower(2, values).integers() == [-(2**63), 0, 2**63 - 1, 5]


@pytest.mark.parametrize("place", [(0, 0), (3, 7), (9, 9)])
@pytest.mark.parametrize("error", [1, -1, 2**40])
def test_a_library_that_does_not_multiply_exactly_is_found_out(place: tuple[int, int], error: int) -> None:
    """One wrong entry of a product differs from integers modulo 2^64 on a vector."""
    A = np.arange(100, dtype=np.int32).reshape(10, 10)
    found = A.astype(np.int64) @ A
    digits._compare(A, A, found)
    found[place] += error
    with pytest.raises(ArithmeticError, match="not exact"):
        digits._compare(A, A, found)


def test_work_and_memory_of_large_matrices_are_bounded(monkeypatch: pytest.MonkeyPatch) -> None:
    """A product of too many multiplications is refused before it is made, and numbers that spread too widely."""
    size = 300
    M = exact.matrix([[1.0 + 2.0**-40 * i * j for j in range(size)] for i in range(size)], size)
    assert M.entries.cost(M.entries) == size**3 * len(M.entries.parts) ** 2
    few = exact.diagonal([1.0 + 2.0**-50] * size).entries
    monkeypatch.setattr(large, "MAX_WORK", size**3)
    with pytest.raises(NotProvedError, match="too large"):
        M * M
    with pytest.raises(NotProvedError, match="too large"):
        M.squared()
    monkeypatch.setattr(digits, "MAX_SIZE", size**2)
    with pytest.raises(ArithmeticError, match="too long"):
        M.entries.raised(100)
    assert few.cost(few) == digits.ONE_BY_ONE * size**2 * len(few.parts) ** 2
    monkeypatch.setattr(digits, "MAX_SIZE", 2 * len(few.parts) * size**2 - 1)
    for product in (lambda: few * few, few.squared):
        with pytest.raises(ArithmeticError, match="too long"):
            product()
    with pytest.raises(NotProvedError, match="spread"):
        M.raised(10**6)


def test_without_numpy_matrices_of_all_sizes_are_flints(monkeypatch: pytest.MonkeyPatch) -> None:
    """The same numbers, one by one, with digits and without."""
    rng = np.random.default_rng(1)
    rows = np.ldexp(rng.normal(size=(260, 260)), rng.integers(-30, 30, (260, 260))).tolist()
    by_digits = exact.matrix(rows, 260)
    assert isinstance(by_digits.entries, Digits)
    monkeypatch.setattr(exact, "_has_numpy", lambda: False)
    by_flint = exact.matrix(rows, 260)
    assert isinstance(by_flint.entries, fmpz_mat)
    assert by_digits.exponent == by_flint.exponent
    assert by_digits.flint == by_flint.entries


def test_entries_are_moved_by_shifts_that_all_differ() -> None:
    """Each entry goes to its own place, whatever the others' are, and the number of places costs nothing."""
    choose = random.Random(5)
    values = [choose.randrange(-(2**70), 2**70) for _ in range(30)]
    shifts = np.array([choose.randrange(4000) for _ in range(30)], np.int64).reshape(5, 6)
    moved = Digits.of_integers((5, 6), values).moved(shifts)
    assert moved.integers() == [v << s for v, s in zip(values, shifts.ravel().tolist(), strict=True)]


def test_sums_that_64_bits_may_not_hold_are_refused() -> None:
    """Rows times digits beyond what is added up without a carry end in an error, not in another number."""
    row = Digits((1, 2**16), [np.full((1, 2**16), -(2**20), np.int32)] * 64)
    with pytest.raises(ArithmeticError, match="fewer bits"):
        row * row.transpose()
    with pytest.raises(ArithmeticError, match="fewer bits"):
        row.squared()


def test_to_read_an_entry_of_many_digits_takes_steps() -> None:
    """Points of long numbers, 875,000 entries of 190 digits, took 17 s of the steps of as many short ones."""
    short, long = (Digits.of_integers((1, 1), [2**bits]) for bits in (200, 4000))
    with limited(100) as account:
        assert short[0, 0] == 2**200
        assert account.spent == 0
        assert long[0, 0] == 2**4000
        assert account.spent == 4000 // 21 // digits.DIGITS_OF_A_STEP


@pytest.mark.parametrize(
    ("size", "bits", "counted"), [(60, 4000, 60**3 * 191**2), (60, 100, 60**3 * 25), (30, 4000, 0)]
)
def test_products_of_flint_count_as_those_of_digits(size: int, bits: int, counted: int) -> None:
    """Below the size of digits, too, but for small ones."""
    X = exact.matrix([[Fraction(2**bits - 1)] * size] * size, size)
    with limited(1, 0) as account:
        before = account.products
        _ = X * X
    assert before - account.products == counted
