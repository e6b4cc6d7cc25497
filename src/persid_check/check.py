"""One file, one answer: read strictly, prove every hypothesis, state what was proved."""

from dataclasses import replace
from pathlib import Path
from typing import Any

from flint import ctx

from persid_check import json_text
from persid_check.claims import prove_stability
from persid_check.enclosure import PRECISION
from persid_check.format import Claimed, Infeasibility, Stability, read_certificate
from persid_check.infeasibility import prove_infeasibility
from persid_check.ledger.check import check_ledger
from persid_check.ledger.file import FORMAT as LEDGER
from persid_check.model import model_sha256, sha256_of
from persid_check.network import prove_network, prove_no_weights, read_network
from persid_check.network_claims import NetworkClaim, NetworkObstruction
from persid_check.outputs import FORMAT as OUTPUT_FORMAT
from persid_check.outputs import NOTHING, Conclusions, detached, output_sha256, read_conclusions
from persid_check.refutation import prove_refutation
from persid_check.results import Accepted, FormatError, Malformed, NotProvedError, Rejected, Result
from persid_check.work import allowance, limited

Source = bytes | str | Path
Networked = NetworkClaim | NetworkObstruction


def check(source: Source, model: Source | None = None, explain: bool = True, *, arrays: bytes | None = None) -> Result:
    """Check a certificate: bytes, or the path of a file; with `model`, it must be the certificate's model.

    Never raises for what a file holds. `explain` fills in the steps of an accepted proof. The companion of a large
    network is looked for in the folder of the file, unless its bytes are given as `arrays`.

    Raises:
        OSError: a file cannot be read.

    Examples:
        >>> type(persid_check.check(b"{}")).__name__
        'Malformed'
    """
    data = _bytes(source)
    other = None if model is None else _bytes(model)
    try:
        with ctx.workprec(PRECISION):
            content = json_text.read(data, floats=False)
            if isinstance(content, dict) and content.get("format") == LEDGER:
                wanted = None if other is None else model_sha256(json_text.read(other, floats=True), _folder(model))
                answer = check_ledger(content, len(data), wanted)
                return answer if explain else replace(answer, steps=())
            plain, optional = detached(content)
            claim = _read(plain, _folder(source), arrays)
            more = NOTHING if isinstance(claim, Networked) else read_conclusions(optional, claim.subject)
            _same_model(claim, more, None if other is None else json_text.read(other, floats=True), _folder(model))
            with limited(_allowance(claim, len(data))):
                answer = _prove(claim, more)
    except FormatError as error:
        return Malformed(error.where, error.why)
    except NotProvedError as error:
        return Rejected(error.where, error.why)
    except ArithmeticError as error:
        return Rejected("arithmetic", str(error))
    return answer if explain else replace(answer, steps=())


def _bytes(source: Source) -> bytes:
    if isinstance(source, bytes):
        return source
    with Path(source).open("rb") as file:
        return file.read(json_text.MAX_BYTES + 1)


def _folder(source: Source | None) -> Path | None:
    return None if source is None or isinstance(source, bytes) else Path(source).parent


def _read(data: Any, folder: Path | None, arrays: bytes | None) -> Claimed | Networked:
    is_network = isinstance(data, dict) and data.get("claim") in ("L1", "L1-infeasible")
    return read_network(data, folder, arrays) if is_network else read_certificate(data)


def _same_model(claim: Claimed | Networked, more: Conclusions, other: Any, folder: Path | None) -> None:
    if sha256_of(claim.subject.form) != claim.subject.sha256:
        raise NotProvedError("model_sha256", "it is not the hash of the model in the file")
    if other is None:
        return
    has_outputs = isinstance(other, dict) and other.get("format") == OUTPUT_FORMAT
    if has_outputs:
        found = output_sha256(other, folder)
        if more.outputs is not None and found != more.outputs.sha256:
            raise NotProvedError("model", "the certificate speaks of other outputs, or of another model")
    if model_sha256(other["dynamics"] if has_outputs else other, folder) != claim.subject.sha256:
        raise NotProvedError("model", "the certificate speaks of another model")


def _allowance(claim: Claimed | Networked, size: int) -> int:
    return allowance(len(claim.kinds if isinstance(claim, Networked) else claim.subject.groups), size)


def _prove(claim: Claimed | Networked, more: Conclusions) -> Accepted:
    if isinstance(claim, Stability):
        return prove_stability(claim, more)
    if isinstance(claim, NetworkObstruction):
        statement, steps = prove_no_weights(claim)
    elif isinstance(claim, NetworkClaim):
        statement, steps = prove_network(claim)
    elif isinstance(claim, Infeasibility):
        statement, steps = prove_infeasibility(claim)
    else:
        statement, steps = prove_refutation(claim)
    return Accepted(claim.subject.claim, statement, steps)
