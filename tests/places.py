"""Where the tests find files: the project, the example's data, files kept for tests, data beside the project."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TRAFFIC = ROOT / "examples" / "traffic.csv"
VALID = ROOT / "tests" / "files" / "valid"
SHARED = ROOT.parent / "shared"
