"""A model for the neighbours' tools: python-control, SymPy, LaTeX, CasADi, and plain or compiled functions for SciPy.

Everything is built from the parsed expressions of the model. A library that is not installed is an ImportError that
names the extra: `pip install "persid[interop]"`.
"""

from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray

from persid._libraries import library
from persid.models.drift import drift
from persid.models.equations import equations
from persid.models.exports.algebra import casadi_algebra, output_side, right_side, sympy_algebra
from persid.models.exports.compiled import compiled

if TYPE_CHECKING:
    from persid.models.model import PersidskiiModel
    from persid.models.outputs import OutputModel


def to_control(model: "PersidskiiModel", name: str | None = None, seen: "OutputModel | None" = None) -> Any:
    """Return a continuous-time `control.NonlinearIOSystem`; its outputs are the states, or those of an output model."""
    control = library("control", "interop")
    rate = prepared(model)
    return control.nlsys(
        lambda t, x, u, params: rate(t, x, u),
        None if seen is None else lambda t, x, u, params: seen.output(x, u),
        states=list(model.states),
        inputs=list(model.inputs) or 0,
        outputs=list(model.states if seen is None else seen.outputs),
        name=name,
        dt=0,
    )


def to_sympy(model: "PersidskiiModel", exact: bool = False) -> Any:
    """Return x' as a SymPy Matrix (n, 1); see `PersidskiiModel.to_sympy`."""
    return _in_sympy(model, exact, right_side)


def outputs_to_sympy(model: "OutputModel", exact: bool = False) -> Any:
    """Return y as a SymPy Matrix (l, 1); see `OutputModel.to_sympy`."""
    return _in_sympy(model.dynamics, exact, partial(output_side, model))


def _in_sympy(model: "PersidskiiModel", exact: bool, side: Callable[..., Any]) -> Any:
    """Return a side of the equations in symbols named like states and inputs."""
    sympy = library("sympy", "interop")
    algebra = sympy_algebra(exact)

    def entry(value: Any) -> Any:
        return algebra.number(Fraction(float(value))) if isinstance(value, float) else value

    def matrix(array: Any) -> Any:
        rows = [[entry(value) for value in row] for row in array]
        return sympy.Matrix(len(rows), len(rows[0]) if rows else 0, [value for row in rows for value in row])

    x, u = (sympy.Matrix(len(names), 1, [sympy.Symbol(s) for s in names]) for names in (model.states, model.inputs))
    return side(model, x, u, algebra, matrix)


def to_latex(model: "PersidskiiModel | OutputModel", digits: int = 4) -> str:
    """Return the equations as one aligned block of LaTeX; see `PersidskiiModel.to_latex`."""
    lines = equations(model, "latex", digits).splitlines()
    body = " \\\\\n".join(line.replace(" = ", " &= ", 1) for line in lines)
    return f"\\begin{{aligned}}\n{body}\n\\end{{aligned}}"


def to_callable(model: "PersidskiiModel", jit: bool = False) -> Callable[..., ndarray]:
    """Return rhs(t, x, u=None); see `PersidskiiModel.to_callable`."""
    return compiled(model) if jit else prepared(model)


def prepared(model: "PersidskiiModel") -> Callable[..., ndarray]:
    """Return rhs(t, x, u=None) in NumPy with everything fixed computed beforehand."""
    dot, B, u_ref, b = drift(model), model.B, model.u_ref, model.b

    def rhs(t: float | int, x: Any, u: Any = None) -> ndarray:
        rate = dot(np.asarray(x, float)) + b
        return rate if u is None else rate + B @ (np.asarray(u, float) - u_ref)

    return rhs


def to_casadi(model: "PersidskiiModel", name: str = "rhs") -> Any:
    """Return the `casadi.Function` (x, u) -> x_dot; see `PersidskiiModel.to_casadi`."""
    return _in_casadi(model, name, {"x_dot": right_side})


def outputs_to_casadi(model: "OutputModel", name: str = "model") -> Any:
    """Return the `casadi.Function` (x, u) -> (x_dot, y); see `OutputModel.to_casadi`."""
    return _in_casadi(model.dynamics, name, {"x_dot": right_side, "y": partial(output_side, model)})


def _in_casadi(model: "PersidskiiModel", name: str, sides: Mapping[str, Callable[..., Any]]) -> Any:
    """Return the function of sides of the equations."""
    casadi = library("casadi", "interop")
    x, u = casadi.SX.sym("x", model.n), casadi.SX.sym("u", model.m)

    def matrix(rows: Any) -> Any:
        return casadi.DM(rows) if isinstance(rows, ndarray) else casadi.vertcat(*(row[0] for row in rows))

    found = [side(model, x, u, casadi_algebra(), matrix) for side in sides.values()]
    return casadi.Function(name, [x, u], found, ["x", "u"], list(sides))
