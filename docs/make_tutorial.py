"""Draw docs/images/tutorial/ by following the tutorial: its command, then its Python, in a temporary folder.

python docs/make_tutorial.py
"""

import contextlib
import os
import re
import shlex
import shutil
import tempfile
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("agg")
mpl.rcParams |= {"svg.hashsalt": "tutorial", "figure.facecolor": "white"}

from persid.commands.cli import main  # noqa: E402

ROOT = Path(__file__).resolve().parents[1]
PICTURES = ROOT / "docs" / "images" / "tutorial"


def follow(folder: Path) -> None:
    """Run the tutorial's blocks in a folder, which receives the pictures."""
    (folder / "examples").symlink_to(ROOT / "examples")
    text = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    names: dict[str, Any] = {}
    with contextlib.chdir(folder):
        for language, block in re.findall(r"^```(sh|python)\n(.*?)^```$", text, re.S | re.M):
            if language == "python":
                exec(compile(block, "tutorial.md", "exec"), names)
            elif block.startswith((".venv/bin/persid ", "persid ")):
                main(shlex.split(block)[1:])


if __name__ == "__main__":
    os.environ["SOURCE_DATE_EPOCH"] = "0"  # no date in the pictures
    PICTURES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as name:
        follow(Path(name))
        for picture in Path(name).glob("*.svg"):
            shutil.copy(picture, PICTURES / picture.name)
