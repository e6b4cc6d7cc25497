"""The examples run, draw, and print what the gallery says that they print."""

import os
import subprocess
import sys
from pathlib import Path

import make_gallery
import pytest

from places import ROOT
from shown import numbers, words

LARGEST = 300_000  # bytes of a picture
LONGEST = 60  # lines of an example
QUICK = ("lure", "two_tanks", "duffing")  # the others run with -m long


def _run(name: str, picture: Path) -> str:
    """Run an example as a reader would, in a process of its own, with warnings as errors; return what it prints."""
    code = (
        "import sys; from pathlib import Path; import make_gallery as g; print(g.run(sys.argv[1], Path(sys.argv[2])))"
    )
    environment = os.environ | {"PYTHONPATH": f"{ROOT / 'src'}:{ROOT / 'docs'}", "MPLBACKEND": "agg"}
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code, name, str(picture)],
        env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


SHOWN = make_gallery.printed_before()


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.long] * (name not in QUICK)) for name in make_gallery.TITLES]
)
def test_example_prints_what_the_gallery_shows(name: str, tmp_path: Path) -> None:
    """An example runs, saves a picture of moderate size, and prints the numbers and words of its section."""
    data = getattr(make_gallery.load(name), "DATA", None)
    if data is not None and not data.is_dir():
        pytest.skip("the real measurements are not on this machine; set PERSID_DATA to their folder")
    printed = _run(name, tmp_path / "picture.svg")
    assert 5_000 < (tmp_path / "picture.svg").stat().st_size < LARGEST
    assert words(printed) == words(SHOWN[name])
    assert numbers(printed) == pytest.approx(numbers(SHOWN[name]), rel=0.1, abs=1e-9)


@pytest.mark.parametrize("name", make_gallery.TITLES)
def test_gallery_is_up_to_date(name: str) -> None:
    """The page holds the text and the source of an example as they are, and its picture is in the repository."""
    page = make_gallery.PAGE.read_text(encoding="utf-8")
    assert make_gallery.section(name, SHOWN[name]) in page, f"run python docs/make_gallery.py {name}"
    assert 5_000 < (make_gallery.PICTURES / f"{name}.svg").stat().st_size < LARGEST


def test_gallery_has_every_example() -> None:
    """Every file of examples is in the gallery, but for the one that makes data, and each is short."""
    files = {path.stem: path for path in (ROOT / "examples").glob("*.py") if not path.stem.startswith("make_")}
    assert set(files) == set(make_gallery.TITLES)
    assert max(len(path.read_text(encoding="utf-8").splitlines()) for path in files.values()) <= LONGEST
