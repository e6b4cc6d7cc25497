"""A model for the neighbours' tools: python-control, SymPy, LaTeX, CasADi, and plain or compiled functions for SciPy.

Everything is built from the parsed expressions of the model. A library that is not installed is an ImportError that
names the extra: `pip install "persid[interop]"`.
"""

from collections.abc import Callable, Mapping, Sequence
from fractions import Fraction
from functools import partial

import numpy as np
from numpy import ndarray

from persid._libraries import library
from persid.models.exports.algebra import Value, casadi_algebra, output_side, right_side, sympy_algebra
from persid.models.exports.compiled import compiled
from persid.models.formulas import lines
from persid.models.output_equation import OutputEquation
from persid.models.vector_field import VectorField


def to_control(field: VectorField, name: str | None = None, seen: OutputEquation | None = None) -> Value:
    """Return a `control.NonlinearIOSystem`; its outputs are the states, or those of an output model."""
    control = library("control", "interop")
    rate = prepared(field)
    return control.nlsys(
        lambda t, x, u, params: rate(t, x, u),
        None if seen is None else lambda t, x, u, params: seen.values(x, u),
        states=list(field.states),
        inputs=list(field.inputs) or 0,
        outputs=list(field.states if seen is None else seen.outputs),
        name=name,
        dt=field.dt or 0,
    )


def to_sympy(field: VectorField, exact: bool = False) -> Value:
    """Return x' as a SymPy Matrix (n, 1); see `PersidskiiModel.to_sympy`."""
    return _in_sympy(partial(right_side, field), _symbols(field.states), _symbols(field.inputs), exact)


def outputs_to_sympy(seen: OutputEquation, exact: bool = False) -> Value:
    """Return y as a SymPy Matrix (l, 1); see `OutputModel.to_sympy`."""
    return _in_sympy(partial(output_side, seen), _symbols(seen.field.states), _symbols(seen.field.inputs), exact)


def to_equations(field: VectorField, seen: OutputEquation | None = None) -> list[Value]:
    """Return one sympy.Eq a state, and one an output, in functions of t, or of the step k, for the states."""
    sympy = library("sympy", "interop")
    t = sympy.Symbol("t") if field.dt is None else sympy.Symbol("k", integer=True)
    names, u = [sympy.Function(name) for name in field.states], _symbols(field.inputs)
    x = [name(t) for name in names]
    left = [symbol.diff(t) for symbol in x] if field.dt is None else [name(t + 1) for name in names]
    found = list(zip(left, _in_sympy(partial(right_side, field), x, u, False), strict=True))
    if seen is not None:
        found += zip(
            (sympy.Function(name)(t) for name in seen.outputs),
            _in_sympy(partial(output_side, seen), x, u, False),
            strict=True,
        )
    return [sympy.Eq(*pair) for pair in found]


def _symbols(names: Sequence[str]) -> list[Value]:
    sympy = library("sympy", "interop")
    return [sympy.Symbol(name) for name in names]


def _in_sympy(side: Callable[..., Value], x: Sequence[object], u: Sequence[object], exact: bool) -> Value:
    """Return a side of the equations in symbols for states and inputs."""
    sympy = library("sympy", "interop")
    algebra = sympy_algebra(exact)

    def entry(value: object) -> Value:
        return algebra.number(Fraction(float(value))) if isinstance(value, float) else value

    def matrix(array: Value) -> Value:
        rows = [[entry(value) for value in row] for row in array]
        return sympy.Matrix(len(rows), len(rows[0]) if rows else 0, [value for row in rows for value in row])

    return side(sympy.Matrix(len(x), 1, list(x)), sympy.Matrix(len(u), 1, list(u)), algebra, matrix)


def to_latex(field: VectorField, digits: int = 4, seen: OutputEquation | None = None) -> str:
    """Return the equations as one aligned block of LaTeX; see `PersidskiiModel.to_latex`."""
    found = lines(field, seen, "latex", digits)
    body = " \\\\\n".join(line.replace(" = ", " &= ", 1) for line in found)
    return f"\\begin{{aligned}}\n{body}\n\\end{{aligned}}"


def to_callable(field: VectorField, jit: bool = False) -> Callable[..., ndarray]:
    """Return rhs(t, x, u=None); see `PersidskiiModel.to_callable`."""
    return compiled(field) if jit else prepared(field)


def prepared(field: VectorField) -> Callable[..., ndarray]:
    """Return rhs(t, x, u=None) in NumPy with everything fixed computed beforehand."""
    dot, B, u_ref, b = field.drift(), field.B, field.u_ref, field.b

    def rhs(t: float | int, x: object, u: object = None) -> ndarray:
        rate = dot(np.asarray(x, float)) + b
        return np.asarray(rate if u is None else rate + B @ (np.asarray(u, float) - u_ref))

    return rhs


def to_casadi(field: VectorField, name: str = "rhs") -> Value:
    """Return the `casadi.Function` (x, u) -> x_dot or x_next; see `PersidskiiModel.to_casadi`."""
    return _in_casadi(field, name, {"x_dot" if field.dt is None else "x_next": partial(right_side, field)})


def outputs_to_casadi(seen: OutputEquation, name: str = "model") -> Value:
    """Return the `casadi.Function` (x, u) -> (x_dot, y); see `OutputModel.to_casadi`."""
    sides = {"x_dot": partial(right_side, seen.field), "y": partial(output_side, seen)}
    return _in_casadi(seen.field, name, sides)


def _in_casadi(field: VectorField, name: str, sides: Mapping[str, Callable[..., Value]]) -> Value:
    """Return the function of sides of the equations."""
    casadi = library("casadi", "interop")
    x, u = casadi.SX.sym("x", field.n), casadi.SX.sym("u", field.m)

    def matrix(rows: Value) -> Value:
        return casadi.DM(rows) if isinstance(rows, ndarray) else casadi.vertcat(*(row[0] for row in rows))

    found = [side(x, u, casadi_algebra(), matrix) for side in sides.values()]
    return casadi.Function(name, [x, u], found, ["x", "u"], list(sides))
