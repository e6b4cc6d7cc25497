"""Tables with odd columns and rows: what means one thing only is read and noted, anything else is refused in words."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest

import persid as ps
from persid.errors import DataError

T = np.round(0.1 * np.arange(40), 1)
U = (np.arange(40) // 7 % 2).astype(float)
X = np.round(np.cos(T), 4)
ASKED = {"states": ["x"], "inputs": ["u"]}
FRAME = pd.DataFrame({"x": X, "u": U}, index=pd.Index(T, name="t"))


def written(folder: Path, header: str, row: Callable[[int], str], end: str = "\n") -> Path:
    """Write a file of 40 rows and return its path."""
    path = folder / "odd.csv"
    path.write_text(end.join([header, *(row(k) for k in range(40)), ""]))
    return path


def right(data: ps.Trajectories) -> bool:
    """Whether data are the one run that all tests mean."""
    run = data[0]
    return (
        (len(data), data.states, data.inputs) == (1, ("x",), ("u",))
        and np.allclose(run.t, T)
        and np.array_equal(run.x[:, 0], X)
        and np.array_equal(run.u[:, 0], U)
    )


@pytest.mark.parametrize(
    "pair", [("OFF", "ON"), ("no", "yes"), ("False", "True"), ("aus", "ein"), ("Nein", "Ja"), ("falsch", "wahr")]
)
def test_words_for_a_truth_value_are_0_and_1(tmp_path: Path, pair: tuple[str, str]) -> None:
    """A switch is an input, in whatever words it was logged, and a note says so."""
    data = ps.read_csv(written(tmp_path, "t,x,u", lambda k: f"{T[k]},{X[k]},{pair[int(U[k])]}"), **ASKED)
    assert right(data)
    assert any("'u' holds" in note and "taken as 0 and 1" in note for note in data.notes)


def test_other_words_stay_an_error(tmp_path: Path) -> None:
    """Words that are no pair of truth values are named by their row."""
    path = written(tmp_path, "t,x,u", lambda k: f"{T[k]},{X[k]},{'on' if U[k] else 'no'}")
    with pytest.raises(DataError, match=r"row 2, column 'u': 'no' is not a number"):
        ps.read_csv(path, **ASKED)


@pytest.mark.parametrize("header", ["t,x,z,z,u", "t,x,,,u"])
def test_columns_that_nobody_asks_for_may_share_a_name(tmp_path: Path, header: str) -> None:
    """Only a name that is asked for has to be unique."""
    assert right(ps.read_csv(written(tmp_path, header, lambda k: f"{T[k]},{X[k]},1,2,{U[k]}"), **ASKED))


@pytest.mark.parametrize(("header", "name"), [("t,x,x,u", "x"), ("t,t,x,u", "t")])
def test_a_doubled_name_is_refused(tmp_path: Path, header: str, name: str) -> None:
    """Two columns of a name that is asked for, or of the time, are named as such."""
    with pytest.raises(DataError, match=f"there are 2 columns named '{name}'"):
        ps.read_csv(written(tmp_path, header, lambda k: f"{T[k]},{T[k]},{X[k]},{U[k]}"), **ASKED)


@pytest.mark.parametrize("end", ["\n\n", "\r\n\r\n"])
def test_blank_lines_are_left_out(tmp_path: Path, end: str) -> None:
    """Lines between the rows that hold nothing, not even a time, are no missing samples; rows keep their numbers."""
    data = ps.read_csv(written(tmp_path, "t,x,u", lambda k: f"{T[k]},{X[k]},{U[k]}", end), **ASKED)
    assert right(data)
    assert data.notes == (f"{tmp_path / 'odd.csv'}: blank lines were left out",)
    path = written(tmp_path, "t,x,u", lambda k: f"{T[k]},{'?' if k == 2 else X[k]},{U[k]}", end)
    with pytest.raises(DataError, match="row 7, column 'x'"):
        ps.read_csv(path, **ASKED)


@pytest.mark.parametrize(("missing", "said"), [("error", "the column holds nothing"), ("drop", "y holds no number")])
def test_a_column_without_a_number_is_named(missing: str, said: str) -> None:
    """Of an empty column no way with missing cells makes data: it has to be left out."""
    with pytest.raises(DataError, match=f"{said}.*leave it out"):
        ps.Trajectories.from_dataframe(FRAME.assign(y=np.nan), states=["x", "y"], inputs=["u"], missing=missing)


@pytest.mark.parametrize(
    ("state", "force"), [("x", "u"), (("tank", "x"), ("valve", "u")), ("tank.x", "valve.u")], ids=str
)
def test_columns_of_two_levels(state: Any, force: Any) -> None:
    """Columns of several levels go by their last one where that tells them apart, or by all of them."""
    frame = FRAME.set_axis(pd.MultiIndex.from_tuples([("tank", "x"), ("valve", "u")]), axis=1)
    assert right(ps.Trajectories.from_dataframe(frame, states=[state], inputs=[force]))


def test_columns_of_two_levels_that_end_alike() -> None:
    """Where the last level is no name, the levels are joined, in a fit, too."""
    frame = FRAME.set_axis(pd.MultiIndex.from_tuples([("left", "x"), ("right", "x")]), axis=1)
    assert ps.Trajectories.from_dataframe(frame).states == ("left.x", "right.x")
    assert ps.PersidskiiIdentifier(["x"], ridge=1e-3).fit(frame).model_.states == ("left.x", "right.x")


def test_a_masked_number_is_none() -> None:
    """What an array masks is never used as if it were measured."""
    x = np.ma.array(X[:, None], mask=np.arange(40)[:, None] == 5)
    with pytest.raises(DataError, match=r"x\[5, 0\] is nan"):
        ps.Trajectories.from_arrays(x, dt=0.1)
    with pytest.raises(ValueError, match="NaN"):
        ps.PersidskiiIdentifier(["x"]).fit(x, dt=0.1)
    whole = ps.Trajectories.from_arrays(np.ma.array(X[:, None]), dt=0.1)
    np.testing.assert_array_equal(whole[0].x[:, 0], X)


def test_a_dataset_has_its_times() -> None:
    """A fit takes an xarray.Dataset and the times in it; inputs have to be named first."""
    xarray = pytest.importorskip("xarray", reason="xarray is not installed")
    when = pd.date_range("2024-01-01", periods=40, freq="100ms")
    dataset = xarray.Dataset({"x": ("time", X)}, coords={"time": when})
    seconds = ps.PersidskiiIdentifier(["x"], ridge=1e-3).fit(X[:, None], t=T).model_
    found = ps.PersidskiiIdentifier(["x"], ridge=1e-3).fit(dataset).model_
    np.testing.assert_allclose(found.A0, seconds.A0, rtol=1e-9)
    with pytest.raises(DataError, match="from_xarray"):
        ps.PersidskiiIdentifier(["x"]).fit(dataset, u=U[:, None])


def test_a_row_written_twice_is_read_once(tmp_path: Path) -> None:
    """A row that repeats the one before it, time and all, is left out with a note; labels of the others stay."""
    path = written(tmp_path, "t,x,u", lambda k: "\n".join([f"{T[k]},{X[k]},{U[k]}"] * (3 if k == 7 else 1)))
    data = ps.read_csv(path, **ASKED)
    assert right(data)
    assert any("2 row(s) that repeat the row before them, the first row 10," in note for note in data.notes)
    path.write_text(path.read_text() + "3.9,7,0\n")
    with pytest.raises(DataError, match=r"row 44, column 't': time 3\.9 is repeated"):
        ps.read_csv(path, **ASKED)
