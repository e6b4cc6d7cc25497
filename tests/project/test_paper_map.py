"""The paper map is complete, and what it names exists."""

import re
from importlib import import_module

import pytest

from places import ROOT, SHARED

PAPER = SHARED / "paper" / "paper.tex"
ROWS = [
    [cell.strip() for cell in line.strip("|\n ").split(" | ")]
    for line in (ROOT / "docs" / "paper-map.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| `")
]


def _exists(name: str) -> bool:
    """Whether a dotted name, below persid unless it says persid_check, or a path below the root exists."""
    if "/" in name:
        return (ROOT / name).exists()
    parts = name.split(".")
    parts = parts if parts[0] == "persid_check" else ["persid", *parts]
    for cut in range(len(parts), 0, -1):
        try:
            found = import_module(".".join(parts[:cut]))
        except ModuleNotFoundError:
            continue
        for part in parts[cut:]:
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return False


def test_every_label_of_the_paper_has_a_row() -> None:
    """Each label of the paper stands in the map once, and no other label does."""
    if not PAPER.exists():
        pytest.skip("the paper's source is not beside the project")
    text = PAPER.read_text(encoding="utf-8")
    labels = set(re.findall(r"\\label\{([^}]*)\}", text))
    named = [row[0].strip("`") for row in ROWS]
    assert sorted(named) == sorted(labels)


@pytest.mark.parametrize("row", ROWS, ids=[row[0].strip("`") for row in ROWS])
def test_what_a_row_names_exists(row: list[str]) -> None:
    """The code and the test that a row names are there."""
    assert all(_exists(name) for name in re.findall(r"`([^`]+)`", row[2]))
    assert all((ROOT / "tests" / name).exists() for name in re.findall(r"`([^`]+)`", row[3]))
