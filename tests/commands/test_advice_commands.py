"""Diagnosis on the command line: remedies are commands to type, and typed they give what was promised."""

import json
import shlex
from pathlib import Path

import pytest

import persid as ps
from ailing import AILMENTS, diagnosed, sound
from persid.commands import cli
from persid.commands.advice import typed
from persid.reports.record import Record


def _written(data: ps.Trajectories) -> list[str]:
    """Write data.csv and return the words that identify from it."""
    names = [*data.states, *data.inputs]
    data.to_dataframe().reset_index()[["t", *names]].to_csv("data.csv", index=False)
    inputs = ["--inputs", ",".join(data.inputs)] if data.inputs else []
    return ["data.csv", "--states", ",".join(data.states), *inputs]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.long
@pytest.mark.xdist_group("ailments")
@pytest.mark.parametrize("name", AILMENTS)
def test_identify_says_what_ails_the_data(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every kind stands in --json with the command that is to be typed."""
    ailment, diagnosis = AILMENTS[name], diagnosed(name)  # the commands make the same one, in a test below
    monkeypatch.setattr("persid.identification.advice.advise", lambda *_, **__: diagnosis)
    words = [
        "identify",
        *_written(ailment.make()),
        "--functions",
        ",".join(ailment.functions),
        "-o",
        "m.json",
        "--json",
    ]
    assert cli.main(words) == 0
    found = json.loads(capsys.readouterr().out)["diagnosis"]
    advice = next(one for one in (*found["remedies"], *found["findings"]) if one["kind"] == ailment.kind)
    if ailment.option is None:
        assert advice["command"] == ""
    else:
        assert shlex.join(ailment.option) in advice["command"]
        assert advice["command"].startswith("persid ")


@pytest.mark.long
@pytest.mark.parametrize("name", ["position", "dead time", "codes", "fast"])
def test_the_command_that_is_named_cures(name: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Typed as it stands, the best remedy gives a model that foretells, and nothing is left to advise."""
    words = ["identify", *_written(AILMENTS[name].make()), "--functions", "x", "-o", "m.json"]
    assert cli.main([*words, "--json"]) == 0
    command = json.loads(capsys.readouterr().out)["diagnosis"]["remedies"][0]["command"]
    assert cli.main(shlex.split(command)[1:]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["free_run"]["r2"] > 0.99
    assert found["diagnosis"]["remedies"] == []


def test_a_good_fit_hears_nothing(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """No row of advice stands in the table, and the object holds an empty diagnosis."""
    words = ["identify", *_written(sound()), "--functions", "x", "-o", "m.json"]
    assert cli.main(words) == 0
    assert not [line for line in capsys.readouterr().out.splitlines() if line.startswith(("try", "see"))]
    assert cli.main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["diagnosis"]["tried"] == 0


@pytest.mark.usefixtures("plain_page")
def test_run_prints_and_keeps_the_diagnosis(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The table of a run names the command; run.json keeps it, and the page shows it."""
    words = ["run", *_written(AILMENTS["position"].make()), "--functions", "x", "--time-limit", "5", "-o", "out"]
    cli.main(words)
    lines = capsys.readouterr().out.splitlines()
    row = next(line for line in lines if line.startswith("try"))
    assert "--derivatives 1" in row
    record = Record.load(Path("out"))
    assert record is not None
    assert record.diagnosis is not None
    assert record.diagnosis.remedies[0].kind == "velocity"


@pytest.mark.usefixtures("plain_page")
@pytest.mark.parametrize(("delay", "seconds"), [("u=2.0", 2.0), ("u=2000 ms", 2.0), ("u=0.05 min", 3.0)])
def test_dead_times_carry_a_unit(delay: str, seconds: float, folder: Path) -> None:
    """--delay takes seconds, or a number with its unit; every command that reads measurements has it."""
    words = _written(AILMENTS["dead time"].make())
    how = ["--functions", "x", "--ridge", "1e-6", "--delay", delay]
    assert cli.main(["run", *words, *how, "--time-limit", "5", "-o", "out", "-q"]) in (0, 1, 3)
    record = Record.load(Path("out"))
    assert record is not None
    assert record.reading["delay"] == {"u": seconds}
    assert cli.main(["score", "out/model.json", "data.csv", "--delay", delay, "-q"]) == 0


@pytest.mark.long
def test_a_report_with_dead_times_is_built_again(folder: Path) -> None:
    """The page of a run with dead times shows the advice that was kept."""
    words = _written(AILMENTS["dead time"].make())
    how = ["--functions", "x", "--ridge", "1e-6", "--delay", "u=1.0", "--time-limit", "5"]
    cli.main(["run", *words, *how, "-o", "out", "-q"])
    assert cli.main(["report", "out"]) == 0
    page = Path("out/report.html").read_text()
    assert "What may help" in page
    assert "--delay u=2" in page  # the whole dead time, of which 1 s was given


@pytest.mark.parametrize("delay", ["u", "u=fast", "u=2 parsec", "v=1"])
def test_dead_times_that_say_nothing_are_refused(delay: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A wrong form, a wrong unit and an unknown input are told in the words of the command line."""
    words = _written(AILMENTS["dead time"].make())
    assert cli.main(["identify", *words, "--delay", delay, "-o", "m.json"]) == 2
    text = capsys.readouterr().err
    assert "no dead time such as u=2.0" in text or "the inputs are" in text
    assert "delay=" not in text


def test_commands_replace_what_they_change() -> None:
    """An option that is advised takes the place of the one that was typed."""
    words = ["run", "a.csv", "--states", "x,y", "--hold=zoh", "--inputs", "u v", "-o", "out"]
    assert typed((("--hold", "paper"),), words) == "persid run a.csv --states x,y --inputs 'u v' -o out --hold paper"
    assert typed((("--outputs", "x"),), words) == "persid run a.csv --hold=zoh --inputs 'u v' -o out --outputs x"
    assert typed((), words) == ""
    assert typed((("--hold", "paper"),), []) == "--hold paper"
