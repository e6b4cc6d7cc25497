"""The command line: exit codes, files, and what is printed where."""

import json
import os
import re
import shlex
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import persid as ps
from command_line import MODEL, RUN, files, raising
from persid.commands import cli
from persid.commands import console as talk
from persid.commands import identify as fit_commands
from persid.reports import folder
from persid.verdicts.verdict import Reason, Undecided
from places import ROOT, TRAFFIC, VALID


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


def test_certify_and_check(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What persid certify writes, persid check accepts, for that model and no other."""
    assert cli.main(["certify", "model.json", "-o", "c.json", "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["verdict"], content["scope"], content["file"]) == ("certified", "global", "c.json")
    assert cli.main(["check", "c.json", "--model", "model.json", "--explain"]) == 0
    assert "accepted, claim" in capsys.readouterr().out
    assert cli.main(["check", "c.json", "--model", "unstable.json", "--json"]) == 5
    assert json.loads(capsys.readouterr().out)["result"] == "rejected"


def test_refuted_exits_with_one(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A refuted model exits with 1, and so does the check of its witness, which the checker accepts."""
    assert cli.main(["certify", "unstable.json", "-o", "w.json"]) == 1
    assert "refuted: " in capsys.readouterr().out
    assert cli.main(["check", "w.json"]) == 1
    assert "claim refuted" in capsys.readouterr().out


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


def test_an_early_interruption_leaves_nothing(
    here: Path, undecided: Undecided, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C before the fit is finished gives exit code 130 and leaves nothing."""
    monkeypatch.setattr("persid.measurements.readers.read_measurements", raising(KeyboardInterrupt()))
    before = files(here)
    assert cli.main(RUN) == 130
    assert files(here) == before
    assert not (here / "out").exists()


def test_a_finished_fit_survives_an_interruption(
    here: Path, undecided: Undecided, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C after the fit, in the search or the report, keeps the model beside older results, and says where."""
    assert cli.main(RUN) == 3
    before = {name: (here / "out" / name).read_bytes() for name in files(here / "out")}
    search = sys.modules["persid.verdicts.certify"]
    for place, stop in (
        ((search, "certify"), lambda *a, **k: Undecided(Reason.INTERRUPTED)),
        ((folder, "write_report"), raising(KeyboardInterrupt())),
    ):
        with monkeypatch.context() as patch:
            patch.setattr(*place, stop)
            assert cli.main(RUN) == 130
        assert "is kept in out/interrupted.json" in capsys.readouterr().err
        assert ps.load_model("out/interrupted.json") == ps.load_model("out/model.json")
        (here / "out" / "interrupted.json").unlink()
        assert {name: (here / "out" / name).read_bytes() for name in files(here / "out")} == before


def test_internal_error(here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """An unexpected exception gives exit code 4, one line, and a traceback only with --debug."""
    monkeypatch.setattr(fit_commands, "_identify", raising(ZeroDivisionError("by zero")))
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


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_output_that_cannot_be_printed() -> None:
    """A full or closed stdout gives exit code 2 or 4 and no traceback, never the 1 that means refuted."""
    words = [sys.executable, "-m", "persid", "--help"]
    with open("/dev/full", "w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False, env=_environment())
    assert done.returncode == 2
    assert "standard output: No space left" in done.stderr
    assert "Traceback" not in done.stderr
    reader, writer = os.pipe()
    os.close(reader)
    done = subprocess.run(words, stdout=writer, stderr=subprocess.PIPE, text=True, check=False, env=_environment())
    os.close(writer)
    assert done.returncode == 4
    assert done.stderr.count("\n") == 1


def _environment() -> dict[str, str]:
    return os.environ | {"PYTHONPATH": str(ROOT / "src")}


@pytest.mark.long
def test_ctrl_c_in_a_real_process(here: Path) -> None:
    """A process that is interrupted exits with 130 and leaves nothing."""
    code = (
        "import os, signal, sys, time, persid.commands.cli as cli, persid.commands.identify as fits;"
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


@pytest.mark.long
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

    monkeypatch.setattr("persid.verdicts.batches.certify", certify)
    (here / "second.json").write_text(json.dumps(MODEL))
    assert cli.main(["certify", "model.json", "second.json", "unstable.json", "-o", "c.json"]) == 130
    assert "1 of 3 models were decided" in capsys.readouterr().err
    assert isinstance(ps.check("model.c.json", "model.json"), ps.Accepted)
    assert not (here / "second.c.json").exists()


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


@pytest.mark.skipif(
    tuple(map(int, version("click").split(".")[:2])) < (8, 2),
    reason="the pages are those of click 8.2, which words a usage anew",
)
def test_command_line_pages_are_up_to_date() -> None:
    """docs/command-line.md is what --help prints."""
    done = subprocess.run(
        [sys.executable, str(ROOT / "docs" / "make_command_line.py"), "--check"], env=_environment(), check=False
    )
    assert done.returncode == 0, "run python docs/make_command_line.py"
