"""The record of a run: how its results came about, in run.json."""

import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, replace
from importlib import metadata
from pathlib import Path

from persid._files import Json
from persid.errors import FolderError
from persid.identification.advice import Diagnosis
from persid.identification.diagnostics import FitReport
from persid.identification.scores import Scores
from persid.measurements.readers.sources import Content, sha256
from persid.reports.layout import RECORD
from persid.reports.objects import read_object, restored, write_object
from persid.verdicts.verdict import Attempt

FORMAT = "persid-run-1"
PACKAGES = ("persid", "numpy", "scipy", "scikit-learn", "pandas", "python-flint")


@dataclass(frozen=True)
class Source:
    """A file of measurements and the SHA-256 of its bytes."""

    path: str
    sha256: str


@dataclass(frozen=True)
class Record:
    """How the results of a run came about. `reading` holds the options of `read_csv`.

    `comparison` sets the free fit and the one under the certificate side by side, where both were made; `scores` are
    the delivered model's on data that it has not seen, `test` the files that were kept from the fit for them;
    `time_unit` is that of what is shown.
    """

    command: str
    sources: tuple[Source, ...]
    reading: Json
    fit: FitReport | None
    attempts: tuple[Attempt, ...]
    versions: Mapping[str, str]
    comparison: Json | None = None
    scores: Scores | None = None
    test: tuple[Source, ...] = ()
    diagnosis: Diagnosis | None = None
    time_unit: str = "s"

    def save(self, folder: Path) -> None:
        """Write run.json; paths of measurements are kept absolute."""
        whole = replace(self, sources=_absolute(self.sources), test=_absolute(self.test))
        write_object(folder / RECORD, {"format": FORMAT, **asdict(whole)})

    @classmethod
    def load(cls, folder: Path) -> "Record | None":
        """Read run.json, where there is one.

        Raises:
            FolderError: it is not the record of a run.
        """
        path = folder / RECORD
        if not path.is_file():
            return None
        content = read_object(path, FORMAT)
        try:
            found: Record = restored(cls, {name: part for name, part in content.items() if name != "format"})
            return found
        except (KeyError, TypeError, ValueError) as error:
            raise FolderError(f"{path}: not the record of a run: {error}") from None


def _absolute(sources: Sequence[Source]) -> tuple[Source, ...]:
    return tuple(replace(source, path=str(Path(source.path).resolve())) for source in sources)


def sources(files: Sequence[Path | Content]) -> tuple[Source, ...]:
    """Return the files of measurements with their hashes."""
    return tuple(Source(str(file), sha256(file)) for file in files)


def versions() -> dict[str, str]:
    """Return the versions of Python and of the packages that a result depends on."""
    found = {"python": platform.python_version()}
    for package in PACKAGES:
        with suppress(metadata.PackageNotFoundError):
            found[package] = metadata.version(package)
    return found
