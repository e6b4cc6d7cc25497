"""The commands identify and bootstrap, and what is said of measurements that cannot be used."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import persid as ps
from command_line import IDENTIFY, RUN, files
from persid.commands import cli
from persid.verdicts.verdict import Undecided
from places import TRAFFIC


def test_identify_writes_the_model(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """persid identify writes the model that the Python interface finds."""
    assert cli.main([*IDENTIFY, "--ridge", "0.01", "--functions", "x, tanh(x); x"]) == 0
    data = ps.read_csv("data.csv", states=["x1", "x2"], inputs=["u"])
    model = ps.PersidskiiIdentifier(functions=[["x", "tanh(x)"], ["x"]], ridge=0.01).fit(data).model_
    assert ps.load_model("m.json").sha256 == model.sha256
    assert "d(x1)/dt = " in capsys.readouterr().out


def test_tables_stand_among_functions_on_the_command_line(here: Path) -> None:
    """The commas and semicolons of a table do not end it; those outside still part functions and states."""
    table = "pwl(x; -1: -2, 0: 0, 1: 0.5)"
    assert cli.main([*IDENTIFY, "--ridge", "0.01", "--functions", f"x, {table}; x, tanh(x)"]) == 0
    model = ps.load_model("m.json")
    assert [f.text for term in model.terms for f in term.f] == [table, "tanh(x)"]


def test_learned_functions_on_the_command_line(here: Path) -> None:
    """--functions "x,pwl" learns what the Python interface learns, and writes it as tables."""
    assert cli.main([*IDENTIFY, "--ridge", "0.01", "--functions", "x,pwl"]) == 0
    data = ps.read_csv("data.csv", states=["x1", "x2"], inputs=["u"])
    fit = ps.PersidskiiIdentifier(functions=["x", "pwl"], ridge=0.01).fit(data)
    assert ps.load_model("m.json").sha256 == fit.model_.sha256
    assert all(f.table is not None for term in fit.model_.terms for f in term.f)


BROKEN = {
    "missing column": ("t,x1,u\n0,1,0\n1,2,0\n", "there is no column 'x2'"),
    "repeated time": ("t,x1,x2,u\n0,1,1,0\n0,2,2,0\n1,2,2,0\n", "row 3, column 't': time 0 is repeated"),
    "unsorted time": ("t,x1,x2,u\n1,1,1,0\n0,2,2,0\n", "row 3, column 't'"),
    "NaN": ("t,x1,x2,u\n0,1,nan,0\n1,2,2,0\n", "row 2, column 'x2'"),
    "empty cell": ("t,x1,x2,u\n0,1,1,0\n1,,2,0\n", "row 3, column 'x1'"),
    "infinity": ("t,x1,x2,u\n0,1,1,0\n1,inf,2,0\n", "row 3, column 'x1'"),
    "no number": ("t,x1,x2,u\n0,1,1,0\n1,2,two,0\n", "row 3, column 'x2'"),
    "too few rows": ("t,x1,x2,u\n0,1,1,0\n", "at least 2"),
    "underdetermined": ("t,x1,x2,u\n0,1,1,0\n1,2,2,0\n2,3,1,1\n", ""),
    "no time": ("x1,x2,u\n1,1,0\n2,2,0\n", "--time"),
    "ragged": ("t,x1,x2,u\n0,1,1,0,9\n1,2,2,0,9\n", "columns"),
    "one row": ("t;x1;x2;u\n0;1;1;0\n", "at least 2"),
    "empty file": ("", "empty"),
    "no text": ("\xff\xfe\x00", "UTF-8"),
}


@pytest.mark.parametrize("what", BROKEN)
@pytest.mark.parametrize("command", [RUN, IDENTIFY], ids=["run", "identify"])
def test_broken_measurements(here: Path, what: str, command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Broken measurements give exit code 2, an error that names the place, and no output at all."""
    text, message = BROKEN[what]
    (here / "data.csv").write_text(text, encoding="latin-1")
    before = files(here)
    assert cli.main(command) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("error: ")
    assert message in err
    assert "Traceback" not in err
    assert files(here) == before
    assert not (here / "out").exists()


@pytest.mark.long
def test_gaps_are_reported(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """A gap splits the run, and the table and the report say so."""
    rows = TRAFFIC.read_text().splitlines()
    (here / "data.csv").write_text("\n".join([*rows[:200], *rows[400:700]]) + "\n")
    assert cli.main(RUN) == 3
    assert "a gap of" in capsys.readouterr().out
    page = (here / "out" / "report.html").read_text()
    assert "a new trajectory starts there" in page


def test_stray_blanks_are_reported(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Names with stray blanks are matched, and said so."""
    (here / "data.csv").write_text((here / "data.csv").read_text().replace("t,x1,x2,u", "t, x1 ,x2, u"))
    assert cli.main(IDENTIFY) == 0
    assert "blanks around the names" in capsys.readouterr().out


@pytest.mark.parametrize("engine", ["chunks", "dask"])
def test_identify_from_a_pattern(here: Path, engine: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Files of a pattern are read chunk by chunk, and the model is that of the data in memory."""
    pytest.importorskip("pyarrow")
    pytest.importorskip("dask.dataframe" if engine == "dask" else "pyarrow")
    (here / "many").mkdir()
    for k in range(3):
        pd.read_csv("data.csv").to_parquet(here / f"many/{k}.parquet")
    words = ["--states", "x1,x2", "--inputs", "u", "--ridge", "0.01"]
    assert cli.main(["identify", "many/*.parquet", *words, "--engine", engine, "-o", "a.json"]) == 0
    assert "3 runs, 900 samples" in capsys.readouterr().out
    assert cli.main(["identify", "many", *words, "-o", "b.json"]) == 0
    one, other = ps.load_model("a.json"), ps.load_model("b.json")
    assert np.allclose(one.A0, other.A0, rtol=1e-9)


@pytest.mark.parametrize(
    "words",
    [
        ["--scheduler", "tcp://127.0.0.1:1"],
        ["--engine", "chunks", "--scheduler", "tcp://127.0.0.1:1"],
        ["--run-column", "who"],
        ["--engine", "chunks", "--derivatives"],
        ["--engine", "chunks", "--method", "derivative"],
        ["--method", "guess"],
    ],
)
def test_wrong_engines(here: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Engines and methods that do not go together are wrong use."""
    assert cli.main([*IDENTIFY, *words]) == 2
    assert capsys.readouterr().err.startswith("error: ")
    assert not (here / "m.json").exists()


@pytest.mark.parametrize(("method", "more"), [("derivative", []), ("edmd", []), ("weak", ["--derivatives"])])
def test_methods(here: Path, method: str, more: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """--method and --derivatives are those of the Python interface."""
    words = [*IDENTIFY, "--functions", "x", "--ridge", "0.01", "--method", method, *more, "--json"]
    assert cli.main(words) == 0
    fit = ps.PersidskiiIdentifier(["x"], method=method, ridge=0.01, derivatives=len(more))
    model = fit.fit(ps.read_csv("data.csv", states=["x1", "x2"], inputs=["u"])).model_
    assert json.loads(capsys.readouterr().out)["sha256"] == model.sha256


def test_bootstrap_command(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """persid bootstrap writes the share that is certified with the spread of rates, gains and coefficients."""
    words = ["bootstrap", "data.csv", "--states", "x1,x2", "--inputs", "u", "--functions", "x", "--ridge", "0.01"]
    assert cli.main([*words, "--count", "3", "--time-limit", "10", "-o", "b.json", "--json"]) == 0
    printed, written = json.loads(capsys.readouterr().out), json.loads(Path("b.json").read_text())
    assert printed == written | {"file": "b.json"}
    assert (written["format"], written["refits"], len(written["terms"])) == ("persid-bootstrap-1", 3, 4)
    assert np.shape(written["deviations"]) == np.shape(written["coefficients"]) == (2, 4)


@pytest.mark.long
@pytest.mark.parametrize("command", [RUN, IDENTIFY], ids=["run", "identify"])
@pytest.mark.usefixtures("plain_page", "undecided")
def test_refine(here: Path, command: list[str]) -> None:
    """--refine is refine=True of the Python interface, for both commands that fit."""
    cli.main([*command, "--functions", "x", "--ridge", "0.01", "--refine"])
    data = ps.read_csv("data.csv", states=["x1", "x2"], inputs=["u"])
    refined = ps.PersidskiiIdentifier(["x"], ridge=0.01, refine=True).fit(data).model_
    written = ps.load_model("out/model.json" if command is RUN else "m.json")
    np.testing.assert_allclose(written.A0, refined.A0, rtol=1e-9)
    assert not np.allclose(refined.A0, ps.PersidskiiIdentifier(["x"], ridge=0.01).fit(data).model_.A0, rtol=1e-3)
