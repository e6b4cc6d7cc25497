"""The univariate prover: properties of l'phi(s) for a curve phi, on R or an interval, shifted by a ball or not.

Each side s = +t and s = -t is proved apart, t >= 0: with G(t) = +-l'phi(+-t) and its derivative D(t), every
property is that an expression in (t, G, D) is not negative. Near 0 and at infinity an expansion gives its sign on a
whole interval; between, intervals are bisected. Every answer is True or False, and False means "not proved".
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, wraps
from math import lcm
from typing import ParamSpec

from flint import ctx, fmpq

from persid_check.enclosure import PRECISION, Element, Interval, UndefinedError, between, constant, value
from persid_check.expansion import CONSTANT, Expansion, Horizon
from persid_check.expression import Program, work_of
from persid_check.search.memory import Question, answers, remembered
from persid_check.search.side import (
    BUDGET,
    FINEST,
    GERMS,
    MONOTONE,
    SECTOR,
    TAILS,
    Curve,
    DisprovedError,
    Domain,
    Form,
    Proof,
    Property,
    Shift,
    Side,
    as_interval,
    scaled,
)
from persid_check.work import spend

MARCHES = (32, 256, 2048)  # steps, tried in this order
ODD_FUNCTIONS = frozenset(["sin", "tan", "sinh", "tanh", "arcsinh", "arctan", "erf", "softsign", "deadzone", "sat"])
EVEN_FUNCTIONS = frozenset(["cos", "cosh", "abs"])
_ZERO, _ONE = Fraction(0), Fraction(1)
_Arguments = ParamSpec("_Arguments")


def _precisely(proof: Callable[_Arguments, bool]) -> Callable[_Arguments, bool]:
    """Run a proof at the checker's precision, whatever the caller's is."""

    @wraps(proof)
    def run(*args: _Arguments.args, **kwargs: _Arguments.kwargs) -> bool:
        with ctx.workprec(PRECISION):
            return proof(*args, **kwargs)

    return run


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
            return scaled(G, self.c - 1) + scaled(t * D, self.c)
        return G - scaled(t, self.c)

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


@_precisely
def prove_sector_form(curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None) -> bool:
    """Prove s l'phi(s) >= 0 on the domain (theory: a sector form), for every shift in the ball."""
    curve, form = _used(curve, form)
    if not prove_continuous(curve, domain, shift):
        return False
    rises = shift is not None and domain is None and _proved(curve, form, None, None, MONOTONE, False)
    return rises or _proved(curve, form, domain, shift, SECTOR, False)


@_precisely
def prove_strict_sector_form(
    curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove s l'phi(s) > 0 for s != 0 on the domain."""
    curve, form = _used(curve, form)
    if not prove_continuous(curve, domain, shift):
        return False
    rises = shift is not None and domain is None and prove_strictly_increasing(curve, form)
    return rises or _proved(curve, form, domain, shift, SECTOR, True)


@_precisely
def prove_nondecreasing(curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None) -> bool:
    """Prove that l'phi is nondecreasing on the domain."""
    curve, form = _used(curve, form)
    return prove_continuous(curve, domain, shift) and _proved(curve, form, domain, shift, MONOTONE, False)


@_precisely
def prove_strictly_increasing(
    curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove that l'phi is strictly increasing: D > 0 but at 0, or D >= 0 of a nonconstant analytic function."""
    curve, form = _used(curve, form)
    if not prove_nondecreasing(curve, form, domain, shift):
        return False
    if _proved(curve, form, domain, shift, MONOTONE, True):
        return True
    return all(_is_analytic(program) for program, _ in curve) and _rises_somewhere(curve, form, domain, shift)


@_precisely
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


@_precisely
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


def _lemma(upper: bool, c: Fraction) -> Integral:
    """One object for one lemma, so that its proofs are found again."""
    return _integrals(Question.of(upper, c))


_integrals = answers(Integral, 4096)


def _integral(curve: Curve, form: Form, domain: Domain, shift: Shift, integral: Integral) -> bool:
    rises = _proved(curve, form, domain, shift, integral.derivative, False)
    return rises or _marched(curve, form, domain, shift, integral)


@_precisely
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


@_precisely
def prove_radially_unbounded(
    curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None
) -> bool:
    """Prove |l'phi(y)| -> infinity at both ends of R."""
    curve, form = _used(curve, form)
    sides = [Side(curve, form, sign, shift) for sign in (1, -1)]
    return domain is None and prove_continuous(curve) and all(_some(TAILS, side, _escapes) for side in sides)


@_precisely
def prove_bounded(curve: Curve, form: Iterable[Fraction], domain: Domain = None, shift: Shift = None) -> bool:
    """Prove that l'phi is bounded on R."""
    curve, form = _used(curve, form)
    sides = [Side(curve, form, sign, shift) for sign in (1, -1)]
    return domain is None and prove_continuous(curve) and all(_some(TAILS, side, _stays) for side in sides)


@_precisely
def prove_bounded_below(curve: Curve, form: Iterable[Fraction]) -> bool:
    """Prove that l'phi is bounded from below on R."""
    curve, form = _used(curve, form)

    def stays_above(side: Side, t: Expansion, G: Expansion) -> bool:
        above = G if side.sign > 0 else -G
        return _stays(side, t, G) or bool(above.relative().lo >= 0)

    return prove_continuous(curve) and all(_some(TAILS, Side(curve, form, sign, None), stays_above) for sign in (1, -1))


@_precisely
def prove_continuous(curve: Curve, domain: Domain = None, shift: Shift = None) -> bool:
    """Prove that every function of the curve is defined and continuous on the domain."""
    center, radius = shift or (_ZERO, _ZERO)
    for program, alpha in curve:
        ends = None
        if domain is not None:
            low, high = sorted(alpha * end for end in (center - radius + domain[0], center + radius + domain[1]))
            ends = (low, high)
        if not _continuous(program, ends):
            return False
    return True


@remembered
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
        spend(work_of(program))
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
    return lcm(*(c.denominator for c in form))


def _used(curve: Curve, form: Iterable[Fraction]) -> tuple[Curve, Form]:
    """Leave out members with coefficient 0, and make the form's entries integers: no property but d changes."""
    form = tuple(form)
    scale = _scale(form)
    kept = [(pair, c * scale) for pair, c in zip(curve, form[1:], strict=True) if c]
    return tuple(pair for pair, _ in kept), (form[0] * scale, *(c for _, c in kept))


@remembered
def _proved(curve: Curve, form: Form, domain: Domain, shift: Shift, wanted: Property, strict: bool) -> bool:
    if domain is not None and not domain[0] < 0 < domain[1]:
        return False
    ends = (None, None) if domain is None else (domain[1], -domain[0])
    mirrored = shift is None and ends[0] == ends[1] and all(is_odd(program) for program, _ in curve)
    sides = [Side(curve, form, sign, shift) for sign in ((1,) if mirrored else (1, -1))]
    return all(Proof(side, end, wanted, strict).run() for side, end in zip(sides, ends, strict=False))


def is_odd(program: Program) -> bool:
    """Whether f(-x) = -f(x) follows from the form of the program: then G(t) is the same on both sides."""
    stack: list[int | None] = []  # 1 odd, 0 even, None neither
    for step in program:
        if step.name in ("x", "number"):
            stack.append(1 if step.name == "x" else 0)
        elif step.name in ("+", "-", "*", "/"):
            b, a = stack.pop(), stack.pop()
            if a is None or b is None:
                stack.append(None)
            else:
                stack.append((a + b) % 2 if step.name in "*/" else a if a == b else None)
        elif step.name != "neg":
            a = stack.pop()
            keeps = step.name in ODD_FUNCTIONS or (step.name == "**" and _is_odd_integer(step.value))
            folds = step.name in EVEN_FUNCTIONS or (step.name == "**" and _is_even_integer(step.value))
            stack.append(a if a == 0 or (a == 1 and keeps) else 0 if a == 1 and folds else None)
    return stack[-1] == 1


def _is_odd_integer(value: Fraction | None) -> bool:
    return value is not None and value.denominator == 1 and value.numerator % 2 == 1


def _is_even_integer(value: Fraction | None) -> bool:
    return value is not None and value.denominator == 1 and value.numerator % 2 == 0


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
    half = any(step.name == "**" and (step.value or _ZERO).denominator == 2 for step in program)
    return not half and not any(step.name in kinked for step in program)


def _rises_somewhere(curve: Curve, form: Form, domain: Domain, shift: Shift) -> bool:
    side = Side(curve, form, 1, shift)
    end = _ONE if domain is None else domain[1]
    try:
        return any(side.on(constant(end * part))[1].lo > 0 for part in (_ONE, Fraction(1, 2), Fraction(1, 64)))
    except UndefinedError:
        return False


@remembered
def _marched(curve: Curve, form: Form, domain: Domain, shift: Shift, integral: "Integral") -> bool:
    """Prove an integral lemma by adding up the integral, on both sides of the domain."""
    if domain is not None and not domain[0] < 0 < domain[1]:
        return False
    ends = (None, None) if domain is None else (domain[1], -domain[0])
    for sign, end in zip((1, -1), ends, strict=True):
        side = Side(curve, form, sign, shift)
        try:
            last = Proof(side, None, integral.derivative, False).tail() if end is None else end
            if last is None or not any(_march(side, last, steps, integral) for steps in MARCHES):
                return False
        except DisprovedError:
            return False
    return True


def _march(side: Side, end: Fraction, steps: int, integral: "Integral") -> bool:
    """One pass in equal steps: the gap stays >= 0 over a step that begins at a and has the gap's derivative >= k there,
    where gap(a) + k * width >= 0 or k >= 0."""
    if not side.starts_at_zero:
        return False
    area, width, slopes = constant(_ZERO), end / steps, None
    for i in range(steps):
        a = i * width
        spend(side.steps)
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


def _keeps(
    side: Side, integral: Integral, a: Fraction, t: Interval, GD: tuple[Interval, Interval], area: Interval
) -> bool:
    """Whether a gap that is >= 0 at a stays so over the step t, by the least value of its derivative there."""
    if a == 0:
        return False
    rise = as_interval(integral.derivative.expression(t, *GD)).lo
    if rise >= 0:
        return True
    start = integral.gap(constant(a), side.on(constant(a))[0], area)
    if start.hi < 0:
        raise DisprovedError
    width = t - constant(a)
    return bool((start + Interval(width.hi, width.hi) * Interval(rise, rise)).lo >= 0)
