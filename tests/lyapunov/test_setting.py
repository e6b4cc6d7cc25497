"""Settings: pools about a point, on a domain, and what leaves them when it is not proved."""

import numpy as np
import pytest

import persid as ps
from persid.lyapunov.shifted_model import Setting
from questions import PENDULUM


def test_reference_is_not_shifted() -> None:
    """At x_ref, at rest, functions stand as they are; about another point they are shifted."""
    model = ps.PersidskiiModel([[-1.0]], [("x**3", None, [[-1.0]])], [[1.0]])
    assert Setting.of(model, ps.find_operating_point(model)[0]).point is None
    moved = Setting.of(model, ps.find_operating_point(model, [1.0])[0])
    assert moved.point is not None
    assert moved.found[0].curve.shift is not None
    assert moved.jacobian[0, 0] == pytest.approx(-1 - 3 * moved.point.x[0] ** 2)


def test_reach() -> None:
    """The reach of a region is the distance from the point to the nearer face of each side."""
    model = ps.PersidskiiModel(**PENDULUM)
    setting = Setting.of(model, ps.find_operating_point(model)[0], np.array([[-1.0, 2.0], [-3.0, 2.5]]))
    assert setting.reach == pytest.approx([1.0, 2.5])
    assert Setting.of(model, None).reach is None


def test_no_effect_no_forms() -> None:
    """A group whose functions have zero columns has no forms and no constants."""
    setting = Setting.of(ps.PersidskiiModel([[-1.0]], [("tanh(x)", None, [[0.0]])], [[1.0]]), None)
    (curve,) = {group.curve for group in setting.found}
    assert len(setting.pools[curve]) == len(setting.upper[curve]) == len(setting.below[curve]) == 0


def test_each_group_begins_with_its_own() -> None:
    """What one group uses is none of the others', though their functions are the same."""
    setting = Setting.of(ps.PersidskiiModel(-np.eye(2), [("tanh(x)", None, -np.eye(2))], np.ones((2, 1))), None)
    curve = setting.found[1].curve
    assert setting.found[0].curve == curve
    first, second = (tuple(form) for form in setting.pools[curve][:2].tolist())
    families = setting.families({(1, curve, frozenset([first])), (1, curve, frozenset([first, second]))})
    assert [family.densities for family in families] == [(), (0,)]
    assert [family.products for family in families] == [(), ((0, 1),)]
