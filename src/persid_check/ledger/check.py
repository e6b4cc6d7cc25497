"""One certificate of format 2, one answer."""

from typing import Any

from persid_check.ledger.file import MAX_BYTES, read_ledger
from persid_check.ledger.sentences import statement, steps
from persid_check.ledger.theorem import prove
from persid_check.model import sha256_of
from persid_check.results import Accepted, FormatError, NotProvedError
from persid_check.work import limited

STEPS = 10**5  # that the proofs of a file may take, and more for each byte
STEPS_OF_A_BYTE = 16
MOST_STEPS = 4 * 10**6
ENTRIES = 10**6  # of a matrix, and more for each byte


def check_ledger(data: Any, size: int, sha256: str | None) -> Accepted:
    """Return what is proved by a file of `size` bytes, or raise.

    Raises:
        FormatError, NotProvedError: it is malformed, or not proved, or not about the model of the hash given.
    """
    if size > MAX_BYTES:
        raise FormatError("file", f"more than {MAX_BYTES} bytes")
    ledger = read_ledger(data)
    if sha256_of(ledger.form) != ledger.sha256:
        raise NotProvedError("model_sha256", "it is not the hash of the model in the file")
    if sha256 is not None and sha256 != ledger.sha256:
        raise NotProvedError("model", "the certificate speaks of another model")
    width = ledger.entries + ledger.inputs + sum(len(deviation.columns) for deviation in ledger.deviations)
    if max(width, len(ledger.points)) * width > ENTRIES + 4 * size:
        raise NotProvedError("model", "its matrices are too large for a file of this length")
    with limited(min(STEPS + STEPS_OF_A_BYTE * size, MOST_STEPS)):
        proved = prove(ledger)
    further = {"incremental": proved.incremental, "everywhere": proved.everywhere}
    names = tuple(name for name, holds in further.items() if holds)
    return Accepted(ledger.claim, statement(ledger, proved), steps(ledger, proved), names)
