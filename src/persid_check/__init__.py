"""An independent checker for persid's certificates: exact arithmetic, from the file alone."""

from persid_check.check import check
from persid_check.definite import is_positive_definite
from persid_check.equilibrium import prove_equilibrium
from persid_check.model import Group, canonical_model, groups, model_sha256
from persid_check.results import Accepted, FormatError, Malformed, Rejected

__all__ = [
    "Accepted",
    "FormatError",
    "Group",
    "Malformed",
    "Rejected",
    "canonical_model",
    "check",
    "groups",
    "is_positive_definite",
    "model_sha256",
    "prove_equilibrium",
]
