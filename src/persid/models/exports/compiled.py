"""A model as machine code by Numba: every instruction of an expression becomes a small compiled function of the last.

No source text is generated. LLVM inlines the small functions, so the result is what a hand-written loop would give.
"""

import math
from collections.abc import Callable
from fractions import Fraction
from itertools import pairwise
from typing import Any, Protocol, TypeVar, cast, no_type_check, runtime_checkable

import numpy as np
from numpy import ndarray
from scipy import sparse

from persid._libraries import library
from persid.models.exports.algebra import Algebra
from persid.models.vector_field import VectorField

Scalar = Callable[[float], float]
OnArray = Callable[[ndarray], None]  # changes the array it is given
Function = TypeVar("Function", bound=Callable[..., Any])


@runtime_checkable
class Compile(Protocol):
    """numba.njit."""

    def __call__(self, function: Function, /) -> Function: ...


_WORDS: dict[str, Scalar] = {
    name: getattr(np, name)
    for name in (
        "sqrt",
        "abs",
        "exp",
        "log1p",
        "expm1",
        "sin",
        "cos",
        "tan",
        "sinh",
        "cosh",
        "tanh",
        "arcsinh",
        "arctan",
    )
} | {"neg": np.negative, "erf": math.erf}
_OWN: dict[str, Scalar] = {
    "softsign": lambda y: y / (1.0 + abs(y)),
    "softplus": lambda y: max(y, 0.0) + np.log1p(np.exp(-abs(y))),
    "relu": lambda y: max(y, 0.0),
    "sat": lambda y: min(max(y, -1.0), 1.0),
    "deadzone": lambda y: y - min(max(y, -1.0), 1.0),
}
_ARITHMETIC: dict[str, Callable[[float, float], float]] = {
    "+": lambda a, b: a + b,
    "-": lambda a, b: a - b,
    "*": lambda a, b: a * b,
    "/": lambda a, b: a / b,
}


def compiled(field: VectorField) -> Callable[..., ndarray]:
    """Return rhs(t, x, u=None), compiled at its first call; see `PersidskiiModel.to_callable`."""
    njit = library("numba", "interop").njit(error_model="numpy")  # 1/0 is inf, as in NumPy
    apply = _on_channels(field, njit)
    channels = field.channels
    rows = sparse.csr_array(channels.rows)
    ends, places, weights = rows.indptr.astype(np.int64), rows.indices.astype(np.int64), rows.data
    A0, columns, B = (np.ascontiguousarray(M) for M in (channels.A0, channels.columns, field.B))
    x_ref, u_ref, b, count = field.x_ref, field.u_ref, field.b, len(channels.functions)

    @no_type_check  # Numba infers the types
    def rhs(t, x, u=None):
        dx = x - x_ref
        y = np.zeros(count)
        for c in range(count):
            for k in range(ends[c], ends[c + 1]):
                y[c] += weights[k] * dx[places[k]]
        apply(y)
        dot = A0 @ dx + columns @ y + b
        if u is not None:
            dot += B @ (u - u_ref)
        return dot

    return cast("Callable[..., ndarray]", njit(rhs))


def _on_channels(field: VectorField, njit: Compile) -> OnArray:
    """Return the compiled function that replaces the arguments y of the channels by f(y), one loop a run of equal f."""
    algebra = _algebra(njit)
    functions = field.channels.functions
    borders = [c for c in range(len(functions)) if c == 0 or functions[c] != functions[c - 1]]
    scalars = {f: algebra.value(f.program, njit(lambda y: y)) for f in set(functions)}
    apply: OnArray = njit(lambda y: None)
    for a, b in pairwise([*borders, len(functions)]):
        apply = _and_then(njit, apply, scalars[functions[a]], a, b)
    return apply


def _and_then(njit: Compile, before: OnArray, f: Scalar, start: int, stop: int) -> OnArray:
    @no_type_check
    def apply(y):
        before(y)
        for c in range(start, stop):
            y[c] = f(y[c])

    return cast("OnArray", njit(apply))


def _algebra(njit: Compile) -> Algebra:
    """Return the algebra whose values are compiled functions of the variable."""
    own = {name: njit(f) for name, f in _OWN.items()}
    arithmetic = {name: njit(f) for name, f in _ARITHMETIC.items()}

    def number(value: Fraction) -> Scalar:
        constant = float(value)
        return njit(lambda y: constant)

    def power(base: Scalar, exponent: Fraction) -> Scalar:
        e = int(exponent) if exponent.denominator == 1 else float(exponent)  # an integer power becomes products
        return njit(lambda y: base(y) ** e)

    def composed(f: Scalar) -> Callable[[Scalar], Scalar]:
        return lambda inner: njit(lambda y: f(inner(y)))

    def joined(f: Callable[[float, float], float]) -> Callable[[Scalar, Scalar], Scalar]:
        return lambda left, right: njit(lambda y: f(left(y), right(y)))

    return Algebra(
        number=number,
        power=power,
        binary={name: joined(f) for name, f in arithmetic.items()},
        unary={name: composed(f) for name, f in (_WORDS | own).items()},
    )
