"""One side s = +t or s = -t of a curve, t >= 0, and the proof that an expression in (t, G, D) is not negative there."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, partial
from itertools import pairwise
from typing import TypeVar

from flint import arb, fmpq

from persid_check.enclosure import Element, Interval, UndefinedError, between, constant, value, value_and_slope
from persid_check.expansion import CONSTANT, Expansion, Horizon
from persid_check.expression import Program, work_of
from persid_check.search.memory import remembered
from persid_check.search.series import LOCAL, Series, least, somewhere, variable
from persid_check.work import spend

Curve = tuple[tuple[Program, Fraction], ...]
Form = tuple[Fraction, ...]
Domain = tuple[Fraction, Fraction] | None
Shift = tuple[Fraction, Fraction] | None
E = TypeVar("E", bound=Element)

BUDGET = 3000  # evaluations on intervals for one side of one property
FINEST = Fraction(1, 2**40)  # no interval is bisected below this part of the first one
GERMS = tuple(Fraction(2) ** k for k in (3, 1, -1, -3, -6, -12, -24))
TAILS = tuple(Fraction(2) ** k for k in (1, 2, 4, 6, 8, 12, 20))
_ZERO, _ONE = Fraction(0), Fraction(1)


@dataclass(frozen=True)
class Side:
    """G(t) = sign * l'phi(sign * t) for t >= 0, with the channels shifted by y* in the ball (center, radius)."""

    curve: Curve
    form: Form
    sign: int
    shift: Shift

    @property
    def steps(self) -> int:
        """The work of one evaluation."""
        return sum((work_of(program) for program, _ in self.curve), 1)

    @cached_property
    def kinks(self) -> tuple[Fraction, ...]:
        """Where hinges of the functions lie, if y* is the middle of its ball."""
        center = (self.shift or (_ZERO, _ZERO))[0]
        return tuple(self.sign * (y / alpha - center) for program, alpha in self.curve for y in kinks(program))

    def on(self, t: Interval) -> tuple[Interval, Interval]:
        """Return enclosures of G and of its derivative D over an interval of t."""
        center, radius = self.shift or (_ZERO, _ZERO)
        parts = _rises(self.curve, self.sign, self.shift, t, between(center - radius, center + radius))
        return self._sum(t, [g for g, _ in parts]), self._sum(t.constant(_ONE), [d for _, d in parts])

    def _sum(self, first: E, others: Sequence[E]) -> E:
        """Combine the entries of phi, or of its derivative, by the form."""
        total = first.constant(self.form[0]) * first
        for c, other in zip(self.form[1:], others, strict=True):
            total = total + first.constant(c) * other
        return total

    @cached_property
    def starts_at_zero(self) -> bool:
        """Whether G(0) = 0 exactly, so that G / t is a mean of D."""
        if self.shift is not None:
            return True
        try:
            G = self.on(constant(_ZERO))[0]
        except UndefinedError:
            return False
        return bool(G.lo == 0 and G.hi == 0)

    def series(self, low: Fraction, high: Fraction) -> tuple[Series, Series, Series]:
        """Return t, G and D as Taylor series about every point of an interval of t."""
        center, radius = self.shift or (_ZERO, _ZERO)
        t = variable(low, high)
        G = self._sum(t, _changes(self.curve, self.sign, self.shift, t, somewhere(center - radius, center + radius)))
        return t, G, G.derivative()

    def beyond(self, Y: Fraction, *, inverse: bool = False, slope: bool = False) -> tuple[Expansion, ...]:
        """Return t, G (and D with `slope`) on [Y, infinity), or with `inverse` on (0, 1/Y], as expansions."""
        found = _beyond(self.curve, self.sign, self.shift, Y, inverse, slope)
        if found is None:
            raise UndefinedError("no expansion")
        t, parts = found
        G = self._sum(t, [part[0] for part in parts])
        return (t, G, self._sum(t.constant(_ONE), [part[1] for part in parts])) if slope else (t, G)


def _changes(curve: Curve, sign: int, shift: Shift, t: E, y: E) -> list[E]:
    """Return sign * f(alpha (y + sign * t)) of each channel, shifted by y* (`y`, an element of the same kind)."""
    direction = t.constant(Fraction(sign))
    places = [(program, t.constant(alpha)) for program, alpha in curve]
    found = [value(program, scale * (y + direction * t)) for program, scale in places]
    if shift is not None:
        found = [f - value(program, scale * y) for f, (program, scale) in zip(found, places, strict=True)]
    return found if sign > 0 else [-f for f in found]


def _rises(curve: Curve, sign: int, shift: Shift, t: E, y: E) -> list[tuple[E, E]]:
    """Return the same with the derivatives by t."""
    direction = t.constant(Fraction(sign))
    found = []
    for program, alpha in curve:
        scale = t.constant(alpha)
        f, slope = value_and_slope(program, scale * (y + direction * t), scale)
        change = f if shift is None else f - value(program, scale * y)
        found.append((change if sign > 0 else -change, slope))
    return found


@partial(remembered, most=4096)
def _beyond(
    curve: Curve, sign: int, shift: Shift, Y: Fraction, inverse: bool, slope: bool
) -> tuple[Expansion, list[tuple[Expansion, ...]]] | None:
    """Return t and each channel's change (and its derivative) on [Y, infinity), or on (0, 1/Y]; None if undefined."""
    horizon = Horizon(Y)
    t = Expansion(horizon, [((fmpq(0), fmpq(-1 if inverse else 1), fmpq(0)), fmpq(1))])
    center, radius = shift or (_ZERO, _ZERO)
    y = t.constant(center)
    if radius:
        y = Expansion(horizon, [(CONSTANT, between(center - radius, center + radius))])
    try:
        if slope:
            return t, list(_rises(curve, sign, shift, t, y))
        return t, [(change,) for change in _changes(curve, sign, shift, t, y)]
    except UndefinedError:
        return None


@dataclass(frozen=True)
class Property:
    """An expression in (t, G, D) that must not be negative.

    Where it vanishes at t = 0 because G does, `origin` divides it by t: G / t is a mean of D, so an enclosure of D over
    [0, h] stands for both. `slope` is the derivative of the expression where it is cheap.
    """

    expression: Callable[..., Element]
    origin: Callable[[Interval], Interval] | None = None
    slope: Callable[[Interval], Interval] | None = None
    needs_slope: bool = True


def scaled(element: Element, factor: Fraction) -> Element:
    """Return factor * element."""
    return element.constant(factor) * element


SECTOR = Property(lambda t, G, D=None: G, lambda D: D, lambda D: D, needs_slope=False)
MONOTONE = Property(lambda t, G, D: D)


def as_interval(element: Element) -> Interval:
    """Return an element that is an interval."""
    if not isinstance(element, Interval):
        raise TypeError("not an interval")
    return element


class Proof:
    """The proof that a property's expression is >= 0 (or > 0 for t > 0) on [0, end], or on [0, infinity)."""

    def __init__(self, side: Side, end: Fraction | None, wanted: Property, strict: bool) -> None:
        self.side, self.end, self.wanted, self.strict = side, end, wanted, strict
        self.budget = BUDGET

    def run(self) -> bool:
        try:
            last = self.tail() if self.end is None else self.end
            start = self._germ(last)
        except DisprovedError:
            return False
        if last is None or (start is None and (self.wanted.origin is None or self.side.shift is None)):
            return False
        return self._between(start or _ZERO, last)

    def _accepts(self, enclosed: Interval) -> bool:
        return bool(enclosed.lo > 0 if self.strict else enclosed.lo >= 0)

    def _sign_beyond(self, Y: Fraction, *, inverse: bool) -> bool:
        """Whether the expansion proves the property; an expansion with the wrong sign ends the proof."""
        try:
            expression = self.wanted.expression(*self.side.beyond(Y, inverse=inverse, slope=self.wanted.needs_slope))
            if not isinstance(expression, Expansion) or not expression.terms:
                return not self.strict
            relative = expression.relative()
        except UndefinedError:
            return False
        if relative.hi < 0:
            raise DisprovedError
        return self._accepts(relative)

    def tail(self) -> Fraction | None:
        """The first Y tried such that the expansion proves the property on [Y, infinity)."""
        return next((Y for Y in TAILS if self._sign_beyond(Y, inverse=False)), None)

    def _germ(self, last: Fraction | None) -> Fraction | None:
        """The length of an interval (0, h] on which the expansion at 0 proves the property."""
        if self.side.starts_at_zero:
            near = next((h for h in GERMS if (last is None or h <= last) and self._by_taylor(_ZERO, h)), None)
            if near is not None:
                return near
        if self.side.shift is not None and self.side.shift[1] and self.wanted.origin is not None:
            return None
        tried = [h for h in GERMS if last is None or h < last]
        whole = [] if last is None else [last]
        return next((h for h in (*whole, *tried) if self._sign_beyond(1 / h, inverse=True)), None)

    def _between(self, start: Fraction, last: Fraction) -> bool:
        """Bisect [start, last]; the expression needs no proof at t = 0 itself."""
        pieces = _cut(start, last, self.side.kinks)
        least = (last - start) * FINEST
        while pieces:
            a, b = pieces.pop()
            self.budget -= 1
            spend(self.side.steps)
            verdict = self._piece(a, b)
            if verdict is None:
                if self.budget <= 0 or b - a <= least:
                    return False
                pieces += [((a + b) / 2, b), (a, (a + b) / 2)]
            elif not verdict:
                return False
        return True

    def _piece(self, a: Fraction, b: Fraction) -> bool | None:
        """True: proved on [a, b]; False: disproved somewhere; None: neither."""
        smooth = self._by_taylor(a, b)
        if smooth is not None:
            return smooth
        t = between(a, b)
        try:
            G, D = self.side.on(t)
            if a == 0 and self.wanted.origin is not None:
                return True if self._accepts(self.wanted.origin(D)) else None
            enclosed = as_interval(self.wanted.expression(t, G, D))
            if self._accepts(enclosed):
                return True
            if enclosed.hi < 0:
                return False
            return None if self.wanted.slope is None else self._by_slope(a, b, self.wanted.slope(D))
        except UndefinedError:
            return None

    def _by_taylor(self, a: Fraction, b: Fraction) -> bool | None:
        """Taylor's formula about the middle; or about 0, where the expression vanishes, divided by t."""
        vanishes = a == 0 and self.wanted.origin is not None
        m = a if vanishes else (a + b) / 2
        try:
            about, over = self._coefficients(m, m), self._coefficients(a, b)
        except UndefinedError:
            return None
        if vanishes:
            about, over = about[1:], over[1:]
        elif about[0] < 0:
            return False
        bound = least(about[:-1], over[-1], constant(b - m).hi, both_sides=not vanishes)
        return True if (bound > 0 if self.strict else bound >= 0) else None

    def _coefficients(self, low: Fraction, high: Fraction) -> list[arb]:
        """The expression's Taylor coefficients about every point of an interval; LOCAL - 1, since D has so many."""
        expression = self.wanted.expression(*self.side.series(low, high))
        if not isinstance(expression, Series):
            raise TypeError("not a series")
        return expression.coefficients(LOCAL - 1)

    def _by_slope(self, a: Fraction, b: Fraction, slope: Interval) -> bool | None:
        """Where the expression is monotone its lower end decides; else the mean value theorem about the middle."""
        if slope.lo >= 0 or slope.hi <= 0:
            enclosed = self._at(a if slope.lo >= 0 else b)
        else:
            half = (b - a) / 2
            enclosed = self._at((a + b) / 2) + slope * between(-half, half)
        if self._accepts(enclosed):
            return True
        return False if enclosed.hi < 0 else None

    def _at(self, t: Fraction) -> Interval:
        point = constant(t)
        return as_interval(self.wanted.expression(point, *self.side.on(point)))


class DisprovedError(Exception):
    """The property is false."""


def _cut(start: Fraction, last: Fraction, kinks: Sequence[Fraction]) -> list[tuple[Fraction, Fraction]]:
    """Intervals from start to last, cut at kinks and at powers of two; the first one is last in the list."""
    if start >= last:
        return []
    cuts = [start, *(c for k in range(-24, 22) if start < (c := Fraction(2) ** k) < last), last]
    if start == 0:
        cuts = [c for c in cuts if c == 0 or c >= min(last, Fraction(1, 4))]
    return list(pairwise(sorted({*cuts, *(t for t in kinks if start < t < last)})))[::-1]


def kinks(program: Program) -> tuple[Fraction, ...]:
    """Return the numbers t of all relu(x - t) and relu(t - x) in a program: pieces had better end there."""
    found = set()
    for k in range(3, len(program)):
        one, other, minus, hinge = program[k - 3 : k + 1]
        if (minus.name, hinge.name) == ("-", "relu") and {one.name, other.name} == {"x", "number"}:
            found.add(one.value if one.value is not None else other.value or Fraction(0))
    return tuple(sorted(found))
