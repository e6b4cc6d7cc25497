"""Curves of a ledger: what is tried to prove of a form."""

from fractions import Fraction

import pytest

from persid.certificates.curves import Curve, Use
from persid.certificates.partitions import cuts_of

TANH = Curve((("tanh(x)", Fraction(1)),), None, None)
FORMS = [(0, 1), (1, -1), (Fraction(9, 10), -1), (-1, 2), (1, Fraction(-65, 64))]


@pytest.mark.parametrize("form", FORMS)
def test_what_falls_in_floating_point_is_not_proved_to_rise(form: tuple[int | Fraction, int | Fraction]) -> None:
    """A form that is left alone because it falls at a point has no proof that it rises, and one that rises is tried."""
    exact = tuple(Fraction(v) for v in form)
    rises = cuts_of(TANH.lemma(exact, "nondecreasing"), None) is not None
    assert TANH._seems_to_fall(exact) != rises


def test_rising_forms_say_so() -> None:
    """The kind that says most is written, where it is proved."""
    x_less_tanh = TANH.written([Use((Fraction(1), Fraction(-1)))], [])
    assert x_less_tanh["forms"][0]["is"] == "nondecreasing"
