"""Witnesses: each kind found where it is true, and only there; accepted again from its file."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import persid as ps
from persid.certificates.witness import _KINDS, find_witness

TRUE: dict[str, dict[str, Any]] = {
    "two-equilibria": {"A0": [[-1.0]], "terms": [("tanh(x)", None, [[2.0]])], "B": [[1.0]]},
    "unstable-equilibrium": {"A0": [[0.1, 1.0], [-1.0, 0.1]], "B": [[1.0], [1.0]]},
    "marginal-direction": {
        "A0": [[-1.0, 1.0], [1.0, -1.0]],
        "terms": [("tanh(x)", None, -np.eye(2))],
        "B": [[1.0], [1.0]],
    },
    "unstable-linear-part": {"A0": [[1.0]], "terms": [("sin(x)", None, [[1.0]])], "B": [[1.0]], "b": [0.3]},
    "cooperative-growth": {"A0": [[-1.0]], "terms": [("x**3", None, [[1.0]])], "B": [[1.0]]},
    "invariant-line": {"A0": [[-1.0, 0.0], [0.0, -1.0]], "terms": [("x**3", None, np.eye(2))],
                       "B": [[1.0], [1.0]]},
}  # fmt: skip
MAKERS = {make.__name__[1:].replace("_", "-"): make for make in _KINDS}


def only(kind: str, model: ps.PersidskiiModel, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return the witness of one kind, or None."""
    monkeypatch.setattr("persid.certificates.witness._KINDS", (MAKERS[kind],))
    return find_witness(model, model.u_ref, ps.find_operating_point(model))


@pytest.mark.parametrize("kind", TRUE)
def test_found(kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Each kind refutes a model that it is made for, and its file is accepted with that model only."""
    model = ps.PersidskiiModel(**TRUE[kind])
    witness = only(kind, model, monkeypatch)
    assert witness is not None
    assert witness.kind == witness.content["witness"]["kind"] == kind
    assert str(witness) == witness.sentence
    assert witness.sentence.endswith(".")
    assert "not input-to-state stable" in witness.statement
    witness.save(tmp_path / "w.json")
    assert isinstance(ps.check(tmp_path / "w.json", model), ps.Accepted)
    other = ps.PersidskiiModel(2 * model.A0, model.terms, model.B, model.b)
    assert not isinstance(ps.check(tmp_path / "w.json", other), ps.Accepted)


@pytest.mark.parametrize("kind", TRUE)
def test_not_found_where_false(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """No kind refutes x' = -x - x^3 + u or the folded curve at u = 0."""
    for terms in ([("x**3", None, [[-1.0]])], [("x**3-3*x**2", None, [[-1.0]])]):
        assert only(kind, ps.PersidskiiModel([[-2.5]], terms, [[1.0]]), monkeypatch) is None


def test_direction_without_input(monkeypatch: pytest.MonkeyPatch) -> None:
    """A marginal direction that no input reaches, or along which a function is unbounded, is no witness."""
    for f, B in (("tanh(x)", 0.0), ("x**3", 1.0)):
        model = ps.PersidskiiModel(None, [(f, None, [[-1.0]])], [[B]])
        assert only("marginal-direction", model, monkeypatch) is None


def test_growth_by_jordan_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Polynomial growth of the linear part is not exponential and refutes nothing by itself."""
    model = ps.PersidskiiModel([[0.0, 1.0], [0.0, 0.0]], [("tanh(x)", None, -np.eye(2))], [[0.0], [0.0]])
    assert only("unstable-linear-part", model, monkeypatch) is None


def test_tampered(tmp_path: Path) -> None:
    """A witness whose second point is moved onto the first is rejected."""
    verdict = ps.certify(ps.PersidskiiModel(**TRUE["two-equilibria"]))
    assert isinstance(verdict, ps.Refuted)
    content = verdict.witness.content
    content["witness"]["points"][1] = content["witness"]["points"][0]
    (tmp_path / "w.json").write_text(json.dumps(content), encoding="utf-8")
    assert isinstance(ps.check(tmp_path / "w.json"), ps.Rejected)
