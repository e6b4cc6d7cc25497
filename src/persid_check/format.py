"""certificate.json, version 1, as values: every field is read here, and what is not specified is refused.

The specification is docs/certificate-format.md. A number is an integer or a dyadic [mantissa, exponent].
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from persid_check.model import Group, Model, canonical_model, groups_of, model_of
from persid_check.results import FormatError
from persid_check.sparse import is_sparse

FORMAT = "persid-certificate-1"
MAX_BITS = 2048  # of a mantissa
MAX_EXPONENT = 2000
MAX_FORMS = 128  # per group
MAX_ENTRIES = 2500  # of z
MAX_FACTOR_BITS = 512  # of an entry of T

Factor = tuple[tuple[int, ...], ...]
Lower = tuple[tuple[Fraction, ...], ...]  # lower rows of a symmetric matrix


@dataclass(frozen=True)
class Point:
    """The ball |x - x_c|_inf <= radius in which exactly one equilibrium for the constant input u is claimed."""

    x: tuple[Fraction, ...]
    radius: Fraction
    u: tuple[Fraction, ...]


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
class Subject:
    """What every file is about: its claim, and the model with its groups."""

    claim: str
    sha256: str
    form: Mapping[str, Any]
    model: Model
    groups: tuple[Group, ...]


@dataclass(frozen=True)
class Stability:
    """Claims G, M, E and R.

    `P` is a tuple of lower rows, or of the diagonal (one entry a row); `gamma` a number, or Gamma's lower rows.
    """

    subject: Subject
    point: Point | None
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


@dataclass(frozen=True)
class Infeasibility:
    """Claim "infeasible": X = L L' separates the family from every certificate."""

    subject: Subject
    full: bool
    groups: tuple[GroupProof, ...]
    L: tuple[tuple[int, ...], ...]
    proof: Mapping[str, Factor]


@dataclass(frozen=True)
class Refutation:
    """Claim "refuted": a witness of one kind against ISS for the constant input u; unused fields are empty."""

    subject: Subject
    u: tuple[Fraction, ...]
    kind: str
    points: tuple[Point, ...]
    vector: tuple[Fraction, ...]
    S: Lower
    number: Fraction
    factor: Factor


Claimed = Stability | Infeasibility | Refutation

COMMON = ("format", "claim", "statement", "model_sha256", "model")
_STABILITY = (*COMMON, "operating_point", "P", "groups", "dropped", "gamma", "proof")
_RATE = (*_STABILITY, "kappa", "p")
FIELDS = {
    "G": _STABILITY,
    "M": _STABILITY,
    "E": _RATE,
    "R": (*_RATE, "box", "level", "input_bound"),
    "infeasible": (*COMMON, "family", "groups", "L", "proof"),
    "refuted": (*COMMON, "u", "witness"),
}
WORDS = {"G": "iss", "M": "iss", "E": "rate-and-gain", "R": "region"}  # the claims in words
WITNESSES = {
    "two-equilibria": ("points",),
    "unstable-equilibrium": ("point", "S", "sigma", "direction", "T"),
    "unstable-linear-part": ("S", "sigma", "direction", "T"),
    "marginal-direction": ("direction",),
    "cooperative-growth": ("point", "start"),
    "invariant-line": ("direction", "offset"),
}


def read_certificate(data: Any) -> Claimed:
    """Return the value of a certificate's JSON object.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    claim = data.get("claim") if isinstance(data, dict) else None
    if not isinstance(claim, str) or claim not in FIELDS:
        raise FormatError("claim", f"one of {', '.join(FIELDS)} is needed")
    require_fields("file", data, FIELDS[claim])
    if data["format"] != FORMAT:
        raise FormatError("format", f'"{FORMAT}" is needed')
    read_text("statement", data["statement"], 5000)
    subject = _subject(claim, data)
    if claim == "infeasible":
        return _infeasibility(subject, data)
    return _refutation(subject, data) if claim == "refuted" else _stability(subject, data)


def _subject(claim: str, data: Mapping[str, Any]) -> Subject:
    read_text("model_sha256", data["model_sha256"], 64)
    form = data["model"]
    if is_sparse(form):
        raise FormatError("model", "in this claim every matrix is written out, none given as an object")
    if canonical_model(form) != form:
        raise FormatError("model", "not in canonical form")
    model = model_of(form, discrete=claim == "refuted")
    if model.n + len(model.channels) > MAX_ENTRIES:
        raise FormatError("model", f"more than {MAX_ENTRIES} states and channels")
    return Subject(claim, data["model_sha256"], form, model, groups_of(model))


def _stability(subject: Subject, data: Mapping[str, Any]) -> Stability:
    model, claim = subject.model, subject.claim
    size = model.n + len(model.channels)
    regional, rated = claim == "R", claim in ("E", "R")
    point = data["operating_point"]
    diagonal, P = read_P(data["P"], model.n)
    return Stability(
        subject,
        None if point is None else _point("operating_point", point, model, None),
        P,
        diagonal,
        _group_proofs(data["groups"], subject, _group_fields(claim)),
        _dropped(data["dropped"], size),
        read_gamma(data["gamma"], model.m + (point is None and any(model.b))),
        read_dyadic("kappa", data["kappa"]) if rated else Fraction(0),
        read_dyadic("p", data["p"]) if rated else Fraction(0),
        _box(data["box"], model.n) if regional else (),
        read_dyadic("level", data["level"]) if regional else Fraction(0),
        read_dyadic("input_bound", data["input_bound"]) if regional else Fraction(0),
        _proof(data["proof"], ("P", "Q")),
    )


def _infeasibility(subject: Subject, data: Mapping[str, Any]) -> Infeasibility:
    if data["family"] not in ("diagonal", "full"):
        raise FormatError("family", '"diagonal" or "full" is needed')
    full = data["family"] == "full"
    size = subject.model.n + len(subject.model.channels)
    rows = read_list("L", data["L"], size)
    width = len(read_list("L[0]", rows[0]))
    if not 1 <= width <= size:
        raise FormatError("L", f"1 to {size} columns are needed")
    L = tuple(_integers(f"L[{i}]", row, width) for i, row in enumerate(rows))
    proofs = _group_proofs(data["groups"], subject, ("forms",))
    return Infeasibility(subject, full, proofs, L, _proof(data["proof"], ("P",) if full else ()))


def _refutation(subject: Subject, data: Mapping[str, Any]) -> Refutation:
    model, witness = subject.model, data["witness"]
    kind = witness.get("kind") if isinstance(witness, dict) else None
    if not isinstance(kind, str) or kind not in WITNESSES:
        raise FormatError("witness.kind", f"one of {', '.join(WITNESSES)} is needed")
    require_fields("witness", witness, ("kind", *WITNESSES[kind]))
    u = read_dyadics("u", data["u"], model.m)
    single = [witness["point"]] if "point" in witness else []
    listed = read_list("witness.points", witness["points"], 2) if "points" in witness else single
    points = tuple(_point(f"witness.points[{i}]", point, model, u) for i, point in enumerate(listed))
    vector = next(name for name in ("direction", "start", "points") if name in witness)
    number = next((witness[name] for name in ("sigma", "offset") if name in witness), [0, 0])
    return Refutation(
        subject,
        u,
        kind,
        points,
        () if vector == "points" else read_dyadics(f"witness.{vector}", witness[vector], model.n),
        read_lower("witness.S", witness["S"], model.n) if "S" in witness else (),
        read_dyadic("witness.sigma or offset", number),
        _factor("witness.T", witness["T"]) if "T" in witness else (),
    )


def require_fields(where: str, data: Mapping[str, Any], known: Sequence[str]) -> None:
    """Refuse an object that lacks a known field or has another one."""
    for name in data:
        if name not in known:
            raise FormatError(where, f"unknown field {name[:60]!r}; known: {', '.join(known)}")
    for name in known:
        if name not in data:
            raise FormatError(where, f"the field {name!r} is missing")


def read_text(where: str, value: Any, longest: int) -> str:
    """Return a text that is not too long."""
    if not isinstance(value, str) or len(value) > longest:
        raise FormatError(where, f"text of at most {longest} characters is needed")
    return value


def read_list(where: str, value: Any, size: int | None = None) -> list[Any]:
    """Return a list, of a given length where one is given."""
    if not isinstance(value, list) or (size is not None and len(value) != size):
        raise FormatError(where, "a list is needed" if size is None else f"a list of {size} is needed")
    return value


def read_object(where: str, value: Any, known: Sequence[str]) -> dict[str, Any]:
    """Return an object of exactly the known fields."""
    if not isinstance(value, dict):
        raise FormatError(where, f"an object with {', '.join(known)} is needed")
    require_fields(where, value, known)
    return value


def _integer(where: str, value: Any, bits: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise FormatError(where, f"an integer is needed, not {str(value)[:40]!r}")
    if value.bit_length() > bits:
        raise FormatError(where, f"an integer of at most {bits} bits is needed")
    return value


def read_index(where: str, value: Any, size: int) -> int:
    """Return an index into so many entries."""
    index = _integer(where, value, 64)
    if not 0 <= index < size:
        raise FormatError(where, f"an index from 0 to {size - 1} is needed, not {index}")
    return index


def _integers(where: str, values: Any, size: int) -> tuple[int, ...]:
    return tuple(_integer(where, value, MAX_FACTOR_BITS) for value in read_list(where, values, size))


def read_dyadic(where: str, value: Any) -> Fraction:
    """Return the number mantissa * 2**exponent of a pair."""
    pair = read_list(where, value, 2)
    mantissa, exponent = _integer(where, pair[0], MAX_BITS), _integer(where, pair[1], 64)
    if abs(exponent) > MAX_EXPONENT:
        raise FormatError(where, f"an exponent of at most {MAX_EXPONENT} is needed")
    return Fraction(mantissa << exponent) if exponent >= 0 else Fraction(mantissa, 1 << -exponent)


def read_dyadics(where: str, values: Any, size: int | None) -> tuple[Fraction, ...]:
    """Return a list of such numbers."""
    return tuple(read_dyadic(f"{where}[{i}]", value) for i, value in enumerate(read_list(where, values, size)))


def read_lower(where: str, rows: Any, n: int) -> Lower:
    """Return the lower rows of a symmetric matrix of order n."""
    return tuple(read_dyadics(f"{where}[{i}]", row, i + 1) for i, row in enumerate(read_list(where, rows, n)))


def read_P(value: Any, n: int) -> tuple[bool, Lower]:
    """Return whether P is diagonal, and its lower rows or its diagonal, one entry a row."""
    if isinstance(value, dict) and set(value) == {"diagonal"}:
        return True, tuple((entry,) for entry in read_dyadics("P.diagonal", value["diagonal"], n))
    return False, read_lower("P.lower", read_object("P", value, ("lower",))["lower"], n)


def read_gamma(value: Any, width: int) -> Fraction | Lower:
    """Return one gain, or the lower rows of a matrix of them."""
    if isinstance(value, dict):
        return read_lower("gamma.lower", read_object("gamma", value, ("lower",))["lower"], width)
    return read_dyadic("gamma", value)


def _point(where: str, value: Any, model: Model, u: tuple[Fraction, ...] | None) -> Point:
    known = ("x", "radius", "u") if u is None else ("x", "radius")
    point = read_object(where, value, known)
    x = read_dyadics(f"{where}.x", point["x"], model.n)
    if u is None:
        u = read_dyadics(f"{where}.u", point["u"], model.m)
    return Point(x, read_dyadic(f"{where}.radius", point["radius"]), u)


def _box(value: Any, n: int) -> tuple[tuple[Fraction, Fraction], ...]:
    sides = [read_dyadics(f"box[{i}]", side, 2) for i, side in enumerate(read_list("box", value, n))]
    return tuple((side[0], side[1]) for side in sides)


def _dropped(value: Any, size: int) -> tuple[int, ...]:
    entries = tuple(read_index(f"dropped[{i}]", entry, size) for i, entry in enumerate(read_list("dropped", value)))
    if len(set(entries)) != len(entries):
        raise FormatError("dropped", "an entry stands twice")
    return entries


def _factor(where: str, value: Any) -> Factor:
    rows = read_list(where, value)
    return tuple(_integers(f"{where}[{i}]", row, i + 1) for i, row in enumerate(rows))


def _proof(value: Any, names: tuple[str, ...]) -> dict[str, Factor]:
    proof = read_object("proof", value, names)
    return {name: _factor(f"proof.{name}", proof[name]) for name in names}


def _group_fields(claim: str) -> tuple[str, ...]:
    more = {"E": ("integral",), "R": ("integral", "quadratic")}.get(claim, ())
    return ("forms", "mu", "products", *more)


def _group_proofs(value: Any, subject: Subject, known: tuple[str, ...]) -> tuple[GroupProof, ...]:
    entries = read_list("groups", value, len(subject.groups))
    return tuple(
        _group_proof(f"groups[{g}]", entry, 1 + len(group.members), known)
        for g, (entry, group) in enumerate(zip(entries, subject.groups, strict=True))
    )


def _group_proof(where: str, value: Any, width: int, known: tuple[str, ...]) -> GroupProof:
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


def _products(where: str, value: Any, size: int) -> tuple[tuple[int, int, Fraction], ...]:
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


def _constants(where: str, value: Any, size: int) -> tuple[Fraction | None, ...]:
    read: Callable[[int, Any], Fraction | None] = lambda i, v: None if v is None else read_dyadic(f"{where}[{i}]", v)  # noqa: E731
    return tuple(read(i, entry) for i, entry in enumerate(read_list(where, value, size)))
