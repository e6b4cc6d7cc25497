"""The README's example prints what the README says."""

import contextlib
import io
import os
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def _numbers(text: str) -> list[float]:
    return [float(v) for v in re.findall(r"-?\d+\.\d+", text)]


def test_the_example_prints_what_it_says(tmp_path: Path) -> None:
    """The numbers of the Python example are those printed, to 5 %."""
    code = re.search(r"```python\n(.*?)```\n\n```\n(.*?)```", TEXT, re.S)
    assert code is not None
    printed, before = io.StringIO(), Path.cwd()
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    try:
        os.chdir(tmp_path)
        with contextlib.redirect_stdout(printed):
            exec(compile(code.group(1), "README.md", "exec"), {})
    finally:
        os.chdir(before)
    assert _numbers(printed.getvalue()) == pytest.approx(_numbers(code.group(2)), rel=0.05)
