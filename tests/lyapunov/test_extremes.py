"""The smallest gain and the largest margin: nothing better is found by asking, and the way to them is short."""

from dataclasses import replace

import numpy as np
import pytest

import persid as ps
from persid.lyapunov.margins import Residuals, largest_margin
from persid.lyapunov.rates import Question, attained, best_rate, kappa, smallest_gain
from persid.lyapunov.second_pass import in_use
from persid.lyapunov.shifted_model import Setting

FEW = 45  # steps of the interior-point method from an outcome to the smallest gain; a single question takes about ten
NARROW = 240  # unknowns at its end, of five states: 340 to 450 where the way went on from near the boundary


def plenty() -> float:
    """Return the time left: a minute, always."""
    return 60.0


def drawn(seed: int, n: int = 2) -> tuple[ps.PersidskiiModel, Question]:
    """Return a random model of n states with x**3 and tanh, and the global question about it, a full P."""
    rng, size = np.random.default_rng(seed), np.sqrt(2 / n)
    terms = [(f, None, 0.3 * size * rng.normal(size=(n, n)) - np.eye(n)) for f in ("x**3", "tanh(x)")]
    model = ps.PersidskiiModel(0.5 * size * rng.normal(size=(n, n)) - np.eye(n), terms, rng.normal(size=(n, 1)))
    setting = Setting.of(model, None)
    return model, Question(setting.system, setting.pools, setting.upper, setting.below, True)


@pytest.mark.parametrize("seed", range(4))
def test_no_smaller_gain_is_found(seed: int) -> None:
    """The outcome attains its ratio gamma / p, one 3 % smaller is not found, and the way takes few steps."""
    _, question = drawn(seed)
    best = best_rate(question, 2.0, plenty)
    assert best is not None
    rate = 0.5 * kappa(best)
    found = smallest_gain(question, rate, best, plenty)
    assert found is not None
    ratio = found.assembly.unknowns.target.ratio
    assert ratio is not None
    assert kappa(found) == rate
    assert attained(question, found)[0] <= 1.03 * ratio
    assert question.ask(rate, 0.97 * ratio, found.families, plenty) is None
    assert 0 < found.steps <= FEW


@pytest.mark.parametrize("seed", range(3))
def test_the_way_goes_on_from_where_it_was_central(seed: int) -> None:
    """Where more unknowns join near the smallest gain, few are needed, and few steps."""
    _, question = drawn(seed, 5)
    start = question.ask(0.3, None, None, plenty)
    assert start is not None
    found = smallest_gain(question, 0.3, start, plenty)
    assert found is not None
    assert 0 < found.steps <= FEW
    assert len(found.solution.y) <= NARROW


@pytest.mark.parametrize("seed", range(4))
def test_few_others_join(seed: int) -> None:
    """Where forms are named few others join; the gain is no smaller than with all, and no larger than at the start."""
    _, question = drawn(seed)
    start = question.ask(0.5, None, None, plenty)
    assert start is not None
    few, all_of = (smallest_gain(question, 0.5, start, plenty, forms) for forms in (in_use(start), None))
    assert few is not None
    assert all_of is not None
    assert len(set(in_use(few)) - set(in_use(start))) < len(set(in_use(all_of)) - set(in_use(start)))
    ratio = attained(question, few)[0]
    assert attained(question, all_of)[0] * 0.99 <= ratio < attained(question, start)[0]


def test_no_time_for_a_smaller_gain() -> None:
    """Without time for the way any gain at that rate is returned."""
    _, question = drawn(0)
    start = question.ask(0.1, None, None, plenty)
    assert start is not None
    found = smallest_gain(question, 0.1, start, lambda: 0.0)
    assert found is not None
    assert kappa(found) == 0.1


@pytest.mark.parametrize("seed", range(4))
def test_no_larger_margin_is_found(seed: int) -> None:
    """Plants within 99 % of the largest margin are certified together, those within 103 % are not."""
    model, question = drawn(seed)
    residuals = Residuals.of(model, 1)
    delta = largest_margin(question, residuals, 0.0, plenty)
    assert delta > 0
    answers = [
        replace(question, deviations=(residuals.within(share * delta),)).ask(0.0, None, None, plenty)
        for share in (0.99, 1.03)
    ]
    assert answers[0] is not None
    assert answers[1] is None
