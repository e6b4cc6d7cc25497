"""Ask the independent checker."""

import json
from pathlib import Path

import persid_check
from persid.certificate import Certificate
from persid.model import PersidskiiModel
from persid_check.results import Result


def check(certificate: Certificate | str | Path, model: PersidskiiModel | str | Path | None = None) -> Result:
    """Check a certificate or the file of one; with `model`, it must be the model that the certificate speaks of.

    Returns:
        Accepted, Rejected or Malformed, as `persid_check` says; never an exception for what a file holds.

    Raises:
        OSError: a file cannot be read.
    """
    source = certificate.data if isinstance(certificate, Certificate) else Path(certificate)
    return persid_check.check(source, _bytes(model))


def _bytes(model: PersidskiiModel | str | Path | None) -> bytes | Path | None:
    if isinstance(model, PersidskiiModel):
        return json.dumps(model.to_dict()).encode("utf-8")
    return None if model is None else Path(model)
