"""Results: what a run found, and how it is read back from its folder."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from persid.errors import FolderError
from persid.measurements.readers import read_measurements
from persid.measurements.readers.sources import sha256
from persid.measurements.trajectories import Trajectories
from persid.models.files import load_model
from persid.reports.layout import MODEL
from persid.reports.record import Record
from persid.reports.verdict_files import read_verdict
from persid.verdicts.verdict import Verdict


@dataclass(frozen=True, eq=False)
class Results:
    """What a run found: model, verdict, the measurements where they are at hand, the record."""

    model: Any  # a PersidskiiModel or an OutputModel
    verdict: Verdict
    data: Trajectories | None
    record: Record | None


def read_results(folder: Path) -> Results:
    """Read a folder that `persid run` has written; the certificate is checked again, the measurements are read again.

    Raises:
        FolderError: files are missing, or do not belong together.
    """
    if not (folder / MODEL).is_file():
        raise FolderError(f"{folder}: there is no {MODEL}; give the folder that persid run has written (-o)")
    model = load_model(folder / MODEL)
    record = Record.load(folder)
    verdict = read_verdict(folder, model, record.attempts if record else ())
    return Results(model, verdict, _read_again(record), record)


def _read_again(record: Record | None) -> Trajectories | None:
    """Read the measurements where they still are what they were."""
    if record is None or not record.sources:
        return None
    paths = [Path(source.path) for source in record.sources]
    same = all(p.is_file() and sha256(p) == s.sha256 for p, s in zip(paths, record.sources, strict=True))
    if not same:
        return None
    reading = dict(record.reading)
    states = {name: reading.pop(name, 0) for name in ("derivatives", "delays")}
    data = read_measurements(paths, **reading)
    if not any(states.values()):
        return data
    from persid.identification.identifier import embedded

    return embedded(data, **states)
