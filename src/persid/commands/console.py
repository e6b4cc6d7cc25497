"""What the command line says, and where: results on stdout, progress and errors on stderr."""

import json
import os
import re
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from threading import Timer

from persid.commands.words import SAID, spoken, spoken_object

BAR = 20  # characters of a bar of progress
PATIENCE = 2.0  # s of work after which a person is told what goes on
COLORS = {"certified": "32", "accepted": "32", "refuted": "31", "rejected": "31", "undecided": "33", "malformed": "31"}


@dataclass(frozen=True)
class Talk:
    """How to speak: one JSON object, or a table, or nothing; on stderr where `output`, a file of results, is stdout."""

    as_json: bool = False
    quiet: bool = False
    output: Path | None = None

    def result(self, content: Mapping[str, object], rows: Sequence[tuple[str, str]]) -> None:
        """Print a result: the object for programs, or the rows for people."""
        stream = sys.stderr if self._aside() else sys.stdout
        if self.as_json:
            print(json.dumps(spoken_object(content), allow_nan=False, default=float), file=stream)
        elif not self.quiet:
            print(table([(name, spoken(text) if name in SAID else text) for name, text in rows]), file=stream)

    def _aside(self) -> bool:
        """Whether a file of results is written to stdout (`-o /dev/stdout`): what is said of it goes to stderr."""
        if self.output is None or not self.output.exists():
            return False
        try:
            return os.path.samestat(self.output.stat(), os.fstat(sys.stdout.fileno()))
        except (OSError, ValueError):  # no descriptor
            return False

    @contextmanager
    def progress(self) -> Iterator["Progress"]:
        """Yield what takes lines of progress; it shows them on a terminal, after two seconds."""
        progress = Progress(sys.stderr.isatty() and not self.quiet)
        try:
            yield progress
        finally:
            progress.close()


class Progress:
    """Shows the newest line of progress in place."""

    def __init__(self, watched: bool) -> None:
        self._line, self._shown = "", False
        self._timer = Timer(PATIENCE, self._appear)
        self._timer.daemon = True
        if watched:
            self._timer.start()

    def __call__(self, line: str) -> None:
        """Take the newest line."""
        self._line = line
        if self._shown:
            self._draw(line)

    def close(self) -> None:
        """Take the line away."""
        self._timer.cancel()
        if self._shown:
            self._draw("")
            self._shown = False

    def _appear(self) -> None:
        self._shown = True
        self._draw(self._line)

    def _draw(self, line: str) -> None:
        width = os.get_terminal_size(sys.stderr.fileno()).columns - 1
        print(f"\r\x1b[K{with_bar(line)[:width]}", end="", file=sys.stderr, flush=True)


def with_bar(line: str) -> str:
    """Put a bar before a line that counts, such as "summing: 3 of 8 chunks"."""
    found = re.search(r"(\d+) of (\d+)", line)
    if not found or int(found[2]) == 0:
        return line
    done = BAR * min(int(found[1]), int(found[2])) // int(found[2])
    return f"[{'#' * done}{'.' * (BAR - done)}] {line}"


def table(rows: Sequence[tuple[str, str]]) -> str:
    """Return rows of a name and a text, aligned; further lines of a text are indented."""
    width = max(len(name) for name, _ in rows)
    indent = "\n" + " " * (width + 2)
    return "\n".join(f"{name:<{width}}  {paint(text)}".rstrip().replace("\n", indent) for name, text in rows)


def paint(text: str) -> str:
    """Colour a leading verdict on a terminal, unless NO_COLOR is set."""
    word = text.split(":")[0].split(",")[0].lower()
    if word not in COLORS or not sys.stdout.isatty() or os.environ.get("NO_COLOR"):
        return text
    return f"\x1b[1;{COLORS[word]}m{text[: len(word)]}\x1b[0m{text[len(word) :]}"


def complain(message: str, code: int, as_json: bool) -> None:
    """Print an error on stderr, and as the one object on stdout where that is asked for."""
    message = spoken(message)
    print(f"error: {message}", file=sys.stderr)
    if as_json:
        print(json.dumps({"error": message, "exit_code": code}))
