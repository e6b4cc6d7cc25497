"""Whether a certificate speaks of the model that is meant: of hashes alone."""

from collections.abc import Mapping
from dataclasses import dataclass

from persid_check.model import sha256_of
from persid_check.results import NotProvedError


@dataclass(frozen=True)
class Meant:
    """The hash of the model that is meant, and of that model with its outputs where it has some."""

    model: str
    outputs: str | None = None


def require_same(form: Mapping[str, object], stated: str, wanted: Meant | None, outputs: str | None = None) -> None:
    """Refuse a certificate that states a false hash, or is about another model; `outputs` is its hash of both.

    Raises:
        NotProvedError: it does.
    """
    if sha256_of(form) != stated:
        raise NotProvedError("model_sha256", "it is not the hash of the model in the file")
    if wanted is None:
        return
    if None not in (outputs, wanted.outputs) and outputs != wanted.outputs:
        raise NotProvedError("model", "the certificate speaks of other outputs, or of another model")
    if wanted.model != stated:
        raise NotProvedError("model", "the certificate speaks of another model")
