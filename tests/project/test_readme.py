"""The README's example prints what the README says."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from places import ROOT

TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def _numbers(text: str) -> list[float]:
    return [float(v) for v in re.findall(r"-?\d+\.\d+", text)]


def test_the_example_prints_what_it_says(tmp_path: Path) -> None:
    """The numbers of the Python example, run as a reader runs it, are those printed, to 5 %."""
    code = re.search(r"```python\n(.*?)```\n\n```(?:text)?\n(.*?)```", TEXT, re.S)
    assert code is not None
    (tmp_path / "examples").symlink_to(ROOT / "examples")
    environment = os.environ | {"PYTHONPATH": str(ROOT / "src")}
    done = subprocess.run(
        [sys.executable, "-c", code.group(1)], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert _numbers(done.stdout) == pytest.approx(_numbers(code.group(2)), rel=0.05)
