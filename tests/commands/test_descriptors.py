"""Models with algebraic variables on the command line."""

import json
from pathlib import Path

import pytest

from descriptors import loop
from persid.commands import cli


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with a loop that is solvable and one that is not."""
    monkeypatch.chdir(tmp_path)
    loop(0.5).save("loop.json")
    loop(2.0).save("several.json")
    return tmp_path


def test_certify_and_check_take_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With the exit codes of other models, and a certificate of another loop is rejected."""
    assert cli.main(["certify", "loop.json", "-o", "c.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "certified"
    assert cli.main(["check", "c.json", "--model", "loop.json"]) == 0
    assert "exactly one solution" in capsys.readouterr().out
    assert cli.main(["check", "c.json", "--model", "several.json"]) == 5
    assert cli.main(["certify", "several.json", "-o", "d.json"]) == 1
    assert cli.main(["check", "d.json", "--model", "several.json"]) == 1
    assert "not well-posed" in capsys.readouterr().out


def test_simulate_writes_all_variables(folder: Path) -> None:
    """Algebraic ones behind the states."""
    assert cli.main(["simulate", "loop.json", "--x0", "1", "--t-end", "1", "-o", "run.csv"]) == 0
    assert (folder / "run.csv").read_text().splitlines()[0] == "t,x1,w,u1"


def test_other_commands_say_what_takes_it(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Scores are about models without algebraic variables."""
    (folder / "data.csv").write_text("t,x1,u1\n0,0,0\n1,0,0\n2,0,0\n")
    assert cli.main(["score", "loop.json", "data.csv"]) == 2
    assert "algebraic variables; persid certify, check and simulate" in capsys.readouterr().err
