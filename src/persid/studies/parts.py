"""Parts of a study: each result is written as JSON when it is finished, and reused by the next run."""

import hashlib
import json
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import ModuleType
from typing import NoReturn, TypeVar, cast

from tqdm import tqdm

from persid._files import Json, json_object, write_atomically
from persid.models.model import PersidskiiModel
from persid.reports.record import versions
from persid.studies.cells import VerdictCell
from persid.verdicts.summary import summarize
from persid.verdicts.verdict import Reason, Undecided, Verdict

BAR = "{bar:20} {n_fmt}/{total_fmt} [{elapsed}<{remaining}]"
PARTS, PROOFS, MODELS = "parts", "proofs", "models"
Cell = TypeVar("Cell", bound=Mapping[str, object])


@dataclass(frozen=True)
class Parts:
    """The folder of a study with its finished parts; `origin` goes into every part's hash, `count` parts are meant."""

    folder: Path
    origin: Mapping[str, object]
    progress: Callable[[str], None]
    count: int = 0
    seconds: dict[str, float] = field(default_factory=dict)
    started: float = field(default_factory=lambda: time.perf_counter())

    @classmethod
    def below(cls, folder: Path, study: ModuleType, progress: Callable[[str], None]) -> "Parts":
        """Return the parts of a study in a folder; its revision and the versions of the packages decide on reuse."""
        for name in (PARTS, PROOFS, MODELS):
            (folder / name).mkdir(parents=True, exist_ok=True)
        origin = {"study": study.__name__, "revision": study.REVISION, "versions": versions()}
        return cls(folder, origin, progress)

    def of(self, count: int) -> "Parts":
        """Return the same parts, knowing how many there will be."""
        return replace(self, count=count)

    def say(self, line: str) -> None:
        """Report a line of progress behind a bar of the parts that are done."""
        spent = time.perf_counter() - self.started
        bar = tqdm.format_meter(len(self.seconds), self.count, spent, bar_format=BAR)
        self.progress(f"{bar} {line}")

    def within(self, name: str) -> Callable[[str], None]:
        """Return what reports the lines of progress of one part."""
        return lambda line: self.say(f"{name}: {line}")

    def part(self, name: str, parameters: Mapping[str, object], compute: Callable[[], Cell]) -> Cell:
        """Return what `compute` returns, from the file of an earlier run where nothing has changed since.

        A result may list `files` below the folder; one that is missing makes the part be computed again.
        """
        self.say(name)
        path, key = self.folder / PARTS / f"{_file_name(name)}.json", self._key(name, parameters)
        found = _read(path)
        if found is None or found.get("key") != key or not self._complete(found["result"]):
            started = time.perf_counter()
            result = _plain(compute())
            found = {"key": key, "seconds": time.perf_counter() - started, "result": result}
            write_atomically(path, json.dumps(found, allow_nan=False) + "\n")
        self.seconds[name] = found["seconds"]
        kept: Cell = found["result"]
        return kept

    @property
    def total(self) -> float:
        """Seconds that the parts asked for so far took, in the run that computed them."""
        return sum(self.seconds.values())

    def verdict(self, name: str, model: PersidskiiModel, verdict: Verdict) -> VerdictCell:
        """Write a model with the checked proof of its verdict; return the verdict in brief with the names of the files.

        Raises:
            KeyboardInterrupt: the verdict was cut short by Ctrl-C, and shall not be kept.
        """
        if isinstance(verdict, Undecided) and verdict.reason is Reason.INTERRUPTED:
            raise KeyboardInterrupt
        files = [f"{MODELS}/{_file_name(name)}.json"]
        model.save(self.folder / files[0])
        proof = verdict.proof
        if proof is not None:
            files.append(f"{PROOFS}/{_file_name(name)}.json")
            proof.save(self.folder / files[1])
        why = verdict.reason.name if isinstance(verdict, Undecided) else getattr(proof, "kind", None)
        brief = summarize(verdict).to_dict()
        kept = {field: brief[field] for field in VerdictCell.__annotations__ if field in brief}
        return cast("VerdictCell", {**kept, "why": why, "files": files})

    def _key(self, name: str, parameters: Mapping[str, object]) -> str:
        content = {"name": name, "parameters": parameters, **self.origin}
        return hashlib.sha256(json.dumps(content, sort_keys=True, default=_refuse).encode()).hexdigest()

    def _complete(self, result: object) -> bool:
        return all((self.folder / name).is_file() for name in _files(result))


def _files(result: object) -> Iterator[str]:
    """Yield the names under "files", at any depth."""
    if isinstance(result, Mapping):
        yield from result.get("files", ())
        for value in result.values():
            yield from _files(value)


def _file_name(name: str) -> str:
    return "".join(c if c.isalnum() or c in ".-" else "_" for c in name).strip("_")


def _read(path: Path) -> Json | None:
    try:
        found = json_object(path.read_bytes())
    except (OSError, ValueError):
        return None
    return found if set(found) == {"key", "seconds", "result"} else None


def _refuse(value: object) -> NoReturn:
    raise TypeError(f"a parameter of a part is {value!r}; needed are JSON values, so that its hash is certain")


def _plain(value: object) -> object:
    """Return JSON values: arrays as lists, numbers that JSON has no word for as None."""
    if isinstance(value, Mapping):
        return {str(name): _plain(part) for name, part in value.items()}
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_plain(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
