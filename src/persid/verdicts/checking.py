"""Ask the independent checker."""

import json
from pathlib import Path

import persid_check
from persid.certificates.certificate import Certificate
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.networks.certificate import NetworkCertificate, companion, load
from persid_check import json_text
from persid_check.results import FormatError, Result


def load_certificate(path: str | Path) -> Certificate | NetworkCertificate:
    """Read a certificate; the checker reads it too, and what it does not accept is refused.

    Of claim L1 it is a NetworkCertificate. A companion of large arrays is looked for in the same folder.

    Raises:
        OSError: the file, or its companion, cannot be read.
        RejectedError: the checker does not accept the file.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
        >>> ps.certify(model).certificate.save("certificate.json")
        >>> ps.load_certificate("certificate.json").model == model
        True
    """
    data, folder = Path(path).read_bytes(), Path(path).parent
    if _claim(data) == "L1":
        return load(data, folder)
    named = b'"companion"' in data and _claim(data) is not None
    return Certificate.accept(data, companion(data, folder) if named else None)


def _claim(data: bytes) -> object:
    """Return what the file names as its claim; None where it is no JSON object: the checker says why."""
    try:
        content = json_text.read(data, floats=False)
    except FormatError:
        return None
    return content.get("claim") if isinstance(content, dict) else None


def check(
    certificate: Certificate | NetworkCertificate | str | Path,
    model: PersidskiiModel | OutputModel | DescriptorModel | str | Path | None = None,
) -> Result:
    """Check a certificate or the file of one; with `model`, it must be the model that the certificate speaks of.

    Returns:
        Accepted, Rejected or Malformed, as `persid_check` says; never an exception for what a file holds.

    Raises:
        OSError: a file cannot be read.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
        >>> certificate = ps.certify(model).certificate
        >>> type(ps.check(certificate, model)).__name__
        'Accepted'
    """
    data = Path(certificate) if isinstance(certificate, str | Path) else certificate.data
    arrays = getattr(certificate, "arrays", None)
    if not (isinstance(model, PersidskiiModel) and model.is_large):
        return persid_check.check(data, _bytes(model), arrays=arrays)
    answer = persid_check.check(data, arrays=arrays)  # a large model is compared by its hash, not written out
    stated = json.loads(data if isinstance(data, bytes) else data.read_bytes()).get("model_sha256")
    if isinstance(answer, persid_check.Accepted) and stated != model.sha256:
        return persid_check.Rejected("model", "the certificate speaks of another model")
    return answer


def _bytes(model: PersidskiiModel | OutputModel | DescriptorModel | str | Path | None) -> bytes | Path | None:
    if isinstance(model, PersidskiiModel | OutputModel | DescriptorModel):
        return json.dumps(model.to_dict()).encode("utf-8")
    return None if model is None else Path(model)
