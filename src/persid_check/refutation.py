"""stub"""

from persid_check.results import NotProvedError


def prove_refutation(claim):
    raise NotProvedError("claim", "not yet")
