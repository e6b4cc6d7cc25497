"""Results: what a run found, and how it is read back from its folder."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from persid._files import Json
from persid.errors import FolderError
from persid.identification.derivatives import embedded
from persid.identification.descriptors import beginnings_and_ends
from persid.identification.scores import Scores, hold_out
from persid.measurements.readers import read_measurements
from persid.measurements.readers.sources import sha256
from persid.measurements.strides import strided
from persid.measurements.trajectories import Trajectories
from persid.models.descriptor import DescriptorModel
from persid.models.files import load_model
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.plants.margin import PlantMargin
from persid.reports.comparison import of_plant
from persid.reports.layout import MODEL
from persid.reports.record import Record, Source
from persid.reports.verdict_files import read_verdict
from persid.verdicts.verdict import Verdict


@dataclass(frozen=True, eq=False)
class Results:
    """What a run found: model, verdict, the measurements where they are at hand, the record.

    `held` is what the scores of the record are on, where it is at hand and the fit has not seen it; `time_limit` (s)
    is for what is proved of the plant beside the verdict.
    """

    model: PersidskiiModel | OutputModel | DescriptorModel
    verdict: Verdict
    data: Trajectories | None
    record: Record | None
    held: Trajectories | None = None
    time_limit: float | int = 60.0

    @property
    def time_unit(self) -> str:
        """The unit of time of rates and axes."""
        return self.record.time_unit if self.record else "s"

    @property
    def dynamics(self) -> PersidskiiModel:
        """The model of the states, whose outputs may be what was measured; with equations their right sides, too."""
        if isinstance(self.model, DescriptorModel):
            return self.model.rows
        return self.model.dynamics if isinstance(self.model, OutputModel) else self.model

    @property
    def hold(self) -> str:
        """How the fit took the inputs between samples."""
        return self.record.fit.hold if self.record and self.record.fit else "zoh"

    @cached_property
    def plant(self) -> PlantMargin | None:
        """What the measurements say of the plant, where the model has few columns and a residual margin."""
        return of_plant(self.verdict, self.data, self.hold, self.time_limit)


def held_out(data: Trajectories | None, scores: Scores | None) -> Trajectories | None:
    """Return the part of the measurements that was held out for scores, if any was."""
    parts = hold_out(data) if data is not None and scores is not None and scores.unseen else None
    return parts.held if parts else None


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
    if record is None:
        return Results(model, verdict, None, None)
    inputs = (model.dynamics if isinstance(model, OutputModel) else model).inputs
    data = _read_again(record.sources, record.reading, inputs)
    held = _read_again(record.test, record.reading, inputs) if record.test else _held_again(model, data, record)
    return Results(model, verdict, data, record, held)


def _held_again(model: object, data: Trajectories | None, record: Record) -> Trajectories | None:
    """Return what the fit of a model has held out of its data."""
    if isinstance(model, DescriptorModel):
        return None if data is None else beginnings_and_ends(data)[1]
    return held_out(data, record.scores)


def _read_again(sources: Sequence[Source], reading: Json, inputs: Sequence[str]) -> Trajectories | None:
    """Read measurements where they still are what they were, with the inputs named."""
    paths = [Path(source.path) for source in sources]
    if not paths or not all(p.is_file() and sha256(p) == s.sha256 for p, s in zip(paths, sources, strict=True)):
        return None
    how = dict(reading)
    states, stride = {name: how.pop(name, 0) for name in ("derivatives", "delays")}, how.pop("stride", 1)
    return strided(embedded(read_measurements(paths, **how).with_inputs(inputs), **states), stride)
