"""The folder of one run: all of its files are written together or not at all, and can be read back."""

import hashlib
import json
import math
import platform
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

import persid_check
from persid._files import move, write_atomically
from persid.certificates.certificate import Certificate
from persid.certificates.obstruction import Obstruction
from persid.certificates.witness import Witness
from persid.errors import FolderError, RejectedError
from persid.identification.diagnostics import Excitation, FitReport, Spectrum
from persid.identification.free_runs import Score
from persid.identification.validation import Curve
from persid.measurements.readers import read_measurements
from persid.measurements.trajectories import Trajectories
from persid.models.files import load_model
from persid.models.model import PersidskiiModel
from persid.networks.certificate import NetworkCertificate
from persid.verdicts.checking import load_certificate
from persid.verdicts.evidence import Evidence
from persid.verdicts.verdict import Attempt, Certified, Reason, Refuted, Undecided

MODEL, RECORD, REPORT, FIGURES = "model.json", "run.json", "report.html", "figures"
CERTIFICATE, WITNESS, OBSTRUCTION = "certificate.json", "witness.json", "obstruction.json"
INFEASIBLE = "infeasible.json"  # the proof of an obstruction, where there is one
RECORD_FORMAT, OBSTRUCTION_FORMAT = "persid-run-1", "persid-obstruction-1"
PACKAGES = ("persid", "numpy", "scipy", "scikit-learn", "pandas", "python-flint")


@dataclass(frozen=True)
class Source:
    """A file of measurements and the SHA-256 of its bytes."""

    path: str
    sha256: str


@dataclass(frozen=True)
class Record:
    """How the results of a run came about. `reading` holds the options of `read_csv`.

    `comparison` sets the free fit and the one under the certificate side by side, where both were made.
    """

    command: str
    sources: tuple[Source, ...]
    reading: Mapping[str, Any]
    fit: FitReport | None
    attempts: tuple[Attempt, ...]
    versions: Mapping[str, str]
    comparison: Mapping[str, Any] | None = None


@dataclass(frozen=True, eq=False)
class Results:
    """What a run found: model, verdict, the measurements where they are at hand, the record."""

    model: PersidskiiModel
    verdict: Any
    data: Trajectories | None
    record: Record | None


def sources(paths: Sequence[str | Path]) -> tuple[Source, ...]:
    """Return the files of measurements with their hashes."""
    return tuple(Source(str(path), sha256(Path(path))) for path in paths)


def sha256(path: Path) -> str:
    """Return the SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that a result depends on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found


@contextmanager
def delivery(folder: Path, stale: Sequence[str]) -> Iterator[Path]:
    """Yield an empty folder; when the block ends well its files move to `folder`, where older results are removed.

    `stale` are patterns of older results. When the block fails, `folder` stays as it was.
    """
    made = _make(folder)
    stage = Path(tempfile.mkdtemp(dir=folder, prefix=".persid-"))
    try:
        yield stage
        for pattern in stale:
            for old in folder.glob(pattern):
                old.unlink()
        for file in sorted(path for path in stage.rglob("*") if path.is_file()):
            target = folder / file.relative_to(stage)
            target.parent.mkdir(exist_ok=True)
            move(file, target)
    finally:
        shutil.rmtree(stage, ignore_errors=True)
        for path in made:
            with suppress(OSError):  # it holds the results
                path.rmdir()


def _make(folder: Path) -> list[Path]:
    """Create a folder and return those that did not exist before, the innermost first."""
    missing = [path for path in (folder, *folder.parents) if not path.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    return missing


def write_verdict(folder: Path, verdict: Any, model: PersidskiiModel) -> str:
    """Write certificate.json, witness.json or obstruction.json, whichever the verdict calls for; return its name."""
    if isinstance(verdict, Certified):
        verdict.certificate.save(folder / CERTIFICATE)
        return CERTIFICATE
    if isinstance(verdict, Undecided):
        write_atomically(folder / OBSTRUCTION, _json(_obstruction(verdict, model)))
        if verdict.obstruction is not None:
            verdict.obstruction.save(folder / INFEASIBLE)
        return OBSTRUCTION
    if not isinstance(verdict, Refuted):
        raise FolderError(f"{verdict!r} is no verdict")
    verdict.witness.save(folder / WITNESS)
    return WITNESS


def _obstruction(verdict: Undecided, model: PersidskiiModel) -> dict[str, Any]:
    return {
        "format": OBSTRUCTION_FORMAT,
        "verdict": "undecided",
        "reason": verdict.reason.name,
        "sentence": verdict.reason.value,
        "detail": verdict.detail,
        "model_sha256": model.sha256,
        "proof": INFEASIBLE if verdict.obstruction else None,
        "evidence": asdict(verdict.evidence) if verdict.evidence else None,
        "attempts": [asdict(attempt) for attempt in verdict.attempts],
    }


def write_record(folder: Path, record: Record) -> None:
    """Write run.json; paths of measurements are kept absolute."""
    absolute = tuple(Source(str(Path(s.path).resolve()), s.sha256) for s in record.sources)
    content = {"format": RECORD_FORMAT, **asdict(record), "sources": [asdict(source) for source in absolute]}
    write_atomically(folder / RECORD, _json(content))


def _json(content: Any) -> str:
    return json.dumps(_finite(content), indent=1, allow_nan=False) + "\n"


def _finite(entry: Any) -> Any:
    """Write numbers that JSON has no word for as {"float": "inf"}."""
    if isinstance(entry, Mapping):
        return {name: _finite(part) for name, part in entry.items()}
    if isinstance(entry, list | tuple):
        return [_finite(part) for part in entry]
    odd = isinstance(entry, float) and not math.isfinite(entry)
    return {"float": str(entry)} if odd else entry


def read_results(folder: Path) -> Results:
    """Read a folder that `persid run` has written; the certificate is checked again, the measurements are read again.

    Raises:
        FolderError: files are missing, or do not belong together.
    """
    if not (folder / MODEL).is_file():
        raise FolderError(f"{folder}: there is no {MODEL}; give the folder that persid run has written (-o)")
    model = load_model(folder / MODEL)
    record = _read_record(folder / RECORD) if (folder / RECORD).is_file() else None
    verdict = _read_verdict(folder, model, record.attempts if record else ())
    return Results(model, verdict, _read_again(record), record)


def _read_verdict(folder: Path, model: PersidskiiModel, attempts: tuple[Attempt, ...]) -> Any:
    if (folder / CERTIFICATE).is_file():
        return Certified(_certificate(folder / CERTIFICATE, model), attempts)
    if (folder / WITNESS).is_file():
        return Refuted(_witness(folder / WITNESS, model), attempts)
    if not (folder / OBSTRUCTION).is_file():
        files = f"{CERTIFICATE}, {WITNESS} and {OBSTRUCTION}"
        raise FolderError(f"{folder}: none of {files} is there; run persid run again")
    content = _read_object(folder / OBSTRUCTION, OBSTRUCTION_FORMAT)
    if content.get("model_sha256") != model.sha256:
        raise FolderError(f"{folder}: {OBSTRUCTION} speaks of another model than {MODEL}; run persid run again")
    try:
        proof = _infeasible(folder / INFEASIBLE, model) if content["proof"] else None
        evidence = Evidence(**_tupled(content["evidence"])) if content.get("evidence") else None
        return Undecided(Reason[content["reason"]], content["detail"], attempts, proof, evidence)
    except KeyError as error:
        raise FolderError(f"{folder / OBSTRUCTION}: {error} is missing or unknown") from None


def _certificate(path: Path, model: PersidskiiModel) -> Certificate | NetworkCertificate:
    try:
        certificate = load_certificate(path)
    except RejectedError as error:
        raise FolderError(f"{path}: {error}") from None
    if certificate.content["model_sha256"] != model.sha256:
        raise FolderError(f"{path}: it speaks of another model than {MODEL}; run persid run again")
    return certificate


def _witness(path: Path, model: PersidskiiModel) -> Witness:
    data, content, answer = _accepted(path, model, "refuted")
    return Witness(data, content["witness"]["kind"], content["statement"], answer.statement, answer.steps)


def _infeasible(path: Path, model: PersidskiiModel) -> Obstruction:
    data, _, answer = _accepted(path, model, "infeasible")
    return Obstruction(data, answer.statement)


def _accepted(path: Path, model: PersidskiiModel, claim: str) -> tuple[bytes, dict[str, Any], persid_check.Accepted]:
    """Read a file that the checker accepts as a proof of the claim about this model."""
    data = path.read_bytes()
    answer = persid_check.check(data)
    if not isinstance(answer, persid_check.Accepted) or answer.claim != claim:
        raise FolderError(f"{path}: the checker does not accept it as a proof of the claim {claim!r}: {answer}")
    content = json.loads(data)
    if content["model_sha256"] != model.sha256:
        raise FolderError(f"{path}: it speaks of another model than {MODEL}; run persid run again")
    return data, content, answer


def _read_record(path: Path) -> Record:
    content = _read_object(path, RECORD_FORMAT)
    try:
        return Record(
            command=content["command"],
            sources=tuple(Source(**source) for source in content["sources"]),
            reading=content["reading"],
            fit=None if content["fit"] is None else _fit_report(content["fit"]),
            attempts=tuple(Attempt(**attempt) for attempt in content["attempts"]),
            versions=content["versions"],
            comparison=content.get("comparison"),
        )
    except (KeyError, TypeError) as error:
        raise FolderError(f"{path}: not the record of a run: {error}") from None


def _read_object(path: Path, form: str) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"), object_hook=_number_or_object)
    except (ValueError, RecursionError) as error:
        raise FolderError(f"{path}: not JSON: {error}") from None
    if not isinstance(content, dict) or content.get("format") != form:
        raise FolderError(f'{path}: "format" should be "{form}"')
    return content


def _number_or_object(content: dict[str, Any]) -> Any:
    return float(content["float"]) if set(content) == {"float"} else content


def _fit_report(content: Mapping[str, Any]) -> FitReport:
    """Return the report of a fit from what `dataclasses.asdict` made of it."""
    values = {name: _tuples(part) for name, part in content.items()}
    for name, kind in (("curve", Curve), ("free_run", Score), ("one_step", Score), ("spectrum", Spectrum)):
        if content.get(name) is not None:
            values[name] = kind(**_tupled(content[name]))
    values["excitation"] = tuple(Excitation(**item) for item in content["excitation"])
    return FitReport(**values)


def _tupled(content: Mapping[str, Any]) -> dict[str, Any]:
    return {name: _tuples(part) for name, part in content.items()}


def _tuples(entry: Any) -> Any:
    return tuple(_tuples(part) for part in entry) if isinstance(entry, list) else entry


def _read_again(record: Record | None) -> Trajectories | None:
    """Read the measurements where they still are what they were."""
    if record is None or not record.sources:
        return None
    paths = [Path(source.path) for source in record.sources]
    same = all(p.is_file() and sha256(p) == s.sha256 for p, s in zip(paths, record.sources, strict=True))
    return read_measurements(paths, **record.reading) if same else None
