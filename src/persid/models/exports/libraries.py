"""A model for the neighbours' tools: python-control, SymPy, LaTeX, CasADi, and plain or compiled functions for SciPy.

Everything is built from the parsed expressions of the model. A library that is not installed is an ImportError that
names the extra: `pip install "persid[interop]"`.
"""

from collections.abc import Callable
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy import ndarray

from persid._libraries import library
from persid.models.drift import drift
from persid.models.equations import equations
from persid.models.exports.algebra import casadi_algebra, right_side, sympy_algebra
from persid.models.exports.compiled import compiled

if TYPE_CHECKING:
    from persid.models.model import PersidskiiModel


def to_control(model: "PersidskiiModel", name: str | None = None) -> Any:
    """Return a continuous-time `control.NonlinearIOSystem`; see `PersidskiiModel.to_control`."""
    control = library("control", "interop")
    rate = prepared(model)
    return control.nlsys(
        lambda t, x, u, params: rate(t, x, u),
        None,  # all states are outputs
        states=list(model.states),
        inputs=list(model.inputs) or 0,
        outputs=list(model.states),
        name=name,
        dt=0,
    )


def to_sympy(model: "PersidskiiModel", exact: bool = False) -> Any:
    """Return x' as a SymPy Matrix (n, 1); see `PersidskiiModel.to_sympy`."""
    sympy = library("sympy", "interop")
    algebra = sympy_algebra(exact)

    def entry(value: Any) -> Any:
        return algebra.number(Fraction(float(value))) if isinstance(value, float) else value

    def matrix(array: Any) -> Any:
        rows = [[entry(value) for value in row] for row in array]
        return sympy.Matrix(len(rows), len(rows[0]) if rows else 0, [value for row in rows for value in row])

    x, u = (sympy.Matrix(len(names), 1, [sympy.Symbol(s) for s in names]) for names in (model.states, model.inputs))
    return right_side(model, x, u, algebra, matrix)


def to_latex(model: "PersidskiiModel", digits: int = 4) -> str:
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
    casadi = library("casadi", "interop")
    x, u = casadi.SX.sym("x", model.n), casadi.SX.sym("u", model.m)

    def matrix(rows: Any) -> Any:
        return casadi.DM(rows) if isinstance(rows, ndarray) else casadi.vertcat(*(row[0] for row in rows))

    dot = right_side(model, x, u, casadi_algebra(), matrix)
    return casadi.Function(name, [x, u], [dot], ["x", "u"], ["x_dot"])
