"""python -m persid_check FILE [--model model.json] [--explain]: the checker as a program.

Exit codes, those of every command of persid: 0 accepted, the model is proved stable; 1 accepted, it is proved not
stable, or its equations not to say what their variables are; 3 accepted, but stability is not what is proved: that no
certificate of a family exists, or practical stability; 5 rejected, the proof does not hold; 2 malformed, or wrong use;
4 internal error; 130 interrupted.
"""

import argparse
import io
import os
import sys

from persid_check.check import check
from persid_check.results import Accepted, Rejected, Result

STABLE, NOT_STABLE, WRONG, UNDECIDED, INTERNAL, REJECTED, INTERRUPTED = 0, 1, 2, 3, 4, 5, 130


def exit_code(result: Result) -> int:
    """Return the exit code of an answer."""
    if isinstance(result, Accepted):
        if result.claim.endswith("infeasible") or result.claim == "practical":  # practically stable is not stable
            return UNDECIDED
        return NOT_STABLE if result.claim == "refuted" else STABLE
    return REJECTED if isinstance(result, Rejected) else WRONG


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
        return _answer(options)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:  # nobody listens any more; keep the interpreter from complaining once more when it ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return INTERNAL
    except OSError as error:
        print(f"cannot be read or printed: {error.filename or 'output'}: {error.strerror}", file=sys.stderr)
        return WRONG
    except Exception as error:  # the border: an interpreter that ends by an exception says 1, which means refuted here
        print(f"internal error: {type(error).__name__}: {error}", file=sys.stderr)
        return INTERNAL


def _answer(options: argparse.Namespace) -> int:
    result = check(options.file, options.model, options.explain)
    if isinstance(result, Accepted):
        print(f"accepted, claim {result.claim}: {result.statement}", *result.steps, sep="\n")
    else:
        verdict = "rejected" if isinstance(result, Rejected) else "malformed"
        print(f"{verdict}: {result.where}: {result.why}")
    sys.stdout.flush()
    return exit_code(result)


if __name__ == "__main__":
    sys.exit(main())
