"""Dates and times of day that stand in two columns are one time."""

from pathlib import Path

import pandas as pd
import pytest

import persid as ps

CASES = {
    "english": ("Date,Time,x", "{day}/05/2024,{hour},{x}", ("03", "04")),
    "german": ("Datum;Uhrzeit;x", "{day}.05.2024;{hour};{x}", ("03", "04")),
    "iso": ("Time,Date,x", "{hour},2024-05-{day},{x}", ("30", "31")),
}


def rows(form: str, days: tuple[str, str]) -> list[str]:
    """Ninety seconds over midnight."""
    clock = [(days[k >= 60], f"{'00:00' if k >= 60 else '23:59'}:{k % 60:02d}") for k in range(90)]
    return [form.format(day=day, hour=hour, x=k % 7) for k, (day, hour) in enumerate(clock)]


@pytest.mark.parametrize("name", CASES)
def test_date_and_time_are_joined(name: str, tmp_path: Path) -> None:
    """A column of dates and one of times of day give one run over midnight, in s from its start, and a note."""
    head, form, days = CASES[name]
    (tmp_path / "a.csv").write_text("\n".join([head, *rows(form, days)]) + "\n")
    data = ps.read_csv(tmp_path / "a.csv", states=["x"])
    assert len(data) == 1
    assert data[0].t.tolist() == list(range(90))
    assert any("are joined to one time" in note for note in data.notes)


def test_a_day_alone_and_an_hour_alone_stay_what_they_are(tmp_path: Path) -> None:
    """One column of dates, or one of times of day, is not joined with anything."""
    for head, cells in (("date", ["2024-05-01", "2024-05-02"]), ("time", ["00:00:01", "00:00:03"])):
        (tmp_path / "a.csv").write_text(
            "\n".join([f"{head},x", *(f"{cell},{k}" for k, cell in enumerate(cells))]) + "\n"
        )
        data = ps.read_csv(tmp_path / "a.csv", states=["x"])
        assert not any("joined" in note for note in data.notes)


def test_date_and_time_of_a_frame_are_joined() -> None:
    """In a DataFrame, too, with dates of the type that workbooks give."""
    frame = pd.DataFrame(
        {"Date": pd.to_datetime(["2024-05-01"] * 5), "Time": [f"10:00:0{k}" for k in range(5)], "x": range(5)}
    )
    data = ps.Trajectories.from_dataframe(frame, states=["x"])
    assert data[0].t.tolist() == [0, 1, 2, 3, 4]
