"""One certificate of format 2, one answer."""

from persid_check.identity import Meant, require_same
from persid_check.ledger import MAX_BYTES
from persid_check.ledger.file import read_ledger
from persid_check.ledger.sentences import statement, steps
from persid_check.ledger.theorem import has_feedback, prove
from persid_check.results import Accepted, FormatError, NotProvedError
from persid_check.work import limited

STEPS = 10**5  # that the proofs of a file may take, and more for each byte
STEPS_OF_A_BYTE = 16
MOST_STEPS = 4 * 10**6
ENTRIES = 10**6  # of a matrix, and more for each byte


def check_ledger(data: object, size: int, wanted: Meant | None) -> Accepted:
    """Return what is proved by a file of `size` bytes, or raise.

    Raises:
        FormatError, NotProvedError: it is malformed, or not proved, or not about the model that is meant.
    """
    if size > MAX_BYTES:
        raise FormatError("file", f"more than {MAX_BYTES} bytes")
    ledger = read_ledger(data)
    require_same(ledger.form, ledger.sha256, wanted, None if ledger.outputs is None else ledger.outputs.sha256)
    width = ledger.entries + ledger.inputs + sum(len(deviation.columns) for deviation in ledger.deviations)
    width += len(ledger.inside)
    if max(width, len(ledger.points)) * width > ENTRIES + 4 * size:
        raise NotProvedError("model", "its matrices are too large for a file of this length")
    with limited(min(STEPS + STEPS_OF_A_BYTE * size, MOST_STEPS)):
        proved = prove(ledger)
    further = {
        "incremental": proved.incremental,
        "everywhere": proved.everywhere,
        "feedback": has_feedback(ledger),
    }
    names = tuple(name for name, holds in further.items() if holds)
    return Accepted(ledger.claim, statement(ledger, proved), steps(ledger, proved), names)
