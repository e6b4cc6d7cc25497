"""The univariate prover: properties of l'phi(s) for a curve phi, on R or an interval, shifted by a ball or not.

Each side s = +t and s = -t is proved apart, for t >= 0: with G(t) = +-l'phi(+-t) and its derivative D(t), every property
is that an expression in (t, G, D) is not negative. Near 0 and at infinity an expansion gives its sign on a whole
interval; between, intervals are bisected. Every answer is True or False, and False means "not proved".
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache
from math import lcm
from typing import TypeVar

from flint import arb, fmpq

from persid_check.enclosure import Element, Interval, UndefinedError, between, constant, value, value_and_slope
from persid_check.expansion import CONSTANT, Expansion, Horizon
from persid_check.expression import Program

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

    def at(self, t: E, y: E) -> tuple[E, E]:
        """Return G(t) and its derivative; `y` is y* as an element of the same kind."""
        sign = t.constant(Fraction(self.sign))
        G, D = t.constant(self.form[0]) * t, t.constant(self.form[0])
        for l, (program, alpha) in zip(self.form[1:], self.curve, strict=True):
            scale, factor = t.constant(alpha), t.constant(l)
            f, slope = value_and_slope(program, scale * (y + sign * t), scale)
            G, D = G + factor * sign * self._change(f, program, scale * y), D + factor * slope
        return G, D

    def value_at(self, t: E, y: E) -> E:
        """Return G(t) alone."""
        sign = t.constant(Fraction(self.sign))
        G = t.constant(self.form[0]) * t
        for l, (program, alpha) in zip(self.form[1:], self.curve, strict=True):
            scale = t.constant(alpha)
            f = value(program, scale * (y + sign * t))
            G = G + t.constant(l) * sign * self._change(f, program, scale * y)
        return G

    def _change(self, f: E, program: Program, start: E) -> E:
        return f if self.shift is None else f - value(program, start)

    def on(self, t: Interval) -> tuple[Interval, Interval]:
        """Return enclosures over an interval of t."""
        center, radius = self.shift or (_ZERO, _ZERO)
        return self.at(t, between(center - radius, center + radius))

    def beyond(self, Y: Fraction, *, inverse: bool = False, slope: bool = False) -> tuple[Expansion, ...]:
        """Return t, G (and D with `slope`) on [Y, infinity), or with `inverse` on (0, 1/Y], as expansions."""
        horizon = Horizon(Y)
        key = (fmpq(0), fmpq(-1 if inverse else 1), fmpq(0))
        t = Expansion(horizon, [(key, fmpq(1))])
        center, radius = self.shift or (_ZERO, _ZERO)
        y = t.constant(center)
        if radius:
            y = Expansion(horizon, [(CONSTANT, between(center - radius, center + radius))])
        return (t, *self.at(t, y)) if slope else (t, self.value_at(t, y))


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


def _scaled(element: Element, factor: Fraction) -> Element:
    return element.constant(factor) * element


SECTOR = Property(lambda t, G, D=None: G, lambda D: D, lambda D: D, needs_slope=False)
MONOTONE = Property(lambda t, G, D: D)


@dataclass(frozen=True)
class Integral:
    """A bound of the integral of G from 0 to t: `gap` >= 0 is to be proved. It is 0 at t = 0."""

    upper: bool
    c: Fraction

    @cached_property
    def derivative(self) -> Property:
        """The gap's derivative: (c - 1) G + c t D, or G - c t."""
        return Property(self._expression, self.origin, needs_slope=self.upper)

    def _expression(self, t: Element, G: Element, D: Element | None = None) -> Element:
        if D is not None and self.upper:
            return _scaled(G, self.c - 1) + _scaled(t * D, self.c)
        return G - _scaled(t, self.c)

    def origin(self, D: Interval) -> Interval:
        """The gap's derivative divided by t, from an enclosure of D on [0, h]."""
        if self.upper:
            return D.constant(self.c - 1) * D + D.constant(self.c) * D
        return D - D.constant(self.c)

    def gap(self, t: Interval, G: Interval, area: Interval) -> Interval:
        """c t G - area, or area - c t^2 / 2."""
        if self.upper:
            return constant(self.c) * t * G - area
        return area - constant(self.c / 2) * t * t


def prove_sector_form(curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None) -> bool:
    """Prove s l'phi(s) >= 0 on the domain (theory: a sector form), for every shift in the ball."""
    curve, form = _used(curve, form)
    if not prove_continuous(curve, domain, shift):
        return False
    rises = shift is not None and domain is None and _proved(curve, form, None, None, MONOTONE, False)
    return rises or _proved(curve, form, domain, shift, SECTOR, False)


def prove_strict_sector_form(
    curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove s l'phi(s) > 0 for s != 0 on the domain."""
    curve, form = _used(curve, form)
    if not prove_continuous(curve, domain, shift):
        return False
    rises = shift is not None and domain is None and prove_strictly_increasing(curve, form)
    return rises or _proved(curve, form, domain, shift, SECTOR, True)


def prove_nondecreasing(curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None) -> bool:
    """Prove that l'phi is nondecreasing on the domain."""
    curve, form = _used(curve, form)
    return prove_continuous(curve, domain, shift) and _proved(curve, form, domain, shift, MONOTONE, False)


def prove_strictly_increasing(
    curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove that l'phi is strictly increasing: D > 0 but at 0, or D >= 0 of an analytic function that is not constant."""
    curve, form = _used(curve, form)
    if not prove_nondecreasing(curve, form, domain, shift):
        return False
    if _proved(curve, form, domain, shift, MONOTONE, True):
        return True
    return all(_is_analytic(program) for program, _ in curve) and _rises_somewhere(curve, form, domain, shift)


def prove_integral_upper(
    curve: Curve, form: Iterable[Fraction], c: Fraction, domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove that the integral of l'phi from 0 to y is at most c y l'phi(y) on the domain."""
    curve, form = _used(curve, form)
    if not prove_continuous(curve, domain, shift):
        return False
    if not any(form[1:]) and form[0] >= 0 and c >= Fraction(1, 2):
        return True
    if shift is not None and domain is None and c >= 1 and _proved(curve, form, None, None, MONOTONE, False):
        return True
    return _integral(curve, form, domain, shift, _lemma(True, c))


def prove_integral_lower(
    curve: Curve, form: Iterable[Fraction], d: Fraction, domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove that the integral of l'phi from 0 to y is at least d y^2 / 2 on the domain."""
    whole = tuple(form)
    curve, form = _used(curve, whole)
    d = d * _scale(whole)
    if not prove_continuous(curve, domain, shift):
        return False
    if d <= 0 and prove_sector_form(curve, form, domain, shift):
        return True
    return _integral(curve, form, domain, shift, _lemma(False, d))


@lru_cache(maxsize=4096)
def _lemma(upper: bool, c: Fraction) -> Integral:
    """One object for one lemma, so that its proofs are found again."""
    return Integral(upper, c)


def _integral(curve: Curve, form: Form, domain: Domain, shift: Shift, integral: Integral) -> bool:
    rises = _proved(curve, form, domain, shift, integral.derivative, False)
    return rises or _marched(curve, form, domain, shift, integral)


def prove_integral_unbounded(
    curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove that the integral of a sector form is positive but at 0 and tends to infinity at both ends of R."""
    curve, form = _used(curve, form)
    if domain is not None or not prove_sector_form(curve, form, None, shift):
        return False
    rises = shift is not None and prove_strictly_increasing(curve, form)
    sides = [Side(curve, form, sign, shift) for sign in (1, -1)]
    return all((rises or _starts_positive(side)) and _some(TAILS, side, _diverges) for side in sides)


def prove_radially_unbounded(
    curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove |l'phi(y)| -> infinity at both ends of R."""
    curve, form = _used(curve, form)
    sides = [Side(curve, form, sign, shift) for sign in (1, -1)]
    return domain is None and prove_continuous(curve) and all(_some(TAILS, side, _escapes) for side in sides)


def prove_bounded(curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None) -> bool:
    """Prove that l'phi is bounded on R."""
    curve, form = _used(curve, form)
    sides = [Side(curve, form, sign, shift) for sign in (1, -1)]
    return domain is None and prove_continuous(curve) and all(_some(TAILS, side, _stays) for side in sides)


def prove_bounded_below(curve: Curve, form: Iterable[Fraction]) -> bool:
    """Prove that l'phi is bounded from below on R."""
    curve, form = _used(curve, form)

    def stays_above(side: Side, t: Expansion, G: Expansion) -> bool:
        above = G if side.sign > 0 else -G
        return _stays(side, t, G) or bool(above.relative().lo >= 0)

    return prove_continuous(curve) and all(_some(TAILS, Side(curve, form, sign, None), stays_above) for sign in (1, -1))


def prove_continuous(curve: Curve, domain: Domain = None, shift: Shift = None) -> bool:
    """Prove that every function of the curve is defined and continuous on the domain."""
    center, radius = shift or (_ZERO, _ZERO)
    for program, alpha in curve:
        ends = None
        if domain is not None:
            ends = (alpha * (center - radius + domain[0]), alpha * (center + radius + domain[1]))
        if not _continuous(program, ends):
            return False
    return True


@lru_cache(maxsize=65536)
def _continuous(program: Program, ends: Domain) -> bool:
    if ends is None:
        reach = next((Y for Y in TAILS if all(_defined_beyond(program, Y, sign) for sign in (1, -1))), None)
        if reach is None:
            return False
        ends = (-reach, reach)
    pieces, budget = [ends], BUDGET
    least = (ends[1] - ends[0]) * FINEST
    while pieces:
        lo, hi = pieces.pop()
        budget -= 1
        try:
            value(program, between(lo, hi))
        except UndefinedError:
            if budget <= 0 or hi - lo <= least:
                return False
            pieces += [((lo + hi) / 2, hi), (lo, (lo + hi) / 2)]
    return True


def _defined_beyond(program: Program, Y: Fraction, sign: int) -> bool:
    try:
        value(program, Expansion(Horizon(Y), [((fmpq(0), fmpq(1), fmpq(0)), fmpq(sign))]))
    except UndefinedError:
        return False
    return True


def _scale(form: Form) -> int:
    return lcm(*(l.denominator for l in form))


def _used(curve: Curve, form: Iterable[Fraction]) -> tuple[Curve, Form]:
    """Leave out members with coefficient 0, and make the form's entries integers: no property but d changes."""
    form = tuple(form)
    scale = _scale(form)
    kept = [(pair, l * scale) for pair, l in zip(curve, form[1:], strict=True) if l]
    return tuple(pair for pair, _ in kept), (form[0] * scale, *(l for _, l in kept))


@lru_cache(maxsize=65536)
def _proved(curve: Curve, form: Form, domain: Domain, shift: Shift, wanted: Property, strict: bool) -> bool:
    if domain is not None and not domain[0] < 0 < domain[1]:
        return False
    ends = (None, None) if domain is None else (domain[1], -domain[0])
    sides = [Side(curve, form, sign, shift) for sign in (1, -1)]
    return all(_Proof(side, end, wanted, strict).run() for side, end in zip(sides, ends, strict=True))


class _Proof:
    """The proof that a property's expression is >= 0 (or > 0 for t > 0) on [0, end], or on [0, infinity)."""

    def __init__(self, side: Side, end: Fraction | None, wanted: Property, strict: bool) -> None:
        self.side, self.end, self.wanted, self.strict = side, end, wanted, strict
        self.budget = BUDGET

    def run(self) -> bool:
        try:
            last = self.tail() if self.end is None else self.end
            start = self._germ(last)
        except _DisprovedError:
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
            if not expression.terms:  # type: ignore[attr-defined]
                return not self.strict
            relative = expression.relative()  # type: ignore[attr-defined]
        except UndefinedError:
            return False
        if relative.hi < 0:
            raise _DisprovedError
        return self._accepts(relative)

    def tail(self) -> Fraction | None:
        """The first Y tried such that the expansion proves the property on [Y, infinity)."""
        return next((Y for Y in TAILS if self._sign_beyond(Y, inverse=False)), None)

    def _germ(self, last: Fraction | None) -> Fraction | None:
        """The length of an interval (0, h] on which the expansion at 0 proves the property."""
        if self.side.shift is not None and self.side.shift[1] and self.wanted.origin is not None:
            return None
        tried = [h for h in GERMS if last is None or h < last]
        whole = [] if last is None else [last]
        return next((h for h in (*whole, *tried) if self._sign_beyond(1 / h, inverse=True)), None)

    def _between(self, start: Fraction, last: Fraction) -> bool:
        """Bisect [start, last]; the expression needs no proof at t = 0 itself."""
        pieces = _powers(start, last)
        least = (last - start) * FINEST
        while pieces:
            a, b = pieces.pop()
            self.budget -= 1
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
        t = between(a, b)
        try:
            G, D = self.side.on(t)
            if a == 0 and self.wanted.origin is not None:
                return True if self._accepts(self.wanted.origin(D)) else None
            enclosed = self.wanted.expression(t, G, D)
            if self._accepts(enclosed):  # type: ignore[arg-type]
                return True
            if enclosed.hi < 0:  # type: ignore[attr-defined]
                return False
            return None if self.wanted.slope is None else self._by_slope(a, b, self.wanted.slope(D))
        except UndefinedError:
            return None

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
        return self.wanted.expression(point, *self.side.on(point))  # type: ignore[return-value]


class _DisprovedError(Exception):
    """The property is false."""


def _powers(start: Fraction, last: Fraction) -> list[tuple[Fraction, Fraction]]:
    """Intervals from start to last, cut at powers of two where kinks like to be; the first one is last in the list."""
    if start >= last:
        return []
    cuts = [start, *(c for k in range(-24, 22) if start < (c := Fraction(2) ** k) < last), last]
    if start == 0:
        cuts = [c for c in cuts if c == 0 or c >= min(last, Fraction(1, 4))]
    return list(zip(cuts, cuts[1:], strict=False))[::-1]


def _some(places: Iterable[Fraction], side: Side, test: Callable[[Side, Expansion, Expansion], bool]) -> bool:
    """Whether a test holds for the expansion of G beyond one of the places."""
    for Y in places:
        try:
            t, G = side.beyond(Y)
            if test(side, t, G):
                return True
        except UndefinedError:
            continue
    return False


def _stays(side: Side, t: Expansion, G: Expansion) -> bool:
    return not G.grows()


def _escapes(side: Side, t: Expansion, G: Expansion) -> bool:
    W = G.relative()
    return G.grows() and bool(W.lo > 0 or W.hi < 0)


def _diverges(side: Side, t: Expansion, G: Expansion) -> bool:
    """Whether G >= w y^-1 for large y, w > 0: then its integral tends to infinity."""
    return bool((t * G).lead()[0] >= CONSTANT and G.relative().lo > 0)


def _starts_positive(side: Side) -> bool:
    """Whether G > 0 on some (0, h]."""
    for h in GERMS:
        try:
            if side.shift is None:
                if side.beyond(1 / h, inverse=True)[1].relative().lo > 0:
                    return True
            elif side.on(between(_ZERO, h))[1].lo > 0:
                return True
        except UndefinedError:
            continue
    return False


def _is_analytic(program: Program) -> bool:
    kinked = {"abs", "relu", "sat", "deadzone", "softsign", "sqrt"}
    return not any(
        step.name in kinked or (step.value or _ZERO).denominator == 2 and step.name == "**" for step in program
    )


def _rises_somewhere(curve: Curve, form: Form, domain: Domain, shift: Shift) -> bool:
    side = Side(curve, form, 1, shift)
    end = _ONE if domain is None else domain[1]
    try:
        return any(side.on(constant(end * part))[1].lo > 0 for part in (_ONE, Fraction(1, 2), Fraction(1, 64)))
    except UndefinedError:
        return False


@lru_cache(maxsize=65536)
def _marched(curve: Curve, form: Form, domain: Domain, shift: Shift, integral: "Integral") -> bool:
    """Prove an integral lemma by adding up the integral, on both sides of the domain."""
    if domain is not None and not domain[0] < 0 < domain[1]:
        return False
    ends = (None, None) if domain is None else (domain[1], -domain[0])
    for sign, end in zip((1, -1), ends, strict=True):
        side = Side(curve, form, sign, shift)
        try:
            last = _Proof(side, None, integral.derivative, False).tail() if end is None else end
        except _DisprovedError:
            return False
        if last is None or not any(_march(side, last, steps, integral) for steps in (32, 256, 2048)):
            return False
    return True


def _march(side: Side, end: Fraction, steps: int, integral: "Integral") -> bool:
    """One pass in equal steps: the gap stays >= 0 over a step that begins at a and has the gap's derivative >= k there,
    where gap(a) + k * width >= 0 or k >= 0."""
    if side.shift is None and not _starts_at_zero(side):
        return False
    area, width, slopes = constant(_ZERO), end / steps, None
    for i in range(steps):
        a = i * width
        try:
            t = between(a, a + width)
            G, D = side.on(t)
            slopes = D if slopes is None else slopes.hull(D)
            if not integral.origin(slopes).lo >= 0 and not _keeps(side, integral, a, t, (G, D), area):
                return False
            middle = side.on(constant(a + width / 2))[0]
        except UndefinedError:
            return False
        error = constant(width * width / 8) * Interval((D.lo - D.hi).lower(), (D.hi - D.lo).upper())
        area = area + constant(width) * middle + error
    return True


def _starts_at_zero(side: Side) -> bool:
    """Whether G(0) = 0 exactly, so that G / t is a mean of D."""
    try:
        G = side.on(constant(_ZERO))[0]
    except UndefinedError:
        return False
    return bool(G.lo == 0 and G.hi == 0)


def _keeps(
    side: Side, integral: Integral, a: Fraction, t: Interval, GD: tuple[Interval, Interval], area: Interval
) -> bool:
    """Whether a gap that is >= 0 at a stays so over the step t, by the least value of its derivative there."""
    if a == 0:
        return False
    rise = interval_of(integral.derivative.expression(t, *GD)).lo
    if rise >= 0:
        return True
    start = integral.gap(constant(a), side.on(constant(a))[0], area)
    width = t - constant(a)
    return bool((start + Interval(width.hi, width.hi) * Interval(rise, rise)).lo >= 0)


def interval_of(element: Element) -> Interval:
    """Return an element that is an interval."""
    if not isinstance(element, Interval):
        raise TypeError("not an interval")
    return element
