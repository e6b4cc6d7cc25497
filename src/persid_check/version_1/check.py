"""One certificate of version 1, one answer: the only door to this room."""

from collections.abc import Mapping

from persid_check.identity import Meant, require_same
from persid_check.results import Accepted
from persid_check.version_1.claims import prove_stability
from persid_check.version_1.conclusions import detached, read_conclusions
from persid_check.version_1.format import read_certificate
from persid_check.work import SEARCHED, allowance, limited


def check_version_1(data: Mapping[str, object], size: int, wanted: Meant | None) -> Accepted:
    """Return what is proved by a file of `size` bytes, or raise.

    Raises:
        FormatError, NotProvedError: it is malformed, or not proved, or not about the model that is meant.
    """
    plain, optional = detached(data)
    claim = read_certificate(plain)
    subject, more = claim.subject, read_conclusions(optional, claim.subject)
    require_same(subject.form, subject.sha256, wanted, None if more.outputs is None else more.outputs.sha256)
    with limited(allowance(size, SEARCHED)):
        return prove_stability(claim, more)
