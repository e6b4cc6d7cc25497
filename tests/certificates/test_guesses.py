"""Guesses in floats: as the checker's intervals but for rounding, and what they save."""

from fractions import Fraction

import numpy as np
import pytest
from flint import ctx

from persid.certificates.curves import curve_of
from persid.certificates.guesses import Spans, least_on
from persid.certificates.partitions import cuts_of
from persid.lyapunov.sectors import Curve
from persid_check.enclosure import PRECISION, UndefinedError, between, value_and_slope
from persid_check.expression import FUNCTIONS, parse
from persid_check.ledger.lemmas import Lemma

TEXTS = (
    *(f"{name}(x)" for name in sorted(FUNCTIONS)), "x**3", "x**63", "x**-2", "x**-3", "x**1.5",
    "x/(1+x**2)", "x*abs(x)", "1/(x-1)",
)  # fmt: skip
ITSELF = (Fraction(0), Fraction(1))


@pytest.mark.parametrize("text", TEXTS)
def test_spans_are_the_intervals_of_the_checker(text: str) -> None:
    """Values and slopes on random pieces are those of the checker but for rounding, and not defined where those are."""
    rng, program = np.random.default_rng(0), parse(text)
    ends = np.sort(rng.normal(size=(60, 2)) * rng.choice([0.1, 1.0, 10.0], size=(60, 1)), axis=1)
    with np.errstate(all="ignore"):
        lo, hi = ends.T
        found = value_and_slope(program, Spans(lo, hi), Spans(np.ones(60), np.ones(60)))
    for k, (a, b) in enumerate(ends.tolist()):
        with ctx.workprec(PRECISION):
            y = between(Fraction(a), Fraction(b))
            try:
                meant = value_and_slope(program, y, y.constant(Fraction(1)))
            except UndefinedError:
                assert not all(np.isfinite([*np.ravel(each.lo)][k % each.lo.size]) for each in found)
                continue
        for each, exact in zip(found, meant, strict=True):
            size = 1e-6 * (1 + abs(float(exact.lo)) + abs(float(exact.hi)))
            assert np.broadcast_to(each.lo, 60)[k] == pytest.approx(float(exact.lo), abs=size)
            assert np.broadcast_to(each.hi, 60)[k] == pytest.approx(float(exact.hi), abs=size)


@pytest.mark.parametrize("kind", ["sector", "nondecreasing", "upper", "one-signed"])
@pytest.mark.parametrize("centre", [None, (Fraction(1, 4), Fraction(1, 4)), (Fraction(1, 4), Fraction(3, 8))])
def test_quantities_are_those_of_the_lemma(kind: str, centre: tuple[Fraction, Fraction] | None) -> None:
    """Pieces on which the least is clearly positive are those on which the checker proves the lemma."""
    functions = tuple((parse(text), alpha) for text, alpha in (("tanh(x)", Fraction(1)), ("x**3", Fraction(-1, 2))))
    lemma = Lemma(functions, (Fraction(-1, 8), Fraction(1), Fraction(1, 4)), kind, centre, c=Fraction(3, 4))
    rng = np.random.default_rng(1)
    start = np.concatenate([rng.uniform(0.5, 3, 100), -rng.uniform(1, 3, 100)])
    lo, hi = start, start + rng.choice([0.01, 0.1, 0.4], 200)
    value, known = least_on(lemma, lo, hi)
    clear = np.abs(value) > 1e3 * known
    proved = [lemma.holds_on(Fraction(a), Fraction(b)) for a, b in zip(lo.tolist(), hi.tolist(), strict=True)]
    assert clear.sum() > 150
    assert ((value >= 0) == proved)[clear].all()
    assert 5 < sum(proved) < 195


def test_a_sum_needs_few_pieces() -> None:
    """The integral of a shifted cube is bounded on a few hundred pieces; equal ratios needed eighteen hundred."""
    moved = curve_of(Curve(("x**3",), (Fraction(1),), None, (Fraction(1, 4), Fraction(1, 2**40))))
    cuts = cuts_of(moved.lemma(ITSELF, "upper", c=Fraction(13, 16)), None)
    assert cuts is not None
    assert len(cuts) < 300


def test_what_is_false_has_no_cuts() -> None:
    """A form that is negative somewhere, however narrowly, has none; one that only touches zero far out has none."""
    tanh = curve_of(Curve(("tanh(x)",), (Fraction(1),)))
    assert cuts_of(tanh.lemma((Fraction(9, 8), Fraction(-1)), "sector"), None) is not None
    assert cuts_of(tanh.lemma((Fraction(2**20 - 1, 2**20), Fraction(-1)), "sector"), None) is None
    waves = curve_of(Curve(("sin(x)+tanh(2*x)",), (Fraction(1),)))
    assert cuts_of(waves.lemma(ITSELF, "sector"), None) is None
