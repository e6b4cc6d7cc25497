"""Measurements at the command line: the options of readers and fits, pipes, and errors in the words of this door."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from command_line import IDENTIFY
from persid.commands import cli
from persid.commands.words import spoken
from places import ROOT, TRAFFIC


@pytest.mark.parametrize(
    ("said", "expected"),
    [
        ('missing="drop" takes', "--missing drop takes"),
        ("give the step (dt=) or name it (time=)", "give the step (--dt) or name it (--time)"),
        ("name the column (run=), ridge=0.1.", "name the column (--run-column), --ridge 0.1."),
        ("method=\"edmd\" with functions=['x', 'x**3']", '--method edmd with --functions "x,x**3"'),
        ("allow_underdetermined=True", "--allow-underdetermined"),
        ("constant=False", "--no-constant"),
        ("x_ref=... and dt=-1.0 is", "--x-ref ... and --dt -1.0 is"),
        ("time = 3 and other=4, lifetime=5", "time = 3 and other=4, lifetime=5"),
    ],
)
def test_sentences_of_the_library_name_the_options(said: str, expected: str) -> None:
    """What the library says of its arguments is said of the options of the command line."""
    assert spoken(said) == expected


FAULTS = {
    "a missing column": ("t,x1\n0,1\n1,2\n", ["no column 'x2'", "the columns are t, x1"]),
    "a missing column of a short file": ("t,x1\n", ["no column 'x2'", "the columns are t, x1"]),
    "no time": ("x1,x2,u\n0,1,1\n1,2,1\n", ["(--time)", "(--dt)"]),
    "a slow channel": (
        "t,x1,x2,u\n" + "".join(f"{k},1,{'' if k % 2 else 1},1\n" for k in range(9)), ["--missing drop"]
    ),
    "one empty cell": (
        "t,x1,x2,u\n" + "".join(f"{k},1,{'' if k == 15 else 1},1\n" for k in range(30)), ["row 17", "--missing split"]
    ),
    "repeated times": ("t,x1,x2,u\n0,1,1,1\n0,2,1,1\n", ["is repeated", "(--dt)", "(--run-column)"]),
    "constants": ("t,x1,x2,u\n" + "".join(f"{k},5,6,1\n" for k in range(9)), ["x1, x2 never vary"]),
}  # fmt: skip


@pytest.mark.parametrize("case", FAULTS)
def test_errors_speak_of_options(here: Path, case: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Bad input exits with 2, and the error offers options of the command line, never arguments of Python."""
    text, words = FAULTS[case]
    (here / "data.csv").write_text(text)
    assert cli.main(IDENTIFY) == 2
    err = capsys.readouterr().err
    for word in words:
        assert word in err
    assert "missing=" not in err
    assert "dt=" not in err
    assert not (here / "m.json").exists()


def test_every_option_that_an_error_names_exists() -> None:
    """Words that are said of options are options of a command."""
    from persid.commands.words import OPTIONS

    known = {flag for command in cli.persid.commands.values() for option in command.params for flag in option.opts}
    assert set(OPTIONS.values()) <= known


@pytest.mark.parametrize("name", ["-", "/dev/stdin"])
def test_measurements_come_through_a_pipe(here: Path, name: str) -> None:
    """A pipe is read once and whole: the model is that of the file."""
    command = [sys.executable, "-m", "persid", "identify", name, *IDENTIFY[2:-1]]
    for last, source in (("pipe.json", TRAFFIC.read_bytes()), ("file.json", None)):
        words = [str(TRAFFIC) if word == name and source is None else word for word in command]
        done = subprocess.run(
            [*words, last], input=source, capture_output=True, env={"PYTHONPATH": str(ROOT / "src")}, check=False
        )
        assert done.returncode == 0, done.stderr
    assert ps.load_model("pipe.json") == ps.load_model("file.json")


@pytest.mark.long
def test_a_run_from_a_pipe_has_its_hash(here: Path) -> None:
    """persid run reads standard input, and its record keeps the hash of what came."""
    import hashlib

    data = (here / "data.csv").read_bytes()
    words = ["run", "/dev/stdin", "--states", "x1,x2", "--inputs", "u", "--functions", "x", "-o", "out"]
    done = subprocess.run(
        [sys.executable, "-m", "persid", *words, "--time-limit", "3"], input=data, capture_output=True,
        env={"PYTHONPATH": str(ROOT / "src")}, check=False,
    )  # fmt: skip
    assert done.returncode in (0, 1, 3), done.stderr
    (source,) = json.loads((here / "out" / "run.json").read_text())["sources"]
    assert source["sha256"] == hashlib.sha256(data).hexdigest()


def test_options_of_readers(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Codes, runs, gaps and ways with missing cells reach the reader, in memory and chunk by chunk."""
    lines = (here / "data.csv").read_text().splitlines()
    rows = [f"{line},{'a' if k < 150 else 'b'}" for k, line in enumerate(lines[1:])]
    rows[40] = ",".join([*rows[40].split(",")[:1], "-9999", *rows[40].split(",")[2:]])
    (here / "data.csv").write_text("\n".join([lines[0] + ",who", *rows]) + "\n")
    options = ["--na", "-9999", "--missing", "drop", "--run-column", "who", "--gap", "1", "--functions", "x"]
    found = []
    for more in ([], ["--engine", "chunks"]):
        assert cli.main([*IDENTIFY, *options, *more, "--ridge", "0.001"]) == 0
        assert "2 runs, 299 samples" in capsys.readouterr().out
        found.append(ps.load_model("m.json"))
    assert np.allclose(found[0].A0, found[1].A0, rtol=1e-9)


OPTIONS = {
    "derivatives": (["--derivatives", "1"], {"derivatives": 1}),
    "derivatives, short": (["--derivatives"], {"derivatives": 1}),
    "delays": (["--delays", "2"], {"delays": 2}),
    "window": (["--window", "8"], {"window": 8}),
    "reference": (["--x-ref", "1,2"], {"x_ref": [1.0, 2.0]}),
    "scales": (["--scale", "2,3"], {"scale": [2.0, 3.0]}),
    "no constant": (["--no-constant"], {"constant": False}),
    "pattern": (["--pattern", "1,0; 1,1"], {"pattern": [[True, False], [True, True]]}),
    "hold": (["--hold", "paper"], {"hold": "paper"}),
    "underdetermined": (["--allow-underdetermined"], {"allow_underdetermined": True}),
}


@pytest.mark.parametrize("case", OPTIONS)
def test_options_of_fits(here: Path, case: str) -> None:
    """An option of the command line does what the argument of the estimator does."""
    words, arguments = OPTIONS[case]
    assert cli.main([*IDENTIFY, "--functions", "x,tanh(x)", "--ridge", "0.01", *words]) == 0
    data = ps.read_csv("data.csv", states=["x1", "x2"], inputs=["u"])
    fit = ps.PersidskiiIdentifier(["x", "tanh(x)"], ridge=0.01, **arguments).fit(data)
    assert ps.load_model("m.json") == fit.model_


@pytest.mark.parametrize(
    "words", [["--pattern", "1,2; 1,1"], ["--pattern", "1,1"], ["--window", "x"], ["--x-ref", "a"]]
)
def test_options_that_cannot_be_read(here: Path, words: list[str]) -> None:
    """A pattern that is not square, or holds other numbers, and words for numbers are wrong use."""
    assert cli.main([*IDENTIFY, *words]) == 2


@pytest.mark.long
def test_rates_are_printed_in_the_unit_that_is_asked_for(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A rate an hour is 3600 times one a second, rounded down, and files and JSON stay in seconds."""
    assert cli.main(["certify", "model.json", "-o", "c.json", "--time-unit", "h"]) == 0
    rate = ps.load_certificate("c.json").rate
    assert rate is not None
    shown = float(capsys.readouterr().out.split(" 1/h")[0].split()[-1])
    assert 0.999 * 3600 * rate < shown <= 3600 * rate
    assert cli.main(["certify", "model.json", "-o", "c.json", "--time-unit", "h", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["rate"] == pytest.approx(rate, rel=1e-6)
    assert cli.main(["certify", "model.json", "-o", "c.json"]) == 0
    assert " 1/s" in capsys.readouterr().out


@pytest.mark.parametrize("words", [["--derivatives", "1"], ["--delays", "1"]])
@pytest.mark.long
def test_a_run_with_more_states_is_reported(here: Path, words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """A run that appends velocities or delays ends with a report, which can be built again from the folder."""
    command = ["run", "data.csv", "--states", "x1,x2", "--inputs", "u", "--functions", "x", "--time-limit", "2"]
    assert cli.main([*command, *words, "-o", "out"]) in (0, 1, 3)
    assert ps.load_model("out/model.json").n == 4
    assert (here / "out" / "report.html").is_file()
    assert cli.main(["report", "out"]) == 0
    assert (here / "out" / "figures" / "free-run-1.png").is_file()
