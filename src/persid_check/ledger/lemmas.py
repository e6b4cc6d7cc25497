"""Lemmas about one function of one variable: the file carries the partition, each piece is evaluated once.

A lemma is about raw g(y) = l'phi(y), phi(y) = (y, f_1(a_1 y), ...), seen from a centre y*: g(y) - g(y*) for all y*
in an interval. Its *quantity* q(y) must be >= 0 on every piece; which one, its kind says (specification, section 2).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from decimal import Context, Decimal
from fractions import Fraction
from functools import cached_property
from itertools import pairwise
from typing import Self, TypeVar

from flint import ctx, fmpq

from persid_check.enclosure import (
    PRECISION,
    Element,
    Interval,
    UndefinedError,
    between,
    constant,
    value,
    value_and_slope,
)
from persid_check.expansion import CONSTANT, Expansion, Horizon
from persid_check.expression import Program, work_of
from persid_check.work import once, spend

Functions = tuple[tuple[Program, Fraction], ...]
Form = tuple[Fraction, ...]
Cuts = tuple[Fraction, ...]
E = TypeVar("E", bound=Element)

SLOPES = ("nondecreasing", "rising")  # kinds whose quantity is g' itself: the centre plays no part
JOINED = 4  # steps of a function of a curve beside its own: its argument is scaled, its value and slope joined
STRICT = ("growing", "rising")  # kinds with q > 0, and |g| -> infinity at both ends
SUMMED = ("offset", "upper")  # kinds whose quantity is added up: it may fall below 0 where it rose before
_ZERO, _ONE = Fraction(0), Fraction(1)


@dataclass(frozen=True)
class Lemma:
    """A kind of statement about a form of some functions, about a centre (None: y* = 0 and nothing is subtracted).

    `kind` is a kind of form, or "upper" with its factor c. `allowance` is the o or e of what is added up.
    """

    functions: Functions
    form: Form
    kind: str
    centre: tuple[Fraction, Fraction] | None = None
    c: Fraction = _ZERO
    allowance: Fraction = _ZERO

    @property
    def _star(self) -> tuple[Fraction, Fraction]:
        """The least and the largest centre."""
        return self.centre or (_ZERO, _ZERO)

    @once
    def unproved(self, cuts: Cuts, domain: tuple[Fraction, Fraction] | None) -> str | None:
        """Return where the lemma is not proved, None where it is: on all pieces, and beyond them without a domain."""
        with ctx.workprec(PRECISION):
            return self._unproved_on(cuts, domain)

    def _unproved_on(self, cuts: Cuts, domain: tuple[Fraction, Fraction] | None) -> str | None:
        (low, high), first, ends = self._star, cuts[0], _ends(cuts, domain)
        if first == 0 and self.even:  # what holds to the right of 0 holds to the left
            first, ends = -cuts[-1], ends[1:]
        if domain is not None and self.kind in STRICT:
            return "growth is a property on all of R"
        if domain is not None and not (first <= low + domain[0] and high + domain[1] <= cuts[-1]):
            return "the cuts do not cover the domain"
        if domain is None and not (first < min(low, _ZERO) and max(high, _ZERO) < cuts[-1]):
            return "the cuts do not hold 0 and the centre inside"
        if self.kind in SUMMED:
            return self._added_up(cuts) or _first_unproved(self, (), ends)
        return _first_unproved(self, pairwise(cuts), ends)

    @cached_property
    def even(self) -> bool:
        """Whether the quantity is the same at y and at -y: g is odd by its form, and seen from 0."""
        if self.kind == "one-signed" or (self.kind not in SLOPES and any(self._star)):
            return False
        spend(_work(self.functions))
        return is_odd([function for c, function in zip(self.form[1:], self.functions, strict=True) if c])

    def _added_up(self, cuts: Cuts) -> str | None:
        """The gap is the allowance at the centre and rises by at least q times the width, outward on both sides."""
        low, high = self._star
        pieces = list(pairwise(cuts))
        germ = ((a, b) for a, b in pieces if a < high and b > low)  # the gap does not fall there
        if reason := _first_unproved(self, germ):
            return reason
        for side in ([p for p in pieces if p[0] >= high], [p for p in pieces[::-1] if p[1] <= low]):
            gap = constant(self.allowance)
            for a, b in side:
                least = self._least_on(a, b)
                gap = gap if least is None else gap + constant(b - a) * least
                if least is None or not gap.lo >= 0:
                    return f"the sum over the piece from {_shown(a)} to {_shown(b)}"
        return None

    def _least_on(self, a: Fraction, b: Fraction) -> Interval | None:
        """Return a lower bound of the mean of q on a piece on one side of the centre, 0 where no better one is known.

        Within the piece the gap is no less than at one of its ends, or than with this mean up to there.
        """
        try:
            least = self._mean_on(a, b, 1 if a >= self._star[1] else -1)
        except UndefinedError:
            least = None
        if (least is None or not least >= 0) and self.holds_on(a, b):
            return constant(_ZERO)
        return None if least is None else Interval(least, least)

    def holds_on(self, a: Fraction, b: Fraction) -> bool:
        """Whether the quantity is proved to be >= 0 (strict kinds: > 0, but at the centre or at 0) on [a, b]."""
        low, high = self._star
        germ = self.kind not in SLOPES and a < high and b > low
        if self.kind not in SLOPES and not (b <= low or a >= high or (a <= low and high <= b)):
            return False
        try:
            if germ or self._touches(a, b):
                if self._accepts(self._quotient_on(a, b)):
                    return True
                if germ and self.kind != "one-signed":
                    return False
            if self._accepts(self._quantity_on(a, b, 1 if a >= high else -1)):
                return True
        except UndefinedError:
            pass
        return self._holds_near_zero(a, b)

    def _touches(self, a: Fraction, b: Fraction) -> bool:
        """Whether the piece ends at a single centre, so that the quantity vanishes there."""
        low, high = self._star
        return self.kind not in SLOPES and low == high and low in (a, b)

    def _accepts(self, least: object) -> bool:
        return bool(least > 0 if self.kind in STRICT else least >= 0)  # type: ignore[operator]

    def _quotient_on(self, a: Fraction, b: Fraction):  # type: ignore[no-untyped-def]
        """The least q / |y - y*| where the piece holds the centre: a mean of g', and for "upper" two of them."""
        if self.kind == "one-signed" or (self.centre is None and not self._vanishes):
            return constant(-_ONE).lo
        D = self._raw(between(a, b))[1]
        if self.kind == "upper":
            return (constant(self.c - 1) * D + constant(self.c) * D).lo
        return D.lo

    @cached_property
    def _vanishes(self) -> bool:
        return vanishes(self.functions, self.form)

    def _quantity_on(self, a: Fraction, b: Fraction, sign: int):  # type: ignore[no-untyped-def]
        """A lower bound of q on [a, b], which lies on one side of the centre."""
        sign = 1 if self.kind == "one-signed" else sign  # its quantity is g - g(y*) on both sides
        q, D = self._at(between(a, b), sign)
        return q.lo if self.kind in SLOPES or self.kind == "upper" else self._sharper(q, D, a, b, sign)

    def _sharper(self, q: Interval, D: Interval, a: Fraction, b: Fraction, sign: int):  # type: ignore[no-untyped-def]
        """The better of the lower end of q = +-g + const and its mean value form, or its value at the lower end."""
        slope = D if sign > 0 else -D
        end = a if slope.lo >= 0 else b if slope.hi <= 0 else (a + b) / 2
        near, _ = self._at(constant(end), sign)
        if end not in (a, b):
            near = near + slope * between((a - b) / 2, (b - a) / 2)
        return near.lo if near.lo > q.lo else q.lo

    def _mean_on(self, a: Fraction, b: Fraction, sign: int):  # type: ignore[no-untyped-def]
        """A lower bound of the mean of q on [a, b]: an offset's by its middle, too, where q has one sign there."""
        if self.kind != "offset":
            return self._quantity_on(a, b, sign)
        q, D = self._at(between(a, b), sign)
        least, (middle, _) = self._sharper(q, D, a, b, sign), self._at(constant((a + b) / 2), sign)
        fallen = middle + D * between((a - b) / 2, (b - a) / 2)
        mean = (middle + constant((b - a) / 8) * (D - D)).lo
        return mean if mean > least and (least >= 0 or q.hi <= 0 or fallen.hi <= 0) else least

    def _at(self, y: Interval, sign: int) -> tuple[Interval, Interval]:
        """Return q and g' on an interval on one side of the centre."""
        G, D = self._raw(y)
        return self._quantity(y, G, D, sign, self._base, between(*self._star)), D

    def _quantity(self, y: E, G: E, D: E | None, sign: int, base: E | None, star: E) -> E:
        if self.kind in SLOPES and D is not None:
            return D
        rise = G if base is None else G - base
        if self.kind == "upper" and D is not None:
            rise = y.constant(self.c - 1) * rise + y.constant(self.c) * (y - star) * D
        return rise if sign > 0 else -rise

    def _raw(self, y: E) -> tuple[E, E]:
        """Return g and g' at an element, whatever the centre."""
        spend(_work(self.functions))
        return _combined(self.functions, self.form, y)

    @cached_property
    def _base(self) -> Interval | None:
        """Return g over all centres; None where nothing is subtracted."""
        return None if self.centre is None else _value(self.functions, self.form, between(*self.centre))

    def _holds_near_zero(self, a: Fraction, b: Fraction) -> bool:
        """Whether an expansion at 0 proves it, on a piece that begins or ends there."""
        centred = self.kind in SLOPES or self._star == (_ZERO, _ZERO)
        if not centred or 0 not in (a, b) or a == b:
            return False
        sign = 1 if b > 0 else -1
        return self._expanded(1 / max(abs(a), abs(b)), sign, inverse=True)

    def holds_beyond(self, Y: Fraction, sign: int) -> bool:
        """Whether it is proved for all y with sign * y >= Y > 0, with growth where the kind asks for it."""
        return self._expanded(Y, sign, inverse=False)

    def _expanded(self, Y: Fraction, sign: int, *, inverse: bool) -> bool:
        try:
            y = variable(Y, sign, inverse=inverse)
            sign = 1 if self.kind == "one-signed" else sign
            sloped = self.kind in SLOPES or self.kind == "upper"
            G, D = _combined(self.functions, self.form, y) if sloped else (_value(self.functions, self.form, y), None)
            base = self._base
            star = Expansion(y.horizon, [(CONSTANT, between(*self._star))] if any(self._star) else [])
            shifted = None if base is None else Expansion(y.horizon, [(CONSTANT, base)])
            q = self._quantity(y, G, D, sign, shifted, star)
            if not q.terms:
                return self.kind not in STRICT
            grown = inverse or self.kind not in STRICT or _escapes(G)
            return grown and self._accepts(q.relative().lo)
        except UndefinedError:
            return False


def _ends(cuts: Cuts, domain: tuple[Fraction, Fraction] | None) -> Sequence[tuple[Fraction, int]]:
    """Return where the cuts end, each end with its sign; on a domain nothing is asked beyond."""
    return () if domain is not None else ((cuts[0], -1), (cuts[-1], 1))


def _first_unproved(
    statement: "Lemma | Product", pieces: Iterable[tuple[Fraction, Fraction]], ends: Iterable[tuple[Fraction, int]] = ()
) -> str | None:
    """Return the first piece on which, or end beyond which, a statement is not proved; None where it is on all."""
    for a, b in pieces:
        if not statement.holds_on(a, b):
            return f"on the piece from {_shown(a)} to {_shown(b)}"
    return next((f"beyond {_shown(t)}" for t, sign in ends if not statement.holds_beyond(sign * t, sign)), None)


def _escapes(G: Expansion) -> bool:
    W = G.relative()
    return G.grows() and bool(W.lo > 0 or W.hi < 0)


def variable(Y: Fraction, sign: int, *, inverse: bool) -> Expansion:
    """Return y = sign t for t in [Y, infinity), or with `inverse` y = sign / t, that is |y| in (0, 1/Y]."""
    return Expansion(Horizon(Y), [((fmpq(0), fmpq(-1 if inverse else 1), fmpq(0)), fmpq(sign))])


def _combined(functions: Functions, form: Form, y: E) -> tuple[E, E]:
    G, D = y.constant(form[0]) * y, y.constant(form[0])
    for c, (program, alpha) in zip(form[1:], functions, strict=True):
        if c:
            scale = y.constant(alpha)
            f, slope = value_and_slope(program, scale * y, scale)
            G, D = G + y.constant(c) * f, D + y.constant(c) * slope
    return G, D


def _value(functions: Functions, form: Form, y: E) -> E:
    total = y.constant(form[0]) * y
    for c, (program, alpha) in zip(form[1:], functions, strict=True):
        if c:
            total = total + y.constant(c) * value(program, y.constant(alpha) * y)
    return total


def _work(functions: Functions) -> int:
    """Return the steps that a form of some functions takes on an interval."""
    return sum((JOINED + work_of(program) for program, _ in functions), 1)


def vanishes(functions: Functions, form: Form) -> bool:
    """Whether l'phi(0) = 0, by exact evaluation."""
    spend(_work(functions))
    try:
        at = _value(functions, form, constant(_ZERO))
    except UndefinedError:
        return False
    return bool(at.lo == 0 and at.hi == 0)


@dataclass(frozen=True)
class Product:
    """(l_k'phi)(l_l'phi) + c >= 0 for all y, nothing shifted."""

    functions: Functions
    forms: tuple[Form, Form]
    c: Fraction

    def unproved(self, cuts: Cuts) -> str | None:
        """Return where it is not proved."""
        return _first_unproved(self, pairwise(cuts), _ends(cuts, None))

    def holds_on(self, a: Fraction, b: Fraction) -> bool:
        """Whether interval arithmetic, or the mean value form, proves it on [a, b]."""
        spend(4 * _work(self.functions))
        half = (b - a) / 2
        try:
            (F, dF), (G, dG) = (_combined(self.functions, form, between(a, b)) for form in self.forms)
            if (F * G + constant(self.c)).lo >= 0:
                return True
            f, g = (_value(self.functions, form, constant(a + half)) for form in self.forms)
        except UndefinedError:
            return False
        return bool((f * g + constant(self.c) + (dF * G + F * dG) * between(-half, half)).lo >= 0)

    def holds_beyond(self, Y: Fraction, sign: int) -> bool:
        """Whether the expansions at infinity prove it for sign * y >= Y."""
        try:
            y = variable(Y, sign, inverse=False)
            f, g = (_value(self.functions, form, y) for form in self.forms)
            q = f * g + y.constant(self.c)
            return not q.terms or bool(q.relative().lo >= 0)
        except UndefinedError:
            return False


def discontinuous(
    functions: Functions, cuts: Cuts, ends: tuple[Fraction, Fraction] | None, *, lipschitz: bool = False
) -> str | None:
    """Return where a function is not proved continuous, None where all are: on [cuts] and, without `ends`, on R.

    With `lipschitz`, where it is not proved locally Lipschitz: the derivative is enclosed, too.
    """
    if ends is not None and not (cuts[0] <= ends[0] and ends[1] <= cuts[-1]):
        return "the cuts do not cover the domain"
    if ends is None and not cuts[0] < 0 < cuts[-1]:
        return "the cuts do not hold 0 inside"
    for program, alpha in functions:
        for a, b in pairwise(cuts):
            spend(JOINED + work_of(program))
            if not _runs(program, alpha, between(a, b), lipschitz):
                return f"on the piece from {_shown(a)} to {_shown(b)}"
        for end, sign in _ends(cuts, ends):
            if not _runs(program, alpha, variable(abs(end), sign, inverse=False), lipschitz):
                return f"beyond {_shown(end)}"
    return None


def _runs(program: Program, alpha: Fraction, y: E, lipschitz: bool) -> bool:
    scale = y.constant(alpha)
    try:
        slope = value_and_slope(program, scale * y, scale)[1] if lipschitz else value(program, scale * y)
    except UndefinedError:
        return False
    return not isinstance(slope, Interval) or bool(slope.lo.is_finite() and slope.hi.is_finite())


def is_odd(functions: Iterable[tuple[Program, Fraction]]) -> bool:
    """Whether every function is odd by its form: f(-y) = -f(y)."""
    return all(value(program, _Parity(1)).of == 1 for program, _ in functions)


_ODD = frozenset(["sin", "tan", "sinh", "tanh", "arcsinh", "arctan", "erf", "softsign", "deadzone", "sat"])
_EVEN = frozenset(["cos", "cosh", "abs"])


class _Parity:
    """1 for an odd function, 0 for an even one, None where its form does not tell."""

    def __init__(self, of: int | None) -> None:
        self.of = of

    def __add__(self, other: Self) -> "_Parity":
        return _Parity(self.of if self.of == other.of else None)

    def __mul__(self, other: Self) -> "_Parity":
        return _Parity(None if self.of is None or other.of is None else (self.of + other.of) % 2)

    def __neg__(self) -> Self:
        return self

    def constant(self, _: Fraction) -> "_Parity":
        return _Parity(0)

    def power(self, exponent: Fraction) -> "_Parity":
        return _Parity(self.of and (exponent.numerator % 2 if exponent.denominator == 1 else None))

    def apply(self, name: str) -> "_Parity":
        return _Parity(self.of and (1 if name in _ODD else 0 if name in _EVEN else None))

    __sub__, __truediv__ = __add__, __mul__


def _shown(t: Fraction) -> str:
    """A cut in words, however large it is."""
    return f"{Context(prec=6).divide(Decimal(t.numerator), Decimal(t.denominator)):g}"
