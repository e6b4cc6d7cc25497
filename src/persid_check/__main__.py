"""python -m persid_check FILE [--model model.json] [--explain]: exit 0 accepted, 1 rejected, 2 malformed."""

import argparse
import io
import sys

from persid_check.check import check
from persid_check.results import Accepted, Rejected


def main(arguments: list[str] | None = None) -> int:
    """Check one file, print the answer, and return the exit code."""
    parser = argparse.ArgumentParser(prog="persid_check", description="Check a stability certificate, exactly.")
    parser.add_argument("file", help="certificate.json")
    parser.add_argument("--model", help="model.json, which must be the certificate's model")
    parser.add_argument("--explain", action="store_true", help="print the steps of the proof")
    options = parser.parse_args(arguments)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")
    try:
        result = check(options.file, options.model, options.explain)
    except OSError as error:
        print(f"malformed: {error.filename}: {error.strerror}", file=sys.stderr)
        return 2
    if isinstance(result, Accepted):
        print(f"accepted, claim {result.claim}: {result.statement}", *result.steps, sep="\n")
        return 0
    verdict = "rejected" if isinstance(result, Rejected) else "malformed"
    print(f"{verdict}: {result.where}: {result.why}")
    return 1 if isinstance(result, Rejected) else 2


if __name__ == "__main__":
    sys.exit(main())
