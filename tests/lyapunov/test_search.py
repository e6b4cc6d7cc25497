"""The search that grows families of forms by the prices of a dual matrix."""

from dataclasses import replace

import numpy as np
import pytest
from numpy import ndarray

from persid.lyapunov.interior_point import Status
from persid.lyapunov.search import (
    FEW,
    FEW_FORMS,
    INSIDE,
    JOINING,
    Outcome,
    PoolFence,
    catalogue,
    join,
    search,
)
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import MANY, Target
from persid.models.model import PersidskiiModel
from problems import BY_NAME


def _searched(model: PersidskiiModel, **options: object) -> Outcome:
    setting = Setting.of(model, None)
    return search(setting.system, setting.pools, **options)


def test_finds_a_margin_where_one_form_pair_is_needed() -> None:
    """sinh against tanh has no certificate with the paper's multipliers, and one with sector forms."""
    found = _searched(BY_NAME["sinh against tanh"].build())
    assert found.status is Status.FEASIBLE
    assert found.solution.lower > 0


def test_full_P_where_a_diagonal_one_does_not_do() -> None:
    """A Hurwitz A0 with a positive entry on its diagonal has no diagonal P and has a full one."""
    model = BY_NAME["nonnormal"].build()
    assert _searched(model).status is Status.INFEASIBLE
    assert _searched(model, full_P=True).status is Status.FEASIBLE


def _prices(found: Outcome, X: ndarray) -> list[tuple[ndarray, ndarray]]:
    about = found.assembly.unknowns
    return catalogue(about.system, about.families, about.symmetric > 0, about.target).prices(X)


def test_nothing_is_left_to_join_when_it_is_infeasible() -> None:
    """An infeasible answer prices every product and density of the pools, and none of them may help."""
    found = _searched(BY_NAME["bistable tanh"].build())
    assert found.status is Status.INFEASIBLE
    for family, prices in zip(found.assembly.unknowns.families, _prices(found, found.solution.X), strict=True):
        grown = join(family, prices, found.solution.upper)
        assert set(grown.products) <= set(family.products)
        assert set(grown.densities) <= set(family.densities)


def _coupled(strength: float, n: int = 6) -> PersidskiiModel:
    """A network with couplings of mixed sign: certified while they are weak."""
    rng = np.random.default_rng(4)
    own, coupling = -np.eye(n), rng.normal(size=(3, n, n)) * (1 - np.eye(n)) * strength / n
    terms = [("tanh(x)", None, -0.4 * own + coupling[1]), ("sinh(x)", None, own + coupling[2])]
    return PersidskiiModel(0.2 * own + coupling[0], terms, rng.normal(size=(n, 1)))


@pytest.mark.parametrize("full_P", [False, True])
@pytest.mark.parametrize("strength", [0.5, 1.0, 1.5, 3.0])
def test_a_fence_does_not_change_the_answer(strength: float, full_P: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a fence from the first step or after free rounds, the search decides the same, and its bounds are bounds."""
    free = _searched(_coupled(strength), full_P=full_P)
    monkeypatch.setattr("persid.lyapunov.search.FREE_STEPS", 1)
    fenced = _searched(_coupled(strength), full_P=full_P)
    assert fenced.status is free.status
    assert fenced.status in (Status.FEASIBLE, Status.INFEASIBLE)
    for found in (free, fenced):
        if found.status is Status.INFEASIBLE:
            assert all((products >= 0).all() for products, _ in _prices(found, found.solution.X))
            assert all((worth + found.solution.upper >= 0).all() for _, worth in _prices(found, found.solution.X))


@pytest.mark.long
def test_couplings_near_the_limit_are_decided() -> None:
    """Within a thousandth of the largest coupling that is certified the search still says yes or no, in few steps."""
    low, high = 0.5, 3.0
    while high / low > 1.001:
        middle = float(np.sqrt(low * high))
        found = _searched(_coupled(middle))
        assert found.status in (Status.FEASIBLE, Status.INFEASIBLE)
        assert found.steps < 150
        low, high = (middle, high) if found.status is Status.FEASIBLE else (low, middle)


def test_fence_lets_a_step_go_to_a_share_of_the_way_out() -> None:
    """A step that would price a product negatively is cut so that a tenth of that product's price is left."""
    found = _searched(BY_NAME["bistable tanh"].build())
    about = found.assembly.unknowns
    whole = catalogue(about.system, about.families, False, about.target)
    X, m = found.assembly.problem.X, 1e3
    line = np.random.default_rng(0).normal(size=len(X))
    out = X - 10 * np.outer(line, line)
    fence = PoolFence(whole)
    share = fence.share((X, m), (out, m))
    assert 0 < share < 1
    least = whole.prices(X + share / INSIDE * (out - X))
    assert min(float(products.min()) for products, _ in least) == pytest.approx(0.0, abs=1e-9)
    assert fence.share((X, m), (2 * X, m)) == 1.0
    assert fence.bound(X) == max(0.0, -min(float(worth.min()) for _, worth in whole.prices(X)))


def test_joining_takes_only_negative_prices() -> None:
    """What joins a family violates the dual matrix that prices it, the most violated first."""
    found = _searched(BY_NAME["bistable tanh"].build())
    bare = replace(found.assembly.unknowns.families[0], densities=(0,), products=())
    prices = _prices(found, np.eye(len(found.solution.X)))[0]
    price = prices[0].copy()
    grown = join(bare, prices, found.solution.upper)
    assert all(price[pair] < 0 for pair in grown.products)
    assert len(grown.products) == min(JOINING, int((np.triu(price, 1) < 0).sum()))


def test_of_many_groups_few_forms_join() -> None:
    """A search for many groups begins with three forms each, and two products of a group join at a time."""
    n = MANY + 1
    terms = [("x**3", None, -np.eye(n)), ("tanh(x)", None, 0.3 * np.eye(n, k=1) - np.eye(n))]
    found = _searched(PersidskiiModel(-0.5 * np.eye(n), terms, np.eye(n, 1)))
    assert found.status is Status.FEASIBLE
    begun = FEW_FORMS * (FEW_FORMS - 1) // 2
    assert max(len(family.products) for family in found.assembly.unknowns.families) <= begun + FEW * (found.rounds - 1)


def test_same_search_twice() -> None:
    """The search is deterministic."""
    model = BY_NAME["damped tanh"].build()
    first, second = _searched(model), _searched(model)
    np.testing.assert_array_equal(first.solution.y, second.solution.y)


def test_time_limit() -> None:
    """Without time the search stops with status TIME and the iterate that it has."""
    found = _searched(BY_NAME["bistable tanh"].build(), time_limit=0.0)
    assert found.status is Status.TIME
    assert np.isfinite(found.solution.y).all()


def test_progress_lines() -> None:
    """Each round reports its size, its iterations and how it ended."""
    lines: list[str] = []
    found = _searched(BY_NAME["damped tanh"].build(), progress=lines.append)
    assert len(lines) == found.rounds
    assert all("unknowns" in line and "iterations" in line for line in lines)


def test_linear_model_needs_no_forms() -> None:
    """A model without channels is decided by P alone."""
    assert _searched(PersidskiiModel([[-1.0]], (), [[1.0]])).status is Status.FEASIBLE
    assert _searched(PersidskiiModel([[1.0]], (), [[1.0]])).status is Status.INFEASIBLE


@pytest.mark.slow
def test_hundred_states() -> None:
    """A random network of 100 states with coefficients of mixed sign is decided within a minute."""
    rng = np.random.default_rng(0)
    n = 100
    coupling = rng.normal(size=(n, n)) / n
    model = PersidskiiModel(
        -np.eye(n) + 0.5 * coupling,
        [("tanh(x)", None, 0.3 * np.eye(n) + coupling), ("x**3", None, -np.eye(n) + 0.3 * coupling)],
        rng.normal(size=(n, 1)),
    )
    assert _searched(model, time_limit=60.0).status is Status.FEASIBLE


def test_a_rate_needs_every_state() -> None:
    """Where a state is dropped the constants of the pool would belong to other forms: no rate is asked for."""
    setting = Setting.of(PersidskiiModel(None, [("x**3", None, [[-1.0]])], [[1.0]]), None)
    assert setting.system.states == ()
    with pytest.raises(ValueError, match="keeps every state"):
        search(setting.system, setting.pools, target=Target(kappa=0.1, upper=setting.upper))
