"""What groups do to themselves: the facets that a pool needs for it, and how deep it is in the cone of forms."""

import runpy
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from numpy import ndarray

from persid.lyapunov.interior_point import Status
from persid.lyapunov.own_functions import NEAR, depths_in, lacking, own_function, own_functions
from persid.lyapunov.search import FEW_FORMS, search
from persid.lyapunov.sectors import Curve, groups, pool
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import MANY, Family
from persid.models.model import PersidskiiModel
from places import SHARED

USUAL = Curve(("x**3", "sinh(x)", "tanh(x)"), (Fraction(1),) * 3)
CANCELLING = np.array([0.4166, -0.0252, 0.0156, 1.0])  # of x, x**3, sinh x, tanh x: positive, but hardly so at 6.1


def network(n: int, own: ndarray, strength: float) -> PersidskiiModel:
    """Return a network whose first state has a function of its own, with couplings of mixed signs."""
    coefficients = strength / np.sqrt(n) * np.random.default_rng(1).normal(size=(4, n, n))
    coefficients *= np.array([1.0, 0.3, 0.5, 1.5])[:, None, None]
    for block, first in zip(coefficients, own, strict=True):
        block[np.diag_indices(n)] = [-first, *[-2.0] * (n - 1)]
    A0, *A = coefficients
    terms = [(f, None, block) for f, block in zip(USUAL.functions, A, strict=True)]
    return PersidskiiModel(A0, terms, np.ones((n, 1)))


def test_terms_that_almost_cancel_are_certified() -> None:
    """x' = -f(x) with f barely positive where its terms cancel is decided, by one facet more."""
    setting = Setting.of(network(1, CANCELLING, 0.0), None)
    forms = setting.pools[USUAL]
    (joined,) = (
        set(map(tuple, forms.tolist()))
        - set(pool(USUAL))
        - set(map(tuple, forms[:20].tolist()))
        - set(map(tuple, np.eye(4).tolist()))
    )
    assert USUAL.proves(joined)
    assert search(setting.system, setting.pools).status is Status.FEASIBLE
    fewer = {USUAL: np.array([form for form in forms.tolist() if tuple(form) != joined])}
    assert search(setting.system, fewer).status is Status.INFEASIBLE


def test_what_is_deep_in_the_cone_needs_no_facet() -> None:
    """Sums of forms of a pool, and functions that are no sector forms, add nothing to it; nor do small curves."""
    forms, rng = np.array(pool(USUAL)), np.random.default_rng(0)
    assert lacking(USUAL, forms, rng.uniform(size=(9, len(forms))) @ forms) == []
    assert lacking(USUAL, forms, np.array([[-1.0, 0, 0, 0], [1, -1, 0, 0], [0, 0, 0, 0]])) == []
    assert lacking(USUAL, forms, np.zeros((0, 4))) == []
    single = Curve(("tanh(x)",), (Fraction(1),))
    assert lacking(single, np.array(pool(single)), np.array([[1.0, -0.999]])) == []


@pytest.mark.parametrize("seed", range(4))
def test_facets_are_few_and_true(seed: int) -> None:
    """Whatever the own functions are, fewer facets join than a pool has, each new, and true on a fine grid."""
    forms, rng = np.array(pool(USUAL)), np.random.default_rng(seed)
    y = np.concatenate([-np.geomspace(1e-3, 30, 4000), np.geomspace(1e-3, 30, 4000)])
    phi = USUAL.values(y) * np.sign(y)[:, None]
    own = rng.normal(size=(4000, 4)) * [1.0, 0.02, 0.02, 1.0]
    own = own[(phi @ own.T > 0).all(axis=0)]
    joined = np.array(lacking(USUAL, forms, own)).reshape(-1, 4)
    assert len(own)
    assert len(joined) <= len(forms)
    assert not set(map(tuple, joined.tolist())) & set(pool(USUAL))
    assert (phi @ joined.T >= 0).all()


def test_own_function_is_what_a_group_does_to_itself() -> None:
    """Of x' = A0 x + A tanh(R x) the own function of a row r has r'A0 r / r'r and r times its column, less the sign."""
    A0, A, R = np.array([[-3.0, 1], [0, -2]]), np.array([[-1.0], [0.5]]), np.array([[1.0, 1]])
    model = PersidskiiModel(A0, [("tanh(x)", R, A)], np.ones((2, 1)))
    found = groups(model.channels)
    (own,) = own_functions(model, found).values()
    np.testing.assert_allclose(own, [[2.0, 0.5]])
    steps = PersidskiiModel(A0, [("tanh(x)", R, A)], np.ones((2, 1)), time="discrete", dt=1.0)
    assert all(not len(own) for own in own_functions(steps, found).values())


def test_depth_is_small_where_terms_cancel_and_zero_without_a_sector_form() -> None:
    """The depth of an own function is that of the curve in units of its length, and at least a little for sectors."""
    depths = []
    for own in (CANCELLING, np.ones(4), np.array([1.0, -1.0, 0.0, 0.0]), np.array([0.0, 0.0, 0.0, 1.0])):
        setting = Setting.of(network(2, own, 0.1), None)
        system = setting.system
        families = [Family.full(setting.pools[group.curve]) for group in system.groups]
        depths.append(depths_in(system, families)[0])
        assert not depths_in(replace(system, discrete=True), families).any()
    assert NEAR < depths[0] < 0.05 * depths[1]
    assert depths[2] == 0
    assert depths[3] == NEAR  # tanh alone: all of the curve far out is sinh


def test_one_hard_group_among_many_takes_few_steps_and_unknowns() -> None:
    """Of 60 groups one has terms that almost cancel: it alone is asked for less, and at the end it alone grows."""
    setting = Setting.of(network(60, 30 * CANCELLING, 0.5), None)
    found = search(setting.system, setting.pools)
    assert len(setting.system.groups) > MANY
    assert found.status is Status.FEASIBLE
    assert found.steps <= 50
    first, *others = (len(family.products) for family in found.assembly.unknowns.families)
    assert first > np.mean(others) > FEW_FORMS
    assert len(found.assembly.problem.cost) <= 15 * 60


@pytest.mark.long
@pytest.mark.parametrize("n", [60, 120])
def test_steps_do_not_grow_with_the_states(n: int) -> None:
    """Networks that columns dominate, coefficients of mixed signs, take some twenty steps and ten unknowns a state."""
    if not (SHARED / "families.py").is_file():
        pytest.skip("families.py of the shared data is not on this machine")
    ((_, _, model),) = runpy.run_path(str(SHARED / "families.py"))["draw"]("column_dominance", n, 1, 1)
    setting = Setting.of(PersidskiiModel.from_dict(model), None)
    found = search(setting.system, setting.pools)
    assert found.status is Status.FEASIBLE
    assert found.steps <= 25
    assert len(found.assembly.problem.cost) <= 14 * n


def test_own_functions_read_what_their_row_reads() -> None:
    """Of a large model an own function costs what its row reads: other coefficients are not looked at."""
    model = network(3, CANCELLING, 0.5)
    (group, *_) = groups(model.channels)
    reads = np.flatnonzero(group.row)
    states, columns = (np.full(M.shape, np.nan) for M in (model.channels.A0, model.channels.columns))
    states[np.ix_(reads, reads)] = model.channels.A0[np.ix_(reads, reads)]
    columns[reads] = model.channels.columns[reads]
    own = own_function(group, states, columns[:, list(group.channels)])
    assert np.allclose(own, CANCELLING)
