"""Figures of earlier runs, and how a new run differs from them. They are recorded by this command alone:

python -m persid.studies.recorded OUT        the folder of one study, quick or full
"""

import json
import sys
from importlib import resources
from pathlib import Path

from persid._files import Json, write_atomically
from persid.studies.tables import Figure, Study

FORMAT = "persid-expected-1"
TOLERANCE = 0.1  # relative, for errors
COUNTS = 1  # blow-ups more or fewer
LEAST = 2e-4  # errors that differ by less are equal


def differences(study: Study) -> list[str]:
    """Return one sentence for each figure that is missing, new, or away from what was recorded.

    Raises:
        FileNotFoundError: nothing was recorded for this study.
    """
    file = resources.files("persid.studies") / "expected" / f"{study.name}.json"
    before = json.loads(file.read_text(encoding="utf-8"))[_size(study.quick)]["figures"]
    missing = [f"{name}: is not there any more" for name in before if name not in study.figures]
    new = [f"{name}: was never recorded" for name in study.figures if name not in before]
    moved = [
        f"{name}: {study.figures[name]!r}, recorded is {before[name]!r}"
        for name in study.figures
        if name in before and not agree(study.figures[name], before[name])
    ]
    return [*missing, *new, *moved]


def agree(found: Figure, before: Figure) -> bool:
    """Whether a figure is what it was: words exactly, counts to one, numbers to 10 %."""
    if isinstance(found, str) or isinstance(before, str) or found is None or before is None:
        return found == before
    if isinstance(found, int) and isinstance(before, int):
        return abs(found - before) <= COUNTS
    return abs(found - before) <= max(TOLERANCE * abs(before), LEAST)


def record(folder: Path) -> Path:
    """Record the figures in the tables.json of a finished study as what is expected; return the file written."""
    found = json.loads((folder / "tables.json").read_text(encoding="utf-8"))
    path = Path(__file__).with_name("expected") / f"{found['study']}.json"
    content: Json = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {"format": FORMAT}
    content |= {"study": found["study"], "tolerance": TOLERANCE}
    content[_size(found["quick"])] = _entry(found)
    write_atomically(path, json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n")
    return path


def _entry(found: Json) -> Json:
    figures = {name: float(f"{v:.4g}") if isinstance(v, float) else v for name, v in found["figures"].items()}
    return {"versions": found["versions"], "seconds": round(found["seconds"], 1), "figures": figures}


def _size(quick: bool) -> str:
    return "quick" if quick else "full"


if __name__ == "__main__":
    for name in sys.argv[1:]:
        print(record(Path(name)))
