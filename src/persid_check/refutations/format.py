"""Refutations and obstructions of format 1 as values; see docs/refutation-format.md."""

from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from persid_check.json_text import Stated
from persid_check.reading import (
    MAX_FORMS,
    Ball,
    Factor,
    Lower,
    read_ball,
    read_dyadic,
    read_dyadics,
    read_factor,
    read_integers,
    read_list,
    read_lower,
    read_object,
    require_fields,
)
from persid_check.results import FormatError
from persid_check.subject import COMMON, Subject, read_subject

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
    """Claim "refuted": a witness of one kind against ISS for the constant input u; unused fields are empty."""

    subject: Subject
    u: tuple[Fraction, ...]
    kind: str
    points: tuple[Ball, ...]
    vector: tuple[Fraction, ...]
    S: Lower
    number: Fraction
    factor: Factor


WITNESSES = {
    "two-equilibria": ("points",),
    "unstable-equilibrium": ("point", "S", "sigma", "direction", "T"),
    "unstable-linear-part": ("S", "sigma", "direction", "T"),
    "marginal-direction": ("direction",),
    "cooperative-growth": ("point", "start"),
    "invariant-line": ("direction", "offset"),
}
FIELDS = {
    "infeasible": (*COMMON, "family", "groups", "L", "proof"),
    "refuted": (*COMMON, "u", "witness"),
}


def read_obstruction(data: Mapping[str, object]) -> Obstruction:
    """Return the value of a file of claim "infeasible".

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    subject = read_subject(data, FIELDS["infeasible"])
    if data["family"] not in ("diagonal", "full"):
        raise FormatError("family", '"diagonal" or "full" is needed')
    full = data["family"] == "full"
    size = subject.model.n + len(subject.model.channels)
    rows = read_list("L", data["L"], size)
    width = len(read_list("L[0]", rows[0]))
    if not 1 <= width <= size:
        raise FormatError("L", f"1 to {size} columns are needed")
    L = tuple(read_integers(f"L[{i}]", row, width) for i, row in enumerate(rows))
    proof = read_object("proof", data["proof"], ("P",) if full else ())
    forms = tuple(
        _forms(f"groups[{g}]", entry, 1 + len(group.members))
        for g, (entry, group) in enumerate(
            zip(read_list("groups", data["groups"], len(subject.groups)), subject.groups, strict=True)
        )
    )
    return Obstruction(subject, full, forms, L, read_factor("proof.P", proof["P"]) if full else ())


def _forms(where: str, value: object, width: int) -> Forms:
    rows = read_list(f"{where}.forms", read_object(where, value, ("forms",))["forms"])
    if len(rows) > MAX_FORMS:
        raise FormatError(f"{where}.forms", f"at most {MAX_FORMS} forms are read")
    return tuple(read_dyadics(f"{where}.forms[{k}]", row, width) for k, row in enumerate(rows))


def read_refutation(data: Stated) -> Refutation:
    """Return the value of a file of claim "refuted".

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    subject = read_subject(data, FIELDS["refuted"])
    model, witness = subject.model, data["witness"]
    kind = witness.get("kind") if isinstance(witness, dict) else None
    if not isinstance(kind, str) or kind not in WITNESSES:
        raise FormatError("witness.kind", f"one of {', '.join(WITNESSES)} is needed")
    require_fields("witness", witness, ("kind", *WITNESSES[kind]))
    u = read_dyadics("u", data["u"], model.m)
    single = [witness["point"]] if "point" in witness else []
    listed = read_list("witness.points", witness["points"], 2) if "points" in witness else single
    points = tuple(read_ball(f"witness.points[{i}]", point, model, u) for i, point in enumerate(listed))
    vector = next(name for name in ("direction", "start", "points") if name in witness)
    number = next((witness[name] for name in ("sigma", "offset") if name in witness), [0, 0])
    return Refutation(
        subject=subject,
        u=u,
        kind=kind,
        points=points,
        vector=() if vector == "points" else read_dyadics(f"witness.{vector}", witness[vector], model.n),
        S=read_lower("witness.S", witness["S"], model.n) if "S" in witness else (),
        number=read_dyadic("witness.sigma or offset", number),
        factor=read_factor("witness.T", witness["T"]) if "T" in witness else (),
    )
