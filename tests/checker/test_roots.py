"""Roots: L proves M > 0 where M less L L' is dominant; nothing else is proved by any L."""

import random
from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from checker import known_ledgers
from checker.ledgers import data
from checker.second_ledger import verdict
from persid.certificates.encoding import root
from persid.certificates.ledger import floats
from persid_check import Accepted, Malformed, Rejected, check, exact, flint_matrix
from persid_check.definite import Root, has_root, is_positive_definite
from persid_check.exact import Matrix, matrix
from persid_check.ledger.assembly import assemble
from persid_check.ledger.file import read_ledger
from persid_check.results import NotProvedError

SIZES = (7, 40)  # FLINT's, and by digits
TINY = Fraction(1, 2**60)


@pytest.fixture(autouse=True)
def _digits_begin_early(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(flint_matrix, "LARGE", 1000)


def written(found: dict[str, Any]) -> Root:
    """The root that an object of a file is."""
    return Root(tuple(found["shifts"]), found["bits"], tuple(map(tuple, found["L"])))


def drawn(size: int, seed: int = 0, spread: int = 20) -> np.ndarray:
    """A positive definite matrix whose rows have very different sizes."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(size, size))
    scale = np.exp2(rng.integers(-spread, spread + 1, size))
    return np.tril((A @ A.T / size + 0.01 * np.eye(size)) * scale * scale[:, None])


def symmetric(lower: np.ndarray) -> Matrix:
    """The exact matrix of a lower triangle."""
    return matrix((np.tril(lower) + np.tril(lower, -1).T).tolist(), len(lower))


def integers(size: int, last: int) -> list[list[int]]:
    """Lower rows of small integers with a given last entry, ones before it on the diagonal."""
    choose = random.Random(size)
    rows = [[choose.choice((-1, 0, 0, 0, 0, 1)) if j < i else 1 for j in range(i + 1)] for i in range(size)]
    rows[-1][-1] = last
    return rows


def gram(rows: list[list[int]], added: Fraction) -> Matrix:
    """L L' + added I."""
    size = len(rows)
    L = matrix([[*row, *[0] * (size - 1 - i)] for i, row in enumerate(rows)], size)
    return L * L.T + exact.diagonal([added] * size)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("spread", [0, 20, 200])
def test_a_root_proves_what_is_positive_definite(size: int, spread: int) -> None:
    """Matrices of all scales have the root that is written for them; with an entry of L changed much they have not."""
    lower = drawn(size, spread=spread)
    M, found = symmetric(lower), written(root(np.asarray(lower + np.tril(lower, -1).T)))
    assert has_root(M, found)
    rows = [list(row) for row in found.L]  # type: ignore[union-attr]
    rows[size // 2][0] += 1 << (found.bits // 2)
    assert not has_root(M, replace(found, L=rows))


@pytest.mark.parametrize("size", SIZES)
def test_the_least_margin_decides(size: int) -> None:
    """L L' + 2^-60 is proved by L itself; L L' and L L' - 2^-60, singular and indefinite, are not."""
    rows = integers(size, 0)
    proof = Root((0,) * size, 0, rows)
    assert has_root(gram(rows, TINY), proof)
    assert not has_root(gram(rows, Fraction(0)), proof)
    assert not has_root(gram(rows, -TINY), proof)


@pytest.mark.parametrize("size", SIZES)
def test_an_indefinite_matrix_has_no_root(size: int) -> None:
    """Whatever L, shifts and bits are tried for a matrix that is indefinite by 2^-60, none is accepted."""
    rows = integers(size, 0)
    M = gram(rows, -TINY)
    choose = random.Random(1)
    for _ in range(12):
        bits, shift = choose.choice((-70, -2, 0, 2, 120, 2000)), choose.choice((0, 1, -3, 60, 2000))
        scale = 1 << max(0, bits // 2 + shift)
        start = choose.choice((rows, integers(size, 1)))
        tried = [[v * scale + choose.choice((0, 0, 0, 1)) for v in row] for row in start]
        assert not has_root(M, Root((shift,) * size, bits, tried))
    zero = [[0] * (i + 1) for i in range(size)]
    assert not has_root(M, Root((0,) * size, 0, zero))


@pytest.mark.parametrize("size", SIZES)
def test_a_root_of_another_shape_or_matrix_is_refused(size: int) -> None:
    """Missing or surplus rows, entries and shifts, another matrix and one that is not symmetric are not proved."""
    lower = drawn(size)
    M, found = symmetric(lower), written(root(np.asarray(lower + np.tril(lower, -1).T)))
    rows = [list(row) for row in found.L]  # type: ignore[union-attr]
    for L in (rows[:-1], [*rows, [0] * (size + 1)], [*rows[:-1], rows[-1][:-1]], [*rows[:-1], [*rows[-1], 1]], []):
        assert not has_root(M, replace(found, L=L))
    assert not has_root(M, replace(found, shifts=found.shifts[:-1]))
    assert not has_root(M, replace(found, shifts=(*found.shifts, 0)))
    assert not has_root(symmetric(drawn(size, seed=1)), found)
    assert not has_root(-M, found)
    askew = lower + np.tril(lower, -1).T
    askew[-1, 0] = np.nextafter(askew[-1, 0], np.inf)
    assert not has_root(matrix(askew.tolist(), size), found)
    assert not is_positive_definite(matrix(lower[:-1].tolist(), size), found)


@pytest.mark.parametrize("size", SIZES)
def test_the_longest_numbers_are_exact_or_refused(size: int) -> None:
    """L of 512 bits, denormal and huge matrices are decided exactly; what is spread too widely is refused."""
    wide = (1 << 511) - 1
    rows = [[0] * i + [wide] for i in range(size)]
    assert has_root(exact.diagonal([wide**2 + 1] * size), Root((0,) * size, 0, rows))
    assert not has_root(exact.diagonal([wide**2] * size), Root((0,) * size, 0, rows))
    zero = [[0] * (i + 1) for i in range(size)]
    for number in (5e-324, 1.7e308):
        M = exact.diagonal([number] * size)
        assert has_root(M, Root((0,) * size, 0, zero))
        assert not has_root(-M, Root((0,) * size, 0, zero))
    apart = exact.diagonal([5e-324, 1.7e308] + [1.0] * (size - 2))
    with pytest.raises(NotProvedError, match="spread"):
        has_root(apart, Root((-2000, *[2000] * (size - 1)), -2000, zero))


@pytest.mark.parametrize("name", ["spring", "rated", "region"])
def test_ledgers_are_proved_by_roots(name: str) -> None:
    """A known ledger whose factors are replaced by roots is accepted; by one of another matrix or for V it is not."""
    content = known_ledgers.load(name)
    matrices = assemble(read_ledger(content))
    M, P = (floats(m) for m in (matrices.M, matrices.Pt))
    kept = [i for i in range(len(M)) if i not in content["dropped"]]
    p = content["p"][0] * 2.0 ** content["p"][1]
    roots = {"M": root(M[np.ix_(kept, kept)]), "P": root(P - p * np.eye(len(P)))}
    proved = content | {"proof": content["proof"] | roots}
    assert isinstance(check(data(proved)), Accepted)
    assert verdict(data(proved)) in ("accepted", "unsupported")
    swapped = content | {"proof": content["proof"] | {"M": roots["P"]}}
    assert isinstance(check(data(swapped)), Rejected)
    if content["proof"]["V"] is not None:
        assert isinstance(check(data(content | {"proof": proved["proof"] | {"V": roots["P"]}})), Malformed)


@pytest.mark.parametrize(
    "change",
    [
        {"shifts": [0.5]}, {"shifts": [2001]}, {"shifts": None}, {"bits": True}, {"bits": [1]}, {"L": None}, {"L": "M"},
        {"L": [[1, 2]]}, {"L": [[1 << 513]]}, {"L": [[1.0]]}, {"more": 0},
    ],
)  # fmt: skip
def test_a_root_that_is_not_as_specified_is_malformed(change: dict[str, Any]) -> None:
    """Floats, long integers, missing arrays and unknown fields are malformed, with the place."""
    content = known_ledgers.load("spring")
    entry = {"shifts": [0], "bits": 0, "L": [[0]]} | change
    answer = check(data(content | {"proof": content["proof"] | {"P": entry}}))
    assert isinstance(answer, Malformed)


def test_both_kinds_of_matrices_decide_alike(monkeypatch: pytest.MonkeyPatch) -> None:
    """With NumPy and without, the same roots are accepted, to the last unit of an entry."""
    lower = drawn(40)
    M, found = symmetric(lower), written(root(np.asarray(lower + np.tril(lower, -1).T)))
    rows = [list(row) for row in found.L]  # type: ignore[union-attr]
    answers = []
    for has in (True, False):
        monkeypatch.setattr(exact, "_has_numpy", lambda has=has: has)
        low, high = 0, 1 << 30  # the most by which one entry may be wrong
        M = symmetric(lower)
        while high - low > 1:
            middle = (low + high) // 2
            tried = [*rows[:-1], [rows[-1][0] + middle, *rows[-1][1:]]]
            low, high = (middle, high) if has_root(M, replace(found, L=tried)) else (low, middle)
        answers.append(low)
    assert answers[0] == answers[1] > 0
