"""Small files that people bring: each ends in a result with its caution, or in an error that says what to do."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import persid as ps
from persid.commands import cli

HOLES = "t,x,u\n0.0,1.00,0\n0.1,,0\n0.2,0.82,0\n" + "".join(
    f"{0.1 * k:.1f},{0.9**k:.4f},{int(k > 8)}\n" for k in range(3, 16)
)


@pytest.fixture
def constant(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """A file in which x never varies."""
    monkeypatch.chdir(tmp_path)
    Path("c7.csv").write_text("t,x\n" + "".join(f"{k},5\n" for k in range(7)))
    return "c7.csv"


@pytest.mark.parametrize(
    "more",
    [[], ["--method", "edmd"], ["--derivatives", "1"], ["--delays", "1"]],
    ids=lambda more: " ".join(more) or "run",
)
def test_a_constant_file_names_itself(constant: str, more: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Where nothing varies there is nothing to identify, by whatever method, and the file is named."""
    assert cli.main(["run", constant, "--states", "x", "--functions", "x", *more, "-o", "out"]) == 2
    assert "c7.csv: x never varies: there is nothing to identify" in capsys.readouterr().err


def test_a_missing_column_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A column that is not there is named beside those that are, with --dt too."""
    monkeypatch.chdir(tmp_path)
    Path("ab.csv").write_text("a,b\n0,1\n0.1,2\n0.3,1\n")
    assert cli.main(["run", "ab.csv", "--states", "y", "--dt", "0.1", "-o", "out"]) == 2
    assert "there is no column 'y'; the columns are a, b" in capsys.readouterr().err


def test_a_dozen_rows_of_noise_are_doubted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Twelve rows of noise may be certified, but never without a caution, and the page is not green."""
    monkeypatch.chdir(tmp_path)
    rows = np.random.default_rng(0).normal(size=12)
    Path("noise.csv").write_text("t,x\n" + "".join(f"{0.1 * k:.1f},{v:.4f}\n" for k, v in enumerate(rows)))
    cli.main(["run", "noise.csv", "--states", "x", "--functions", "x", "-o", "out"])
    text = capsys.readouterr().out
    assert "nothing was held out" in text
    assert 'class="verdict certified"' not in Path("out/report.html").read_text()


def test_the_hint_about_a_hole_leads_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Every way out that the error about an empty cell names ends in a result."""
    monkeypatch.chdir(tmp_path)
    Path("holes.csv").write_text(HOLES)
    words = ["identify", "holes.csv", "--states", "x", "--inputs", "u", "--functions", "x", "-o", "m.json"]
    assert cli.main(words) == 2
    said = capsys.readouterr().err
    named = [way for way in ("split", "drop", "interpolate") if f"--missing {way}" in said]
    assert named
    assert [cli.main([*words, "--missing", way]) for way in named] == [0] * len(named)


def test_dates_of_a_frame_are_seconds() -> None:
    """A column of dates in a DataFrame gives seconds since the first row."""
    frame = pd.DataFrame({"time": pd.date_range("2024-01-01", periods=6, freq="s"), "x": [5, 4, 3.2, 2.6, 2.1, 1.7]})
    assert ps.Trajectories.from_dataframe(frame, states=["x"])[0].t.tolist() == [0, 1, 2, 3, 4, 5]


def test_an_input_in_the_place_of_a_target_is_refused() -> None:
    """fit(x, u) would ignore its second argument, and says how inputs are given."""
    with pytest.raises(ps.DataError, match="u="):
        ps.PersidskiiIdentifier(["x"]).fit(np.zeros((9, 1)), np.zeros((9, 1)), dt=0.1)
