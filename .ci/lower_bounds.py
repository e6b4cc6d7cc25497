"""Print the lowest versions that pyproject.toml allows, as constraints for pip: .ci/oldest.txt.

python .ci/lower_bounds.py > .ci/oldest.txt
"""

import re
import tomllib
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[1] / "pyproject.toml"
BOUND = re.compile(r"([\w-]+)(?:\[[\w,]+\])?>=([\d.]+)")


def constraints() -> str:
    """Return a line name==version for each requirement at run time, and for pytest."""
    project = tomllib.loads(PROJECT.read_text(encoding="utf-8"))["project"]
    needed = [
        *project["dependencies"],
        *(r for r in project["optional-dependencies"]["test"] if r.startswith("pytest")),
    ]
    return "".join(f"{name}=={version}\n" for name, version in (BOUND.fullmatch(one).groups() for one in needed))


if __name__ == "__main__":
    print(constraints(), end="")
