"""What a file of format 1 is about: its claim, and the model with its groups of channels."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from persid_check.entry import Entry, Row
from persid_check.json_text import Stated
from persid_check.model import Model, read_model

FORMAT = "persid-certificate-1"
COMMON = ("format", "claim", "statement", "model_sha256", "model")
MAX_ENTRIES = 2500  # of states and channels


@dataclass(frozen=True)
class Group:
    """Channels whose rows are positive multiples of one row: r_c = alpha r_g, alpha > 0, exactly."""

    row: Row
    members: tuple[tuple[int, Fraction], ...]


@dataclass(frozen=True)
class Subject:
    """The claim, the model and its hash, its canonical form, and its groups."""

    claim: str
    sha256: str
    form: Mapping[str, object]
    model: Model
    groups: tuple[Group, ...]


def read_heading(data: Stated, fields: Sequence[str], optional: Sequence[str] = ()) -> dict[str, Entry]:
    """Return the fields of a file: all that are needed, of optional ones those it has, and no other.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    given = Entry(data).fields(fields, optional)
    if given["format"].value != FORMAT:
        given["format"].refuse(f'"{FORMAT}" is needed')
    given["statement"].text(5000)
    given["model_sha256"].text(64)
    return given


def read_subject(given: Mapping[str, Entry]) -> Subject:
    """Return the subject of a file whose model stands in it, every number written out.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    claim, entry = given["claim"].value, given["model"]
    refuted = claim == "refuted"
    model = read_model(entry, discrete=refuted, algebraic=refuted)
    if model.n + len(model.channels) > MAX_ENTRIES:
        entry.refuse(f"more than {MAX_ENTRIES} states and channels")
    return Subject(claim, given["model_sha256"].value, entry.value, model, groups_of(model))


def groups_of(model: Model) -> tuple[Group, ...]:
    """Return the groups of a model in the order of their first channels, of whose rows the others' are multiples."""
    places: dict[tuple[tuple[int, Fraction], ...], int] = {}
    rows: list[Row] = []
    members: list[list[tuple[int, Fraction]]] = []
    for c, channel in enumerate(model.channels):
        scale = abs(next(iter(channel.row.values()), Fraction(1)))
        key = tuple((i, value / scale) for i, value in channel.row.items())
        place = places.setdefault(key, len(rows))
        if place == len(rows):
            rows.append(channel.row)
            members.append([])
        first = abs(next(iter(rows[place].values()), Fraction(1)))
        members[place].append((c, scale / first))
    return tuple(Group(row, tuple(group)) for row, group in zip(rows, members, strict=True))
