"""Settings: pools about a point, on a domain, and what leaves them when it is not proved."""

from importlib import import_module

import numpy as np
import pytest

import persid as ps
from persid.lyapunov.multipliers import choose
from persid.lyapunov.search import search
from persid.lyapunov.sectors import Curve
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


def test_false_forms_leave(monkeypatch: pytest.MonkeyPatch) -> None:
    """A form that is not proved leaves its pool, with its constants, and is named."""
    setting = Setting.of(ps.PersidskiiModel([[-1.0]], [("tanh(x)", None, [[-1.0]])], [[1.0]]), None)
    found = search(setting.system, setting.pools)
    lyapunov = choose(found.assembly, found.solution.y)
    assert setting.without_unproved(lyapunov)[1] == ()
    curve = setting.found[0].curve
    before = len(setting.pools[curve])
    monkeypatch.setattr(Curve, "proves", lambda self, form: False)
    left, named = setting.without_unproved(lyapunov)
    assert named
    assert all("x" in line for line in named)
    assert len(left.pools[curve]) == before - len(named) == len(left.upper[curve])
    assert len(setting.pools[curve]) == before
    assert left.without_unproved(lyapunov) == (left, ())  # it has left already


def test_undecided_for_want_of_a_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no form can be proved the reason is FORM, and the forms are named."""
    monkeypatch.setattr(Curve, "proves", lambda self, form: False)
    monkeypatch.setattr(import_module("persid.verdicts.questions"), "certify_network", lambda *question: None)
    verdict = ps.certify(ps.PersidskiiModel([[2.0]], [("sinh(x)", None, [[-3.0]])], [[1.0]]))
    assert isinstance(verdict, ps.Undecided)
    assert verdict.reason.name == "FORM"
    assert "sinh(x)" in verdict.detail
