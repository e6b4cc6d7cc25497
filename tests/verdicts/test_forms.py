"""How often a model changes its form on the way to a verdict."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import persid as ps
from persid.models import model as models
from persid.models.model import PersidskiiModel
from persid_check.ledger import file


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count the objects that a model is turned into, here and by the checker."""
    found: Counter[str] = Counter()

    def counting(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def count(*given: Any, **named: Any) -> Any:
            found[name] += 1
            return function(*given, **named)

        return count

    monkeypatch.setattr(PersidskiiModel, "to_dict", counting("object", PersidskiiModel.to_dict))
    monkeypatch.setattr(models, "canonical_model", counting("written", models.canonical_model))
    monkeypatch.setattr(file, "read_model", counting("file", file.read_model))
    return found


def test_a_verdict_turns_its_model_into_a_proof_once(counted: Counter[str]) -> None:
    """All proofs share one canonical model; each of the three files is read to be factored and to be checked."""
    model = ps.PersidskiiModel(-np.eye(2), [("tanh(x)", None, [[-1.0, 0.3], [-0.3, -1.0]])], [[1.0], [0.5]])
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.claim == "rate-and-gain"
    assert counted == {"object": 1, "written": 1, "file": 6}


def test_the_form_of_proofs_leads_back_to_the_model() -> None:
    """A model read from its canonical form is the same one, number for number."""
    model = ps.PersidskiiModel([[-0.1]], [("x**3", [[0.3]], [[-0.7]])], [[0.1]], domain=[[-1.0, 2.0]])
    assert PersidskiiModel.from_canonical(model.canonical) == model
