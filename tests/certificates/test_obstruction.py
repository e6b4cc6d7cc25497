"""Obstructions: a proof that a family holds no certificate, accepted by the checker, and what it does not say."""

import json
from pathlib import Path

import numpy as np
import pytest

import persid as ps
import persid_check
from persid.certificates.obstruction import find_obstruction
from persid.lyapunov.interior_point import Status
from persid.lyapunov.search import search
from persid.lyapunov.shifted_model import Setting
from persid.verdicts.verdict import Reason

DRIVEN = [("x**3", None, [[0.0, 1.0], [0.0, 0.0]]), ("tanh(x)", None, [[0.0, 0.0], [1.0, 0.0]])]


@pytest.mark.filterwarnings("ignore:divide by zero")
def test_proved_reason(tmp_path: Path) -> None:
    """A cube that a bounded function drives has no certificate in the family, by proof; that refutes nothing."""
    verdict = ps.certify(ps.PersidskiiModel(-np.eye(2), DRIVEN, np.eye(2)))
    assert isinstance(verdict, ps.Undecided)
    assert verdict.reason is Reason.INFEASIBLE
    assert verdict.obstruction is not None
    assert "does not refute" in verdict.obstruction.statement
    verdict.obstruction.save(tmp_path / "o.json")
    answer = ps.check(tmp_path / "o.json")
    assert isinstance(answer, ps.Accepted)
    assert answer.claim == "infeasible"
    content = verdict.obstruction.content
    content["L"] = [[-v for v in row] if i else row for i, row in enumerate(content["L"])]
    (tmp_path / "o.json").write_text(json.dumps(content), encoding="utf-8")
    assert not isinstance(ps.check(tmp_path / "o.json"), ps.Accepted)


def test_not_a_certificate(tmp_path: Path) -> None:
    """The file of an obstruction cannot be loaded as a certificate."""
    verdict = ps.certify(ps.PersidskiiModel([[-1.0, 3.0], [3.0, -1.0]], [], [[1.0], [1.0]]))
    assert isinstance(verdict, ps.Refuted)
    verdict.witness.save(tmp_path / "w.json")
    with pytest.raises(ps.PersidError, match="accepts it as refuted"):
        ps.load_certificate(tmp_path / "w.json")


def test_a_pool_of_many_forms_is_shown_to_hold_no_certificate() -> None:
    """Two functions have more than 64 forms; the checker reads and prices all of them, every pair."""
    model = ps.PersidskiiModel([[0.3]], [("tanh(x)", None, [[-0.1]]), ("x**3", None, [[-0.1]])], [[1.0]])
    setting = Setting.of(model, None)
    assert max(map(len, setting.pools.values())) > 64
    found = search(setting.system, setting.pools)
    assert found.status is Status.INFEASIBLE
    assert found.solution.upper < 0.1 * found.solution.lower, "the bound is clear of zero, and so of rounding"
    obstruction = find_obstruction(model, found)
    assert obstruction is not None
    assert len(obstruction.content["groups"][0]["forms"]) == len(setting.pools[setting.found[0].curve])
    content = obstruction.content
    forms = content["groups"][0]["forms"]
    content["groups"][0]["forms"] = (forms * 2)[:129]
    answer = persid_check.check(json.dumps(content).encode())
    assert isinstance(answer, ps.Malformed)
    assert (answer.where, answer.why) == ("groups[0].forms", "at most 128 are read")
