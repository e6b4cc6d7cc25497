"""The command line: exit codes, files, and what is printed where."""

import json
import os
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

import persid as ps
from persid import certify as _  # noqa: F401  (the module is loaded, so that the name below can be patched)
from persid import cli, fit_commands, folder, talk
from persid.certificate import plain_model
from persid.certify import Attempt, Certified, Reason, Refuted, Undecided
from persid.constrained import Delivery

ROOT = Path(__file__).resolve().parents[1]
TRAFFIC = ROOT / "examples" / "traffic.csv"
VALID = ROOT / "tests" / "certificates" / "valid"
MODEL = {
    "format": "persid-model-1", "states": ["x1", "x2"], "inputs": ["u"],
    "A0": [[-1, 0.5], [0.5, -2]], "terms": [{"f": "tanh(x)", "R": None, "A": [[-1, 0], [0, -1]]}],
    "B": [[1], [0]],
}  # fmt: skip
UNSTABLE = MODEL | {"A0": [[0.5, 1], [-1, 0.5]], "terms": []}


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with a short file of measurements and two models."""
    monkeypatch.chdir(tmp_path)
    rows = TRAFFIC.read_text().splitlines()[:301]
    (tmp_path / "data.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "model.json").write_text(json.dumps(MODEL))
    (tmp_path / "unstable.json").write_text(json.dumps(UNSTABLE))
    return tmp_path


def free_fit_only(fit: Any, verdict: Any, *more: Any, **how: Any) -> Delivery:
    """Deliver the free fit, where a test is about a verdict that a fit under the certificate would avoid."""
    return Delivery(fit.model_, verdict)


@pytest.fixture
def undecided(monkeypatch: pytest.MonkeyPatch) -> Undecided:
    """Certification that is quick and always undecided, for a fit under the certificate too."""
    verdict = Undecided(Reason.STALLED, "Try more ridge.", (Attempt("a look", "stalled", 0.5),))
    monkeypatch.setattr(sys.modules["persid.certify"], "certify", lambda model, **how: verdict)
    monkeypatch.setattr("persid.constrained.deliver", free_fit_only)
    return verdict


@pytest.fixture
def plain_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report without figures, where a test is about something else."""
    monkeypatch.setattr("persid.report.write_report", lambda results, stage: (stage / "report.html").write_text("page"))


RUN = ["run", "data.csv", "--states", "x1,x2", "--inputs", "u", "-o", "out"]
IDENTIFY = ["identify", "data.csv", "--states", "x1,x2", "--inputs", "u", "-o", "m.json"]


def files(path: Path) -> set[str]:
    """Return the names of all files below a folder."""
    return {str(file.relative_to(path)) for file in path.rglob("*") if file.is_file()}


def test_no_arguments_show_the_path_in_five_lines(capsys: pytest.CaptureFixture[str]) -> None:
    """Without arguments the command line shows the way from data to proof in five lines."""
    assert cli.main([]) == 0
    assert len(capsys.readouterr().out.splitlines()) == 5


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    """--version prints the version and exits with 0."""
    assert cli.main(["--version"]) == 0
    assert capsys.readouterr().out == f"persid {ps.__version__}\n"


@pytest.mark.parametrize("name", sorted(cli.persid.commands))
def test_every_help_has_an_example_that_parses(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Every help text holds an example, and the example is one that the command understands."""
    assert cli.main([name, "--help"]) == 0
    text = capsys.readouterr().out
    line = re.search(rf"persid {name} (.*)", text[text.index("Example") :])
    assert line
    words = [str(TRAFFIC) if word == "examples/traffic.csv" else word for word in shlex.split(line[1])]
    words = [str(VALID / "g_full.json") if word in ("certificate.json", "model.json") else word for word in words]
    words = [str(VALID) if word == "out" and name == "report" else word for word in words]
    cli.persid.commands[name].make_context(name, words)


def test_run_certifies_and_delivers(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run on measurements ends with the verdict and the paths of the report and the checked certificate."""
    assert cli.main([*RUN, "--ridge", "0.05", "--functions", "x,tanh(x)", "--time-limit", "5"]) == 0
    lines = capsys.readouterr().out.splitlines()
    names = [line.split()[0] for line in lines if not line.startswith(" ")]
    assert names[-4:] == ["verdict", "but", "report", "certificate"]  # its free run is worse than the mean
    assert any("the proof is about the model, not about the plant" in line for line in lines)
    assert {"model.json", "certificate.json", "report.html", "run.json", "figures/free-run-1.png"} <= files(
        here / "out"
    )
    assert ps.check("out/certificate.json", "out/model.json") == ps.check(ps.load_certificate("out/certificate.json"))
    assert isinstance(ps.check("out/certificate.json"), ps.Accepted)


def test_run_undecided_says_why(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """An undecided run exits with 3, leaves obstruction.json with the attempts, and removes a stale certificate."""
    (here / "out" / "figures").mkdir(parents=True)
    (here / "out" / "certificate.json").write_text("stale")
    (here / "out" / "figures" / "level-sets-1-2.png").write_text("stale")
    (here / "out" / "mine.txt").write_text("mine")
    assert cli.main(RUN) == 3
    assert "undecided: The solver stalled" in capsys.readouterr().out
    found = files(here / "out")
    assert "certificate.json" not in found
    assert "figures/level-sets-1-2.png" not in found
    assert {"mine.txt", "obstruction.json"} <= found
    content = json.loads((here / "out" / "obstruction.json").read_text())
    assert content["reason"] == "STALLED"
    assert content["attempts"] == [{"what": "a look", "outcome": "stalled", "seconds": 0.5}]
    assert content["model_sha256"] == ps.load_model("out/model.json").sha256


@pytest.mark.usefixtures("plain_page")
def test_run_json_is_one_object(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """--json prints exactly one object on stdout, with the keys that were promised."""
    assert cli.main([*RUN, "--json"]) == 3
    content = json.loads(capsys.readouterr().out)
    keys = {"verdict", "claim", "scope", "operating_point", "reason", "rate", "gain", "seconds"}
    assert keys <= set(content)
    assert content["verdict"] == "undecided"
    assert Path(content["files"]["report"]).is_file()


@pytest.mark.usefixtures("plain_page")
def test_quiet_prints_nothing(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """--quiet leaves stdout and stderr empty; the exit code speaks."""
    assert cli.main([*RUN, "--quiet"]) == 3
    assert capsys.readouterr() == ("", "")


def test_report_is_rebuilt(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """persid report builds the same page again from the files of a run."""
    cli.main(RUN)
    page = (here / "out" / "report.html").read_text()
    (here / "out" / "report.html").unlink()
    assert cli.main(["report", "out"]) == 0
    assert (here / "out" / "report.html").read_text() == page


def test_report_without_measurements(here: Path, undecided: Undecided) -> None:
    """Where the measurements have changed since, the report is rebuilt without them and says so."""
    cli.main(RUN)
    (here / "data.csv").write_text("t,x1\n0,1\n")
    assert cli.main(["report", "out"]) == 0
    assert "no longer where they were, or have changed" in (here / "out" / "report.html").read_text()


@pytest.mark.usefixtures("plain_page")
def test_report_refuses_a_foreign_model(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder whose files speak of different models is refused."""
    cli.main(RUN)
    (here / "out" / "model.json").write_text(json.dumps(MODEL))
    assert cli.main(["report", "out"]) == 2
    assert "another model" in capsys.readouterr().err


def test_certificate_of_run_is_checked_again(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """persid report refuses a folder whose certificate has been tampered with."""
    source = json.loads((VALID / "g_full.json").read_text())
    (here / "out").mkdir()
    certificate = ps.load_certificate(VALID / "g_full.json")
    certificate.model.save(here / "out" / "model.json")
    (here / "out" / "certificate.json").write_text(json.dumps(source | {"gamma": [1, -60]}))
    assert cli.main(["report", "out"]) == 2
    assert "does not accept" in capsys.readouterr().err
    (here / "out" / "certificate.json").write_bytes(certificate.data)
    assert cli.main(["report", "out"]) == 0


def test_identify_writes_the_model(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """persid identify writes the model that the Python interface finds."""
    assert cli.main([*IDENTIFY, "--ridge", "0.01", "--functions", "x, tanh(x); x"]) == 0
    data = ps.read_csv("data.csv", states=["x1", "x2"], inputs=["u"])
    model = ps.PersidskiiIdentifier(functions=[["x", "tanh(x)"], ["x"]], ridge=0.01).fit(data).model_
    assert ps.load_model("m.json").sha256 == model.sha256
    assert "d(x1)/dt = " in capsys.readouterr().out


def test_certify_and_check(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What persid certify writes, persid check accepts, for that model and no other."""
    assert cli.main(["certify", "model.json", "-o", "c.json", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["verdict"], content["scope"], content["file"]) == ("certified", "global", "c.json")
    assert cli.main(["check", "c.json", "--model", "model.json", "--explain"]) == 0
    assert "accepted, claim" in capsys.readouterr().out
    assert cli.main(["check", "c.json", "--model", "unstable.json", "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["result"] == "rejected"


def test_refuted_exits_with_one(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A refuted model exits with 1, and its witness is a file that the checker accepts."""
    assert cli.main(["certify", "unstable.json", "-o", "w.json"]) == 1
    assert "refuted: " in capsys.readouterr().out
    assert cli.main(["check", "w.json"]) == 0
    assert "claim refuted" in capsys.readouterr().out


def test_run_refuted(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A refuted run leaves witness.json and a report that shows the checker's words; it can be rebuilt."""
    verdict = ps.certify(ps.load_model("unstable.json"))
    assert isinstance(verdict, Refuted)
    monkeypatch.setattr(sys.modules["persid.certify"], "certify", lambda model, **how: verdict)
    monkeypatch.setattr("persid.constrained.deliver", free_fit_only)
    monkeypatch.setattr(fit_commands, "_identify", _identified("unstable.json"))
    assert cli.main(RUN) == 1
    assert "witness.json" in files(here / "out")
    assert "is not input-to-state stable" in (here / "out" / "report.html").read_text()
    assert cli.main(["report", "out"]) == 0


def _identified(path: str) -> Callable[..., Any]:
    def identify(measured: ps.Trajectories, **how: Any) -> Any:
        fit = ps.PersidskiiIdentifier(functions=how["functions"], ridge=0.01).fit(measured)
        fit.model_ = ps.load_model(path)
        return fit

    return identify


def test_run_obstructed(here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Where no certificate of the family exists, the proof of that is delivered, checked, and shown again."""
    data = (VALID / "infeasible_full.json").read_bytes()
    form = json.loads(data)["model"]
    (here / "m.json").write_text(json.dumps(plain_model(form)))
    obstruction = ps.Obstruction(data, ps.check(VALID / "infeasible_full.json").statement)  # type: ignore[union-attr]
    verdict = Undecided(Reason.INFEASIBLE, "", (), obstruction)
    monkeypatch.setattr(sys.modules["persid.certify"], "certify", lambda model, **how: verdict)
    monkeypatch.setattr("persid.constrained.deliver", free_fit_only)
    monkeypatch.setattr(fit_commands, "_identify", _identified("m.json"))
    (here / "data.csv").write_text((here / "data.csv").read_text().replace("x1", "a"))
    words = ["run", "data.csv", "--states", "a", "--inputs", "u", "-o", "out"]
    assert cli.main(words) == 3
    assert cli.main(["check", "out/infeasible.json"]) == 0
    assert "python -m persid_check infeasible.json" in (here / "out" / "report.html").read_text()
    assert cli.main(["report", "out"]) == 0


def test_several_models(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of several models each gets a file of its own, and one refuted makes the exit code 1."""
    assert cli.main(["certify", "model.json", "unstable.json", "-o", "c.json", "--json"]) == 1
    found = json.loads(capsys.readouterr().out)["models"]
    assert [one["verdict"] for one in found] == ["certified", "refuted"]
    assert {"model.c.json", "unstable.c.json"} <= files(here)


def test_models_of_one_name_are_refused(here: Path) -> None:
    """Two models whose certificates would have the same name are wrong use."""
    (here / "other").mkdir()
    (here / "other" / "model.json").write_text(json.dumps(MODEL))
    assert cli.main(["certify", "model.json", "other/model.json", "-o", "c.json"]) == 2
    assert "c.json" not in {name for name in files(here)}


def test_undecided_keeps_only_a_certificate_of_this_model(here: Path, undecided: Undecided) -> None:
    """An undecided certify removes a certificate of another model under its name, and keeps one of this model."""
    (here / "c.json").write_bytes((VALID / "g_full.json").read_bytes())
    assert cli.main(["certify", "model.json", "-o", "c.json"]) == 3
    assert not (here / "c.json").exists()
    (here / "c.json").write_text(json.dumps({"model_sha256": ps.load_model("model.json").sha256}))
    assert cli.main(["certify", "model.json", "-o", "c.json"]) == 3
    assert (here / "c.json").exists()


@pytest.mark.parametrize(
    ("text", "code"),
    [('{"format": "persid-certificate-1"}', 2), ("no JSON", 2), ("", 2), ("[" * 100000, 2), ("\x00\xff", 2)],
)
def test_malformed_certificates(here: Path, text: str, code: int, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that is no certificate is malformed, exit code 2."""
    (here / "c.json").write_text(text, encoding="latin-1")
    assert cli.main(["check", "c.json"]) == code
    assert "malformed" in capsys.readouterr().out


def test_simulate_from_an_expression(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """persid simulate writes the run of the Python interface, every number exact."""
    words = ["simulate", "model.json", "--x0", "1,-3", "--input", "0.5*sin(t)", "--t-end", "2", "--dt", "0.5"]
    assert cli.main([*words, "-o", "new/run.csv"]) == 0
    table = np.loadtxt("new/run.csv", delimiter=",", skiprows=1)
    t = np.array([0.0, 0.5, 1.0, 1.5, 2.0])
    run = ps.load_model("model.json").simulate([1, -3], t, lambda s: np.array([0.5 * np.sin(s)]))[0]
    assert (table == np.column_stack([run.t, run.x, run.u])).all()
    assert Path("new/run.csv").read_text().startswith("t,x1,x2,u\n")


def test_simulate_from_a_table(here: Path) -> None:
    """Inputs of a table are held until the next row."""
    (here / "in.csv").write_text("t,u\n0,1\n1,0\n2,5\n")
    words = ["simulate", "model.json", "--x0", "0,0", "--inputs-csv", "in.csv", "--dt", "0.5", "-o", "run.csv"]
    assert cli.main(words) == 0
    table = np.loadtxt("run.csv", delimiter=",", skiprows=1)
    assert table[:, 3].tolist() == [1, 1, 0, 0, 5]


def test_simulate_tells_a_blow_up(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run that diverges ends there and says so; that is no error."""
    (here / "up.json").write_text(json.dumps(MODEL | {"terms": [{"f": "x**3", "R": None, "A": [[9, 0], [0, 9]]}]}))
    assert cli.main(["simulate", "up.json", "--x0", "2,2", "--t-end", "9", "-o", "r.csv", "--json"]) == 0
    assert 0 < json.loads(capsys.readouterr().out)["diverged_at"] < 1


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--t-end", "1", "--x0", "1"], "x0"),
        (["--t-end", "1", "--x0", "1,a"], "list of numbers"),
        (["--x0", "1,1"], "--t-end is missing"),
        (["--x0", "1,1", "--t-end", "-1"], "must be positive"),
        (["--x0", "1,1", "--t-end", "1", "--dt", "2"], "must be positive"),
        (["--x0", "1,1", "--t-end", "1e9", "--dt", "1e-9"], "larger --dt"),
        (["--x0", "1,1", "--t-end", "1", "--input", "sin(q)"], "not an expression of t"),
        (["--x0", "1,1", "--t-end", "1", "--input", "x"], "depends on x"),
        (["--x0", "1,1", "--t-end", "1", "--input", "t", "--input", "t"], "2 signals"),
        (["--x0", "1,1", "--t-end", "1", "--input", "t", "--inputs-csv", "data.csv"], "both given"),
        (["--x0", "1,1", "--t-end", "99", "--inputs-csv", "data.csv"], "covers"),
    ],
)
def test_simulate_errors(here: Path, words: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Wrong words of a simulation are named, exit code 2, and nothing is written."""
    assert cli.main(["simulate", "model.json", *words, "-o", "r.csv"]) == 2
    assert message in capsys.readouterr().err
    assert not (here / "r.csv").exists()


BROKEN = {
    "missing column": ("t,x1,u\n0,1,0\n1,2,0\n", "there is no column 'x2'"),
    "repeated time": ("t,x1,x2,u\n0,1,1,0\n0,2,2,0\n1,2,2,0\n", "row 3, column 't': time 0.0 is repeated"),
    "unsorted time": ("t,x1,x2,u\n1,1,1,0\n0,2,2,0\n", "row 3, column 't'"),
    "NaN": ("t,x1,x2,u\n0,1,nan,0\n1,2,2,0\n", "row 2, column 'x2'"),
    "empty cell": ("t,x1,x2,u\n0,1,1,0\n1,,2,0\n", "row 3, column 'x1'"),
    "infinity": ("t,x1,x2,u\n0,1,1,0\n1,inf,2,0\n", "row 3, column 'x1'"),
    "no number": ("t,x1,x2,u\n0,1,1,0\n1,2,two,0\n", "row 3, column 'x2'"),
    "too few rows": ("t,x1,x2,u\n0,1,1,0\n", "at least 2"),
    "underdetermined": ("t,x1,x2,u\n0,1,1,0\n1,2,2,0\n2,3,1,1\n", ""),
    "no time": ("x1,x2,u\n1,1,0\n2,2,0\n", "--time"),
    "ragged": ("t,x1,x2,u\n0,1,1,0,9\n1,2,2,0,9\n", "columns"),
    "semicolons": ("t;x1;x2;u\n0;1;1;0\n", "comma"),
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


@pytest.mark.parametrize(
    "words",
    [
        ["nonsense"],
        ["run"],
        ["run", "absent.csv", "--states", "x1", "-o", "out"],
        ["run", "data.csv", "-o", "out"],
        ["run", "data.csv", "--states", "x1,,x2", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--ridge", "much", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--ridge", "-1", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--ridge", "nan", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--functions", "x,,x", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--functions", "import(x)", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--dt", "0", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--dt", "1", "--time", "t", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--time-limit", "-1", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "--operating-point", "1", "-o", "out"],
        ["run", "data.csv", "--states", "x1,x2", "-o", "data.csv"],
        ["run", "data.csv", "--states", "x1,x2", "-o", "data.csv/out"],
        ["certify", "absent.json", "-o", "c.json"],
        ["certify", "data.csv", "-o", "c.json"],
        ["check", "absent.json"],
        ["report", "."],
        ["report", "absent"],
    ],
)
def test_wrong_use(here: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Wrong use gives exit code 2 and an error on stderr; nothing is written."""
    if words == ["report", "."]:
        (here / "model.json").unlink()
    before = files(here)
    assert cli.main(words) == 2
    out, err = capsys.readouterr()
    assert (out, err[:7]) == ("", "error: ")
    assert files(here) == before


@pytest.mark.parametrize(
    "content",
    [
        "null", "[]", "{}", '"text"', '{"format": "persid-model-1"}',
        '{"format": "persid-model-1", "states": 5, "B": [], "terms": []}',
        '{"format": "persid-model-1", "states": ["x"], "B": [], "terms": 7}',
        '{"format": "persid-model-1", "states": ["x"], "B": [[1]], "terms": [{"f": "x"}]}',
        '{"format": "persid-model-1", "states": ["x"], "B": [[1]], "terms": [3]}',
        '{"format": "persid-model-1", "states": ["x"], "inputs": 3, "B": [[1]], "terms": []}',
        '{"format": "persid-model-1", "states": ["x"], "B": [[NaN]], "terms": []}',
        '{"format": "persid-model-1", "states": ["x"], "A0": [[' + "9" * 5000 + ']], "B": [], "terms": []}',
        "[" * 100000,
    ],
)  # fmt: skip
@pytest.mark.parametrize("command", ["certify", "simulate"])
def test_malformed_models(here: Path, content: str, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A file that is no model gives exit code 2, whatever it holds."""
    (here / "m.json").write_text(content)
    more = ["--x0", "1", "--t-end", "1"] if command == "simulate" else []
    assert cli.main([command, "m.json", *more, "-o", "c.json"]) == 2
    assert "m.json" in capsys.readouterr().err


def _raising(error: BaseException) -> Callable[..., Any]:
    def fail(*args: Any, **how: Any) -> Any:
        raise error

    return fail


@pytest.mark.parametrize("place", ["persid.folder.read_measurements", "persid.report.write_report"])
def test_interruption(here: Path, undecided: Undecided, place: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C gives exit code 130 and leaves nothing, whenever it comes."""
    monkeypatch.setattr(place, _raising(KeyboardInterrupt()))
    before = files(here)
    assert cli.main(RUN) == 130
    assert files(here) == before
    assert not (here / "out").exists()


def test_interruption_of_the_search(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C during the search for a proof is an interruption, not an undecided verdict."""
    monkeypatch.setattr(sys.modules["persid.certify"], "certify", lambda *a, **k: Undecided(Reason.INTERRUPTED))
    assert cli.main(RUN) == 130
    assert not (here / "out").exists()


def test_internal_error(here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """An unexpected exception gives exit code 4, one line, and a traceback only with --debug."""
    monkeypatch.setattr(fit_commands, "_identify", _raising(ZeroDivisionError("by zero")))
    assert cli.main(RUN) == 4
    err = capsys.readouterr().err
    assert "ZeroDivisionError: by zero" in err
    assert "Traceback" not in err
    assert cli.main([*RUN, "--debug"]) == 4
    assert "Traceback" in capsys.readouterr().err
    assert not (here / "out").exists()


def test_json_errors_are_objects(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With --json an error is the one object on stdout, too."""
    assert cli.main(["run", "absent.csv", "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["exit_code"] == 2


@pytest.mark.usefixtures("plain_page")
def test_full_disk(here: Path, undecided: Undecided, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full while the results are written leaves the older results as they were."""
    cli.main(RUN)
    before = {name: (here / "out" / name).read_bytes() for name in files(here / "out")}
    monkeypatch.setattr("persid.folder.write_atomically", _raising(OSError(28, "No space left on device", "out")))
    assert cli.main(RUN) == 2
    assert {name: (here / "out" / name).read_bytes() for name in files(here / "out")} == before


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_output_that_cannot_be_printed() -> None:
    """A full or closed stdout gives exit code 2 or 4 and no traceback, never the 1 that means refuted."""
    words = [sys.executable, "-m", "persid", "--help"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=_environment())
    assert done.returncode == 2
    assert "No space left" in done.stderr
    assert "Traceback" not in done.stderr
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, text=True, check=False, env=_environment())
    os.close(writer)
    assert done.returncode == 4
    assert done.stderr.count("\n") == 1


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT / "src")}


def test_ctrl_c_in_a_real_process(here: Path) -> None:
    """A process that is interrupted exits with 130 and leaves nothing."""
    code = (
        "import os, signal, sys, time, persid.cli as cli, persid.fit_commands as fits;"
        "signal.signal(signal.SIGINT, signal.default_int_handler);"  # a job in the background inherits none
        "fits._identify = lambda *a, **k: (os.kill(os.getpid(), signal.SIGINT), time.sleep(5));"
        f"sys.exit(cli.main({RUN!r}))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=_environment())
    assert done.returncode == 130
    assert done.stderr.strip().splitlines()[-1].startswith("error: interrupted")
    assert not (here / "out").exists()


def test_progress_shows_only_to_a_patient_watcher(monkeypatch: pytest.MonkeyPatch) -> None:
    """Progress appears on a terminal after the time of patience, and nowhere else."""
    shown: list[str] = []
    monkeypatch.setattr(talk.Progress, "_draw", lambda self, line: shown.append(line))
    monkeypatch.setattr(talk, "PATIENCE", 0.05)
    for watched in (False, True):
        progress = talk.Progress(watched)
        progress("working")
        time.sleep(0.2)
        progress("still working")
        progress.close()
        assert shown == (["working", "still working", ""] if watched else [])


@pytest.mark.parametrize(("variable", "coloured"), [("", True), ("1", False)])
def test_colour(variable: str, coloured: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """A verdict is coloured on a terminal, unless NO_COLOR is set."""
    monkeypatch.setenv("NO_COLOR", variable)
    monkeypatch.setattr(sys, "stdout", SimpleNamespace(isatty=lambda: True))
    assert ("\x1b" in talk.paint("certified: yes")) == coloured


def _cut(path: Path) -> None:
    """Deliver half of the files, then fail."""
    with folder.delivery(path, ["*.json"]) as stage:
        (stage / "new.json").write_text("half")
        raise RuntimeError


def test_delivery_is_all_or_nothing(tmp_path: Path) -> None:
    """A delivery that fails leaves an existing folder as it was, and creates none."""
    (tmp_path / "old.json").write_text("old")
    with pytest.raises(RuntimeError):
        _cut(tmp_path)
    assert files(tmp_path) == {"old.json"}
    with pytest.raises(RuntimeError):
        _cut(tmp_path / "a" / "b")
    assert not (tmp_path / "a").exists()
    with folder.delivery(tmp_path, ["*.json"]) as stage:
        (stage / "new.json").write_text("new")
    assert files(tmp_path) == {"new.json"}


@pytest.mark.usefixtures("plain_page")
def test_record_keeps_odd_numbers(here: Path, undecided: Undecided) -> None:
    """The record of a run reads back as it was written, infinite figures included."""
    cli.main(RUN)
    path = here / "out" / "run.json"
    content = json.loads(path.read_text())
    content["fit"]["condition_raw"] = {"float": "inf"}
    path.write_text(json.dumps(content))
    record = folder.read_results(here / "out").record
    assert record is not None
    assert record.fit is not None
    assert record.fit.condition_raw == float("inf")
    folder.write_record(here, record)
    assert json.loads((here / "run.json").read_text()) == content


def test_summary_of_rates() -> None:
    """The brief of claim E names the rate and the gain that the checker states."""
    from persid.summary import summarize

    brief = summarize(Certified(ps.load_certificate(VALID / "e_mixed_pair.json")))
    assert brief.rate == 0.25
    assert brief.gain == pytest.approx(2.13472, rel=1e-5)


@pytest.mark.parametrize(
    ("number", "low", "high"), [(0.157451, "0.1574", "0.1575"), (2.0, "2", "2"), (0.125, "0.125", "0.125")]
)
def test_shown_bounds_are_rounded_outwards(number: float, low: str, high: str) -> None:
    """A shown rate is rounded down, a shown gain up; exact numbers stay."""
    from persid.summary import above, below

    assert float(below(number)) <= number <= float(above(number))
    assert float(below(number)) == pytest.approx(float(low), rel=1e-9)
    assert float(above(number)) == pytest.approx(float(high), rel=1e-3)


@pytest.mark.parametrize("engine", ["chunks", "dask"])
def test_identify_from_a_pattern(here: Path, engine: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Files of a pattern are read chunk by chunk, and the model is that of the data in memory."""
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


def test_explain_prints_every_attempt(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--explain prints what was tried, how it ended and the seconds, for people and for programs."""
    assert cli.main(["certify", "model.json", "-o", "c.json", "--explain"]) == 0
    lines = capsys.readouterr().out.splitlines()
    first = next(k for k, line in enumerate(lines) if line.startswith("attempts"))
    assert "equilibria at the nominal input" in lines[first]
    assert any(line.strip().startswith("in all") and line.endswith(" s") for line in lines)
    assert cli.main(["certify", "model.json", "-o", "c.json", "--explain", "--json"]) == 0
    assert {"what", "outcome", "seconds"} == set(json.loads(capsys.readouterr().out)["attempts"][0])


def test_gains_of_each_input(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """--gains each prints a gain for each input, those of the certificate."""
    (here / "two.json").write_text(json.dumps(MODEL | {"inputs": ["u", "v"], "B": [[1, 0], [0, 0.1]]}))
    assert cli.main(["certify", "two.json", "-o", "c.json", "--gains", "each", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)["gains"]
    assert found == dict(zip("uv", ps.load_certificate("c.json").gains, strict=True))
    assert found["v"] < found["u"]


@pytest.mark.parametrize("jobs", [[], ["--jobs", "2"]], ids=["one by one", "processes"])
def test_one_broken_model_does_not_stop_the_others(
    here: Path, jobs: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """Of several models a broken one is reported in its place; the exit code is 2 where none is refuted."""
    (here / "broken.json").write_text("{}")
    assert cli.main(["certify", "broken.json", "model.json", "-o", "c.json", "--json", *jobs]) == 2
    found = json.loads(capsys.readouterr().out)["models"]
    assert "ModelError" in found[0]["error"]
    assert (found[1]["verdict"], found[1]["file"]) == ("certified", "model.c.json")
    assert cli.main(["certify", "broken.json", "unstable.json", "-o", "c.json"]) == 1


def test_an_interrupted_batch_keeps_what_is_done(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C in a batch leaves the proofs of the models that were decided, whole, and exits with 130."""
    answers = iter([ps.certify(ps.load_model("model.json"))])

    def certify(model: Any, **how: Any) -> Any:
        return next(answers, Undecided(Reason.INTERRUPTED))

    monkeypatch.setattr("persid.batches.certify", certify)
    (here / "second.json").write_text(json.dumps(MODEL))
    assert cli.main(["certify", "model.json", "second.json", "unstable.json", "-o", "c.json"]) == 130
    assert "1 of 3 models were decided" in capsys.readouterr().err
    assert isinstance(ps.check("model.c.json", "model.json"), ps.Accepted)
    assert not (here / "second.c.json").exists()


def test_bootstrap_command(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """persid bootstrap writes the share that is certified with the spread of rates, gains and coefficients."""
    words = ["bootstrap", "data.csv", "--states", "x1,x2", "--inputs", "u", "--functions", "x", "--ridge", "0.01"]
    assert cli.main([*words, "--count", "3", "--time-limit", "10", "-o", "b.json", "--json"]) == 0
    printed, written = json.loads(capsys.readouterr().out), json.loads(Path("b.json").read_text())
    assert printed == written | {"file": "b.json"}
    assert (written["format"], written["refits"], len(written["terms"])) == ("persid-bootstrap-1", 3, 4)
    assert np.shape(written["deviations"]) == np.shape(written["coefficients"]) == (2, 4)


@pytest.mark.parametrize(("shell", "mark"), [("bash", "complete -o"), ("zsh", "#compdef persid"), ("fish", "complete")])
def test_completion_scripts(shell: str, mark: str, capsys: pytest.CaptureFixture[str]) -> None:
    """persid completion prints the script of each shell."""
    assert cli.main(["completion", shell]) == 0
    assert mark in capsys.readouterr().out


def test_words_are_completed() -> None:
    """The shell gets commands and options for what has been typed, and exit code 0."""
    asked = {"_PERSID_COMPLETE": "bash_complete", "COMP_WORDS": "persid certify --ex", "COMP_CWORD": "2"}
    words = [sys.executable, "-m", "persid"]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=_environment() | asked)
    assert (done.returncode, done.stderr) == (0, "")
    assert "--explain" in done.stdout


@pytest.mark.parametrize("name", sorted(cli.persid.commands))
def test_every_command_can_be_quiet_and_speak_json(name: str) -> None:
    """--json, --quiet and --debug are options of every command."""
    options = {word for parameter in cli.persid.commands[name].params for word in parameter.opts}
    assert {"--json", "--quiet", "--debug"} <= options


@pytest.mark.parametrize(
    ("line", "bar"), [("3 of 4 chunks", "[###############.....] "), ("0 of 0", ""), ("working", "")]
)
def test_bars(line: str, bar: str) -> None:
    """A line of progress that counts has a bar before it."""
    assert talk.with_bar(line) == bar + line


def test_command_line_pages_are_up_to_date() -> None:
    """docs/command-line.md is what --help prints."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "make_command_line.py"), "--check"], env=_environment(), check=False
    )
    assert done.returncode == 0, "run python docs/make_command_line.py"
