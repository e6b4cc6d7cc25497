"""stub"""

from persid_check.results import NotProvedError


def prove_infeasibility(claim):
    raise NotProvedError("claim", "not yet")
