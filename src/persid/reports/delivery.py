"""Delivery: all files of a run come into its folder together, or none does."""

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from persid._files import move


@contextmanager
def delivery(folder: Path, stale: Sequence[str]) -> Iterator[Path]:
    """Yield an empty folder; when the block ends well its files move to `folder`, where older results are removed.

    `stale` are patterns of older results. When the block fails, `folder` stays as it was.
    """
    made = _make(folder)
    stage = Path(tempfile.mkdtemp(dir=folder, prefix=".persid-"))
    try:
        yield stage
        for pattern in stale:
            for old in folder.glob(pattern):
                old.unlink()
        for file in sorted(path for path in stage.rglob("*") if path.is_file()):
            target = folder / file.relative_to(stage)
            target.parent.mkdir(exist_ok=True)
            move(file, target)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        for path in made:
            with suppress(OSError):  # it holds the results
                path.rmdir()


def _make(folder: Path) -> list[Path]:
    """Create a folder and return those that did not exist before, the innermost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing
