"""Verdicts whose inequalities are solved on another device."""

import pytest

import persid as ps
from persid.verdicts.verdict import Certified

MODEL = ps.PersidskiiModel([[-1.0, 0.5], [0.2, -1.5]], [("tanh(x)", None, [[-0.3, 0.4], [0.1, -0.2]])], [[1.0], [0.0]])


def test_a_verdict_does_not_depend_on_the_device() -> None:
    """The same rate and gain are certified where PyTorch solves the inequalities ("cpu:0" is its name of the host)."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    here, there = ps.certify(MODEL), ps.certify(MODEL, device="cuda" if torch.cuda.is_available() else "cpu:0")
    assert isinstance(here, Certified)
    assert isinstance(there, Certified)
    assert there.certificate.rate == pytest.approx(here.certificate.rate, rel=0.05)
    assert there.certificate.gain == pytest.approx(here.certificate.gain, rel=0.02)


def test_without_pytorch_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    """A device other than the host needs PyTorch, and the error says what to install."""
    monkeypatch.setitem(__import__("sys").modules, "torch", None)
    with pytest.raises(ImportError, match=r"persid\[gpu\]"):
        ps.certify(MODEL, device="cuda")
