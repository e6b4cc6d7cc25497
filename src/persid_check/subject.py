"""What a file of format 1 is about: its claim, and the model with its groups."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from persid_check.json_text import Stated
from persid_check.model import Group, Model, groups_of
from persid_check.reading import read_model, read_text, require_fields
from persid_check.results import FormatError

FORMAT = "persid-certificate-1"
COMMON = ("format", "claim", "statement", "model_sha256", "model")


@dataclass(frozen=True)
class Subject:
    """The claim, the model and its hash, its canonical form, and its groups."""

    claim: str
    sha256: str
    form: Mapping[str, object]
    model: Model
    groups: tuple[Group, ...]


def read_heading(data: Mapping[str, object], fields: Sequence[str]) -> str:
    """Return the hash that a file states, which has all its fields and no other.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    require_fields("file", data, fields)
    if data["format"] != FORMAT:
        raise FormatError("format", f'"{FORMAT}" is needed')
    read_text("statement", data["statement"], 5000)
    return read_text("model_sha256", data["model_sha256"], 64)


def read_subject(data: Stated, fields: Sequence[str]) -> Subject:
    """Return the subject of a file whose model stands in it, every number written out.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    stated = read_heading(data, fields)
    refuted = data["claim"] == "refuted"
    model = read_model(data["model"], discrete=refuted, algebraic=refuted)
    return Subject(data["claim"], stated, data["model"], model, groups_of(model))
