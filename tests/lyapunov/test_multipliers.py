"""The Lyapunov function in numbers: the matrix of its decrease, made group by group."""

import numpy as np
import pytest

from persid.lyapunov.inequality import assemble
from persid.lyapunov.multipliers import lyapunov_function
from persid.lyapunov.pairs import combine
from persid.lyapunov.sectors import Curve
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import Family, Target
from random_problems import random_families, random_model


@pytest.mark.parametrize("kappa", [0.0, 0.3])
@pytest.mark.parametrize("seed", range(12))
def test_the_decrease_is_the_matrix_that_was_solved_for(seed: int, kappa: float) -> None:
    """In the units of the inequality -Q - kappa W is -sum y_k F_k, with all unknowns in use."""
    setting = Setting.of(random_model(seed), None)
    if kappa and len(setting.system.states) < setting.system.n:
        pytest.skip("a rate keeps every state")
    alike = dict[Curve, Family]()
    pairs = zip(setting.system.groups, random_families(setting.system, seed), strict=True)
    families = tuple(alike.setdefault(group.curve, family) for group, family in pairs)
    upper = {
        curve: np.linspace(0.5, 1.0, len(family.forms)) for curve, family in alike.items()
    }  # any constants do here
    target = Target(kappa, None, None, upper if kappa else {})
    assembly = assemble(setting.system, families, full_P=seed % 3 == 2, target=target)
    y = np.random.default_rng(seed).uniform(0.5, 2.0, len(assembly.problem.cost))
    decrease = lyapunov_function(assembly.unknowns, y, setting.system).decrease
    weights = assembly.unknowns.units.entries
    scaled = decrease * np.outer(weights, weights)
    np.testing.assert_allclose(scaled, -combine(assembly.problem, y), atol=1e-6 * np.abs(scaled).max())
    np.testing.assert_allclose(scaled, scaled.T, atol=1e-12 * np.abs(scaled).max())
