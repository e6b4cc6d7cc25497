"""The one matrix of the ledger (docs/ledger.md, sections 5 and 10), exactly: facts of any kind, any rows.

With zeta = (x, s, v), x' = G zeta and half the gradient of V equal to E'zeta,

    M = Gamma - kappa W - (E G + G'E') - sum tau (p q' + q p')           Pt = P + sum mu d r r'

Every unknown is a sum of pairs of rows, in M and in Pt, just as in `inequality`; a pair (p, q) stands for p q' + q p':
    P_ij: (e_i, -g_j - kappa/2 e_j) and its mirror image,     mu: (l'N, -r'G - kappa c r),     tau: (p, -q).
In discrete time, x+ = G zeta and s+ = s + sigma, z+ = H zeta, and with g+ and dg the form after a step and its rise
    P_ij: ((1 - kappa) e_i, e_j) and (-h_i, h_j),     mu: (l'N, -kappa c r), (g+, -dy) and (dg, d/2 dg).
An equation 0 = h'zeta of a model with algebraic variables has a multiplier for every entry of zeta: (e_i, -h).
With slopes, P is over z = (x, values of functions) and zeta = (x, s, sigma, v), z' = (G zeta, sigma).
Rows are kept as fractions: which of their products cancel is a question with an exact answer (`zero_rows`).
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from itertools import combinations, combinations_with_replacement, product

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse

from persid.lyapunov.pairs import Problem
from persid.lyapunov.points import Form, Point, Row
from persid.lyapunov.unknowns import Label
from persid_check.model import Model

_HALF, _ONE = Fraction(1, 2), Fraction(1)
Pair = tuple[Row, Row]
Strip = tuple[Mapping[int, Fraction], Fraction, Fraction]  # lo < r'x < hi


@dataclass(frozen=True)
class Unknown:
    """A coefficient of M and Pt; `label` says what it multiplies, and a `multiplier` is to be positive."""

    label: Label
    M: tuple[Pair, ...]
    Pt: tuple[Pair, ...] = ()
    multiplier: bool = True


@dataclass(frozen=True, eq=False)
class Frame:
    """A model about a point: x' = G zeta, or x+ = G zeta, over x, the channels of the points, and v, with the points.

    Of a model with algebraic variables x are all variables, and the last rows of G are equations, 0 = H zeta.

    `lone` is 1 where the constant b is one more input. `between` solutions holds what is proved with V = x'P x and
    products of two nondecreasing forms at one point. `sloped`: V reads values of functions, and slopes along solutions
    make facts. In badly scaled coordinates `basis` has the rows of better ones, and P is made of their products. Of
    each of the `identities` the sum of all 2 sigma zeta_i zeta_j, (i, j, sigma) in it, is zero for every x. `strips`
    bound a region beside the domains of points.
    """

    model: Model
    points: tuple[Point, ...]
    lone: bool
    between: bool = False
    sloped: bool = False
    solving: Mapping[Label, Fraction] = field(default_factory=dict)  # why equations have one solution
    basis: tuple[Row, ...] = ()
    identities: tuple[tuple[tuple[int, int, Fraction], ...], ...] = ()
    strips: tuple[Strip, ...] = ()

    @property
    def monotone(self) -> "Frame":
        """The frame with what proves a bound between any two solutions."""
        points = tuple(
            replace(point, forms=tuple(form for form in point.forms if form.kind == "nondecreasing"))
            for point in self.points
        )
        return replace(self, points=points, between=True)

    @property
    def n(self) -> int:
        """Number of variables: states, then algebraic ones."""
        return self.model.n

    @property
    def order(self) -> int:
        """Number of states."""
        return self.model.order

    @cached_property
    def places(self) -> dict[int, int]:
        """The entry of zeta of every channel that acts."""
        acting = sorted(c for point in self.points for c in point.channels)
        return {c: self.n + k for k, c in enumerate(acting)}

    @cached_property
    def slopes(self) -> dict[int, int]:
        """The entry of zeta of the derivative of every value that V reads."""
        inside = sorted(c for point in self.points for c in point.restricted) if self.sloped else ()
        return {c: self.n + len(self.places) + k for k, c in enumerate(inside)}

    @property
    def z(self) -> list[int]:
        """The entries of zeta that P reads."""
        return [*range(self.order), *(self.places[c] for c in self.slopes)]

    @property
    def entries(self) -> int:
        """Number of entries of x, s and sigma."""
        return self.n + len(self.places) + len(self.slopes)

    @property
    def width(self) -> int:
        """Number of entries of zeta."""
        return self.entries + self.model.m + self.lone

    @property
    def is_regional(self) -> bool:
        """Whether a curve is known on a strip alone, or a region has strips of its own."""
        return bool(self.sides)

    @property
    def sides(self) -> list[Strip]:
        """All strips of a region: domains of points, then its own."""
        domains = ((point.row, point.curve.domain) for point in self.points)
        return [*((row, *domain) for row, domain in domains if domain is not None), *self.strips]

    @cached_property
    def flow(self) -> tuple[Row, ...]:
        """The rows of G."""
        model, found = self.model, []
        for i in range(self.n):
            row = {j: v for j, v in enumerate(model.A0[i]) if v}
            row |= {at: Fraction(v) for c, at in self.places.items() if (v := model.channels[c].column[i])}
            inputs = (*model.B[i], model.b[i]) if self.lone else model.B[i]
            row |= {self.entries + j: Fraction(v) for j, v in enumerate(inputs) if v}
            found.append(row)
        return tuple(found)

    def unit(self, i: int) -> Row:
        """Return the row that is entry i of zeta, in coordinates of `basis`."""
        return self.basis[i] if self.basis and i < self.n else {i: _ONE}

    def along(self, row: Row, kappa: Fraction) -> Row:
        """Return -r'G - kappa r, of a row over z."""
        total: dict[int, Fraction] = {i: -kappa * v for i, v in row.items()} if kappa else {}
        for i, r in row.items():
            for j, v in (self.flow[i] if i < self.n else self._sigma[i]).items():
                total[j] = total.get(j, Fraction(0)) - r * v
        return {j: v for j, v in total.items() if v}

    @cached_property
    def _sigma(self) -> dict[int, Row]:
        """The derivative of the entry of each value that V reads."""
        return {self.places[c]: {at: _ONE} for c, at in self.slopes.items()}

    @cached_property
    def _next(self) -> dict[int, Row]:
        """The rows of z after a step."""
        values = {
            at: {at: _ONE, sigma: _ONE} for at, sigma in zip(self.z[self.order :], self.slopes.values(), strict=True)
        }
        return dict(enumerate(self.flow)) | values

    def unknowns(self, kappa: Fraction, *, across: bool) -> list[Unknown]:
        """Return P, densities and facts; those of two channels only `across`."""
        if self.between:
            return [*self._quadratic(kappa), *self._values(), *self._equations()]
        joint = self._across() if across else ()
        moving = self._steps(across=across) if self.model.is_discrete else self._slopes()
        known = (*self._values(), *joint, *moving, *self._equations(), *self._identities())
        return [*self._quadratic(kappa), *self._densities(kappa), *known]

    def _equations(self) -> Iterator[Unknown]:
        for h in range(self.order, self.n):
            down = {j: -v for j, v in self.flow[h].items()}
            for i in range(self.width):
                yield Unknown(("equation", h - self.order, i), (({i: _ONE}, down),), multiplier=False)

    def _identities(self) -> Iterator[Unknown]:
        for k, identity in enumerate(self.identities):
            pairs = tuple(({i: _ONE}, {j: -sigma}) for i, j, sigma in identity)
            yield Unknown(("identity", k), pairs, multiplier=False)

    def _quadratic(self, kappa: Fraction) -> Iterator[Unknown]:
        return self._stepped(kappa) if self.model.is_discrete else self._flowing(kappa)

    def _stepped(self, kappa: Fraction) -> Iterator[Unknown]:
        """What (1 - kappa) x'P x - x+'P x+ holds of each entry of P."""
        for i, j in combinations_with_replacement(self.z, 2):
            share = _HALF if i == j else _ONE
            down = {k: -share * v for k, v in self._next[i].items()}
            pairs = ({i: (1 - kappa) * share}, {j: _ONE}), (down, self._next[j])
            yield Unknown(("P", i, j), pairs, (({i: share}, {j: _ONE}),), multiplier=False)

    def _flowing(self, kappa: Fraction) -> Iterator[Unknown]:
        unit = {i: self.unit(i) for i in self.z}
        down = {i: self.along(row, kappa / 2) for i, row in unit.items()}
        for i, j in combinations_with_replacement(self.z, 2):
            if i == j:
                half = {k: v / 2 for k, v in unit[i].items()}
                yield Unknown(("P", i, i), ((unit[i], down[i]),), ((unit[i], half),), multiplier=False)
            else:
                pairs = ((unit[i], down[j]), (unit[j], down[i]))
                yield Unknown(("P", i, j), pairs, ((unit[i], unit[j]),), multiplier=False)

    def _densities(self, kappa: Fraction) -> Iterator[Unknown]:
        for p, point in enumerate(self.points):
            if any(i >= self.order for i in point.row):
                continue
            steady = point.steady if self.sloped else ()
            for k, form in enumerate(point.forms):
                if self.model.is_discrete and k not in steady:
                    continue
                if np.isfinite(form.c) and any(form.form[1:]):
                    row, d = point.row, Fraction(form.d)
                    if form.square and self.sloped:
                        row, d = point.reads(form.form, self.places), Fraction(form.square)
                    below = {i: d / 2 * r for i, r in row.items()}
                    pairs = self._gained(point, k, kappa)
                    yield Unknown(("mu", p, k), pairs, ((row, below),) if d else ())

    def _gained(self, point: Point, k: int, kappa: Fraction) -> tuple[Pair, ...]:
        """What V' + kappa W, or V(x+) - V(x) + kappa W, has of the integral of a form, with its sign turned."""
        form = point.forms[k]
        g, c = point.reads(form.form, self.places), kappa * Fraction(form.c)
        if not self.model.is_discrete:
            return ((g, self.along(point.row, c)),)
        after, y = (self._after(point, each) for each in (form.form, (1.0, *[0.0] * len(point.channels))))
        dg, dy = _sum(after, g, -1), _sum(point.row, y, -1)
        share = {i: Fraction(form.square) / 2 * v for i, v in dg.items()}
        pairs = (g, {i: -c * v for i, v in point.row.items()}), (after, dy), (dg, share)
        return tuple(pair for pair, used in zip(pairs, (c, 1, form.square), strict=True) if used)

    def _after(self, point: Point, form: Form) -> Row:
        """Return a form of a point after a step."""
        first, *values = (Fraction(v) for v in form)
        read = [(c, v) for c, v in zip(point.channels, values, strict=True) if v]
        s = {at[c]: v for at in (self.places, self.slopes) for c, v in read}
        return _sum(s, self.along(point.row, Fraction(0)), -first)

    def _steps(self, *, across: bool) -> Iterator[Unknown]:
        """Products of forms of a point after a step, and of its differences from points now."""
        for (p, here), (q, there) in product(enumerate(self.points if self.sloped else ()), repeat=2):
            if not here.restricted or (p != q and not (across and self._alike(here, there))):
                continue
            signs = [-1] + [0] * (p == q) + [1] * here.is_odd
            for sign, (k, j) in product(signs, combinations(here.steady, 2)):
                after = (self._after(here, here.forms[i].form) for i in (k, j))
                now = (there.reads(here.forms[i].form, self.places) for i in (k, j))
                rows = (_sum(a, b, sign) for a, b in zip(after, now, strict=True))
                yield self._fact(("step", p, q, sign, k, j), *rows)

    @staticmethod
    def _alike(here: Point, there: Point) -> bool:
        """Whether points stand on one curve with one known centre."""
        return here.curve == there.curve and (here.curve.shift is None or here.curve.shift[1] == 0)

    def _values(self) -> Iterator[Unknown]:
        for p, point in enumerate(self.points):
            sectors = [k for k, form in enumerate(point.forms) if form.kind in ("nondecreasing", "sector")]
            for k, j in combinations(sectors, 2):
                yield self._fact(("value", p, k, j), *(point.reads(point.forms[i].form, self.places) for i in (k, j)))

    def _slopes(self) -> Iterator[Unknown]:
        """Products of nondecreasing forms of (y', sigma), y' = r'G zeta."""
        for p, point in enumerate(self.points if self.sloped else ()):
            if not point.restricted:
                continue
            y = {i: -v for i, v in self.along(point.row, Fraction(0)).items()}
            for k, j in combinations(point.steady, 2):
                yield self._fact(("slope", p, k, j), *(self._slope(point, y, i) for i in (k, j)))

    def _slope(self, point: Point, y: Row, k: int) -> Row:
        first, *values = (Fraction(v) for v in point.forms[k].form)
        total = {i: first * v for i, v in y.items()} if first else {}
        return total | {self.slopes[c]: v for c, v in zip(point.channels, values, strict=True) if v}

    def _across(self) -> Iterator[Unknown]:
        signed = [
            (p, k, point.reads(form.form, self.places))
            for p, point in enumerate(self.points)
            for k, form in enumerate(point.forms)
            if form.kind == "one-signed"
        ]
        for (p, k, a), (q, j, b) in combinations(signed, 2):
            if p != q:
                yield self._fact(("one_signed", p, k, q, j), a, b)
        for p, q in combinations(range(len(self.points)), 2):
            here, there = self.points[p], self.points[q]
            if self._alike(here, there):
                signs = (-1, 1) if here.is_odd else (-1,)
                for sign, (k, j) in product(signs, combinations(here.rising, 2)):
                    yield self._fact(("difference", p, q, sign, k, j), *(self._joint(p, q, sign, i) for i in (k, j)))

    def _joint(self, p: int, q: int, sign: int, k: int) -> Row:
        """Return l'(Phi_p ± Phi_q)."""
        form = self.points[p].forms[k].form
        first, second = (self.points[i].reads(form, self.places) for i in (p, q))
        return _sum(first, second, sign)

    @staticmethod
    def _fact(label: tuple[object, ...], a: Row, b: Row) -> Unknown:
        return Unknown(label, ((a, {i: -v for i, v in b.items()}),))


def _sum(a: Row, b: Row, factor: int | Fraction) -> Row:
    """Return a + factor b."""
    total = dict(a)
    for i, v in b.items():
        total[i] = total.get(i, Fraction(0)) + factor * v
    return {i: v for i, v in total.items() if v}


@dataclass(frozen=True, eq=False)
class Matrices:
    """M on the kept entries and Pt as functions of the unknowns, in units in which all are of moderate size.

    y = sizes * y^, zeta = units * zeta^, and M is divided by `rate`, so that it is of the size of Pt.
    """

    frame: Frame
    unknowns: Sequence[Unknown]
    units: Float[ndarray, " w"]
    rate: float
    kept: Int[ndarray, " k"]

    @cached_property
    def back(self) -> Float[ndarray, "n n"]:
        """The states in units as states: x = back x^."""
        n = self.frame.n
        rows = [[float(row.get(i, 0)) for i in range(n)] for row in self.frame.basis]
        S = np.array(rows) if rows else np.eye(n)
        return np.asarray(np.linalg.inv(S) * self.units[:n])

    @property
    def identity(self) -> Float[ndarray, "k k"]:
        """|x|^2 as a form over z in units."""
        n, values = self.frame.order, len(self.frame.z) - self.frame.order
        states = self.back[:n, :n]
        return np.pad(states.T @ states, ((0, values), (0, values)))

    @cached_property
    def sizes(self) -> Float[ndarray, " J"]:
        """The sizes of unknowns: P in units of the states, others so that their part of M has about norm 1."""
        return np.array([self._size(each) for each in self.unknowns])

    def _size(self, unknown: Unknown) -> float:
        if unknown.label[0] == "P":
            _, i, j = unknown.label
            return float((1 + (i == j)) / (self.units[i] * self.units[j]))
        return self.rate / (2 * sum(self._norm(a) * self._norm(b) for a, b in unknown.M) or 1.0)

    def _norm(self, row: Row) -> float:
        return float(np.linalg.norm(self.row(row)[: self.frame.entries]))

    def row(self, row: Row) -> Float[ndarray, " w"]:
        """Return a row over zeta in units."""
        n, found = self.frame.n, np.zeros(self.frame.width)
        found[list(row)] = [float(v) for v in row.values()]
        found[n:] *= self.units[n:]
        found[:n] = found[:n] @ self.back
        return found

    def part(self, chosen: Sequence[int]) -> "Matrices":
        """Return the matrices of some of the unknowns."""
        return replace(self, unknowns=[self.unknowns[k] for k in chosen])

    def M(
        self, more: Sequence[Sequence[tuple[int, float]]] = (), *, inputs: bool = False, sign: float = 1.0
    ) -> Problem:
        """Return M times a sign, with unknowns at the end that are diagonal: lists of entries and coefficients."""
        kept = [*self.kept, *range(self.frame.entries, self.frame.width)] if inputs else self.kept
        return self._pairs([each.M for each in self.unknowns], np.array(kept, int), sign / self.rate, more)

    def Pt(self, more: Sequence[Sequence[tuple[int, float]]] = ()) -> Problem:
        """Return Pt, likewise."""
        return self._pairs([each.Pt for each in self.unknowns], np.array(self.frame.z), 1.0, more)

    def _pairs(
        self, parts: Sequence[tuple[Pair, ...]], kept: ndarray, weight: float,
        more: Sequence[Sequence[tuple[int, float]]],
    ) -> Problem:  # fmt: skip
        pairs = [
            (a, b, weight * size, k)
            for k, (part, size) in enumerate(zip(parts, self.sizes, strict=True))
            for a, b in part
        ]
        added = [
            (self.frame.unit(i), self.frame.unit(i), v / 2 / self.units[i] ** 2, len(parts) + k)
            for k, each in enumerate(more)
            for i, v in each
        ]
        return paired([*pairs, *added], len(parts) + len(more), len(kept), lambda row: self.row(row)[kept])


def paired(
    pairs: Sequence[tuple[Row, Row, float, int]], count: int, order: int, read: Callable[[Row], ndarray]
) -> Problem:
    """Return pairs with weights and the unknowns that they belong to; `read` gives a row in units, on kept entries."""
    left, p = _distinct([a for a, *_ in pairs], order, read)
    right, q = _distinct([b for _, b, *_ in pairs], order, read)
    data = np.array([weight for *_, weight, _ in pairs], float)
    owner = np.array([k for *_, k in pairs], int)
    tie = sparse.csr_array((data, (np.arange(len(pairs)), owner)), shape=(len(pairs), count))
    eye = sparse.csr_array(sparse.eye_array(order))
    return Problem(
        S=sparse.csr_array(left), H=right, p=p, q=len(left) + q, cost=np.zeros(count), C=eye, symmetric=0, tie=tie
    )


def _distinct(
    rows: Sequence[Row], order: int, read: Callable[[Row], ndarray]
) -> tuple[Float[ndarray, "r k"], Int[ndarray, " K"]]:
    """Return the distinct rows and which one each row is."""
    numbers: dict[tuple[tuple[int, Fraction], ...], int] = {}
    where = [numbers.setdefault(tuple(sorted(row.items())), len(numbers)) for row in rows]
    found = [read(dict(row)) for row in numbers]
    return np.array(found).reshape(len(numbers), order), np.array(where, int)
