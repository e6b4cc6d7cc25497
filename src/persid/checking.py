"""Ask the independent checker."""

import json
from pathlib import Path

import persid_check
from persid.certificate import Certificate
from persid.model import PersidskiiModel
from persid.network_proof import NetworkCertificate, is_large
from persid_check.results import Result


def check(
    certificate: Certificate | NetworkCertificate | str | Path, model: PersidskiiModel | str | Path | None = None
) -> Result:
    """Check a certificate or the file of one; with `model`, it must be the model that the certificate speaks of.

    Returns:
        Accepted, Rejected or Malformed, as `persid_check` says; never an exception for what a file holds.

    Raises:
        OSError: a file cannot be read.
    """
    data = Path(certificate) if isinstance(certificate, str | Path) else certificate.data
    arrays = getattr(certificate, "arrays", None)
    if not (isinstance(model, PersidskiiModel) and is_large(model)):
        return persid_check.check(data, _bytes(model), arrays=arrays)
    answer = persid_check.check(data, arrays=arrays)  # a large model is compared by its hash, not written out
    stated = json.loads(data if isinstance(data, bytes) else data.read_bytes()).get("model_sha256")
    if isinstance(answer, persid_check.Accepted) and stated != model.sha256:
        return persid_check.Rejected("model", "the certificate speaks of another model")
    return answer


def _bytes(model: PersidskiiModel | str | Path | None) -> bytes | Path | None:
    if isinstance(model, PersidskiiModel):
        return json.dumps(model.to_dict()).encode("utf-8")
    return None if model is None else Path(model)
