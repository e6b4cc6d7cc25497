"""Doubts: what a Lyapunov function uses and no partition proves leaves its pool, or weakens."""

from fractions import Fraction
from importlib import import_module

import pytest

import persid as ps
from persid.certificates.curves import Curve, Use, curve_of
from persid.certificates.doubts import without_unproved
from persid.lyapunov import sectors
from persid.lyapunov.multipliers import choose
from persid.lyapunov.search import search
from persid.lyapunov.shifted_model import Setting

TANH = curve_of(sectors.Curve(("tanh(x)",), (Fraction(1),)))
SINE = curve_of(sectors.Curve(("sin(x)",), (Fraction(1),), (Fraction(-2), Fraction(2)), (Fraction(0), Fraction(0))))
ITSELF = (Fraction(0), Fraction(1))


@pytest.mark.parametrize(
    ("curve", "use", "lack"),
    [
        (TANH, Use(ITSELF), None),
        (TANH, Use((Fraction(1, 2), Fraction(-1))), "form"),
        (TANH, Use(ITSELF, Fraction(1)), None),
        (TANH, Use(ITSELF, Fraction(3, 4)), "upper"),
        (SINE, Use(ITSELF, Fraction(2), Fraction(11, 16)), None),
        (SINE, Use(ITSELF, Fraction(2), Fraction(3, 4)), "lower"),
    ],
)  # fmt: skip
def test_what_is_not_proved_is_named(curve: Curve, use: Use, lack: str | None) -> None:
    """The form itself, the upper or the lower bound of its integral: the first that is false is named."""
    assert curve.lack(use) == lack


def test_false_forms_leave(monkeypatch: pytest.MonkeyPatch) -> None:
    """A form that is not proved leaves its pool, with its constants, and is named."""
    setting = Setting.of(ps.PersidskiiModel([[-1.0]], [("tanh(x)", None, [[-1.0]])], [[1.0]]), None)
    found = search(setting.system, setting.pools)
    lyapunov = choose(found.assembly, found.solution.y)
    assert without_unproved(setting, lyapunov)[1] == ()
    curve = setting.found[0].curve
    before = len(setting.pools[curve])
    monkeypatch.setattr(Curve, "lack", lambda self, use: "form")
    left, named = without_unproved(setting, lyapunov)
    assert named
    assert all("x" in line for line in named)
    assert len(left.pools[curve]) == before - len(named) == len(left.upper[curve])
    assert len(setting.pools[curve]) == before
    assert without_unproved(left, lyapunov) == (left, ())  # it has left already


def test_undecided_for_want_of_a_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where no form can be proved the reason is FORM, and the forms are named."""
    monkeypatch.setattr(Curve, "lack", lambda self, use: "form")
    monkeypatch.setattr(import_module("persid.verdicts.questions"), "certify_network", lambda *question: None)
    verdict = ps.certify(ps.PersidskiiModel([[2.0]], [("sinh(x)", None, [[-3.0]])], [[1.0]]))
    assert isinstance(verdict, ps.Undecided)
    assert verdict.reason.name == "FORM"
    assert "sinh(x)" in verdict.detail
