"""The search that grows families of forms by the prices of a dual matrix."""

from dataclasses import replace

import numpy as np
import pytest
from numpy import ndarray

from persid.interior_point import Status
from persid.model import PersidskiiModel
from persid.search import JOINING, Outcome, catalogue, join, search
from persid.setting import Setting
from persid.system import Target
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
    about = found.assembly
    return catalogue(about.system, about.families, about.problem.symmetric > 0, about.target).prices(X)


def test_nothing_is_left_to_join_when_it_is_infeasible() -> None:
    """An infeasible answer prices every product and density of the pools, and none of them may help."""
    found = _searched(BY_NAME["bistable tanh"].build())
    assert found.status is Status.INFEASIBLE
    for family, prices in zip(found.assembly.families, _prices(found, found.solution.X), strict=True):
        grown = join(family, prices, found.solution.upper)
        assert set(grown.products) <= set(family.products)
        assert set(grown.densities) <= set(family.densities)


def test_joining_takes_only_negative_prices() -> None:
    """What joins a family violates the dual matrix that prices it, the most violated first."""
    found = _searched(BY_NAME["bistable tanh"].build())
    bare = replace(found.assembly.families[0], densities=(0,), products=())
    prices = _prices(found, np.eye(len(found.solution.X)))[0]
    price = prices[0].copy()
    grown = join(bare, prices, found.solution.upper)
    assert all(price[pair] < 0 for pair in grown.products)
    assert len(grown.products) == min(JOINING, int((np.triu(price, 1) < 0).sum()))


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
    with pytest.raises(ValueError, match="keep every state"):
        search(setting.system, setting.pools, target=Target(kappa=0.1, upper=setting.upper))
