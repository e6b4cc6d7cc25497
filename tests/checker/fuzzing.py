"""Coverage-guided fuzzing: `python tests/checker/fuzzing.py ACCEPTED CORPUS [options of libFuzzer]`; needs atheris.

Every input must be answered, in bounded time. What is accepted is written to the folder ACCEPTED, to be looked at.
"""

import hashlib
import sys
from pathlib import Path

import atheris

with atheris.instrument_imports(include=["persid_check"]):
    import persid_check
    from persid_check.expression import ExpressionError, parse

KINDS = (persid_check.Accepted, persid_check.Rejected, persid_check.Malformed)


def one(data: bytes) -> None:
    """Check one input as a file, and parse it as an expression."""
    result = persid_check.check(data)
    if not isinstance(result, KINDS):
        raise TypeError(f"answered {result!r}")
    if isinstance(result, persid_check.Accepted):
        (Path(sys.argv[1]) / hashlib.sha256(data).hexdigest()[:16]).write_bytes(data)
    try:
        parse(data.decode("utf-8", "replace"))
    except ExpressionError:
        return


if __name__ == "__main__":
    atheris.Setup([sys.argv[0], *sys.argv[2:]], one)
    atheris.Fuzz()
