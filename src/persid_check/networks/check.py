"""One certificate of a network, or one obstruction to it, one answer."""

from collections.abc import Mapping
from pathlib import Path

from persid_check.identity import Meant, require_same
from persid_check.networks.certificate import prove_network, prove_no_weights, read_network
from persid_check.networks.claims import NetworkClaim
from persid_check.results import Accepted
from persid_check.work import SEARCHED, allowance, limited

MOST_STEPS = 2 * 10**7  # of a network: each of its kinds is proved by a search


def check_network(
    data: Mapping[str, object], size: int, wanted: Meant | None, folder: Path | None, arrays: bytes | None
) -> Accepted:
    """Return what is proved by a file of `size` bytes with its companion, in a folder or given, or raise.

    Raises:
        FormatError, NotProvedError: it is malformed, or not proved, or not about the model that is meant.
    """
    claim = read_network(data, folder, arrays)
    require_same(claim.subject.form, claim.subject.sha256, wanted)
    with limited(allowance(size, SEARCHED, MOST_STEPS)):
        statement, steps = prove_network(claim) if isinstance(claim, NetworkClaim) else prove_no_weights(claim)
    members = isinstance(claim, NetworkClaim) and claim.members is not None
    return Accepted(claim.subject.claim, statement, steps, ("members",) * members)
