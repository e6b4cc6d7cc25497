"""The second pass: forms that are not needed leave, for a stated share of what is asked."""

from collections.abc import Callable

import numpy as np
import pytest

import persid as ps
from persid.lyapunov import second_pass
from persid.lyapunov.inequality import Catalogue
from persid.lyapunov.multipliers import choose
from persid.lyapunov.rates import Question
from persid.lyapunov.search import Outcome
from persid.lyapunov.second_pass import RATE, RATIO, in_use, loosened, with_fewer_forms
from persid.lyapunov.sectors import Form
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import Target

SATURATING = ps.PersidskiiModel(
    [[-1.0, 0.3], [-0.2, -1.2]],
    [("x**3", None, [[-0.3, 0.02], [0.01, -0.2]]), ("tanh(x)", None, [[0.2, 0.3], [-0.3, 0.1]])],
    [[0.5], [0.3]],
)


def plenty() -> float:
    """Return the time left: a minute, always."""
    return 60.0


def found(model: ps.PersidskiiModel, kappa: float, ratio: float | None = None) -> tuple[Question, Outcome]:
    """Return the global question about a model, and what is found for a rate and a ratio."""
    setting = Setting.of(model, None)
    question = Question(setting.system, setting.pools, setting.upper, setting.below, True)
    outcome = question.ask(kappa, ratio, None, plenty)
    assert outcome is not None
    return question, outcome


def forms(outcome: Outcome) -> int:
    """Return how many forms an outcome may use."""
    families, groups = outcome.assembly.unknowns.families, outcome.assembly.unknowns.system.groups
    return len({(g.curve, k) for g, family in zip(groups, families, strict=True) for k in family.used})


def test_fewer_forms_prove_almost_the_same() -> None:
    """Near the smallest gain a quarter of the forms can go for less than half a percent of the gain."""
    _, outcome = found(SATURATING, 0.9, 0.6)
    target = loosened(outcome.assembly.unknowns.target)
    fewer = with_fewer_forms(outcome, target, plenty)
    assert 0 < forms(fewer) <= 0.75 * forms(outcome)
    proved = choose(fewer.assembly, fewer.solution.y)
    assert proved.is_sound
    assert proved.gamma / proved.depth <= 1.01 * RATIO * 0.6
    assert np.sqrt(RATIO) < 1.005


def test_what_is_needed_stays() -> None:
    """Without the form that the only function is, nothing is proved of x' = x - x^3: all forms of V stay."""
    _, outcome = found(ps.PersidskiiModel([[-1.0]], [("x**3", None, [[-1.0]])], [[1.0]]), 1.5)
    fewer = with_fewer_forms(outcome, outcome.assembly.unknowns.target, plenty)
    proved = choose(fewer.assembly, fewer.solution.y)
    assert proved.is_sound
    assert proved.kappa == 1.5


def test_without_time_nothing_is_tried() -> None:
    """An outcome stays what it is where there is no time."""
    _, outcome = found(SATURATING, 0.5)
    assert with_fewer_forms(outcome, outcome.assembly.unknowns.target, lambda: 0.0) is outcome


@pytest.mark.parametrize(
    ("target", "slowest", "kappa", "ratio"),
    [
        (Target(2.0), 0.0, 2.0 * RATE, None),
        (Target(2.0), 2.0, 2.0, None),
        (Target(2.0), 3.0, 2.0, None),
        (Target(2.0, 1.0), 0.0, 2.0, RATIO),
        (Target(), 0.0, 0.0, None),
    ],
)
def test_what_is_given_up(target: Target, slowest: float, kappa: float, ratio: float | None) -> None:
    """A little of the gain, else of the rate, but no rate that is asked for."""
    less = loosened(target, slowest)
    assert (less.kappa, less.ratio) == (kappa, ratio)


def test_known_forms_stay() -> None:
    """Forms that another proof uses anyway stay; of the others at most as many are left as without them."""
    _, outcome = found(SATURATING, 0.9, 0.6)
    target = loosened(outcome.assembly.unknowns.target)
    known = in_use(with_fewer_forms(outcome, target, plenty))
    assert sorted(in_use(with_fewer_forms(outcome, target, plenty, known)), key=known.index) == known
    half = known[1::2]
    assert set(half) <= set(in_use(with_fewer_forms(outcome, target, plenty, half)))


def test_what_failed_is_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """No choice of forms is tried that another one holds which was not enough."""
    failed, solved, tried = list[set[Form]](), second_pass._solved, list[bool]()

    def watched(whole: Catalogue, outcome: Outcome, forms: set[Form], left: Callable[[], float]) -> Outcome | None:
        tried.append(any(map(forms.issubset, failed)))
        answer = solved(whole, outcome, forms, left)
        failed.extend([forms] if answer is None else [])
        return answer

    monkeypatch.setattr(second_pass, "_solved", watched)
    for ratio in (0.6, 0.62, 0.65):
        _, outcome = found(SATURATING, 0.9, ratio)
        failed.clear()
        with_fewer_forms(outcome, loosened(outcome.assembly.unknowns.target), plenty)
    assert len(tried) > 12
    assert not any(tried)
