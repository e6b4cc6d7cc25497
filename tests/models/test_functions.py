"""Scalar functions: value, derivative, antiderivative and LaTeX agree with each other."""

import warnings

import numpy as np
import pytest
from scipy.integrate import quad

from persid.errors import ModelError
from persid.models.functions import scalar_function

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
POINTS = np.array([-2.3, -0.7, -0.11, 0.13, 0.9, 1.7])


@pytest.mark.parametrize("text", [*ODD, *OTHERS, *KINKED])
def test_derivatives_agree_with_differences(text):
    """The derivative is the limit of central differences."""
    f, h = scalar_function(text), 1e-5
    difference = (f.value(POINTS + h) - f.value(POINTS - h)) / (2 * h)
    assert np.allclose(f.derivative(POINTS), difference, rtol=1e-7, atol=1e-8)


@pytest.mark.parametrize("text", [*ODD, *OTHERS, "cos(x)", "exp(x)"])
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
