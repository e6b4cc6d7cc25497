"""Published stability problems: what persid answers now, beside what others have published and what is true.

    OMP_NUM_THREADS=1 python benchmarks/published.py [NAME ...] [-o benchmarks/results/published.json]

Each figure is the better the larger: the largest slope or coupling up to which models are certified for all states
(bisection to 1 %), the size of a region that is certified with no box given, or the best proved rate. Seconds are those
of the slowest single question.
"""

import argparse
import json
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import persid as ps

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "tests"))

from further_problems import FURTHER  # noqa: E402
from other_problems import OTHER  # noqa: E402
from published_problems import PUBLISHED, Published  # noqa: E402

ALL: tuple[Published, ...] = (*PUBLISHED, *FURTHER, *OTHER)


def asked(problem: Published, time_limit: float) -> dict[str, Any]:
    """Return the row of a problem."""
    slowest = 0.0

    def watched(*arguments: Any, **question: Any) -> Any:
        nonlocal slowest
        began = time.perf_counter()
        verdict = certify(*arguments, **question)
        slowest = max(slowest, time.perf_counter() - began)
        return verdict

    certify, ps.certify = ps.certify, watched
    try:
        figure = problem.largest({"time_limit": time_limit})
    finally:
        ps.certify = certify
    return {
        "problem": problem.name, "what": problem.unit, "now": figure, "before": problem.before,
        "published": problem.published, "truth": problem.truth, "seconds": round(slowest, 1), "source": problem.source,
    }  # fmt: skip


def main() -> None:
    """Ask problems, print their rows, and put these into the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="parts of names; the rows of other problems stay as they are")
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "benchmarks" / "results" / "published.json")
    parser.add_argument("--time-limit", type=float, default=60.0)
    chosen, rows = parser.parse_args(), []
    for problem in ALL:
        if chosen.names and not any(name in problem.name for name in chosen.names):
            continue
        row = asked(problem, chosen.time_limit)
        rows.append(row)
        beside = "  ".join(f"{key} {row[key]:g}" for key in ("before", "published", "truth") if row[key] is not None)
        print(
            f"{row['problem']:50.50s} {row['what']:28s} {row['now']:9.4g}  {row['seconds']:5.1f} s  {beside}",
            flush=True,
        )
    content = {"version": ps.__version__, "rows": [*merged(chosen.output, rows)]}
    chosen.output.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def merged(path: Path, rows: list[dict[str, Any]]) -> Iterator[dict[str, Any]]:
    """Yield the rows of all problems, those that were not asked from the file, in the order of the problems."""
    kept = json.loads(path.read_text(encoding="utf-8"))["rows"] if path.is_file() else []
    found = {row["problem"]: row for row in (*kept, *rows)}
    for problem in ALL:
        if problem.name in found:
            yield found[problem.name] | {"source": problem.source}


if __name__ == "__main__":
    main()
