"""The command line in discrete time: from measurements to a verdict, scores and the report again."""

import json
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from persid.commands import cli
from persid.reports.results import read_results


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Measurements of x+ = -.6 x - .2 tanh(x) + u, at .1 s, which have no generator."""
    monkeypatch.chdir(tmp_path)
    model = ps.PersidskiiModel([[-0.6]], [("tanh(x)", None, [[-0.2]])], [[1.0]], time="discrete", dt=0.1)
    t, u = 0.1 * np.arange(200), np.random.default_rng(0).normal(size=(200, 1))
    x = model.simulate([1.0], t, u)[0].x
    table = np.column_stack([t, x, u])
    np.savetxt("data.csv", table, delimiter=",", header="t,x,u", comments="", fmt="%.9g")
    return tmp_path


FIT = ["--states", "x", "--inputs", "u", "--functions", "x,tanh(x)"]


def test_the_error_of_a_logarithm_offers_the_option(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Where EDMD has no logarithm the command line says --time discrete, in its own words."""
    assert cli.main(["identify", "data.csv", *FIT, "--method", "edmd", "-o", "m.json"]) == 2
    said = capsys.readouterr().err
    assert "--time discrete" in said
    assert "time=" not in said


@pytest.mark.parametrize("order", [["t", "discrete"], ["discrete", "t"]])
def test_a_column_of_the_time_may_be_named_beside_it(
    order: list[str], folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--time says the column and discrete time, in any order; two columns are refused."""
    both = [part for word in order for part in ("--time", word)]
    assert cli.main(["identify", "data.csv", *FIT, *both, "--stride", "2", "-o", "m.json"]) == 0
    model = ps.load_model("m.json")
    assert model.dt == pytest.approx(0.2)
    assert cli.main(["identify", "data.csv", *FIT, *both, "--time", "x", "-o", "m.json"]) == 2
    assert "--time names 2 columns" in capsys.readouterr().err


def test_discrete_time_goes_with_states(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A model of inputs and outputs is one in continuous time: the option is refused, not ignored."""
    asked = ["run", "data.csv", "--outputs", "x", "--inputs", "u", "--time", "discrete", "-o", "out"]
    assert cli.main(asked) == 2
    assert "--time discrete goes with --states" in capsys.readouterr().err


def test_a_run_in_discrete_time(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """run --time discrete fits, certifies and reports; the report is made again, and the model scored on a file."""
    assert cli.main(["run", "data.csv", *FIT, "--time", "discrete", "--stride", "1", "-o", "out"]) == 0
    said = capsys.readouterr().out
    assert "one-step form" in said
    assert "a step is 1 sample(s), 0.1 s" in said
    model = ps.load_model("out/model.json")
    assert model.is_discrete
    assert isinstance(ps.check("out/certificate.json", "out/model.json"), ps.Accepted)
    page = (folder / "out" / "report.html").read_text()
    assert "<mi>k</mi><mo>+</mo><mn>1</mn>" in page
    found = read_results(folder / "out")
    assert found.data is not None
    assert found.held is not None
    assert cli.main(["score", "out/model.json", "data.csv", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scores"]["rows"][-1]["r2"] > 0.99
    assert cli.main(["certify", "out/model.json", "-o", "again.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["verdict"] == "certified"
