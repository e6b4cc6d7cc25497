"""The barrier method, and unknowns of a matrix whose rows have to vanish."""

from fractions import Fraction

import numpy as np
import pytest

from persid.lyapunov.barrier import Block, Region, minimise
from persid.lyapunov.frame import Unknown
from persid.lyapunov.zero_rows import reduced

ONE = Fraction(1)


@pytest.mark.parametrize("seed", range(5))
def test_the_largest_trace_is_found(seed: int) -> None:
    """Minimise sum y with C + diag(y) > 0: for C = -v v' the optimum is (sum |v|)^2 and known in closed form."""
    v = np.random.default_rng(seed).normal(size=4)
    region = Region([Block(-np.outer(v, v), np.eye(4)[:, :, None] * np.eye(4)[:, None])], np.eye(4), 1e3)
    start = np.full(4, 2 * v @ v)
    found = minimise(region, np.ones(4), start)
    assert found.objective == pytest.approx(np.abs(v).sum() ** 2, rel=1e-5)
    assert found.objective - found.gap <= np.abs(v).sum() ** 2 * (1 + 1e-9)


def test_a_diagonal_that_nothing_raises_makes_its_row_zero() -> None:
    """Entry 1 has no positive diagonal: the unknown that lowers it goes, and its other entries are equations."""
    raises = Unknown(("P", 0, 0), (({0: ONE}, {0: ONE, 1: Fraction(1, 3)}),), (({0: ONE}, {0: ONE}),), multiplier=False)
    lowers = Unknown(("mu", 0, 0), (({1: ONE}, {1: -ONE}),))
    fact = Unknown(("value", 0, 0, 1), (({0: ONE}, {1: -ONE}),))
    found = reduced([raises, lowers, fact], entries=2, states=1)
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
    found = reduced([P, *facts], entries=2, states=1)
    assert found is not None
    assert found.unknowns == (P,)
