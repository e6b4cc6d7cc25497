"""Cuts that begin at 0 speak of both sides where the quantity is even: of odd functions seen from 0, of no others."""

from fractions import Fraction
from itertools import product

import numpy as np
import pytest

from persid.certificates.partitions import cuts_of
from persid.models.functions import scalar_function
from persid_check.expression import FUNCTIONS, parse
from persid_check.ledger.lemmas import SLOPES, Lemma, is_odd

F = Fraction
ODD = ("sin(x)", "tanh(x)", "x**3", "x/(1+x**2)", "sinh(x)", "x*abs(x)", "x**2*arctan(x)", "sat(x)")
OTHERS = ("softplus(x)", "x+2*abs(x)", "tanh(x)+1", "x**2", "relu(x)", "x*exp(x)", "x**3+x**2", "exp(x)-exp(-2*x)")
KINDS = ("sector", "nondecreasing", "growing", "rising", "upper", "offset")
FORMS = (F(1), F(1)), (F(1), F(-1)), (F(1, 4), F(1)), (F(0), F(1)), (F(3), F(-1))
DOMAINS = None, (F(-2), F(2)), (F(-1), F(2))
SHAPES = "{0}", "{0}*{0}", "{0}+x", "x+{0}", "x**2+{0}", "x*{0}", "x/(2+{0})", "{0}**3", "{0}**1.5", "{0}**0"
ARGUMENTS = "x", "x**2", "x+1", "x*abs(x)", "1"


def _lemma(
    text: str, form: tuple[Fraction, Fraction], kind: str, centre: tuple[Fraction, Fraction] | None = None
) -> Lemma:
    numbers = {"upper": {"c": F(3, 4), "allowance": F(1)}, "offset": {"allowance": F(2)}}.get(kind, {})
    return Lemma(((parse(text), F(1)),), form, kind, centre, **numbers)


def test_halves_that_are_proved_are_proved_whole() -> None:
    """Of many lemmas: where cuts that begin at 0 are enough, their mirror image beside them is accepted, too."""
    halves = 0
    for text, form, kind, domain in product(ODD, FORMS, KINDS, DOMAINS):
        lemma = _lemma(text, form, kind)
        cuts = cuts_of(lemma, domain)
        if cuts is None or cuts[0] != 0 or lemma.unproved(cuts, domain) is not None:
            continue
        halves += 1
        whole = tuple(sorted({-t for t in cuts} | set(cuts)))
        assert lemma.unproved(whole, domain) is None, (text, form, kind, domain)
    assert halves > 200


@pytest.mark.parametrize("text", OTHERS)
def test_other_functions_need_both_sides(text: str) -> None:
    """Whatever holds to the right of 0, cuts that begin there prove nothing of what is not odd by its form."""
    tried = 0
    for form, kind in product(FORMS[:3], KINDS):
        lemma = _lemma(text, form, kind)
        assert not lemma.even
        for cuts in ((F(0), F(8)), tuple(F(k, 16) for k in range(129))):
            tried += 1
            assert lemma.unproved(cuts, None) is not None, (form, kind)
            assert lemma.unproved(cuts, (F(-2), F(2))) is not None, (form, kind)
    assert tried == 36


@pytest.mark.parametrize("kind", ["sector", "upper", "offset", "growing"])
def test_a_centre_beside_zero_has_no_mirror(kind: str) -> None:
    """Seen from y* != 0 an odd function is not odd: the same cuts are refused, whether y* is a number or a range."""
    for centre in ((F(1), F(1)), (F(-1, 8), F(1, 4)), (F(0), F(1))):
        lemma = _lemma("tanh(x)", (F(1), F(1)), kind, centre)
        assert not lemma.even
        assert lemma.unproved((F(0), F(8)), None) is not None
        assert lemma.unproved((F(0), F(8)), (F(-2), F(2))) is not None
    assert _lemma("tanh(x)", (F(1), F(1)), kind).unproved((F(0), F(8)), None) is None


@pytest.mark.parametrize("kind", SLOPES)
def test_a_slope_is_even_whatever_the_centre_and_reaches_all_centres(kind: str) -> None:
    """The slope of an odd function knows no centre; the cuts hold all of them, with their mirror image."""
    assert _lemma("tanh(x)", (F(1), F(1)), kind, (F(-3), F(1))).unproved((F(0), F(8)), None) is None
    for centre in ((F(-9), F(1)), (F(1), F(8)), (F(-8), F(-8))):
        reason = _lemma("tanh(x)", (F(1), F(1)), kind, centre).unproved((F(0), F(8)), None)
        assert reason == "the cuts do not hold 0 and the centre inside"


def test_one_signed_forms_have_no_mirror() -> None:
    """An odd form that is >= 0 to the right of 0 is <= 0 to the left: as one-signed it is refused by such cuts."""
    lemma = _lemma("x**3", (F(1), F(1)), "one-signed")
    assert not lemma.even
    assert lemma.unproved((F(0), F(8)), None) is not None
    assert lemma.unproved((F(0), F(8)), (F(-1), F(1))) is not None


@pytest.mark.parametrize("domain", [(F(-2), F(1)), (F(-1), F(2)), (F(-2), F(2))])
def test_the_mirror_image_holds_the_domain(domain: tuple[Fraction, Fraction]) -> None:
    """[-t, t] must hold the domain, its longer side, too; and no tail is asked for."""
    lemma = _lemma("sin(x)", (F(0), F(1)), "sector")
    assert lemma.unproved((F(0), F(1)), domain) == "the cuts do not cover the domain"
    assert lemma.unproved((F(0), F(2)), domain) is None


def test_what_is_odd_by_its_form_is_odd_at_samples() -> None:
    """Of each function, of odd, even and other arguments, in sums, products and powers; and defined on both sides."""
    y, odd = np.linspace(0.013, 3.2, 40), 0
    for name, shape, argument in product(sorted(FUNCTIONS), SHAPES, ARGUMENTS):
        text = shape.format(f"{name}({argument})")
        if not is_odd([(parse(text), F(1))]):
            continue
        odd += 1
        with np.errstate(all="ignore"):
            right, left = (scalar_function(text).value(side * y) for side in (1.0, -1.0))
        assert np.isfinite(right).any(), text
        assert np.allclose(right, -left, rtol=1e-9, atol=1e-12, equal_nan=True), text
    assert odd > 150


@pytest.mark.parametrize("kind", ["sector", "nondecreasing", "upper", "offset"])
@pytest.mark.parametrize("cuts", [(F(1), F(8)), (F(1, 2**40), F(8)), (F(-8), F(0)), (F(-8), F(-1))])
def test_cuts_that_begin_elsewhere_have_no_mirror(kind: str, cuts: tuple[Fraction, Fraction]) -> None:
    """Beyond 0 a piece between them and their mirror image is left out; to the left of 0 nothing is mirrored."""
    lemma = _lemma("tanh(x)", (F(1), F(1)), kind)
    assert lemma.even
    assert lemma.unproved(cuts, None) == "the cuts do not hold 0 and the centre inside"
    assert lemma.unproved(cuts, (F(-2), F(2))) == "the cuts do not cover the domain"


@pytest.mark.parametrize("kind", ["sector", "offset", "upper"])
def test_the_tail_is_asked_for(kind: str) -> None:
    """tanh(y) - y/8 is positive as far as its last cut, and falls without end beyond it, on both sides alike."""
    lemma = _lemma("tanh(x)", (F(-1, 8), F(1)), kind)
    assert lemma.unproved((F(0), F(1, 2), F(1), F(2)), (F(-2), F(2))) is None
    assert lemma.unproved((F(0), F(1, 2), F(1), F(2)), None) == "beyond 2"


def test_no_cut_but_zero_is_refused() -> None:
    """One cut at 0 has no piece beside it."""
    for kind in KINDS:
        assert _lemma("tanh(x)", (F(1), F(1)), kind).unproved((F(0),), None) is not None


def test_a_function_that_the_form_does_not_read_may_be_any() -> None:
    """Only what has a coefficient stands in g."""
    functions = ((parse("tanh(x)"), F(1)), (parse("cos(x)"), F(1)))
    assert Lemma(functions, (F(1), F(1), F(0)), "sector").unproved((F(0), F(8)), None) is None
    assert Lemma(functions, (F(9), F(1), F(1, 8)), "nondecreasing").unproved((F(0), F(8)), None) is not None
