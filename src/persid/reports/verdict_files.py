"""The file of a verdict: a certificate, a witness, or why it is undecided; and back, checked again."""

from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from persid._files import json_object
from persid.certificates.certificate import Certificate
from persid.certificates.margin import Margin
from persid.certificates.obstruction import Obstruction
from persid.certificates.witness import Witness
from persid.errors import FolderError, RejectedError
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.networks.certificate import NetworkCertificate, NetworkObstruction, companion
from persid.reports.layout import CERTIFICATE, FASTEST, INFEASIBLE, MARGIN, MODEL, OBSTRUCTION, PLANTS, WITNESS
from persid.reports.objects import read_object, write_object
from persid.verdicts.checking import load_certificate
from persid.verdicts.summary import margin_facts
from persid.verdicts.verdict import Attempt, Certified, Refuted, Undecided, Verdict

FORMAT = "persid-obstruction-1"
MARGIN_FORMAT = "persid-margin-1"


def write_verdict(folder: Path, verdict: Verdict, model: PersidskiiModel | OutputModel | DescriptorModel) -> str:
    """Write certificate.json, witness.json or obstruction.json, whichever the verdict calls for; return its name."""
    if isinstance(verdict, Certified):
        verdict.certificate.save(folder / CERTIFICATE)
        if verdict.fastest is not None:
            verdict.fastest.save(folder / FASTEST)
        if verdict.margin is not None:
            verdict.margin.certificate.save(folder / PLANTS)
            write_object(folder / MARGIN, {"format": MARGIN_FORMAT, **margin_facts(verdict.margin)})
        return CERTIFICATE
    if isinstance(verdict, Undecided):
        proof = INFEASIBLE if verdict.obstruction else None
        about = {"format": FORMAT, "model_sha256": model.sha256, "proof": proof}
        write_object(folder / OBSTRUCTION, {**about, **verdict.to_dict()})
        if verdict.obstruction is not None:
            verdict.obstruction.save(folder / INFEASIBLE)
        return OBSTRUCTION
    verdict.witness.save(folder / WITNESS)
    return WITNESS


def read_verdict(
    folder: Path, model: PersidskiiModel | OutputModel | DescriptorModel, attempts: tuple[Attempt, ...]
) -> Verdict:
    """Return the verdict whose file stands in a folder.

    Raises:
        FolderError: there is none, the checker does not accept it, or it speaks of another model.
    """
    if (folder / CERTIFICATE).is_file():
        fastest = _proof(folder / FASTEST, model, _stability) if (folder / FASTEST).is_file() else None
        return Certified(
            _proof(folder / CERTIFICATE, model, load_certificate), attempts, fastest, _margin(folder, model)
        )
    if (folder / WITNESS).is_file():
        return Refuted(_proof(folder / WITNESS, model, _witness), attempts)
    if not (folder / OBSTRUCTION).is_file():
        files = f"{CERTIFICATE}, {WITNESS} and {OBSTRUCTION}"
        raise FolderError(f"{folder}: none of {files} is there; run persid run again")
    content = read_object(folder / OBSTRUCTION, FORMAT)
    if content.get("model_sha256") != model.sha256:
        raise FolderError(f"{folder}: {OBSTRUCTION} speaks of another model than {MODEL}; run persid run again")
    try:
        proof = _proof(folder / INFEASIBLE, model, _obstruction) if content["proof"] else None
        return Undecided.from_dict(content, proof)
    except (KeyError, TypeError) as error:
        raise FolderError(f"{folder / OBSTRUCTION}: {error} is missing or unknown") from None


def _margin(folder: Path, model: PersidskiiModel | OutputModel | DescriptorModel) -> Margin | None:
    """Return the residual margin that stands beside a certificate, its certificate checked again; None without one."""
    if not (folder / PLANTS).is_file() or not (folder / MARGIN).is_file():
        return None
    content, proof = read_object(folder / MARGIN, MARGIN_FORMAT), _proof(folder / PLANTS, model, _stability)
    try:
        width = np.array([float(content["width"][name]) for name in proof.model.states])
        largest, radius, resting = (float(content[name]) for name in ("largest", "radius", "resting"))
    except (KeyError, TypeError, ValueError) as error:
        raise FolderError(f"{folder / MARGIN}: {error} is missing or no number") from None
    return Margin(largest, radius, resting, width, tuple(content["known"]), proof)


Proof = TypeVar("Proof", Certificate | NetworkCertificate, Certificate, Witness, Obstruction | NetworkObstruction)


def _proof(path: Path, model: PersidskiiModel | OutputModel | DescriptorModel, read: Callable[[Path], Proof]) -> Proof:
    """Return a proof that the checker accepts and that speaks of this model."""
    try:
        proof = read(path)
    except RejectedError as error:
        raise FolderError(f"{path}: {error}") from None
    if proof.content["model_sha256"] != model.sha256:
        raise FolderError(f"{path}: it speaks of another model than {MODEL}; run persid run again")
    return proof


def _stability(path: Path) -> Certificate:
    proof = load_certificate(path)
    if not isinstance(proof, Certificate):
        raise FolderError(f"{path}: it is no certificate of a rate; run persid run again")
    return proof


def _witness(path: Path) -> Witness:
    return Witness.accept(path.read_bytes())


def _obstruction(path: Path) -> Obstruction | NetworkObstruction:
    data = path.read_bytes()
    arrays = companion(data, path.parent)
    if json_object(data).get("claim") == "L1-infeasible":
        return NetworkObstruction.accept(data, arrays)
    return Obstruction.accept(data)
