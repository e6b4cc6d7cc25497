"""Write again what pages show of the program: help texts, the rooms, printed numbers, pictures. One command.

python docs/make_all.py            everything (minutes)
python docs/make_all.py PAGE …     the printed numbers of these pages, such as README.md docs/tutorial.md
"""

import contextlib
import os
import subprocess
import sys
import tempfile
from pathlib import Path

import counting_clock
from snippets import TIME, Block, prepare, run

ROOT = Path(__file__).resolve().parents[1]
MAKERS = ("make_command_line", "make_rooms", "make_trust", "make_gallery", "make_tutorial", "make_readme")


def renewed(page: Path, folder: Path) -> str:
    """Run the blocks of a page in a folder, and return the page with what they print; seconds alone change nothing."""
    (folder / "examples").symlink_to(ROOT / "examples")
    text, names, found = page.read_text(encoding="utf-8"), {"__name__": "__main__"}, list[tuple[Block, str]]()
    with contextlib.chdir(folder):
        for block in prepare(page, folder):
            printed = run(block, names, page)
            if block.output is not None and TIME.sub("", printed.strip()) != TIME.sub("", block.output.strip()):
                found.append((block, printed.strip("\n")))
    for block, printed in reversed(found):
        text = text[: block.place[0]] + printed + text[block.place[1] :]
    return text


def main(pages: list[str]) -> None:
    """Write pages, or all of them and the pictures."""
    if not pages:
        for maker in MAKERS:
            subprocess.run([sys.executable, str(ROOT / "docs" / f"{maker}.py")], check=True, cwd=ROOT)
    listed = [Path(page).resolve() for page in pages] or [ROOT / "README.md", *sorted((ROOT / "docs").rglob("*.md"))]
    with tempfile.TemporaryDirectory() as name:  # one for all: a command that stands on several pages runs once
        for k, page in enumerate(listed):
            (folder := Path(name) / str(k)).mkdir()
            page.write_text(renewed(page, folder), encoding="utf-8")


if __name__ == "__main__":
    counting_clock.install()  # as in the tests that compare
    os.environ["SOURCE_DATE_EPOCH"] = "0"  # no date in pictures
    main(sys.argv[1:])
