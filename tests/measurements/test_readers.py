"""Readers: files as laboratories write them, each with its right values; and doors that lead to the same table."""

import io
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import persid as ps
from persid.errors import DataError
from persid.measurements.readers import read_measurements
from places import ROOT

sys.path.insert(0, str(ROOT / "tests" / "measurements"))
from odd_files import COUNT, FORCE, PACKED, POSITION, STEP, T, all_tables, table


def put(folder: Path, content: str | bytes, name: str = "run.csv") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode("utf-8"))
    return path


@pytest.mark.long
def test_every_form_of_a_table_has_the_same_values(tmp_path):
    """Separators, decimal marks, headers, times, encodings and compressions in any combination give one run."""
    count = 0
    for odd in all_tables():
        data = read_measurements(put(tmp_path, odd.content), states=[odd.state], inputs=[odd.force], time=odd.time)
        assert len(data) == 1, odd.name
        assert np.array_equal(data[0].x[:, 0], POSITION), odd.name
        assert np.array_equal(data[0].u[:, 0], FORCE), odd.name
        assert np.allclose(data[0].t - data[0].t[0], T, rtol=0, atol=1e-7), odd.name
        count += 1
    assert count == 7 * 6 * 9


@pytest.mark.parametrize("packing", PACKED)
def test_what_was_found_is_noted(tmp_path, packing):
    """The notes name separators, decimal commas, encoding, compression, units and what was taken as the time."""
    odd = table("german", "units below", "milliseconds", "cp1252", packing)
    notes = " ".join(read_measurements(put(tmp_path, odd.content), states=["Weg"]).notes)
    for words in ("semicolons", "decimal commas", "cp1252", "row of units", "'Zeit[ms]' is taken as the time", "ms;"):
        assert words in notes
    assert packing == "plain" or packing in notes


RIGHT = {
    "sep line": ("sep=;\nt;x\n0;1,5\n1;2,5\n2;3\n", {}, [0, 1, 2], [1.5, 2.5, 3]),
    "thousands": ("t;x\n0;999,5\n1;1.000,25\n2;1.234.567\n", {}, [0, 1, 2], [999.5, 1000.25, 1234567]),
    "english thousands": ('t,x\n0,"999.5"\n1,"1,000.25"\n', {}, [0, 1], [999.5, 1000.25]),
    "swiss thousands": ("t;x\n0;999.5\n1;1'000.25\n", {}, [0, 1], [999.5, 1000.25]),
    "decimal commas far below": (
        "t;x\n" + "".join(f"{k};{k}\n" for k in range(300)) + "300;0,5\n",
        {},
        list(range(301)),
        [*range(300), 0.5],
    ),
    "comments between": ("# a\nt,x\n0,1\n# b\n1,2\n2,3 # c\n", {}, [0, 1, 2], [1, 2, 3]),
    "percent": ("% t x\n 0   1.5\n 1   2.5\n", {}, [0, 1], [1.5, 2.5]),
    "booleans": ("t,x\n0,True\n1,False\n2,TRUE\n", {}, [0, 1, 2], [1, 0, 1]),
    "a lone step": ("x,Ts,\n1,0.5,\n2,,\n4,,\n", {}, [0, 0.5, 1], [1, 2, 4]),
    "a lone step by name": ("x,h\n1,0.5\n2,\n4,\n", {"time": "h"}, [0, 0.5, 1], [1, 2, 4]),
    "times of day": ("time,x\n23:59:58,1\n23:59:59.5,2\n", {}, [86398, 86399.5], [1, 2]),
    "day before month": ("date;x\n13/02/2024 00:00;1\n13/02/2024 00:01;2\n", {}, [0, 60], [1, 2]),
    "days and months": ("date,x\n01/02/2024,1\n01/03/2024,2\n", {}, [0, 86400], [1, 2]),
    "dates of any name": ("when,x\n2024-01-01 00:00,1\n2024-01-01 00:01,2\n", {}, [0, 60], [1, 2]),
    "an index without a name": (",x\n2024-01-01 00:00,1\n2024-01-01 00:01,2\n", {}, [0, 60], [1, 2]),
    "one column of decimal commas": ("x\n1,5\n2,5\n", {"dt": 0.5}, [0, 0.5], [1.5, 2.5]),
    "quoted decimal commas": ('"t","x"\n"0,5","1,5"\n"1,5","2,5"\n', {}, [0.5, 1.5], [1.5, 2.5]),
    "a time of two words": ("Elapsed time [s],x\n0,1\n1,2\n", {}, [0, 1], [1, 2]),
    "lines that end as on old machines": ("t,x\r0,1\r1,2\r", {}, [0, 1], [1, 2]),
    "a column of texts beside": ('t,x,note\n0,1,start\n1,2,"a, b"\n', {}, [0, 1], [1, 2]),
    "hours": ("t [h],x\n0,1\n0.5,2\n", {}, [0, 1800], [1, 2]),
    "seconds since 1970": ("time,x\n1700000000.25,1\n1700000001.25,2\n", {}, [0, 1], [1, 2]),
    "numbers as names": ("773869,t\n1,0\n2,1\n", {"states": ["773869"]}, [0, 1], [1, 2]),
    "codes": ("t,x\n0,1\n1,2\n2,-9999\n3,4\n4,5\n", {"na": [-9999], "missing": "drop"}, [0, 1, 3, 4], [1, 2, 4, 5]),
    "words for missing": ("t,x\n0,1\n1,2\n2,---\n", {"na": ["---"], "missing": "split"}, [0, 1], [1, 2]),
    "a slow channel": ("t,x,u\n0,1,0\n1,,0\n2,3,1\n3,,0\n", {"missing": "drop"}, [0, 2], [1, 3]),
    "a slow channel and a step": ("x,u\n1,0\n,0\n3,1\n", {"missing": "drop", "dt": 0.5}, [0, 1], [1, 3]),
    "straight lines": ("t,x\n0,1\n1,\n3,7\n", {"missing": "interpolate"}, [0, 1, 3], [1, 3, 7]),
}


@pytest.mark.parametrize("case", RIGHT)
def test_right_values(tmp_path, case):
    """A small file of each kind has the times and values that are known."""
    text, options, t, x = RIGHT[case]
    data = read_measurements(put(tmp_path, text), **({"states": ["x"]} | options))
    assert len(data) == 1
    assert data[0].t.tolist() == t
    assert data[0].x[:, 0].tolist() == x


def test_held_inputs_are_filled_by_the_value_before(tmp_path):
    """Where missing cells are filled, an input keeps its value, since it is held between samples."""
    path = put(tmp_path, "t,x,u\n0,0,1\n1,1,\n2,2,5\n")
    data = read_measurements(path, states=["x"], inputs=["u"], missing="interpolate")
    assert data[0].u[:, 0].tolist() == [1, 1, 5]
    assert any("hold the value before" in note for note in data.notes)


def test_ambiguous_thousands_are_refused(tmp_path):
    """1.234 beside decimal commas may be either; without a cell that tells, it is no number."""
    with pytest.raises(DataError, match=r"column 'x': '.*' is not a number"):
        read_measurements(put(tmp_path, "t;x\n0;0,5\n1;1.234\n"), states=["x"])


def test_a_clock_that_starts_again_starts_a_run(tmp_path):
    """Runs one below the other in a file are told apart by their clock, and this is noted with the row."""
    rows = "".join(f"{k % 5},{k}\n" for k in range(15))
    data = read_measurements(put(tmp_path, "t,x\n" + rows), states=["x"])
    assert [run.x[:, 0].tolist() for run in data] == [[*range(5)], [*range(5, 10)], [*range(10, 15)]]
    assert "starts again at row 7" in data.notes[0]


def test_of_many_cuts_of_a_kind_the_first_are_noted(tmp_path):
    """Eighty runs below each other are not eighty notes: three, how many more, and the last of them."""
    rows = "".join(f"{k % 5},{k}\n" for k in range(400))
    data = read_measurements(put(tmp_path, "t,x\n" + rows), states=["x"])
    assert len(data) == 80
    assert len(data.notes) == 4
    assert "and 76 more times, the last: the clock starts again at row 397" in data.notes[-1]


def test_a_column_tells_runs_apart(tmp_path):
    """Rows of two runs that alternate are put together by their label."""
    rows = "".join(f"{k // 2},{k},{'ab'[k % 2]}\n" for k in range(10))
    data = read_measurements(put(tmp_path, "t,x,who\n" + rows), states=["x"], run="who")
    assert [run.x[:, 0].tolist() for run in data] == [[0, 2, 4, 6, 8], [1, 3, 5, 7, 9]]
    with pytest.raises(DataError, match="no column 'whom'; did you mean 'who'"):
        read_measurements(put(tmp_path, "t,x,who\n" + rows), states=["x"], run="whom")


def test_rows_are_named_by_their_line(tmp_path):
    """With lines above the table and comments between, an error names the line of the file."""
    text = "Prüfstand\n\n# c\nt;x\n[s];[m]\n0;1\n# d\n1;oops\n2;3\n"
    with pytest.raises(DataError, match="row 8, column 'x': 'oops'"):
        read_measurements(put(tmp_path, text), states=["x"])


def test_names_that_come_again_are_refused_where_they_stand(tmp_path):
    """A second row of names inside a file is named by its line, not taken as a time."""
    rows = "".join(f"{k},{k}\n" for k in range(5))
    with pytest.raises(DataError, match="row 7, column 't': 't' is not a time"):
        read_measurements(put(tmp_path, "t,x\n" + rows + "t,x\n" + rows), states=["x"])


def test_open_files_and_pipes_are_read_once(tmp_path):
    """An open file, binary or text, is read as its path is."""
    path = put(tmp_path, "t,x\n0,1\n1,2\n")
    with open(path) as text, open(path, "rb") as binary:
        for file in (text, binary, io.StringIO(path.read_text()), io.BytesIO(path.read_bytes())):
            assert ps.read_csv(file, states=["x"])[0].x[:, 0].tolist() == [1, 2]


def test_an_archive_of_several_files_is_refused(tmp_path):
    """Which file of an archive is meant is not guessed."""
    import zipfile

    with zipfile.ZipFile(tmp_path / "two.zip", "w") as archive:
        archive.writestr("a.csv", "t,x\n0,1\n1,2\n")
        archive.writestr("b.csv", "t,x\n0,1\n1,2\n")
    with pytest.raises(DataError, match=r"2 files \(a\.csv, b\.csv\)"):
        read_measurements(tmp_path / "two.zip", states=["x"])


def test_workbooks(tmp_path):
    """A sheet of an xlsx file reads as text does, with dates, a row of units and blank rows above."""
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook()
    book.active.append(["Versuch 3"])
    book.active.append(["Zeit [ms]", "Weg"])
    book.active.append(["ms", "mm"])
    for k in range(20):
        book.active.append([20 * k, 0.1 * k])
    book.save(tmp_path / "run.xlsx")
    data = read_measurements(tmp_path / "run.xlsx", states=["Weg"])
    assert np.allclose(data[0].t, np.arange(20) * 0.02)
    assert np.allclose(data[0].x[:, 0], np.arange(20) / 10, rtol=1e-15)


def test_matlab_files(tmp_path):
    """Vectors are columns, a matrix is several, a scalar named like a step is one; what is missing is listed."""
    from scipy.io import savemat

    x = np.arange(20.0).reshape(10, 2)
    savemat(tmp_path / "run.mat", {"X": x, "u": np.ones((1, 10)), "Ts": 0.5, "note": "text"})
    data = read_measurements(tmp_path / "run.mat", states=["X1", "X2"], inputs=["u"])
    assert np.array_equal(data[0].x, x)
    assert data[0].t.tolist() == (np.arange(10) * 0.5).tolist()
    with pytest.raises(DataError, match="the columns are X1, X2, u, Ts"):
        read_measurements(tmp_path / "run.mat", states=["y"])


def test_matlab_files_of_version_7_3(tmp_path):
    """HDF5 files of MATLAB are read by mat73."""
    pytest.importorskip("mat73")
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "run.mat", "w", userblock_size=512) as file:
        for name, value in (("t", np.arange(10.0)), ("x", np.arange(10.0) ** 2)):
            file.create_dataset(name, data=value[:, None]).attrs["MATLAB_class"] = np.bytes_("double")
    content = bytearray((tmp_path / "run.mat").read_bytes())
    content[:19] = b"MATLAB 7.3 MAT-file"
    content[124:128] = b"\x00\x02IM"
    (tmp_path / "run.mat").write_bytes(bytes(content))
    data = read_measurements(tmp_path / "run.mat", states=["x"])
    assert data[0].x[:, 0].tolist() == (np.arange(10.0) ** 2).tolist()


DATES = pd.date_range("2024-01-01", periods=COUNT, freq="20ms")
CLOCKS = {
    "datetimes": DATES,
    "zones": DATES.tz_localize("Europe/Berlin"),
    "microseconds": DATES.as_unit("us"),
    "seconds": pd.date_range("2024-01-01", periods=COUNT, freq="s").as_unit("s"),
    "durations": pd.to_timedelta(T, unit="s"),
    "periods": pd.period_range("2024-01-01", periods=COUNT, freq="20ms"),
    "ISO texts": pd.Index([date.isoformat() for date in DATES]),
    "numbers": pd.Index(T),
    "since 1970": pd.Index(DATES.as_unit("ms").asi8),
}


@pytest.mark.parametrize("clock", CLOCKS)
@pytest.mark.parametrize("door", ["index", "column", "t", "parquet", "csv", "xarray"])
def test_dates_of_any_kind_at_every_door(tmp_path, clock, door):
    """Dates, durations and numbers since 1970 give steps in s as an index, a column, an array, a file or a Dataset."""
    times = CLOCKS[clock]
    expected = np.arange(COUNT) * (1.0 if clock == "seconds" else STEP)
    frame = pd.DataFrame({"x": POSITION}, index=pd.Index(times, name="time"))
    if door == "index":
        data = ps.Trajectories.from_dataframe(frame)
    elif door == "column":
        data = ps.Trajectories.from_dataframe(frame.reset_index())
    elif door == "t":
        data = ps.Trajectories.from_arrays(POSITION[:, None], t=times, states=["x"])
    elif door == "xarray":
        pytest.importorskip("xarray")
        if clock in ("periods", "zones"):
            pytest.skip("xarray has no such times")
        data = ps.Trajectories.from_xarray(frame.to_xarray())
    else:
        if clock in ("periods", "durations"):
            frame.index = DATES.rename("time")
        if door == "parquet":
            pytest.importorskip("pyarrow")
            frame.to_parquet(tmp_path / "run.parquet")
        else:
            frame.to_csv(tmp_path / "run.csv")
        data = read_measurements(tmp_path / f"run.{door}", states=["x"])
    assert data.states == ("x",)
    assert np.allclose(data[0].t - data[0].t[0], expected, rtol=0, atol=1e-7)
    assert data[0].x[:, 0].tolist() == POSITION.tolist()


def test_a_fit_in_real_seconds_from_dates():
    """A rate of decay of 2/s is found from a frame with an index of dates."""
    t = np.arange(200) * 0.02
    frame = pd.DataFrame({"x": np.exp(-2 * t)}, index=pd.date_range("2024-01-01", periods=200, freq="20ms"))
    fit = ps.PersidskiiIdentifier(["x"], ridge=0.0, constant=False, holdout=0.0).fit(frame)
    assert fit.model_.A0[0, 0] == pytest.approx(-2.0, rel=1e-4)
    assert "dates are taken as s since 2024-01-01" in " ".join(fit.report_.notes)


def test_dask_doors_take_dates():
    """A Dask DataFrame with an index or a column of dates, and Dask arrays with dates as t, are in seconds."""
    dd = pytest.importorskip("dask.dataframe")
    t = np.arange(400) * 0.02
    x = np.exp(-2 * t)
    dates = pd.date_range("2024-01-01", periods=400, freq="20ms", name="when")
    frame = pd.DataFrame({"x": x}, index=dates)
    options = {"ridge": 0.0, "constant": False, "holdout": 0.0}
    for given in (dd.from_pandas(frame, npartitions=3), dd.from_pandas(frame.reset_index(), npartitions=3)):
        fit = ps.PersidskiiIdentifier(["x"], **options).fit(given)
        assert fit.model_.states == ("x",)
        assert fit.model_.A0[0, 0] == pytest.approx(-2.0, rel=1e-4)
    with pytest.raises(DataError, match="no times"):
        ps.PersidskiiIdentifier(["x"]).fit(dd.from_pandas(frame.reset_index(drop=True), npartitions=3))
