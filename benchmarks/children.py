"""Cases of a benchmark in processes of their own, measured, with limits; results kept with machine and versions.

Needs the standard library only: peers run it with the Python of their own environment.
"""

import importlib
import json
import os
import platform
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from typing import Any

RESULTS = Path(__file__).resolve().parent / "results"
PICTURES = RESULTS.parents[1] / "docs" / "images" / "benchmarks"
SHARED = RESULTS.parents[2] / "shared"
SECONDS, MEMORY = 180, 8 * 2**30
THREADS = {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL", "RAYON", "NUMBA")}
LIBRARIES = (
    "persid", "numpy", "scipy", "scikit-learn", "pandas", "pysindy", "pykoop", "pykoopman", "torch", "picos", "cvxopt",
    "cvxpy", "clarabel", "scs", "python-flint",
)  # fmt: skip


def shared_families() -> Any:
    """Return the module of random models of known truth; end with a message where it is not on this machine."""
    if not (SHARED / "families.py").is_file():
        sys.exit("families.py of the shared data is not on this machine")
    sys.path.insert(0, str(SHARED))
    return importlib.import_module("families")


def python_of(peer: str) -> str:
    """Return the Python of a peer's environment: PYTHON_OF_PYKOOP and the like, by default this one."""
    return os.environ.get(f"PYTHON_OF_{peer.upper()}", sys.executable)


def versions() -> dict[str, str]:
    """Return the versions of the libraries of this environment that matter."""
    found = {}
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def machine() -> dict[str, Any]:
    """Return what the figures depend on: processor, cores, memory, system, Python, libraries."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").is_file() else []
    models = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    bytes_ = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "processor": models[0] if models else platform.processor(),
        "cores": os.cpu_count(),
        "memory_GiB": round(bytes_ / 2**30, 1),
        "system": f"{platform.system()} {platform.machine()}",
        "python": platform.python_version(),
        "threads": 1,
        "date": time.strftime("%Y-%m-%d"),
    } | versions()


def measured(route: Callable[[], Any]) -> tuple[Any, float, float | None]:
    """Return the value of a route, its processor seconds, and the growth of the peak of resident memory in MB."""
    before = _resident("VmRSS", reset=True)
    start = time.process_time()
    value = route()
    seconds = time.process_time() - start
    peak = _resident("VmHWM")
    return value, seconds, None if before is None or peak is None else (peak - before) / 1000


def _resident(field: str, reset: bool = False) -> float | None:
    """Return a field of this process's memory in kB; `reset` lets the peak start anew (Linux only)."""
    try:
        if reset:
            Path("/proc/self/clear_refs").write_text("5")
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return None
    return next(float(line.split()[1]) for line in lines if line.startswith(field))


def child(
    script: str, *arguments: str, python: str = sys.executable, seconds: int = SECONDS, limits: bool = True
) -> dict[str, Any]:
    """Run a script of this folder; return the JSON object that it prints last, or {"answer": why not}.

    Without `limits` it has as long, as much memory and as many threads as it likes.
    """

    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))

    command = [python, "-W", "ignore", str(RESULTS.parent / script), *arguments]
    source = {"PYTHONPATH": str(RESULTS.parents[1] / "src")}
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=8 * seconds if limits else None,
            env=os.environ | (THREADS if limits else {}) | source, preexec_fn=limited if limits else None,
        )  # fmt: skip
    except (subprocess.TimeoutExpired, FileNotFoundError) as error:
        return {"answer": "time-out" if isinstance(error, subprocess.TimeoutExpired) else "not installed"}
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return {"answer": "time-out"}
    if done.returncode:
        last = (done.stderr.strip().splitlines() or [f"ended by signal {-done.returncode}"])[-1]
        absent = last.startswith("ModuleNotFoundError")
        return {"answer": "not installed" if absent else "failed", "why": last[:120]}
    return {"answer": "done"} | json.loads(done.stdout.strip().splitlines()[-1])


def kept(name: str, key: str) -> list[dict[str, Any]]:
    """Return the records that a results file has under a key; none where there is no file."""
    path = RESULTS / f"{name}.json"
    return json.loads(path.read_text(encoding="utf-8")).get(key, []) if path.is_file() else []


def keep(name: str, **content: Any) -> None:
    """Write a results file, the machine first."""
    RESULTS.mkdir(exist_ok=True)
    path = RESULTS / f"{name}.json"
    beside = path.with_suffix(".part")
    beside.write_text(json.dumps({"machine": machine()} | content, indent=1) + "\n", encoding="utf-8")
    beside.replace(path)


def joined(rows: list[dict[str, Any]], row: dict[str, Any], case: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return the records with one put in place of the older one of the same case, so that a table grows in parts."""
    return [other for other in rows if any(other.get(k) != row.get(k) for k in case)] + [row]
