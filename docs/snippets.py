"""The fenced blocks of a page: what runs, what it prints, and what the page says that it prints.

A block of `python` or `sh` runs; a block of text right after it is its output. tests/project/test_docs.py compares the
two, docs/make_all.py writes the outputs anew.
"""

import contextlib
import io
import re
import shlex
import shutil
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt

from persid.commands.cli import main
from persid_check.__main__ import main as check_alone

RUNNABLE = ("python", "sh", "bash")
TIME = re.compile(r"[\d.]+ s$", re.M)  # seconds at the end of a line differ from run to run
FENCE = re.compile(r"^( *)(`{3,})([^\n`]*)\n(.*?)\n\1\2 *$", re.M | re.S)
ALONE = "PYTHONPATH=src checker/bin/python -m persid_check"
ELSEWHERE = (
    "python3 -m venv",
    "checker/bin/pip",
    ".venv/bin/pip",
    ".venv/bin/pytest",
)  # what .ci/run does in a fresh environment
SHORT = ("1_000_000", "1_000")  # a network of a million states is tested with a thousand
DELIVERED: dict[tuple[str, ...], tuple[Path, str]] = {}  # what `persid run` left and printed, by its arguments


@dataclass(frozen=True)
class Block:
    """One fenced block of a page: its language, its text, and the output that the page shows for it, if any."""

    line: int
    language: str
    text: str
    output: str | None = None
    place: tuple[int, int] = (0, 0)  # of the output in the page


def blocks(path: Path) -> list[Block]:
    """Return the fenced blocks of a page; a block of text right after one that runs is its output."""
    text = path.read_text(encoding="utf-8")
    found = list(FENCE.finditer(text))
    after = {one.end(): two for one, two in pairwise(found) if not text[one.end() : two.start()].strip()}
    return [
        Block(text.count("\n", 0, match.start()) + 1, match[3].strip(), match[4], *_output(after.get(match.end())))
        for match in found
    ]


def _output(match: re.Match[str] | None) -> tuple[str | None, tuple[int, int]]:
    if match is None or match[3].strip() not in ("text", ""):
        return None, (0, 0)
    return match[4], match.span(4)


def run(block: Block, names: dict[str, object], page: Path) -> str:
    """Run a block and return what it prints."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed), mpl.rc_context({"backend": "agg"}):
        if block.language == "python":
            exec(compile("\n" * block.line + block.text.replace(*SHORT), str(page), "exec"), names)
        else:
            for command in re.sub(r"\\\n", " ", block.text).splitlines():
                for part in command.split(" && "):
                    _persid(part.split("  #")[0].strip())
    plt.close("all")
    return printed.getvalue()


def _persid(command: str) -> None:
    """Run one persid command in this process; commands of .ci/run pass, others are no part of a page.

    `persid run` takes seconds and stands on several pages: the same command is run once, and its folder copied.
    """
    if not command or command.startswith(ELSEWHERE):
        return
    if command.startswith(ALONE):
        assert check_alone(shlex.split(command.removeprefix(ALONE))) == 0
        return
    program, *arguments = shlex.split(command.removeprefix(".venv/bin/"))
    assert program == "persid", f"{command!r} is no persid command; mark the block as text"
    key = tuple(arguments)
    if key in DELIVERED:
        folder, printed = DELIVERED[key]
        shutil.copytree(folder, arguments[-1])
        print(printed)
        return
    heard = io.StringIO()
    with contextlib.redirect_stdout(heard):
        assert main(arguments) == 0, command
    print(heard.getvalue())
    if arguments[0] == "run":
        DELIVERED[key] = (Path(arguments[-1]).resolve(), heard.getvalue())


def prepare(page: Path, folder: Path) -> list[Block]:
    """Return the blocks of a page that run in a folder, which receives what a page of reference calls commands on."""
    runnable = [block for block in blocks(page) if block.language in RUNNABLE]
    text = "".join(block.text for block in runnable)
    if "certificate.json" in text and "OUT/" not in text:
        import persid as ps

        model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
        model.save(folder / "model.json")
        ps.certify(model).certificate.save(folder / "certificate.json")
    return runnable
