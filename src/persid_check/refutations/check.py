"""One refutation or obstruction, one answer."""

from collections.abc import Mapping

from persid_check.identity import Meant, require_same
from persid_check.refutations.format import Obstruction, Refutation, read_obstruction, read_refutation
from persid_check.refutations.obstruction import prove_obstruction
from persid_check.refutations.refutation import prove_refutation
from persid_check.results import Accepted
from persid_check.work import SEARCHED, allowance, limited


def check_refutation(data: Mapping[str, object], size: int, wanted: Meant | None) -> Accepted:
    """Return what is proved by a file of `size` bytes, or raise.

    Raises:
        FormatError, NotProvedError: it is malformed, or not proved, or not about the model that is meant.
    """
    claim = read_refutation(data) if data["claim"] == "refuted" else read_obstruction(data)
    require_same(claim.subject.form, claim.subject.sha256, wanted)
    with limited(allowance(size, SEARCHED)):
        statement, steps = _proof(claim)
    return Accepted(claim.subject.claim, statement, steps)


def _proof(claim: Refutation | Obstruction) -> tuple[str, tuple[str, ...]]:
    return prove_refutation(claim) if isinstance(claim, Refutation) else prove_obstruction(claim)
