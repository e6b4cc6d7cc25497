"""Memory and processor time of a fit to measurements in Parquet files, against reading the same files once.

n = 9 states and 9 held inputs, functions x, x**3, sinh, tanh, arctan: 55 columns; ten files, row groups of 2**17 rows.
Each route runs in a process of its own, in one thread; memory is the growth of the resident set over that after the
imports. A fit reads the files twice or more, evaluates the functions and adds up the products; "read" only reads.

    OMP_NUM_THREADS=1 python benchmarks/out_of_core.py [rows] [folder]

The files are made in the folder (a temporary one by default) and removed at the end.
"""

import json
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

N, FILES, GROUP, STEP = 9, 10, 2**17, 0.01
NAMES = {"states": [f"x{k}" for k in range(N)], "inputs": [f"u{k}" for k in range(N)]}
FUNCTIONS = ["x", "x**3", "sinh(x)", "tanh(x)", "arctan(x)"]
ROUTES = ("import", "read", "weak", "edmd")
RESULTS = Path(__file__).parent / "results" / "out_of_core.json"


def make(folder: Path, rows: int) -> None:
    """Write the files, row group by row group."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    rng = np.random.default_rng(0)
    names = ["t", *NAMES["states"], *NAMES["inputs"]]
    schema = pa.schema([(name, pa.float64()) for name in names])
    for k in range(FILES):
        walk = np.zeros(N)
        with pq.ParquetWriter(folder / f"{k}.parquet", schema) as file:
            for begin in range(0, rows // FILES, GROUP):
                count = min(GROUP, rows // FILES - begin)
                path = walk + np.cumsum(rng.normal(size=(count, N)), axis=0) * 0.01
                walk = path[-1]
                t = (begin + np.arange(count)) * STEP
                table = np.column_stack([t, np.sin(path), rng.normal(size=(count, N))])
                file.write_table(pa.Table.from_arrays([pa.array(column) for column in table.T], schema=schema))


def route(name: str, folder: Path) -> None:
    """Work on the files in one way; print processor seconds and the peak of the resident set in bytes."""
    import pyarrow.parquet as pq

    import persid as ps
    from persid.identification.identifier import PersidskiiIdentifier

    began = time.process_time()
    if name == "read":
        for path in sorted(folder.glob("*.parquet")):
            with pq.ParquetFile(path) as file:
                for k in range(file.num_row_groups):
                    np.column_stack([part.to_numpy() for part in file.read_row_group(k, use_threads=False).columns])
    elif name in ("weak", "edmd"):
        data = ps.open_recordings(folder, **NAMES)
        PersidskiiIdentifier(FUNCTIONS, method=name, ridge=1e-6, holdout=0.0).fit(data)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(json.dumps({"seconds": time.process_time() - began, "bytes": peak}))


def measure(rows: int, folder: Path) -> dict[str, dict[str, float]]:
    """Run every route in a process of its own."""
    found = {}
    for name in ROUTES:
        words = [sys.executable, __file__, "--route", name, str(folder)]
        done = subprocess.run(words, capture_output=True, text=True, check=True, env=os.environ)
        found[name] = json.loads(done.stdout)
    floor = found.pop("import")["bytes"]
    raw = found["read"]["seconds"]
    for name, one in found.items():
        one["mebibytes"] = (one.pop("bytes") - floor) / 2**20
        one["ratio"] = one["seconds"] / raw
        print(
            f"{rows:>11,} rows  {name:<5} {one['seconds']:8.1f} s  {one['ratio']:5.1f} x  {one['mebibytes']:7.0f} MiB"
        )
    return found


def main() -> None:
    """Measure a tenth of the rows and all of them."""
    rows = int(float(sys.argv[1])) if len(sys.argv) > 1 else 10_000_000
    found = {}
    for count in (rows // 10, rows):
        with tempfile.TemporaryDirectory(dir=sys.argv[2] if len(sys.argv) > 2 else None) as name:
            make(Path(name), count)
            found[str(count)] = measure(count, Path(name))
    machine = {"processor": platform.machine(), "python": platform.python_version(), "numpy": np.__version__}
    content = {"states": N, "inputs": N, "columns": 55, "machine": machine, "rows": found}
    RESULTS.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    if sys.argv[1:2] == ["--route"]:
        route(sys.argv[2], Path(sys.argv[3]))
    else:
        main()
