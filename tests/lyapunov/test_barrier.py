"""The barrier method, and unknowns of a matrix whose rows have to vanish."""

from fractions import Fraction

import numpy as np
import pytest

from persid.lyapunov import barrier
from persid.lyapunov.barrier import Block, Paired, Region, definite, faces, minimise
from persid.lyapunov.frame import Unknown, paired
from persid.lyapunov.pairs import Problem
from persid.lyapunov.zero_rows import reduced

ONE = Fraction(1)


@pytest.mark.parametrize("seed", range(5))
def test_the_largest_trace_is_found(seed: int) -> None:
    """Minimise sum y with C + diag(y) > 0: for C = -v v' the optimum is (sum |v|)^2 and known in closed form."""
    v = np.random.default_rng(seed).normal(size=4)
    region = Region([Block(-np.outer(v, v)[None], np.eye(4)[:, :, None] * np.eye(4)[:, None])], np.eye(4), 1e3)
    start = np.full(4, 2 * v @ v)
    found = minimise(region, np.ones(4), start)
    assert found.objective == pytest.approx(np.abs(v).sum() ** 2, rel=1e-5)
    assert found.objective - found.gap <= np.abs(v).sum() ** 2 * (1 + 1e-9)


def _some_pairs(random: np.random.Generator, order: int, count: int) -> Problem:
    """Unknowns that are sums of one or two pairs of sparse rows."""

    def row() -> dict[int, Fraction]:
        places = random.choice(order, 3, replace=False)
        return {int(i): Fraction(int(v), 8) for i, v in zip(places, random.integers(1, 9, 3), strict=True)}

    def read(row: dict[int, Fraction]) -> np.ndarray:
        return np.array([float(row.get(i, 0)) for i in range(order)])

    pairs = [(row(), row(), float(random.normal()), k) for k in range(count) for _ in range(1 + k % 2)]
    return paired(pairs, count, order, read)


@pytest.mark.parametrize("seed", range(3))
def test_large_matrices_are_the_small_ones(monkeypatch: pytest.MonkeyPatch, seed: int) -> None:
    """Matrices, steps, gradients and Hessians are the same whether every F is formed or not, and for many faces."""
    random = np.random.default_rng(seed)
    pairs, N, w = _some_pairs(random, 6, 9), random.normal(size=(9, 7)), 0.1 * random.normal(size=7)
    constants = [20 * np.eye(6) + np.outer(v, v) for v in random.normal(size=(3, 6))]
    small = faces(pairs, N, constants)
    assert all(isinstance(each, Block) for each in small)
    monkeypatch.setattr(barrier, "FORMED", 0)
    large = [definite(pairs, N, constant) for constant in constants]
    assert all(isinstance(each, Paired) for each in large)
    expected = [Region([each], np.zeros((0, 7)), 1e3) for each in small]
    for one, other in zip(expected, (Region([each], np.zeros((0, 7)), 1e3) for each in large), strict=True):
        _agree(one, other, w)
    _agree(Region(small, np.zeros((0, 7)), 1e3), Region(faces(pairs, N, constants), np.zeros((0, 7)), 1e3), w)


def _agree(one: Region, other: Region, w: np.ndarray) -> None:
    assert other.order == one.order
    assert other.value(w) == pytest.approx(one.value(w), rel=1e-12)
    assert other.reach(w, w + 1) == pytest.approx(one.reach(w, w + 1), rel=1e-9)
    for found, known in zip(other.derivatives(w), one.derivatives(w), strict=True):
        assert found == pytest.approx(known, rel=1e-9, abs=1e-10)


def test_a_diagonal_that_nothing_raises_makes_its_row_zero() -> None:
    """Entry 1 has no positive diagonal: the unknown that lowers it goes, and its other entries are equations."""
    raises = Unknown(("P", 0, 0), (({0: ONE}, {0: ONE, 1: Fraction(1, 3)}),), (({0: ONE}, {0: ONE}),), multiplier=False)
    lowers = Unknown(("mu", 0, 0), (({1: ONE}, {1: -ONE}),))
    fact = Unknown(("value", 0, 0, 1), (({0: ONE}, {1: -ONE}),))
    found = reduced([raises, lowers, fact], able=[1])
    assert found is not None
    assert found.zero == (1,)
    assert [each.label for each in found.unknowns] == [raises.label, fact.label]
    P, tau = found.exact([ONE])
    assert tau == P / 3
    assert all(value.denominator & (value.denominator - 1) == 0 for value in (P, tau))


def test_a_multiplier_that_must_be_zero_goes() -> None:
    """Two positive numbers do not cancel: with their equation both vanish."""
    facts = [Unknown(("value", 0, 0, k), (({0: ONE}, {1: ONE}),)) for k in (1, 2)]
    P = Unknown(("P", 0, 0), (({0: ONE}, {0: ONE}),), (({0: ONE}, {0: ONE}),), multiplier=False)
    found = reduced([P, *facts], able=[1])
    assert found is not None
    assert found.unknowns == (P,)


def test_no_step_is_made_without_time() -> None:
    """With no time left the first step is the last one, whether or not a centre is reached, and ends inside."""
    region = Region([Block(np.zeros((1, 2, 2)), np.eye(2)[:, :, None] * np.eye(2)[:, None])], np.eye(2), 1e3)
    start, asked = np.array([1e-3, 500.0]), list[float]()

    def left() -> float:
        asked.append(0.0)
        return 0.0

    found = minimise(region, np.ones(2), start, left=left)
    assert len(asked) == 1
    assert np.isfinite(region.value(found.w))
    assert not np.array_equal(found.w, start)
