"""Refutations and obstructions of format 1 as values; see docs/refutation-format.md."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from persid_check.entry import Entry, Factor, Lower
from persid_check.json_text import Stated
from persid_check.reading import MAX_FORMS, Ball, read_ball
from persid_check.subject import COMMON, Subject, read_heading, read_subject

Forms = tuple[tuple[Fraction, ...], ...]


@dataclass(frozen=True)
class Obstruction:
    """Claim "infeasible": X = L L' separates the family from every certificate; the forms of each group."""

    subject: Subject
    full: bool
    forms: tuple[Forms, ...]
    L: tuple[tuple[int, ...], ...]
    factor: Factor


@dataclass(frozen=True)
class Refutation:
    """Claim "refuted": a witness of one kind against ISS for the constant input u, or against equations that tell what
    their variables are; unused fields are empty.
    """

    subject: Subject
    u: tuple[Fraction, ...]
    kind: str
    points: tuple[Ball, ...]
    vector: tuple[Fraction, ...]
    S: Lower
    number: Fraction
    factor: Factor
    multipliers: tuple[tuple[Fraction, ...], ...]


WITNESSES = {
    "two-equilibria": ("points",),
    "unstable-equilibrium": ("point", "S", "sigma", "direction", "T"),
    "unstable-linear-part": ("S", "sigma", "direction", "T"),
    "marginal-direction": ("direction",),
    "cooperative-growth": ("point", "start"),
    "invariant-line": ("direction", "offset"),
    "two-solutions": ("points",),
    "free-direction": ("direction",),
}
POSED = ("two-solutions", "free-direction")  # these are about equations alone
FIELDS = {
    "infeasible": (*COMMON, "family", "groups", "L", "proof"),
    "refuted": (*COMMON, "u", "witness"),
}


def read_obstruction(data: Stated) -> Obstruction:
    """Return the value of a file of claim "infeasible".

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    given = read_heading(data, FIELDS["infeasible"])
    subject, full = read_subject(given), given["family"].one_of(("diagonal", "full")) == "full"
    size = subject.model.n + len(subject.model.channels)
    rows = given["L"].items(size)
    width = len(rows[0].items())
    if not 1 <= width <= size:
        given["L"].refuse(f"1 to {size} columns are needed")
    proof = given["proof"].fields(("P",) if full else ())
    groups = zip(given["groups"].items(len(subject.groups)), subject.groups, strict=True)
    forms = tuple(_forms(entry, 1 + len(group.members)) for entry, group in groups)
    L = tuple(row.integers(width) for row in rows)
    return Obstruction(subject, full, forms, L, proof["P"].factor() if full else ())


def _forms(entry: Entry, width: int) -> Forms:
    rows = entry.fields(("forms",))["forms"].items(longest=MAX_FORMS)
    return tuple(row.dyadics(width) for row in rows)


def read_refutation(data: Stated) -> Refutation:
    """Return the value of a file of claim "refuted".

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    given = read_heading(data, FIELDS["refuted"])
    subject, kind = read_subject(given), _kind(given["witness"])
    model = subject.model
    more = ("multipliers",) if kind == "unstable-equilibrium" and model.algebraic else ()
    witness = given["witness"].fields(("kind", *WITNESSES[kind], *more))
    size = model.algebraic if kind == "free-direction" else model.order
    u = given["u"].dyadics(model.m)
    balls = [*(witness["points"].items(2) if "points" in witness else ()), *_given(witness, "point")]
    vector, number = _given(witness, "direction", "start"), _given(witness, "sigma", "offset")
    return Refutation(
        subject=subject,
        u=u,
        kind=kind,
        points=tuple(read_ball(ball, model, u) for ball in balls),
        vector=vector[0].dyadics(size) if vector else (),
        S=witness["S"].lower(model.order) if "S" in witness else (),
        number=number[0].dyadic() if number else Fraction(0),
        factor=witness["T"].factor() if "T" in witness else (),
        multipliers=tuple(
            row.dyadics(model.n) for entry in _given(witness, "multipliers") for row in entry.items(model.algebraic)
        ),
    )


def _kind(entry: Entry) -> str:
    kind = entry.value.get("kind") if isinstance(entry.value, dict) else None
    return Entry(kind, "kind", entry).one_of(tuple(WITNESSES))


def _given(witness: Mapping[str, Entry], *names: str) -> list[Entry]:
    """Return the fields of some names that a witness has."""
    return [witness[name] for name in names if name in witness]
