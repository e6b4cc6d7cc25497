"""Expressions in other algebras: a postfix program is run once with SymPy's, CasADi's or Numba's meaning of every word.

Nothing here reads text: what reaches another library is built from the instructions of a parsed expression.
"""

import operator
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from typing import Any

from persid._libraries import library
from persid.models.output_equation import OutputEquation
from persid.models.vector_field import VectorField
from persid_check.expression import Program

Value = Any  # an expression, a matrix or an equation of SymPy, CasADi or python-control, which have no types
Function = Callable[..., Value]
MakeMatrix = Callable[[Value], Value]  # a library's matrix of an array, or of a list of rows

_ARITHMETIC = {"+": operator.add, "-": operator.sub, "*": operator.mul, "/": operator.truediv}


@dataclass(frozen=True)
class Algebra:
    """What the words of the grammar mean for values of another library."""

    number: Callable[[Fraction], Value]
    power: Callable[[Value, Fraction], Value]
    binary: Mapping[str, Callable[[Value, Value], Value]]
    unary: Mapping[str, Callable[[Value], Value]]

    def value(self, program: Program, x: object) -> Value:
        """Return the value of an expression at x."""
        stack: list[Value] = []
        for step in program:
            if step.name == "x":
                stack.append(x)
            elif step.name == "number":
                stack.append(self.number(step.value or Fraction(0)))
            elif step.name == "**":
                stack.append(self.power(stack.pop(), step.value or Fraction(0)))
            elif step.name in self.binary:
                right, left = stack.pop(), stack.pop()
                stack.append(self.binary[step.name](left, right))
            else:
                stack.append(self.unary[step.name](stack.pop()))
        return stack.pop()


def right_side(field: VectorField, x: object, u: object, algebra: Algebra, matrix: MakeMatrix) -> Value:
    """Return A0 (x - x_ref) + sum_c a_c f_c(r_c'(x - x_ref)) + B (u - u_ref) + b as a column of another library.

    Paper: eq:main_system_Per. `matrix` makes a library's matrix of an array (or list of rows); x and u are columns.
    """
    channels = field.channels
    dx = x - matrix(field.x_ref[:, None])
    dot = matrix(channels.A0) @ dx + matrix(field.b[:, None])
    if channels.functions:
        arguments = matrix(channels.rows) @ dx
        dot += matrix(channels.columns) @ matrix(
            [[algebra.value(f.program, arguments[c])] for c, f in enumerate(channels.functions)]
        )
    return dot + matrix(field.B) @ (u - matrix(field.u_ref[:, None])) if field.m else dot


def output_side(seen: OutputEquation, x: object, u: object, algebra: Algebra, matrix: MakeMatrix) -> Value:
    """Return h(C (x - x_ref) + D (u - u_ref) + d) as a column of another library; see `right_side`."""
    field = seen.field
    y = matrix(seen.C) @ (x - matrix(field.x_ref[:, None])) + matrix(seen.d[:, None])
    if field.m:
        y += matrix(seen.D) @ (u - matrix(field.u_ref[:, None]))
    maps = seen.output_map
    return y if maps is None else matrix([[algebra.value(h.program, y[i])] for i, h in enumerate(maps)])


def sympy_algebra(exact: bool) -> Algebra:
    """Return the algebra of SymPy expressions; a number is a Rational, or a Float of the same 53 bits."""
    sympy = library("sympy", "interop")

    def number(value: Fraction) -> Value:
        if exact or value.denominator == 1:
            return sympy.Rational(value.numerator, value.denominator)
        return sympy.Float(float(value))

    return Algebra(
        number=number,
        power=lambda base, exponent: base ** sympy.Rational(exponent.numerator, exponent.denominator),
        binary=_ARITHMETIC,
        unary={
            name: getattr(sympy, name) for name in ("sqrt", "exp", "sin", "cos", "tan", "sinh", "cosh", "tanh", "erf")
        }
        | {"neg": operator.neg, "abs": sympy.Abs, "arcsinh": sympy.asinh, "arctan": sympy.atan}
        | {"log1p": lambda y: sympy.log(1 + y), "expm1": lambda y: sympy.exp(y) - 1}
        | {"softplus": lambda y: sympy.log(1 + sympy.exp(y))}
        | _clipped(sympy.Abs, sympy.Max, sympy.Min),
    )


def casadi_algebra() -> Algebra:
    """Return the algebra of CasADi's scalar expressions."""
    casadi = library("casadi", "interop")
    names = ("sqrt", "exp", "log1p", "expm1", "sin", "cos", "tan", "sinh", "cosh", "tanh", "arcsinh", "arctan", "erf")

    return Algebra(
        number=float,
        power=lambda base, exponent: base ** float(exponent),
        binary=_ARITHMETIC,
        unary={name: getattr(casadi, name) for name in names}
        | {"neg": operator.neg, "abs": casadi.fabs}
        | {"softplus": lambda y: casadi.fmax(y, 0) + casadi.log1p(casadi.exp(-casadi.fabs(y)))}
        | _clipped(casadi.fabs, casadi.fmax, casadi.fmin),
    )


def _clipped(absolute: Function, maximum: Function, minimum: Function) -> dict[str, Callable[[Value], Value]]:
    """Return the piecewise functions, which libraries do not have, by what they have."""
    return {
        "softsign": lambda y: y / (1 + absolute(y)),
        "relu": lambda y: maximum(y, 0),
        "sat": lambda y: minimum(maximum(y, -1), 1),
        "deadzone": lambda y: y - minimum(maximum(y, -1), 1),
    }
