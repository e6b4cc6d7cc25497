"""An independent checker for persid's certificates: exact arithmetic, from the file alone."""

from typing import TYPE_CHECKING

from persid_check.check import check
from persid_check.definite import is_positive_definite
from persid_check.results import Accepted, FormatError, Malformed, Rejected

if TYPE_CHECKING:
    from persid_check.canonical import canonical_model, model_sha256

__all__ = [
    "Accepted",
    "FormatError",
    "Malformed",
    "Rejected",
    "canonical_model",
    "check",
    "is_positive_definite",
    "model_sha256",
]


def __getattr__(name: str) -> object:
    """Find what writes canonical forms, for which no check has a use."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from persid_check import canonical

    return getattr(canonical, name)
