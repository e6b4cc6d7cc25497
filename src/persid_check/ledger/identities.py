"""Identities: a form over (x, s) that is zero for every x, since the functions that it reads are polynomials.

Section 12 of the specification (docs/ledger.md): every coefficient of the form, expanded exactly, is compared with 0.
"""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import zip_longest
from typing import Self

from flint import fmpq

from persid_check.enclosure import value
from persid_check.exact import Matrix, Number, mirrored, scattered
from persid_check.ledger.values import Ledger
from persid_check.model import Channel, Model
from persid_check.results import NotProvedError, require
from persid_check.work import spend

MAX_DEGREE = 16  # of a function that an identity reads
MAX_BITS = 2**15  # of the numbers of its coefficients
BITS_A_STEP = 1024
FACTORS_A_STEP = 4  # of a monomial
WHERE = "facts.identity"

Monomial = tuple[int, ...]  # the states in it, rising, each as often as its power says
Terms = dict[Monomial, fmpq]
Polynomial = Mapping[Monomial, fmpq]  # without zero coefficients
Coefficients = list[fmpq]  # of y^0, y^1, ...


def prove_identity(ledger: Ledger) -> None:
    """Prove that sum 2 sigma zeta_i zeta_j over the entries of the identity is zero for every x.

    Raises:
        NotProvedError: a function is not a polynomial, the point is not known exactly, or a coefficient is not zero.
    """
    if not ledger.identity:
        return
    plain = not ledger.model.algebraic and not ledger.model.is_discrete
    require(plain, WHERE, "a model with algebraic variables, or in discrete time, has none")
    known = ledger.ball is None or not ledger.ball.radius
    require(known, WHERE, "the operating point is not known exactly: its radius is not 0")
    entries = {i: _entry(ledger, i) for i in sorted({place for i, j, _ in ledger.identity for place in (i, j)})}
    beside: dict[int, Terms] = {}
    for i, j, sigma in ledger.identity:
        add_product(beside.setdefault(i, {}), entries[j], {(): _exact(sigma)})
    total: Terms = {}
    for i, partner in beside.items():
        add_product(total, entries[i], without_zeros(partner))
    if left := without_zeros(total):
        place = " ".join(ledger.model.states[i] for i in min(left)) or "1"
        raise NotProvedError(WHERE, f"it is not zero: the coefficient of {place} is not")


def form_of_identity(ledger: Ledger, size: int) -> Matrix:
    """Return the form sum 2 sigma zeta_i zeta_j, over zeta of `size` entries."""
    lower = {(i, j): 2 * sigma if i == j else sigma for i, j, sigma in ledger.identity}
    return scattered(size, size, mirrored(lower))


def _entry(ledger: Ledger, i: int) -> Polynomial:
    """Return entry i of (x, s) as a polynomial of x, which is less x* from here on."""
    model = ledger.model
    if i < model.n:
        return {(i,): fmpq(1)}
    return polynomial(model, model.channels[i - model.n], None if ledger.ball is None else ledger.ball.x)


def polynomial(model: Model, channel: Channel, point: Sequence[Fraction] | None) -> Polynomial:
    """Return the value of a channel as a polynomial of x, from a point; None is x_ref, and nothing is subtracted.

    Raises:
        NotProvedError: its function is no polynomial, or too large a one.
    """
    spend(len(channel.row) + 1)
    spend(2 * sum(step.name == "x" for step in channel.program) - 2)  # y counts wherever it is read
    coefficients = value(channel.program, _Powers([fmpq(0), fmpq(1)])).coefficients
    y: Polynomial = {(k,): _exact(r) for k, r in channel.row.items() if r}
    if point is not None:
        at = sum((r * (point[k] - model.x_ref[k]) for k, r in channel.row.items()), Fraction(0))
        moved = _value(coefficients, {(): _exact(at), (0,): fmpq(1)} if at else {(0,): fmpq(1)})
        coefficients = [fmpq(0), *(moved.get((0,) * k, fmpq(0)) for k in range(1, len(coefficients)))]
    return _value(coefficients, y)


def _value(coefficients: Sequence[fmpq], y: Polynomial) -> Polynomial:
    """Return sum c_k y^k, by Horner's rule."""
    total: Polynomial = {}
    for c in reversed(coefficients):
        product: Terms = {(): c}
        add_product(product, total, y)
        total = without_zeros(product)
    return total


def add_product(total: Terms, a: Polynomial, b: Polynomial) -> None:
    """Add a b to a total."""
    bits, factors = _bits(a.values()) + _bits(b.values()), _factors(a) + _factors(b)
    spend(len(a) * len(b) * (1 + bits // BITS_A_STEP + factors // FACTORS_A_STEP))
    for first, v in a.items():
        for second, w in b.items():
            monomial = tuple(sorted(first + second))
            total[monomial] = total.get(monomial, fmpq(0)) + v * w


def _factors(a: Polynomial) -> int:
    return max(map(len, a), default=0)


def without_zeros(total: Terms) -> Polynomial:
    """Return a total as a polynomial."""
    return {monomial: value for monomial, value in total.items() if value}


def _exact(value: Number) -> fmpq:
    return fmpq(*value.as_integer_ratio())


def _bits(values: Iterable[fmpq]) -> int:
    return max((int(abs(v.p)).bit_length() + int(v.q).bit_length() for v in values), default=0)


class _Powers:
    """A polynomial c_0 + c_1 y + ... of short numbers and no high degree, or refused; zeros at the end are cut."""

    def __init__(self, coefficients: Coefficients) -> None:
        spend(len(coefficients))
        while len(coefficients) > 1 and coefficients[-1] == 0:
            coefficients = coefficients[:-1]
        short = len(coefficients) <= MAX_DEGREE + 1 and _bits(coefficients) <= MAX_BITS
        require(short, WHERE, f"a channel's degree is more than {MAX_DEGREE}, or its coefficients are too long")
        self.coefficients = coefficients

    def constant(self, value: Fraction) -> "_Powers":
        return _Powers([_exact(value)])

    def __add__(self, other: Self) -> "_Powers":
        pairs = zip_longest(self.coefficients, other.coefficients, fillvalue=fmpq(0))
        return _Powers([v + w for v, w in pairs])

    def __neg__(self) -> "_Powers":
        return _Powers([-v for v in self.coefficients])

    def __sub__(self, other: Self) -> "_Powers":
        pairs = zip_longest(self.coefficients, other.coefficients, fillvalue=fmpq(0))
        return _Powers([v - w for v, w in pairs])

    def __mul__(self, other: Self) -> "_Powers":
        a, b = self.coefficients, other.coefficients
        spend(len(a) * len(b) * (1 + (_bits(a) + _bits(b)) // BITS_A_STEP))
        total = [fmpq(0)] * (len(a) + len(b) - 1)
        for i, v in enumerate(a):
            for j, w in enumerate(b):
                total[i + j] += v * w
        return _Powers(total)

    def __truediv__(self, other: Self) -> "_Powers":
        divisor = other.coefficients
        constant = len(divisor) == 1 and divisor[0] != 0
        require(constant, WHERE, "a channel's function is not a polynomial: it divides by one, or by 0")
        return _Powers([v / divisor[0] for v in self.coefficients])

    def power(self, exponent: Fraction) -> "_Powers":
        natural = exponent.denominator == 1 and exponent >= 1
        require(natural, WHERE, "a channel's function is not a polynomial: a power of it is not 1, 2, 3, ...")
        total = self
        for _ in range(int(exponent) - 1):
            total = total * self
        return _Powers(total.coefficients)

    def apply(self, name: str) -> "_Powers":
        raise NotProvedError(WHERE, f"a channel's function is not a polynomial: {name}")
