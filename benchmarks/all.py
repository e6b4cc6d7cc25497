"""Every table and picture by one command: the benchmarks one after the other, then the pictures.

    python benchmarks/all.py [names]      without names: all of them, about an hour and a half on one core

Peers that need an environment of their own are found by PYTHON_OF_PYKOOP and PYTHON_OF_PYKOOPMAN, the paths of the
Pythons of these environments; where a peer is absent its rows say "not installed".
"""

import os
import subprocess
import sys
import time
from pathlib import Path

from children import RESULTS, THREADS

NAMES = (
    "speed", "power", "agreement", "scaling", "verdicts", "networks", "out_of_core", "peers_identification",
    "peers_accuracy", "admits_failure", "growth", "public", "published", "plants", "margins", "pictures",
)  # fmt: skip


def main(names: list[str]) -> int:
    """Run benchmarks; return 1 where one of them failed."""
    folder, failed = RESULTS.parent, []
    source = {"PYTHONPATH": str(folder.parent / "src")}
    for name in names or [name for name in NAMES if (folder / f"{name}.py").is_file()]:
        print(f"== {name}", flush=True)
        start = time.perf_counter()
        done = subprocess.run(
            [sys.executable, str(Path(folder, f"{name}.py"))], env=os.environ | THREADS | source, check=False
        )
        print(f"== {name}: {time.perf_counter() - start:.0f} s", flush=True)
        failed += [name] if done.returncode else []
    print(f"failed: {', '.join(failed)}" if failed else "all done")
    return int(bool(failed))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
