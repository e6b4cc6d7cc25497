"""One certificate of format 2, one answer."""

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from persid_check.identity import Meant, require_same
from persid_check.ledger import COMPANION, MAX_BYTES
from persid_check.ledger.file import read_ledger
from persid_check.ledger.sentences import statement, steps
from persid_check.ledger.theorem import prove
from persid_check.ledger.values import Ledger
from persid_check.results import Accepted, FormatError, require
from persid_check.work import allowance, limited

if TYPE_CHECKING:
    from persid_check.companion import Arrays

ENTRIES = 10**6  # of a matrix, and more for each byte


def check_ledger(
    data: Mapping[str, object],
    size: int,
    wanted: Meant | None,
    folder: Path | None = None,
    content: bytes | None = None,
) -> Accepted:
    """Return what is proved by a file of `size` bytes with its companion, in a folder or given, or raise.

    Raises:
        FormatError, NotProvedError: it is malformed, or not proved, or not about the model that is meant.
    """
    if size > MAX_BYTES:
        raise FormatError("file", f"more than {MAX_BYTES} bytes")
    arrays = {} if data.get(COMPANION) is None else _gathered(data, folder, content)
    beside = sum(array.nbytes for array in arrays.values())
    with limited(allowance(size), size + beside):
        ledger = read_ledger(data, arrays)
        require_same(ledger.form, ledger.sha256, wanted, None if ledger.outputs is None else ledger.outputs.sha256)
        _require_written(ledger, size + beside)
        proved = prove(ledger)
    return Accepted(ledger.claim, statement(ledger, proved), steps(ledger, proved), proved.further)


def _require_written(ledger: Ledger, size: int) -> None:
    """Refuse matrices that are far larger than the file and its companion."""
    columns = sum(len(deviation.columns) for deviation in ledger.deviations)
    width = ledger.entries + ledger.inputs + columns + len(ledger.inside)
    written = max(width, len(ledger.points)) * width <= ENTRIES + 4 * size
    require(written, "model", "its matrices are too large for a file of this length")


def _gathered(data: Mapping[str, object], folder: Path | None, content: bytes | None) -> "Arrays":
    from persid_check.ledger.arrays import gathered

    return gathered(data, folder, content)
