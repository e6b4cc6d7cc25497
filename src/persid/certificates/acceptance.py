"""Acceptance: nothing is a proof before `persid_check` has accepted its very bytes."""

from collections.abc import Collection

import persid_check
from persid.errors import RejectedError


def accepted(data: bytes, claims: Collection[str], arrays: bytes | None = None) -> persid_check.Accepted:
    """Return what the checker says of a file, and of its companion, that it accepts as a proof of one of the claims.

    Raises:
        RejectedError: it rejects the file or finds it malformed, or another claim is proved; the message says which.
    """
    answer = persid_check.check(data, arrays=arrays)
    if not isinstance(answer, persid_check.Accepted):
        raise RejectedError(f"the checker does not accept it: {answer.where}: {answer.why}")
    if answer.claim not in claims:
        raise RejectedError(f"the checker accepts it as {answer.claim}; needed is one of {', '.join(claims)}")
    return answer
