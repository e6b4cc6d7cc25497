"""The values of a ledger: what a certificate of format 2 says, each noun frozen (docs/ledger.md, section 8)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property

from persid_check.definite import Root
from persid_check.entry import Factor, Lower
from persid_check.expression import Program
from persid_check.ledger.lemmas import Cuts, Functions, is_odd, vanishes
from persid_check.model import Model
from persid_check.reading import Ball
from persid_check.work import spend_products

RISING = ("nondecreasing", "rising")

Row = Mapping[int, Fraction]


@dataclass(frozen=True)
class Upper:
    """The integral of l'Phi is at most c s l'Phi + e; without cuts by a rule of the specification."""

    c: Fraction
    e: Fraction
    cuts: Cuts | None


@dataclass(frozen=True)
class Form:
    """A row l over (y, f_1, ..., f_J), what it is, and bounds of its integral; `lower` is (d, j)."""

    l: tuple[Fraction, ...]  # noqa: E741 (the letter of the mathematics)
    kind: str
    cuts: Cuts
    offset: Fraction
    upper: Upper | None
    lower: tuple[Fraction, int] | None


@dataclass(frozen=True)
class ProductForm:
    """(l_k'phi)(l_q'phi) + c >= 0."""

    k: int
    q: int
    c: Fraction
    cuts: Cuts


@dataclass(frozen=True)
class Curve:
    """Functions f_j(a_j y), the possible centres (None, a ball (c, r), or "any"), the domain (None: R), its forms."""

    functions: Functions
    shift: tuple[Fraction, Fraction] | str | None
    domain: tuple[Fraction, Fraction] | None
    continuous: Cuts
    forms: tuple[Form, ...]
    products: tuple[ProductForm, ...]

    @cached_property
    def resting(self) -> tuple[bool, ...]:
        """Whether l'Phi(0) = 0, form by form: of itself where something is subtracted, else by exact evaluation."""
        return tuple(self.shift is not None or vanishes(self.functions, form.l) for form in self.forms)

    @cached_property
    def odd(self) -> bool:
        """Whether every function is odd by its form."""
        return is_odd(self.functions)

    @cached_property
    def squares(self) -> tuple[bool, ...]:
        """Whether a bound from below is one by the form's square, (d/2) g^2: form j is e_0 - d l; form by form."""
        return tuple(form.lower is not None and self._is_square(form.l, *form.lower) for form in self.forms)

    def _is_square(self, l: Sequence[Fraction], d: Fraction, j: int) -> bool:  # noqa: E741
        spend_products(len(l), l, (d,))
        return self.forms[j].l == (1 - d * l[0], *(-d * value for value in l[1:]))

    def is_sector(self, k: int) -> bool:
        """Whether form k is a sector form: as it says, or because it does not fall and rests at 0."""
        kind = self.forms[k].kind
        return kind in ("sector", "growing") or (kind in RISING and self.resting[k])


@dataclass(frozen=True)
class Point:
    """A curve on a row of the states; the channels that are its functions; densities (form, mu)."""

    curve: int
    row: Row
    channels: tuple[int, ...]
    densities: tuple[tuple[int, Fraction], ...]


@dataclass(frozen=True)
class Fact:
    """A multiple of the product of form k at point p and form l at point q.

    sign 0: (l_k'Phi_p)(l_l'Phi_q); sign +1 or -1: both forms of Phi_p + sign Phi_q. `constant`: products[k] of p.
    `slope`: both forms of the derivative of Phi_p along the solution. `step`: of Phi_p after a step plus sign Phi_q.
    """

    kind: str
    p: int
    q: int
    sign: int
    k: int
    l: int  # noqa: E741
    tau: Fraction


@dataclass(frozen=True)
class Deviation:
    """L w with |w|^2 <= |C zeta_0|^2 + epsilon^2, C of so many rows, and its multiplier s."""

    columns: tuple[Row, ...]
    C: tuple[Row, ...]
    s: Fraction
    epsilon: Fraction


@dataclass(frozen=True)
class Map:
    """An output map h that is nowhere steeper than L, by its cuts."""

    h: Program
    L: Fraction
    cuts: Cuts


@dataclass(frozen=True)
class Output:
    """y = h(row'x + direct'v + ...) with (row'x)^2 <= constant V."""

    name: str
    row: Row
    direct: tuple[Fraction, ...]
    constant: Fraction
    map: Map | None

    @property
    def steepness(self) -> Fraction:
        """The Lipschitz constant of h."""
        return Fraction(1) if self.map is None else self.map.L


@dataclass(frozen=True)
class Outputs:
    """The outputs of a model, and the hash of both."""

    sha256: str
    listed: tuple[Output, ...]


@dataclass(frozen=True)
class Reach:
    """How far the row of a point may go: (r'z)^2 <= alpha V + beta |v|^2, by equations, facts and a proof."""

    equations: tuple[Row, ...]
    facts: tuple[Fact, ...]
    alpha: Fraction
    beta: Fraction
    proof: Factor


@dataclass(frozen=True)
class Algebraic:
    """What a file says of equations: why they have one solution, their multipliers, and how far points may go."""

    solving: tuple[Row, ...]
    products: tuple[Fact, ...]
    proof: Factor
    equations: tuple[Row, ...]
    bounds: tuple[Reach, ...] = ()


@dataclass(frozen=True)
class Ledger:
    """A certificate of format 2. `P` and `gamma` are lower rows; P has one entry a row where it is diagonal.

    P is over the states and the values of `inside`, channels. `identity` lists (i, j, sigma) with entries i >= j of
    (x, s): the sum of all 2 sigma zeta_i zeta_j is zero.
    """

    claim: str
    sha256: str
    form: Mapping[str, object]
    model: Model
    ball: Ball | None
    curves: tuple[Curve, ...]
    points: tuple[Point, ...]
    facts: tuple[Fact, ...]
    diagonal: bool
    P: Lower
    inside: tuple[int, ...]
    gamma: Fraction | Lower
    deviations: tuple[Deviation, ...]
    dropped: tuple[int, ...]
    spanning: tuple[tuple[int, int], ...]
    kappa: Fraction
    p: Fraction
    strips: tuple[tuple[Row, Fraction, Fraction], ...]
    level: Fraction
    input_bound: Fraction
    outputs: Outputs | None
    proof: Mapping[str, Factor | Root]
    algebraic: Algebraic | None = None
    identity: tuple[tuple[int, int, Fraction], ...] = ()

    @property
    def has_slopes(self) -> bool:
        """Whether V reads values of functions, or a fact is about slopes along solutions."""
        return bool(self.inside) or any(fact.kind == "slope" for fact in self.facts)

    @cached_property
    def inside_at(self) -> Mapping[int, int]:
        """The place of each channel among those whose values P reads."""
        return {c: i for i, c in enumerate(self.inside)}

    def centre(self, p: int) -> tuple[Fraction, Fraction]:
        """Return the ball of r_p'(x* - x_ref)."""
        if self.ball is None:
            return Fraction(0), Fraction(0)
        if p not in self._centres:
            row, offset = self.points[p].row, self._offset
            spend_products(len(row), row.values(), (offset[i] for i in row))
            middle = sum((r * offset[i] for i, r in row.items()), Fraction(0))
            self._centres[p] = middle, self.ball.radius * sum(map(abs, row.values()), Fraction(0))
        return self._centres[p]

    @cached_property
    def _centres(self) -> dict[int, tuple[Fraction, Fraction]]:
        return {}

    @cached_property
    def _offset(self) -> list[Fraction]:
        point = self.model.x_ref if self.ball is None else self.ball.x
        return [x - r for x, r in zip(point, self.model.x_ref, strict=True)]

    @property
    def counts_b(self) -> bool:
        """Whether b is one more input column, with the constant input 1."""
        return self.ball is None and any(self.model.b)

    @property
    def entries(self) -> int:
        """Number of entries of (x, s), with algebraic variables of (z, s)."""
        return self.model.n + len(self.model.channels)

    @property
    def sides(self) -> list[tuple[Row, Fraction, Fraction]]:
        """The strips lo <= r'z <= hi of a region: domains of points, then those of the file."""
        domains = ((point.row, self.curves[point.curve].domain) for point in self.points)
        return [*((row, *domain) for row, domain in domains if domain is not None), *self.strips]

    def is_of_states(self, row: Row) -> bool:
        """Whether a row reads no algebraic variable."""
        return all(i < self.model.order for i in row)

    def reads_algebraic(self, p: int) -> bool:
        """Whether the row of point p reads an algebraic variable."""
        return not self.is_of_states(self.points[p].row)

    @property
    def inputs(self) -> int:
        """Number of entries of v."""
        return self.model.m + self.counts_b
