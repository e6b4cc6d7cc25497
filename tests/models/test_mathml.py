"""MathML of equations: well formed, complete, and set as the mathematics asks."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

import persid as ps
from persid.models import mathml
from persid_check.expression import FUNCTIONS


def words(element: str) -> str:
    """Return the text of an element, invisible signs left out; it must be well-formed XML."""
    return re.sub("[\u2061\u2062]", "", "".join(ElementTree.fromstring(element).itertext()))


def term(model: ps.PersidskiiModel, state: int = 0, place: int = -1) -> str:
    """Return the text of one term of one equation."""
    return words(mathml.equation(model, state)[1][place])


def test_an_equation_is_its_terms_in_order() -> None:
    """Left side, states, functions, inputs and constant stand in order, zeros left out, with their signs between."""
    model = ps.PersidskiiModel(
        [[-1.5, 0], [2, 0]], [("tanh(x)", None, [[0, -0.25], [0, 0]])], [[1], [0]], [-3, 0], states=["x1", "speed"]
    )
    left, terms = mathml.equation(model, 0)
    assert words(left) == "dx1dt="
    assert [words(part) for part in terms] == ["−1.5x1", "−0.25tanh(speed)", "+u1", "−3"]
    assert words(mathml.equation(model, 1)[0]) == "dspeeddt="
    assert mathml.counts(model).tolist() == [4, 1]


def test_an_empty_equation_is_zero() -> None:
    """An equation without terms reads 0."""
    assert term(ps.PersidskiiModel([[0.0]])) == "0"


@pytest.mark.parametrize("name", sorted(FUNCTIONS))
def test_every_function_is_set(name: str) -> None:
    """Every function of the grammar is well formed, with its argument."""
    text = term(ps.PersidskiiModel([[0.0]], [(f"{name}(x)", [[0.5]], [[2.0]])]))
    assert text in {f"2{name}(x1/2)", "2|x1/2|", "2x1/2"}


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        ("x**3", "2(x1−3)3"),
        ("(1+x)**2-1", "2((1+(x1−3))2−1)"),
        ("x/(1+x**2)", "2(x1−3)1+(x1−3)2"),
        ("-x*exp(-x)", "2(−(x1−3))exp(−(x1−3))"),
        ("x*(x-1)", "2(x1−3)((x1−3)−1)"),
        ("x**-0.5", "2(x1−3)−0.5"),
    ],
)
def test_brackets_stand_where_they_are_needed(function: str, expected: str) -> None:
    """Sums inside products and powers are bracketed; fractions, roots and arguments need no brackets."""
    assert term(ps.PersidskiiModel([[0.0]], [(function, None, [[2.0]])], x_ref=[3])) == expected


def test_rows_of_several_states() -> None:
    """An argument of several states is a sum with its signs, bracketed under a power."""
    model = ps.PersidskiiModel(np.zeros((2, 2)), [("x**3", [[-1, 2]], [[-1], [0]])])
    assert term(model) == "−(−x1+2x2)3"


def test_small_numbers_are_powers_of_ten() -> None:
    """A number that needs an exponent is set as a power of ten."""
    assert term(ps.PersidskiiModel([[-2.5e-7]])) == "−2.5×10−7x1"


def test_names_cannot_break_out() -> None:
    """Markup in a name is text."""
    assert term(ps.PersidskiiModel([[2.0]], states=["<script>&"])) == "2<script>&"
