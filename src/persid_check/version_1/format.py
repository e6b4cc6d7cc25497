"""certificate.json, version 1, as values: claims G, M, E and R. No claim is added here; format 2 is the ledger.

The specification is docs/certificate-format.md.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction

from persid_check.json_text import Stated
from persid_check.reading import (
    MAX_FORMS,
    Ball,
    Factor,
    Lower,
    read_ball,
    read_dropped,
    read_dyadic,
    read_dyadics,
    read_factor,
    read_gamma,
    read_index,
    read_list,
    read_object,
    read_P,
)
from persid_check.results import FormatError
from persid_check.subject import COMMON, Subject, read_subject


@dataclass(frozen=True)
class GroupProof:
    """What the file says of one group: forms l_k, mu_k, (k, l, tau), and the constants c_k and d_k where given."""

    forms: tuple[tuple[Fraction, ...], ...]
    mu: tuple[Fraction, ...] = ()
    products: tuple[tuple[int, int, Fraction], ...] = ()
    integral: tuple[Fraction | None, ...] = ()
    quadratic: tuple[Fraction | None, ...] = ()

    def used(self) -> list[int]:
        """Indices of the forms that stand in V or in S."""
        paired = {k for *pair, tau in self.products if tau for k in pair}
        return [k for k, mu in enumerate(self.mu) if mu or k in paired]


@dataclass(frozen=True)
class Stability:
    """Claims G, M, E and R.

    `P` is a tuple of lower rows, or of the diagonal (one entry a row); `gamma` a number, or Gamma's lower rows.
    """

    subject: Subject
    point: Ball | None
    P: Lower
    diagonal: bool
    groups: tuple[GroupProof, ...]
    dropped: tuple[int, ...]
    gamma: Fraction | Lower
    kappa: Fraction
    p: Fraction
    box: tuple[tuple[Fraction, Fraction], ...]
    level: Fraction
    input_bound: Fraction
    proof: Mapping[str, Factor]


_STABILITY = (*COMMON, "operating_point", "P", "groups", "dropped", "gamma", "proof")
_RATE = (*_STABILITY, "kappa", "p")
FIELDS = {"G": _STABILITY, "M": _STABILITY, "E": _RATE, "R": (*_RATE, "box", "level", "input_bound")}
WORDS = {"G": "iss", "M": "iss", "E": "rate-and-gain", "R": "region"}  # the claims in words


def read_certificate(data: Stated) -> Stability:
    """Return the value of a certificate's JSON object.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    subject = read_subject(data, FIELDS[data["claim"]])
    model, claim = subject.model, subject.claim
    size = model.n + len(model.channels)
    regional, rated = claim == "R", claim in ("E", "R")
    point = data["operating_point"]
    diagonal, P = read_P(data["P"], model.n)
    return Stability(
        subject=subject,
        point=None if point is None else read_ball("operating_point", point, model),
        P=P,
        diagonal=diagonal,
        groups=_group_proofs(data["groups"], subject, _group_fields(claim)),
        dropped=read_dropped(data["dropped"], size),
        gamma=read_gamma(data["gamma"], model.m + (point is None and any(model.b))),
        kappa=read_dyadic("kappa", data["kappa"]) if rated else Fraction(0),
        p=read_dyadic("p", data["p"]) if rated else Fraction(0),
        box=_box(data["box"], model.n) if regional else (),
        level=read_dyadic("level", data["level"]) if regional else Fraction(0),
        input_bound=read_dyadic("input_bound", data["input_bound"]) if regional else Fraction(0),
        proof=_proof(data["proof"]),
    )


def _proof(value: object) -> dict[str, Factor]:
    proof = read_object("proof", value, ("P", "Q"))
    return {name: read_factor(f"proof.{name}", rows) for name, rows in proof.items()}


def _box(value: object, n: int) -> tuple[tuple[Fraction, Fraction], ...]:
    sides = [read_dyadics(f"box[{i}]", side, 2) for i, side in enumerate(read_list("box", value, n))]
    return tuple((side[0], side[1]) for side in sides)


def _group_fields(claim: str) -> tuple[str, ...]:
    more = {"E": ("integral",), "R": ("integral", "quadratic")}.get(claim, ())
    return ("forms", "mu", "products", *more)


def _group_proofs(value: object, subject: Subject, known: tuple[str, ...]) -> tuple[GroupProof, ...]:
    entries = read_list("groups", value, len(subject.groups))
    return tuple(
        _group_proof(f"groups[{g}]", entry, 1 + len(group.members), known)
        for g, (entry, group) in enumerate(zip(entries, subject.groups, strict=True))
    )


def _group_proof(where: str, value: object, width: int, known: tuple[str, ...]) -> GroupProof:
    group = read_object(where, value, known)
    rows = read_list(f"{where}.forms", group["forms"])
    if len(rows) > MAX_FORMS:
        raise FormatError(f"{where}.forms", f"at most {MAX_FORMS} forms are read")
    forms = tuple(read_dyadics(f"{where}.forms[{k}]", row, width) for k, row in enumerate(rows))
    size = len(forms)
    return GroupProof(
        forms,
        read_dyadics(f"{where}.mu", group["mu"], size) if "mu" in known else (),
        _products(f"{where}.products", group["products"], size) if "products" in known else (),
        _constants(f"{where}.integral", group["integral"], size) if "integral" in known else (),
        _constants(f"{where}.quadratic", group["quadratic"], size) if "quadratic" in known else (),
    )


def _products(where: str, value: object, size: int) -> tuple[tuple[int, int, Fraction], ...]:
    found = []
    for i, entry in enumerate(read_list(where, value)):
        place = f"{where}[{i}]"
        k, q, tau = read_list(place, entry, 3)
        found.append((read_index(place, k, size), read_index(place, q, size), read_dyadic(place, tau)))
        if found[-1][0] >= found[-1][1]:
            raise FormatError(place, "k < l is needed")
    if len({(k, q) for k, q, _ in found}) != len(found):
        raise FormatError(where, "a pair stands twice")
    return tuple(found)


def _constants(where: str, value: object, size: int) -> tuple[Fraction | None, ...]:
    read: Callable[[int, object], Fraction | None] = lambda i, v: None if v is None else read_dyadic(f"{where}[{i}]", v)  # noqa: E731
    return tuple(read(i, entry) for i, entry in enumerate(read_list(where, value, size)))
