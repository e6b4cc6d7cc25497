"""Trajectories and their readers: what is accepted, what is repaired and said so, and what is refused and where."""

import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from persid.errors import DataError
from persid.measurements.opening import open_recordings
from persid.measurements.readers import read_csv, read_parquet
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory

ROWS = ["0,1,2,3", "0.1,4,5,6", "0.2,7,8,9", "0.3,1,1,1", "0.4,2,2,2"]


def write(folder: Path, rows: list[str], header: str = "t,x1,x2,u") -> Path:
    path = folder / "run.csv"
    path.write_text("\n".join([header, *rows]) + "\n")
    return path


def read(path: Path, **options) -> Trajectories:
    return read_csv(path, **({"states": ["x1", "x2"], "inputs": ["u"]} | options))


@pytest.mark.skipif(os.environ.get("CHECK_SHAPES") != "1", reason="shapes are checked with CHECK_SHAPES=1 alone")
def test_shapes_are_checked_where_asked():
    """A call that breaks a signature's shapes fails while they are checked."""
    with pytest.raises(Exception, match="type"):
        Trajectory(np.zeros(3), np.zeros((4, 1)), np.zeros((3, 1)))


def test_a_csv_file_is_read_bit_for_bit(tmp_path):
    """A decimal cell becomes the nearest binary64."""
    path = write(tmp_path, ["0,0.1,1e-3,0.30000000000000004", "1,2.2250738585072014e-308,0.7,-1"])
    run = read(path)[0]
    assert run.x[0].tolist() == [0.1, 1e-3]
    assert run.u[0, 0] == 0.30000000000000004
    assert run.x[1, 0] == 2.2250738585072014e-308


def test_blanks_around_names_are_ignored(tmp_path):
    """A header with a blank after each comma is matched in files and tables, and the notes say so."""
    data = read(write(tmp_path, ROWS, "t, x1, x2, u"))
    assert data.states == ("x1", "x2")
    assert "blanks around the names" in data.notes[0]
    frame = pd.DataFrame({"t": [0.0, 1.0], " x1": [1.0, 2.0]})
    data = Trajectories.from_dataframe(frame, ["x1"])
    assert data.states == ("x1",)
    assert "blanks" in data.notes[0]


def test_several_files_are_several_trajectories(tmp_path):
    """Files are never joined to one run."""
    path = write(tmp_path, ROWS)
    assert [len(run) for run in read([path, path])] == [5, 5]


def test_time_comes_from_a_named_column_or_from_dt(tmp_path):
    """Both ways to give the time agree."""
    path = write(tmp_path, ROWS, "clock,x1,x2,u")
    assert np.allclose(read(path, time="clock")[0].t, read(path, dt=0.1)[0].t)


def test_a_gap_in_time_starts_a_new_trajectory_and_is_noted(tmp_path):
    """A jump of many steps is not one long step."""
    data = read(write(tmp_path, [*ROWS, "99,1,1,1", "99.1,2,2,2"]))
    assert [len(run) for run in data] == [5, 2]
    assert "row 6 to row 7" in data.notes[0]


def test_missing_cells_split_where_asked(tmp_path):
    """With missing="split" an incomplete row ends a trajectory and is noted by its row."""
    data = read(write(tmp_path, [*ROWS[:2], "0.2,,8,9", *ROWS[3:]]), missing="split")
    assert [len(run) for run in data] == [2, 2]
    assert "row 4" in data.notes[0]


BROKEN = {
    "nan": ([*ROWS[:2], "0.2,nan,8,9"], {}, ["row 4", "'x1'", "NaN"]),
    "empty cell": ([*ROWS[:2], "0.2,7,,9"], {}, ["row 4", "'x2'", "empty"]),
    "infinity": ([*ROWS[:2], "0.2,7,8,inf"], {}, ["row 4", "'u'", "inf"]),
    "text": ([*ROWS[:2], "0.2,7,off,9"], {}, ["row 4", "'x2'", "'off'"]),
    "truth value": ([*ROWS[:2], "0.2,7,True,9"], {}, ["row 4", "'x2'", "True"]),
    "disorder": ([ROWS[k] for k in (0, 1, 3, 2, 4)], {}, ["row 5", "'t'", "comes after 0.3", "sort"]),
    "no header": ([ROWS[0]], {"states": ["a"]}, ["'a'", "the columns are"]),
    "a column nearly so called": (ROWS, {"states": ["x11"]}, ["did you mean 'x1'?", "t, x1, x2, u"]),
    "a column before too few rows": (ROWS[:1], {"states": ["y"]}, ["no column 'y'"]),
    "a slow channel": (["0,1,,3", "0.1,4,5,6", "0.2,7,,9"], {}, ["1 of 3 rows have a value", 'missing="drop"']),
    "a way with missing cells that is none": (ROWS, {"missing": "fill"}, ["split, drop, interpolate"]),
    "unsorted times": ([ROWS[1], ROWS[0]], {}, ["row 3", "'t'", "sort"]),
    "repeated times": ([ROWS[0], ROWS[1], "0.1,4,5,7"], {}, ["row 4", "'t'", "repeated"]),
    "too few rows": (ROWS[:1], {}, ["1 rows", "at least 2"]),
    "no rows": ([], {}, ["0 rows"]),
    "missing column": (ROWS, {"states": ["x1", "speed"]}, ["'speed'", "the columns are t, x1, x2, u"]),
    "missing time column": (ROWS, {"time": "clock"}, ["'clock'"]),
    "a row too long": ([*ROWS, "0.5,1,2,3,4,5"], {}, ["4 columns"]),
    "a row too short": ([*ROWS, "0.5,1"], {}, ["row 7", "'x2'", "empty"]),
    "both clocks": (ROWS, {"time": "t", "dt": 0.1}, ["give one"]),
    "a step that is none": (ROWS, {"dt": -1.0}, ["positive"]),
    "a name twice": (ROWS, {"inputs": ["x1"]}, ["no name twice"]),
}


UNNAMED = ("both clocks", "a step that is none", "a name twice", "a way with missing cells that is none")


@pytest.mark.parametrize("case", BROKEN)
def test_broken_files_are_refused_with_their_place(tmp_path, case):
    """Every fault of a file is an error that names file, row and column."""
    rows, options, words = BROKEN[case]
    path = write(tmp_path, rows)
    with pytest.raises(DataError) as error:
        read(path, **options)
    for word in [*words] if case in UNNAMED else ["run.csv", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("content", "word"),
    [
        (b"", "empty"),
        (b"t;x1;x2;u\n1;2;3;4\n", "1 rows"),
        (b"\xff\xfe\x00t", "no column"),
        (b"\x7fELF\x02\x01\x00\x00" + bytes(range(1, 200)) + b"\x00\x00\x00", "no text"),
        (b"\x1f\x8b\x08\x00", "unpacked as gz"),
        (b"PK\x03\x04 half an archive", "unpacked as zip"),
        (b"PAR1 and no more", "Parquet"),
        (b"MATLAB 5.0 MAT-file and no more", "MATLAB"),
        (b"x1,x1,x2,u,t\n1,1,1,1,1\n1,1,1,1,2\n", "2 columns"),
    ],
)
def test_files_that_are_no_table_are_refused(tmp_path, content, word):
    """An empty file, half a file, one that holds no text and doubled names are errors."""
    if word == "Parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / "run.csv"
    path.write_bytes(content)
    with pytest.raises(DataError, match=word):
        read(path)


def test_without_pyarrow_a_parquet_file_names_the_extra(tmp_path, monkeypatch):
    """Who lacks the library is told how to get it, in memory and chunk by chunk."""

    def absent(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name="pyarrow")

    monkeypatch.setattr("persid._libraries.import_module", absent)
    path = tmp_path / "run.parquet"
    path.write_bytes(b"PAR1")
    with pytest.raises(ImportError, match=r"persid\[dask\]"):
        read_parquet(path, states=["x"])
    with pytest.raises(ImportError, match=r"persid\[dask\]"):
        open_recordings(path, states=["x"])


def test_an_absent_file_is_named():
    """A path that does not exist is a DataError with the path."""
    with pytest.raises(DataError, match=r"nowhere\.csv"):
        read(Path("nowhere.csv"))


def test_a_table_without_any_clock_is_refused(tmp_path):
    """Time is never guessed."""
    with pytest.raises(DataError, match=r"dt=.*the columns are k, x1, x2, u"):
        read(write(tmp_path, ROWS, "k,x1,x2,u"))


def test_parquet_reads_as_csv(tmp_path):
    """The same table in Parquet gives the same trajectories."""
    pytest.importorskip("pyarrow")
    path = write(tmp_path, ROWS)
    pd.read_csv(path).to_parquet(tmp_path / "run.parquet")
    assert np.array_equal(read_parquet(tmp_path / "run.parquet", states=["x1"])[0].x, read(path, states=["x1"])[0].x)


def test_dataframes_keep_names_and_episodes():
    """An (episode, time) index gives one run per episode."""
    frames = [pd.DataFrame({"a": [1.0, 2, 3], "v": [0.0, 0, 1]}, index=[0.0, 0.5, 1.0]) for _ in range(2)]
    data = Trajectories.from_dataframe(pd.concat(frames, keys=["up", "down"], names=["episode", "time"]), inputs=["v"])
    assert (data.states, data.inputs, len(data)) == (("a",), ("v",), 2)
    assert data[1].t.tolist() == [0, 0.5, 1]


def test_a_bad_cell_of_a_dataframe_is_named_by_its_index():
    """The error speaks of the label in the frame's index."""
    frame = pd.DataFrame({"a": [1.0, np.nan]}, index=pd.Index([10.0, 20.0], name="t"))
    with pytest.raises(DataError, match=r"row 20\.0, column 'a'"):
        Trajectories.from_dataframe(frame)


def test_arrays_make_trajectories():
    """Arrays and lists of arrays are taken with t or dt."""
    data = Trajectories.from_arrays([np.ones((3, 2)), np.ones((4, 2))], [np.ones(3), np.ones(4)], dt=0.5)
    assert (len(data), data.samples, data.inputs) == (2, 7, ("u1",))


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"x": np.ones((5, 1)), "u": np.ones((4, 1)), "dt": 1.0}, "u has 4 rows but x has 5"),
        ({"x": np.array([[1.0], [np.nan]]), "dt": 1.0}, r"x\[1, 0\]"),
        ({"x": np.ones((3, 1)), "t": [0.0, 2.0, 1.0]}, "sample 2"),
        ({"x": np.ones((3, 1))}, "either the times t or the step dt"),
        ({"x": np.ones((1, 1)), "dt": 1.0}, "two samples"),
        ({"x": np.ones((3, 1)), "dt": 0.0}, "positive"),
        ({"x": np.ones((3, 2)), "dt": 1.0, "states": ["a"]}, "2 different names"),
        ({"x": [["a"], ["b"]], "dt": 1.0}, "real numbers"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(arguments, words):
    """The message says what was given and what is needed."""
    with pytest.raises(DataError, match=words):
        Trajectories.from_arrays(**arguments)


def test_split_cuts_a_run_into_consecutive_runs():
    """No sample is lost, doubled or reordered by a split."""
    data = Trajectories.from_arrays(np.arange(23.0)[:, None], dt=1.0)
    pieces = data.split(5)
    assert len(pieces) == 5
    assert np.array_equal(np.concatenate([run.x for run in pieces]), data[0].x)
    with pytest.raises(DataError, match="at least 24"):
        data.split(12)


def test_the_real_measurements_are_read(measurements):
    """A header with blanks is repaired; a clock that repeats itself is refused, and reads with dt."""
    qube = sorted((measurements / "qube").glob("*.csv"))[0]
    assert read_csv(qube, states=["theta", "alpha"], inputs=["feedforward"]).samples == 10_000
    rig = measurements / "faster" / "faster.csv"
    with pytest.raises(DataError, match=r"row 12902, column 't': time 100\.01 is repeated"):
        read_csv(rig, states=["y"], inputs=["r", "d"])
    assert read_csv(rig, states=["y"], inputs=["r", "d"], dt=0.007753).samples == 21_275


def test_data_are_printed_in_one_line() -> None:
    """Runs say how large they are instead of printing every sample."""
    data = Trajectories.from_arrays([np.zeros((500, 2)), np.ones((20, 2))], dt=0.5)
    assert repr(data) == "Trajectories(2 runs, 520 samples, states ('x1', 'x2'), inputs ())"
    assert repr(data[1]) == "Trajectory(20 samples, 2 states, 0 inputs, t = 0 ... 9.5 s)"
