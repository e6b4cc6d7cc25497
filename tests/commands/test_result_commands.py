"""The commands that show: what persid simulate says of a run that ended early."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from persid.commands import cli
from persid.models import integration as integrate
from places import ROOT


def test_simulate_names_a_run_that_was_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A model that is too fast to be followed is not called diverged: the time at which it was stopped is told."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(integrate, "BUDGET", 2000)
    monkeypatch.setattr(integrate, "BUDGET_PER_SAMPLE", 10)
    fast = {"format": "persid-model-1", "states": ["a", "b"], "A0": [[0, 1e9], [-1e9, 0]], "terms": [], "B": [[], []]}
    Path("m.json").write_text(json.dumps(fast))
    words = ["simulate", "m.json", "--x0", "1,0", "--t-end", "1", "-o", "run.csv"]
    assert cli.main([*words, "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert content["diverged_at"] is None
    assert 0 < content["stopped_at"] < 1
    assert cli.main(words) == 0
    out = capsys.readouterr().out
    assert "stopped" in out
    assert "diverged" not in out


def test_a_file_that_is_stdout_holds_nothing_else(tmp_path: Path) -> None:
    """With -o /dev/stdout a pipe receives the file alone, and what is said of it goes to stderr."""
    (tmp_path / "m.json").write_text(
        json.dumps({"format": "persid-model-1", "states": ["x"], "A0": [[-1.0]], "terms": [], "B": [[]]})
    )
    words = ["simulate", "m.json", "--x0", "1", "--t-end", "1", "--dt", "0.5", "-o", "/dev/stdout"]
    call = [sys.executable, "-m", "persid", *words]
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run(call, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True)
    assert len(done.stdout.splitlines()) == 4
    assert "samples" in done.stderr
