"""The model x' = A0 (x - x_ref) + sum A f(R (x - x_ref)) + B (u - u_ref) + b, read in its canonical form.

In discrete time the same right side is x+ - x_ref, x+ the state one step of `dt` later. With algebraic variables, which
come after the states, the last rows of the right side are equations: zero, instead of a derivative.
"""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

from persid_check.entry import Entry, Row
from persid_check.exact import Matrix, blocks, diagonal, matrix
from persid_check.expression import Program, is_linear

FORMAT = "persid-model-1"
FIELDS = ("format", "states", "inputs", "x_ref", "u_ref", "A0", "terms", "B", "b", "domain")
CLOCK = ("time", "dt")  # of a model in discrete time, dt in s
ALGEBRAIC = "algebraic"  # of a model with equations: the names of its algebraic variables
MAX_STATES = 2000
MAX_CHANNELS = 3000  # 12 functions for each of 250 states, 3 for each of 1000, 1 for each of 2000


@dataclass(frozen=True)
class Channel:
    """One scalar channel a f(r'(x - x_ref)): `row` is r (its nonzero entries), `column` is a."""

    text: str
    program: Program
    row: Row
    column: tuple[float, ...]


@dataclass(frozen=True)
class Model:
    """A model with its linear terms merged into A0, exactly; every number stands for itself, no rounding.

    `linear` is A0 as one matrix.
    `dt` is the length of a step in s in discrete time, None in continuous time. `algebraic` is how many of the
    variables, the last ones, are algebraic: their rows are equations.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    x_ref: tuple[Fraction, ...]
    u_ref: tuple[Fraction, ...]
    linear: Matrix
    channels: tuple[Channel, ...]
    B: tuple[tuple[float, ...], ...]
    b: tuple[float | Fraction, ...]
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
        return replace(self, linear=self.linear + -diagonal([1] * self.n), dt=None)

    @cached_property
    def A0(self) -> tuple[tuple[Fraction, ...], ...]:
        """The rows of A0."""
        return self.linear.rows

    @property
    def flow(self) -> Matrix:
        """G = [A0, all a_c]."""
        return blocks([[self.linear, matrix([channel.column for channel in self.channels], self.n).T]])

    @property
    def n(self) -> int:
        """Number of variables: states, then algebraic ones."""
        return len(self.states)

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.inputs)


def sha256_of(form: Mapping[str, object]) -> str:
    """Return the SHA-256 of a canonical form, written as JSON with sorted keys and no spaces."""
    text = json.dumps(form, sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode("utf-8")).hexdigest()


def model_of(form: Mapping[str, object], *, discrete: bool = False, algebraic: bool = False) -> Model:
    """Return the model of a canonical form; see `read_model`."""
    return read_model(Entry(form, "model"), discrete=discrete, algebraic=algebraic)


def read_model(entry: Entry, *, discrete: bool = False, algebraic: bool = False) -> Model:
    """Return a model that stands in canonical form, with terms f = x merged into A0: nothing is left out or expanded.

    One in discrete time, or with algebraic variables, only for callers that say they know what to do with it.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    given = entry.fields(FIELDS, (*CLOCK, ALGEBRAIC))
    given["format"].require(given["format"].value == FORMAT, f'"{FORMAT}" is needed')
    names, inputs, dt = _variables(given), given["inputs"].names(), _step(given)
    n, m, order = len(names), len(inputs), len(given["states"].value)
    few = order > 0 and n <= MAX_STATES and m <= MAX_STATES
    given["states"].require(few, f"1 to {MAX_STATES} states and at most {MAX_STATES} inputs are read")
    if order < n and not algebraic:
        given[ALGEBRAIC].refuse("nothing of this kind is proved of a model with algebraic variables")
    if dt is not None and not discrete:
        given["time"].refuse("nothing of this kind is proved of a model in discrete time")
    if given["domain"].value is not None:  # where data were, which no proof uses
        given["domain"].matrix(n, 2)
    linear, channels = _merged(matrix(given["A0"].matrix(n, n), n), list(_channels(given["terms"], n)))
    return Model(
        states=tuple(names),
        inputs=tuple(inputs),
        x_ref=tuple(map(Fraction, given["x_ref"].vector(n))),
        u_ref=tuple(map(Fraction, given["u_ref"].vector(m))),
        linear=linear,
        channels=channels,
        B=tuple(map(tuple, given["B"].matrix(n, m))),
        b=tuple(given["b"].vector(n)),
        dt=dt,
        algebraic=n - order,
    )


def _variables(given: Mapping[str, Entry]) -> list[str]:
    """Return the names of states and algebraic variables."""
    names = given["states"].names()
    if ALGEBRAIC not in given:
        return names
    added = given[ALGEBRAIC]
    added.require(added.names(), "at least one name is needed; without equations the field is left out")
    added.require(given.keys().isdisjoint(CLOCK), "a model with algebraic variables is in continuous time")
    return Entry([*names, *added.value], "model.algebraic").names()


def _step(given: Mapping[str, Entry]) -> Fraction | None:
    """Return the length of a step in discrete time; in continuous time both fields are left out."""
    stated = [given[name] for name in CLOCK if name in given]
    if not stated:
        return None
    discrete = len(stated) == 2 and stated[0].value == "discrete"
    stated[0].require(discrete, '"discrete" with a step dt, or neither, is needed')
    dt = stated[1].binary64()
    return Fraction(dt) if dt > 0 else stated[1].refuse("a step in s is positive")


def _channels(terms: Entry, n: int) -> Iterator[Channel]:
    listed = [term.fields(("f", "R", "A")) for term in terms.items(longest=MAX_CHANNELS)]
    terms.require(sum(_count(term, n) for term in listed) <= MAX_CHANNELS, f"more than {MAX_CHANNELS} channels")
    for term in listed:
        yield from _of_term(term, n)


def _count(term: Mapping[str, Entry], n: int) -> int:
    """Return how many channels a term has, one at least."""
    if term["R"].value is None:
        return n
    return len(term["R"].items()) or term["R"].refuse("one row at least is needed")


def _of_term(term: Mapping[str, Entry], n: int) -> Iterator[Channel]:
    """The channels of A f(R (x - x_ref)); R = null is the identity, and `f` is one text where all are the same."""
    k, R, f = _count(term, n), term["R"], term["f"]
    rows = [{i: Fraction(1)} for i in range(n)] if R.value is None else map(_nonzero, R.matrix(k, n))
    texts = [f] * k if isinstance(f.value, str) else f.items(k)
    programs: dict[str, Program] = {}
    for text in texts:
        if not isinstance(text.value, str) or text.value not in programs:
            programs[text.value] = text.program()
    f.require(isinstance(f.value, str) or len(programs) > 1, "one text stands where all are the same")
    columns = zip(*term["A"].matrix(n, k), strict=True)
    for text, row, column in zip(texts, rows, columns, strict=True):
        yield Channel(text.value, programs[text.value], row, column)


def _nonzero(row: list[float]) -> Row:
    return {j: Fraction(value) for j, value in enumerate(row) if value}


def _merged(A0: Matrix, channels: Sequence[Channel]) -> tuple[Matrix, tuple[Channel, ...]]:
    """Return A0 with the terms f = x added, by one product of exact matrices, and the other terms."""
    n, linear = A0.width, [channel for channel in channels if is_linear(channel.program)]
    if linear:
        R = matrix([[channel.row.get(j, 0) for j in range(n)] for channel in linear], n)
        A0 += matrix([channel.column for channel in linear], n).T * R
    return A0, tuple(channel for channel in channels if not is_linear(channel.program))
