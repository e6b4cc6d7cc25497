"""certificate.json, version 1, as values: claims G, M, E and R. No claim is added here; format 2 is the ledger.

The specification is docs/certificate-format.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from persid_check.entry import Entry, Factor, Lower
from persid_check.json_text import Stated
from persid_check.reading import MAX_FORMS, Ball, read_ball, read_gamma, read_P
from persid_check.subject import COMMON, Group, Subject, read_heading, read_subject


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
    given = read_heading(data, FIELDS[data["claim"]])
    subject = read_subject(given)
    model, claim, point = subject.model, subject.claim, given["operating_point"]
    regional, rated = claim == "R", claim in ("E", "R")
    diagonal, P = read_P(given["P"], model.n)
    return Stability(
        subject=subject,
        point=None if point.value is None else read_ball(point, model),
        P=P,
        diagonal=diagonal,
        groups=_group_proofs(given["groups"], subject.groups, _group_fields(claim)),
        dropped=given["dropped"].indices(model.n + len(model.channels)),
        gamma=read_gamma(given["gamma"], model.m + (point.value is None and any(model.b))),
        kappa=given["kappa"].dyadic() if rated else Fraction(0),
        p=given["p"].dyadic() if rated else Fraction(0),
        box=_box(given["box"], model.n) if regional else (),
        level=given["level"].dyadic() if regional else Fraction(0),
        input_bound=given["input_bound"].dyadic() if regional else Fraction(0),
        proof={name: rows.factor() for name, rows in given["proof"].fields(("P", "Q")).items()},
    )


def _box(entry: Entry, n: int) -> tuple[tuple[Fraction, Fraction], ...]:
    pairs = (side.dyadics(2) for side in entry.items(n))
    return tuple((low, high) for low, high in pairs)


def _group_fields(claim: str) -> tuple[str, ...]:
    more = {"E": ("integral",), "R": ("integral", "quadratic")}.get(claim, ())
    return ("forms", "mu", "products", *more)


def _group_proofs(entry: Entry, groups: Sequence[Group], known: tuple[str, ...]) -> tuple[GroupProof, ...]:
    listed = zip(entry.items(len(groups)), groups, strict=True)
    return tuple(_group_proof(each.fields(known), 1 + len(group.members)) for each, group in listed)


def _group_proof(given: Mapping[str, Entry], width: int) -> GroupProof:
    forms = tuple(row.dyadics(width) for row in given["forms"].items(longest=MAX_FORMS))
    size = len(forms)
    return GroupProof(
        forms,
        given["mu"].dyadics(size),
        _products(given["products"], size),
        _constants(given["integral"], size) if "integral" in given else (),
        _constants(given["quadratic"], size) if "quadratic" in given else (),
    )


def _products(entry: Entry, size: int) -> tuple[tuple[int, int, Fraction], ...]:
    found = []
    for each in entry.items():
        k, q, tau = each.items(3)
        found.append((k.index(size), q.index(size), tau.dyadic()))
        if found[-1][0] >= found[-1][1]:
            each.refuse("k < l is needed")
    if len({(k, q) for k, q, _ in found}) != len(found):
        entry.refuse("a pair stands twice")
    return tuple(found)


def _constants(entry: Entry, size: int) -> tuple[Fraction | None, ...]:
    return tuple(None if each.value is None else each.dyadic() for each in entry.items(size))
