"""The commands that prove: what persid certify leaves of a verdict that is none."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

import persid as ps
import persid.verdicts.certify
from persid.commands import cli
from persid.models.arguments import plain_model
from persid.verdicts.verdict import Reason, Undecided
from places import VALID


@pytest.fixture
def obstructed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Undecided:
    """A model file m.json, and a verdict that it has no certificate of the family, with the proof."""
    monkeypatch.chdir(tmp_path)
    data = (VALID / "infeasible_full.json").read_bytes()
    Path("m.json").write_text(json.dumps(plain_model(json.loads(data)["model"])))
    answer: Any = ps.check(VALID / "infeasible_full.json")
    verdict = Undecided(Reason.INFEASIBLE, "", (), ps.Obstruction(data, answer.statement))
    monkeypatch.setattr(sys.modules["persid.verdicts.certify"], "certify", lambda model, **how: verdict)
    return verdict


def test_an_obstruction_is_written(obstructed: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """Where no certificate of the family exists, the proof of that is written, named, and accepted by the checker."""
    assert cli.main(["certify", "m.json", "-o", "c.json"]) == 3
    assert "c.json (proves the reason; stability is not refuted)" in capsys.readouterr().out
    assert cli.main(["check", "c.json", "--model", "m.json"]) == 3
    assert "claim infeasible" in capsys.readouterr().out
    assert cli.main(["certify", "m.json", "-o", "c.json", "--json"]) == 3
    assert json.loads(capsys.readouterr().out)["file"] == "c.json"


def test_an_obstruction_spares_a_certificate_of_the_same_model(obstructed: Undecided) -> None:
    """A certificate of this model (of a region, say) is not written over; one of another model is."""
    kept = json.dumps({"model_sha256": ps.load_model("m.json").sha256, "claim": "R"})
    Path("c.json").write_text(kept)
    assert cli.main(["certify", "m.json", "-o", "c.json"]) == 3
    assert Path("c.json").read_text() == kept
    Path("c.json").write_bytes((VALID / "g_full.json").read_bytes())
    assert cli.main(["certify", "m.json", "-o", "c.json"]) == 3
    assert json.loads(Path("c.json").read_text())["claim"] == "infeasible"
