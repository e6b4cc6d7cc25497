"""persid score: how a saved model foretells other files."""

import json
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from persid.commands import cli
from persid.reports.results import read_results


def _write(path: Path, rate: float) -> None:
    model = ps.PersidskiiModel(A0=[[rate]], B=[[1.0]], states=["x"], inputs=["u"])
    t = 0.1 * np.arange(200)
    run = model.simulate([0.5], t, np.where(np.arange(200) // 13 % 2, 1.0, -1.0)[:, None])[0]
    rows = [f"{a},{x[0]},{u[0]}" for a, x, u in zip(run.t, run.x, run.u, strict=True)]
    path.write_text("\n".join(["t,x,u", *rows]) + "\n")


@pytest.fixture
def files_of_a_plant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two files of x' = -x + u, and a saved model that is right."""
    monkeypatch.chdir(tmp_path)
    for name in ("a.csv", "b.csv"):
        _write(tmp_path / name, -1.0)
    ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]], states=["x"], inputs=["u"]).save("model.json")
    return tmp_path


def test_a_right_model_scores_well_on_other_files(files_of_a_plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Every horizon stands in the table, in units and in percent of the range, and as numbers in --json."""
    assert cli.main(["score", "model.json", "a.csv", "b.csv"]) == 0
    text = capsys.readouterr().out
    assert "on 2 other files" in text
    assert "0.4 s (4 samples)" in text
    assert cli.main(["score", "model.json", "a.csv", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert min(row["r2"] for row in found["scores"]["rows"]) > 0.9999
    assert [row["free_run"] for row in found["scores"]["rows"]][-1] is True
    assert found["doubts"] == []


def test_a_wrong_model_is_doubted(files_of_a_plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A model that foretells less than no model is told so."""
    ps.PersidskiiModel(A0=[[-1.0]], B=[[-1.0]], states=["x"], inputs=["u"]).save("wrong.json")
    assert cli.main(["score", "wrong.json", "a.csv"]) == 0
    assert "foretells less than the mean" in capsys.readouterr().out


def test_a_file_without_the_states_of_the_model_is_refused(
    files_of_a_plant: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The columns are those of the model; a missing one is named beside those that exist."""
    Path("c.csv").write_text("t,y,u\n0,1,0\n0.1,1,0\n0.2,1,0\n")
    assert cli.main(["score", "model.json", "c.csv"]) == 2
    assert "no column 'x'" in capsys.readouterr().err


def test_run_scores_files_that_were_kept(files_of_a_plant: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--test files stay out of the fit, and the headline is the delivered model's score on them."""
    words = [
        "run",
        "a.csv",
        "--states",
        "x",
        "--inputs",
        "u",
        "--functions",
        "x",
        "--test",
        "b.csv",
        "-o",
        "out",
        "--json",
    ]
    assert cli.main(words) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["scores"]["on"] == "1 other file"
    assert found["scores"]["rows"][found["scores"]["headline"]]["r2"] > 0.999
    assert json.loads(Path("out/run.json").read_text())["sources"][0]["path"].endswith("a.csv")


@pytest.mark.long
def test_files_that_were_kept_get_the_states_that_the_fit_appends(
    files_of_a_plant: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--test and persid score append velocities as the fit does, and the report reads the kept files again."""
    words = ["run", "a.csv", "--states", "x", "--inputs", "u", "--functions", "x", "--derivatives", "1"]
    cli.main([*words, "--test", "b.csv", "-o", "out", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert found["scores"]["on"] == "1 other file"
    assert read_results(Path("out")).held is not None
    assert cli.main(["score", "out/model.json", "b.csv", "--derivatives", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scores"]["rows"] == found["scores"]["rows"]
    assert cli.main(["score", "out/model.json", "b.csv"]) == 2
    assert "no column 'x_dot'" in capsys.readouterr().err
