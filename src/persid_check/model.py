"""The model x' = A0 (x - x_ref) + sum A f(R (x - x_ref)) + B (u - u_ref) + b: its form, hash, groups.

In discrete time the same right side is x+ - x_ref, x+ the state one step of `dt` later. With algebraic variables, which
come after the states, the last rows of the right side are equations: zero, instead of a derivative.
"""

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from persid_check.expression import ExpressionError, Program, is_linear, parse
from persid_check.fields import (
    ALGEBRAIC,
    CLOCK,
    FIELDS,
    FORMAT,
    REQUIRED,
    read_algebraic,
    read_clock,
    read_matrix,
    read_names,
    read_vector,
    refuse_fields,
)
from persid_check.json_text import Json, Stated
from persid_check.results import FormatError

MAX_STATES = 1000
MAX_CHANNELS = 3000  # 12 functions for each of 250 states, or 3 for each of 1000

Row = dict[int, Fraction]


@dataclass(frozen=True)
class Channel:
    """One scalar channel a f(r'(x - x_ref)): `row` is r (its nonzero entries), `column` is a."""

    text: str
    program: Program
    row: Row
    column: tuple[float, ...]


@dataclass(frozen=True)
class Group:
    """Channels whose rows are positive multiples of one row: r_c = alpha r_g, alpha > 0, exactly."""

    row: Row
    members: tuple[tuple[int, Fraction], ...]


@dataclass(frozen=True)
class Model:
    """A model with its linear terms merged into A0, exactly; every number stands for itself, no rounding.

    `dt` is the length of a step in s in discrete time, None in continuous time. `algebraic` is how many of the
    variables, the last ones, are algebraic: their rows are equations.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    x_ref: tuple[Fraction, ...]
    u_ref: tuple[Fraction, ...]
    A0: tuple[tuple[Fraction, ...], ...]
    channels: tuple[Channel, ...]
    B: tuple[tuple[float, ...], ...]
    b: tuple[float, ...]
    dt: Fraction | None = None
    algebraic: int = 0

    @property
    def order(self) -> int:
        """Number of variables that have a derivative."""
        return self.n - self.algebraic

    @property
    def is_discrete(self) -> bool:
        """Whether time goes in steps."""
        return self.dt is not None

    @property
    def resting(self) -> "Model":
        """The model whose right side is zero where this one rests: x+ - x in discrete time, else itself."""
        if not self.is_discrete:
            return self
        A0 = tuple(tuple(a - (i == j) for j, a in enumerate(row)) for i, row in enumerate(self.A0))
        return replace(self, A0=A0, dt=None)

    @property
    def n(self) -> int:
        """Number of variables: states, then algebraic ones."""
        return len(self.states)

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.inputs)


def canonical_model(data: Mapping[str, object], folder: Path | None = None) -> Json:
    """Return the canonical form: all fields present, every number a float.hex() string, no provenance.

    A canonical form is returned unchanged. A large model with sparse matrices, whose companions stand in `folder`, has
    its arrays' digests instead of numbers (the network form).

    Raises:
        FormatError: a field is unknown, missing, of the wrong type or shape; the message names the place.
    """
    if not isinstance(data, Mapping):
        raise FormatError("model", "an object is needed")
    if holds_objects(data):  # a large network: what reads it is not needed elsewhere
        from persid_check import sparse

        model = sparse.read_sparse(data, sparse.gathered(data, folder))
        if model.n > sparse.FILLED_STATES:
            return model.form()
        data = sparse.filled(model)
    refuse_fields("model", data, (*FIELDS, *CLOCK, ALGEBRAIC, "provenance"), REQUIRED)
    if data["format"] != FORMAT:
        raise FormatError("model.format", f'"{FORMAT}" is needed')
    states = read_names("model.states", data["states"])
    inputs = read_names("model.inputs", data.get("inputs") or [])
    equations = read_algebraic(data, states)
    n, m = len(states) + len(equations.get(ALGEBRAIC, ())), len(inputs)
    if not states or n > MAX_STATES or m > MAX_STATES:
        raise FormatError("model.states", f"1 to {MAX_STATES} states and at most {MAX_STATES} inputs are read")
    return {
        "format": FORMAT,
        "states": states,
        "inputs": inputs,
        "x_ref": read_vector("model.x_ref", data.get("x_ref"), n),
        "u_ref": read_vector("model.u_ref", data.get("u_ref"), m),
        "A0": read_matrix("model.A0", data.get("A0"), n, n),
        "terms": _terms(data["terms"], n),
        "B": read_matrix("model.B", None if m == 0 and data["B"] in ([], None) else data["B"], n, m),
        "b": read_vector("model.b", data.get("b"), n),
        "domain": None if data.get("domain") is None else read_matrix("model.domain", data["domain"], n, 2),
    } | (equations or read_clock(data))


def holds_objects(data: Mapping[str, object]) -> bool:
    """Whether a matrix or a vector is given as an object: sparse, or in a companion."""
    terms = data.get("terms")
    parts = [data.get(name) for name in ("A0", "B", "x_ref", "b", "domain")]
    for term in terms if isinstance(terms, list) else []:
        parts += [term.get("A"), term.get("R")] if isinstance(term, Mapping) else []
    return any(isinstance(part, Mapping) for part in parts)


def model_sha256(data: Mapping[str, object], folder: Path | None = None) -> str:
    """Return the SHA-256 of the canonical form, written as JSON with sorted keys and no spaces.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])
        >>> persid_check.model_sha256(model.to_dict()) == model.sha256
        True
    """
    return sha256_of(canonical_model(data, folder))


def sha256_of(form: Mapping[str, object]) -> str:
    """Return the SHA-256 of a canonical form."""
    text = json.dumps(form, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def read_model(data: Mapping[str, object], *, discrete: bool = False, algebraic: bool = False) -> Model:
    """Return the model of an object, plain or canonical, with terms f = x merged into A0 exactly; see `model_of`."""
    return model_of(canonical_model(data), discrete=discrete, algebraic=algebraic)


def model_of(form: Stated, *, discrete: bool = False, algebraic: bool = False) -> Model:
    """Return the model of a canonical form; one in discrete time, or one with algebraic variables, only to callers that
    say they know what to do with it.

    Raises:
        FormatError: it is one of these, and the caller knows differential equations alone.
    """
    names = tuple(form.get(ALGEBRAIC, ()))
    if names and not algebraic:
        raise FormatError("model.algebraic", "nothing of this kind is proved of a model with algebraic variables")
    dt = Fraction(float.fromhex(form["dt"])) if form.get("time") == "discrete" else None
    if dt is not None and not discrete:
        raise FormatError("model.time", "nothing of this kind is proved of a model in discrete time")
    n = len(form["states"]) + len(names)
    A0 = [[Fraction(value) for value in row] for row in _floats(form["A0"])]
    channels: list[Channel] = []
    for term in form["terms"]:
        A = _floats(term["A"])
        programs = {text: parse(text) for text in set(_texts(term))}
        for k, (text, row) in enumerate(zip(_texts(term), _rows(term, n), strict=True)):
            channel = Channel(text, programs[text], row, tuple(line[k] for line in A))
            if is_linear(channel.program):
                _merge(A0, channel)
            else:
                channels.append(channel)
    B = tuple(tuple(row) for row in _floats(form["B"]))
    x_ref, u_ref = (tuple(Fraction(float.fromhex(v)) for v in form[name]) for name in ("x_ref", "u_ref"))
    b = tuple(float.fromhex(v) for v in form["b"])
    rows = tuple(tuple(row) for row in A0)
    variables, inputs = (*form["states"], *names), tuple(form["inputs"])
    return Model(
        states=variables,
        inputs=inputs,
        x_ref=x_ref,
        u_ref=u_ref,
        A0=rows,
        channels=tuple(channels),
        B=B,
        b=b,
        dt=dt,
        algebraic=len(names),
    )


def groups(data: Mapping[str, object]) -> tuple[Group, ...]:
    """Return the groups of a model object: a channel joins the first group whose row is a positive multiple."""
    return groups_of(read_model(data))


def groups_of(model: Model) -> tuple[Group, ...]:
    """Return the groups of a model, in the order of their first channels."""
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


def _merge(A0: list[list[Fraction]], channel: Channel) -> None:
    for i, a in enumerate(channel.column):
        for j, r in channel.row.items():
            A0[i][j] += Fraction(a) * r


def _texts(term: Stated) -> list[str]:
    return [term["f"]] * len(term["A"][0]) if isinstance(term["f"], str) else term["f"]


def _rows(term: Stated, n: int) -> list[Row]:
    if term["R"] is None:
        return [{i: Fraction(1)} for i in range(n)]
    return [{j: Fraction(v) for j, v in enumerate(row) if v} for row in _floats(term["R"])]


def _floats(rows: list[list[str]]) -> list[list[float]]:
    return [[float.fromhex(value) for value in row] for row in rows]


def _terms(terms: object, n: int) -> list[dict[str, object]]:
    if not isinstance(terms, list) or len(terms) > MAX_CHANNELS:
        raise FormatError("model.terms", f"a list of at most {MAX_CHANNELS} terms is needed")
    if sum(_channels(term, n) for term in terms) > MAX_CHANNELS:  # before zeros are written for any of them
        raise FormatError("model.terms", f"more than {MAX_CHANNELS} channels")
    return [_term(f"model.terms[{i}]", term, n) for i, term in enumerate(terms)]


def _channels(term: object, n: int) -> int:
    """How many channels a term says that it has, one at least."""
    R = term.get("R") if isinstance(term, Mapping) else ()
    return n if R is None else max(1, len(R)) if isinstance(R, list) else 1


def _term(where: str, term: object, n: int) -> dict[str, object]:
    if not isinstance(term, Mapping):
        raise FormatError(where, "an object with f, R and A is needed")
    refuse_fields(where, term, ("f", "R", "A"), {"f", "A"})
    R = term.get("R")
    if R is not None and (not isinstance(R, list) or not 1 <= len(R) <= MAX_CHANNELS):
        raise FormatError(f"{where}.R", "null or a list of rows is needed")
    k = n if R is None else len(R)
    texts = [term["f"]] * k if isinstance(term["f"], str) else term["f"]
    if not isinstance(texts, list) or len(texts) != k:
        raise FormatError(f"{where}.f", f"one expression, or one per row of R ({k}), is needed")
    for text in dict.fromkeys(text if isinstance(text, str) else None for text in texts):
        _refuse_expression(f"{where}.f", text)
    return {
        "f": texts[0] if len(set(texts)) == 1 else texts,
        "R": None if R is None else read_matrix(f"{where}.R", R, k, n),
        "A": read_matrix(f"{where}.A", term["A"], n, k),
    }


def _refuse_expression(where: str, text: str | None) -> None:
    if text is None or not text.isprintable():
        raise FormatError(where, "an expression is printable text")
    try:
        parse(text)
    except ExpressionError as error:
        raise FormatError(where, str(error)) from None
