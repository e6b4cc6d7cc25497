"""Scalar functions: value, derivative, antiderivative and LaTeX agree with each other."""

import warnings
from xml.etree import ElementTree

import numpy as np
import pytest
from scipy.integrate import quad

from persid.errors import ModelError
from persid.models import mathml
from persid.models.equations import equations
from persid.models.functions import ScalarFunction, layer, scalar_function
from persid.models.lookup_tables import lookup_table
from persid.models.model import PersidskiiModel

ODD = ["x", "x**3", "x**5", "x**7", "sinh(x)", "tanh(x)", "arctan(x)", "arcsinh(x)", "softsign(x)", "erf(x)", "sin(x)"]
OTHERS = [
    "x - tanh(x)",
    "x*abs(x)",
    "x/(1 + x**2)",
    "expm1(x)",
    "log1p(x**2)*x",
    "-x**2",
    "2*x**3 - x",
    "sqrt(1 + x**2)",
]
KINKED = ["relu(x)", "deadzone(x)", "sat(x)", "abs(x)", "softplus(x)", "exp(x)", "cosh(x)", "cos(x)", "tan(x/4)"]
TABLES = ["pwl(x; -1: -2, 0.5: 0, 1: 3)", "pwl(x; -2: -1, -0.5: -1, 0: 0, 1: 0.5)", "2*pwl(x; 1: 1, 2: 0) - x"]
POINTS = np.array([-2.3, -0.7, -0.11, 0.13, 0.9, 1.7])


@pytest.mark.parametrize("text", [*ODD, *OTHERS, *KINKED, *TABLES])
def test_derivatives_agree_with_differences(text):
    """The derivative is the limit of central differences."""
    f, h = scalar_function(text), 1e-5
    difference = (f.value(POINTS + h) - f.value(POINTS - h)) / (2 * h)
    assert np.allclose(f.derivative(POINTS), difference, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("text", [*ODD, *OTHERS, "cos(x)", "exp(x)", *TABLES[:2]])
def test_antiderivatives_agree_with_quadrature(text):
    """The antiderivative is the integral from 0."""
    f = scalar_function(text)
    expected = [quad(lambda s: float(f.value(np.array(s))), 0, y, epsabs=1e-12)[0] for y in POINTS]
    assert np.allclose(f.antiderivative(POINTS), expected, rtol=1e-9, atol=1e-11)


@pytest.mark.parametrize("text", ["cos(1)", "exp(2)", "2**3", "3", "sqrt(4)", "relu(1)"])
def test_constants_are_constant(text):
    """A function of a number alone has that value everywhere, no slope, and a straight line as its integral."""
    f, value = scalar_function(text), {"cos(1)": np.cos(1), "exp(2)": np.exp(2), "2**3": 8, "3": 3, "sqrt(4)": 2}
    assert np.allclose(f.value(POINTS), value.get(text, 1))
    assert np.allclose(f.derivative(POINTS), 0)
    assert np.allclose(f.antiderivative(POINTS), value.get(text, 1) * POINTS)


@pytest.mark.parametrize("exponent", range(1, 12))
def test_powers_are_products(exponent):
    """Small integer powers agree with the general power to the last digits."""
    y = np.linspace(-3, 3, 41)
    assert np.allclose(scalar_function(f"x**{exponent}").value(y), np.power(y, exponent), rtol=4e-15, atol=0)


def test_tables_say_what_they_were_given():
    """A table from knots and values has these values, exactly, goes on beyond its ends, and is named by its knots."""
    knots, values = np.array([-1, 0.1, 0.3, 2]), np.array([-0.7, 0.1, 0.1, 5])
    f = scalar_function(lookup_table(knots, values))
    assert f.text == "pwl(x; -1: -0.7, 0.1: 0.1, 0.3: 0.1, 2: 5)"
    assert (f.value(knots[:-1]) == values[:-1]).all()
    assert np.allclose(f.value(np.array([-3, 0.2, 3.0])), [-0.7 - 2 * 0.8 / 1.1, 0.1, 5 + 4.9 / 1.7])
    assert f.derivative(0.1) == 0
    assert f.latex("x_{1}") == r"\operatorname{pwl}_{4}\left(x_{1}\right)"
    model = PersidskiiModel([[0.0]], [(f.text, [[2.0]], [[-3.0]])], states=["v"])
    assert equations(model) == "d(v)/dt = -3 pwl4(2*v)"
    assert "".join(ElementTree.fromstring(mathml.equation(model, 0)[1][0]).itertext()).endswith("pwl4\u2061(2\u2062v)")


@pytest.mark.parametrize(
    ("knots", "values", "what"),
    [
        ([0, 1], [0], "one value a knot"), ([0], [0], "2 to 64"), (range(65), range(65), "2 to 64"),
        ([0, 0], [0, 1], "larger than the one before"), ([0, np.nan], [0, 1], "finite"),
        ([0, 1], [0, np.inf], "finite"),
    ],
)  # fmt: skip
def test_tables_that_are_none_are_refused(knots, values, what):
    """Tables of wrong lengths, of knots that do not rise, and of numbers that are none name what is needed."""
    with pytest.raises(ModelError, match=what):
        lookup_table(list(knots), list(values))


def test_latex_is_readable():
    """LaTeX keeps the structure of the expression."""
    assert scalar_function("x**3").latex("x_{1}") == "x_{1}^{3}"
    assert scalar_function("x**3").latex(r"\frac{x}{2}") == r"\left(\frac{x}{2}\right)^{3}"
    assert scalar_function("2*x").latex("a - b") == r"2 \left(a - b\right)"
    assert scalar_function("tanh(2*x)").latex() == r"\tanh \left(2 x\right)"
    assert scalar_function("x/(1+x**2)").latex() == r"\frac{x}{1 + x^{2}}"


@pytest.mark.parametrize(
    "text", ["y", "x**x", "__import__('os')", "x if x else 1", "", "1e999", "lambda x: x", "x.real"]
)
def test_nothing_outside_the_grammar_is_read(text):
    """Anything but an expression of the grammar is refused by name."""
    with pytest.raises(ModelError):
        scalar_function(text)


def test_only_x_itself_is_linear():
    """A linear term is the bare x."""
    assert scalar_function("x").is_linear
    assert not scalar_function("2*x").is_linear


def test_arrays_of_any_shape_are_taken():
    """Functions work elementwise on scalars, vectors and matrices."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for shape in ((), (3,), (2, 3)):
            assert scalar_function("x - tanh(x)").value(np.ones(shape)).shape == shape


def test_functions_are_sorted_without_comparing_all_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of fifty different functions, each twice, no two are compared more often than a table needs."""
    functions = tuple(scalar_function(f"{k} * tanh(x)") for k in [*range(1, 51)] * 2)
    compared: list[object] = []
    same = ScalarFunction.__eq__
    monkeypatch.setattr(ScalarFunction, "__eq__", lambda f, g: compared.append(g) or same(f, g))
    kinds = layer.__wrapped__(functions).kinds
    assert [places for _, places in kinds] == [(k, k + 50) for k in range(50)]
    assert len(compared) <= len(functions)
