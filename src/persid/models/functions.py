"""Scalar functions of a model: value, derivative, antiderivative and LaTeX, all read off one postfix program.

The grammar and its meaning belong to `persid_check.expression`; here every instruction gets its floating-point meaning.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, lru_cache, partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import ModelError
from persid.models.lookup_tables import LookupTable, read_table
from persid_check.expression import ExpressionError, Instruction, Program, parse

_Unary = Callable[[ndarray], ndarray]


def _erf(y: ndarray) -> ndarray:
    from scipy.special import erf

    return erf(y)


def _softplus(y: ndarray) -> ndarray:
    return np.asarray(np.logaddexp(0.0, y))


def _logistic(y: ndarray) -> ndarray:
    return 0.5 * (1 + np.tanh(0.5 * y))


def _log_cosh(y: ndarray) -> ndarray:
    return np.asarray(np.abs(y) + np.log1p(np.exp(-2 * np.abs(y))) - np.log(2.0))


# name: (value, derivative). At a kink the derivative is the one on the right.
_FUNCTIONS: dict[str, tuple[_Unary, _Unary]] = {
    "sqrt": (np.sqrt, lambda y: 0.5 / np.sqrt(y)),
    "abs": (np.abs, lambda y: np.where(y >= 0, 1.0, -1.0)),
    "exp": (np.exp, np.exp),
    "log1p": (np.log1p, lambda y: 1 / (1 + y)),
    "expm1": (np.expm1, np.exp),
    "sin": (np.sin, np.cos),
    "cos": (np.cos, lambda y: -np.sin(y)),
    "tan": (np.tan, lambda y: 1 + np.tan(y) ** 2),
    "sinh": (np.sinh, np.cosh),
    "cosh": (np.cosh, np.sinh),
    "tanh": (np.tanh, lambda y: 1 - np.tanh(y) ** 2),
    "arcsinh": (np.arcsinh, lambda y: 1 / np.hypot(1, y)),
    "arctan": (np.arctan, lambda y: 1 / (1 + y**2)),
    "erf": (_erf, lambda y: 2 / np.sqrt(np.pi) * np.exp(-(y**2))),
    "softsign": (lambda y: y / (1 + np.abs(y)), lambda y: 1 / (1 + np.abs(y)) ** 2),
    "softplus": (_softplus, _logistic),
    "relu": (lambda y: np.maximum(y, 0), lambda y: np.where(y >= 0, 1.0, 0.0)),
    "deadzone": (lambda y: y - np.clip(y, -1, 1), lambda y: np.where(np.abs(y) >= 1, 1.0, 0.0)),
    "sat": (lambda y: np.clip(y, -1, 1), lambda y: np.where(np.abs(y) < 1, 1.0, 0.0)),
}
VALUES: dict[str, _Unary] = {name: f for name, (f, _) in _FUNCTIONS.items()}
_LATEX = {"abs": r"\left|{}\right|", "sqrt": r"\sqrt{{{}}}", "arcsinh": r"\operatorname{{arcsinh}} {}"} | {
    name: rf"\operatorname{{{{{name}}}}} {{}}"
    for name in ("log1p", "expm1", "erf", "softsign", "softplus", "relu", "deadzone", "sat")
}

# Closed antiderivatives vanishing at 0, in the words of the grammar; other functions are integrated by quadrature.
_ANTIDERIVATIVES: dict[str, _Unary] = {
    "sinh(x)": lambda y: 2 * np.sinh(y / 2) ** 2,
    "tanh(x)": _log_cosh,
    "sin(x)": lambda y: 2 * np.sin(y / 2) ** 2,
    "cos(x)": np.sin,
    "arctan(x)": lambda y: y * np.arctan(y) - 0.5 * np.log1p(y**2),
    "arcsinh(x)": lambda y: y * np.arcsinh(y) - y**2 / (1 + np.hypot(1, y)),
    "softsign(x)": lambda y: np.abs(y) - np.log1p(np.abs(y)),
}


def _on_arrays(f: _Unary, y: ndarray | float) -> ndarray:
    """Apply f to an array of at least one dimension (NumPy turns arrays without one into scalars)."""
    y = np.asarray(y, float)
    return f(y) if y.ndim else f(y[None])[0:1].reshape(())


def _power(base: ndarray, exponent: float) -> ndarray:
    if exponent == int(exponent) and 1 <= exponent <= 8:  # a few products cost a tenth of a general power
        result = base
        for bit in bin(int(exponent))[3:]:
            result = result * result if bit == "0" else result * result * base
        return result
    return np.asarray(np.power(base, int(exponent) if exponent == int(exponent) else exponent))


def _pair(program: Program, y: ndarray) -> tuple[ndarray, ndarray]:
    """Value and derivative together: forward differentiation on the program's stack."""
    stack: list[tuple[ndarray, ndarray]] = []
    one, zero = np.ones_like(y), np.zeros_like(y)
    for step in program:
        if step.name == "number":
            stack.append((np.full_like(y, float(step.value or 0)), zero))
        elif step.name == "x":
            stack.append((y, one))
        elif step.name in "+-*/":
            (b, db), (a, da) = stack.pop(), stack.pop()
            if step.name in "+-":
                sign = 1.0 if step.name == "+" else -1.0
                stack.append((a + sign * b, da + sign * db))
            elif step.name == "*":
                stack.append((a * b, da * b + a * db))
            else:
                stack.append((a / b, (da - a / b * db) / b))
        else:
            a, da = stack.pop()
            if step.name == "neg":
                stack.append((-a, -da))
            elif step.name == "**":
                e = float(step.value or 0)
                stack.append((_power(a, e), (e * _power(a, e - 1) if e else zero) * da))
            else:
                f, df = _FUNCTIONS[step.name]
                stack.append((f(a), df(a) * da))
    return stack.pop()


def _value(program: Program, y: ndarray) -> ndarray:
    stack: list[ndarray] = []
    for step in program:
        if step.name == "number":
            stack.append(np.full_like(y, float(step.value or 0)))
        elif step.name == "x":
            stack.append(y)
        elif step.name in "+-*/":
            b, a = stack.pop(), stack.pop()
            operation = {"+": np.add, "-": np.subtract, "*": np.multiply, "/": np.divide}[step.name]
            stack.append(operation(a, b))
        elif step.name == "neg":
            stack.append(-stack.pop())
        elif step.name == "**":
            stack.append(_power(stack.pop(), float(step.value or 0)))
        else:
            stack.append(_FUNCTIONS[step.name][0](stack.pop()))
    return stack.pop()


_SYMBOL = re.compile(r"(\\?[A-Za-z]+(\{\w+\})?|\w)(_\{\w+\})?")


def _latex_number(value: Fraction) -> str:
    return f"{float(value):.6g}"


def _latex(program: Program, variable: str) -> str:
    """LaTeX of a program; the second entry on the stack tells how tightly the text binds."""
    stack: list[tuple[str, int]] = []

    def wrap(item: tuple[str, int], level: int) -> str:
        return item[0] if item[1] >= level else rf"\left({item[0]}\right)"

    for step in program:
        if step.name == "number":
            stack.append((_latex_number(step.value or Fraction(0)), 4))
        elif step.name == "x":
            stack.append((variable, 4 if _SYMBOL.fullmatch(variable) else 0))
        elif step.name in "+-*/":
            b, a = stack.pop(), stack.pop()
            if step.name in "+-":
                stack.append((f"{wrap(a, 1)} {step.name} {wrap(b, 2)}", 1))
            elif step.name == "*":
                stack.append((f"{wrap(a, 2)} {wrap(b, 3)}", 2))
            else:
                stack.append((rf"\frac{{{a[0]}}}{{{b[0]}}}", 4))
        elif step.name == "neg":
            stack.append((f"-{wrap(stack.pop(), 2)}", 1))
        elif step.name == "**":
            stack.append((f"{wrap(stack.pop(), 4)}^{{{_latex_number(step.value or Fraction(0))}}}", 3))
        else:
            a = stack.pop()
            argument = a[0] if step.name in ("abs", "sqrt") else rf"\left({a[0]}\right)"
            stack.append((_LATEX.get(step.name, rf"\{step.name} {{}}").format(argument), 3))
    return stack.pop()[0]


@dataclass(frozen=True)
class ScalarFunction:
    """A scalar function f of one variable, given by an expression of the closed grammar, such as "x**3" or "tanh(2*x)".

    Raises:
        ModelError: the text is not an expression of the grammar.
    """

    text: str

    @cached_property
    def program(self) -> Program:
        """The postfix program of the expression."""
        try:
            return parse(self.text)
        except ExpressionError as error:
            raise ModelError(f"f = {self.text!r} is not a function persid knows: {error}") from None

    def __post_init__(self) -> None:
        _ = self.program

    @cached_property
    def table(self) -> LookupTable | None:
        """The knots and values, where the function is a table; else None."""
        return read_table(self.text)

    def __reduce__(self) -> tuple[Callable[[str], "ScalarFunction"], tuple[str]]:
        return scalar_function, (
            self.text,
        )  # what is cached is no part of a function, and not all of it can be pickled

    @cached_property
    def on_arrays(self) -> _Unary:
        """The function as a plain callable on arrays of at least one dimension, for inner loops."""
        step = self._only_step
        if self.table is not None:
            return self.table.value
        if step is not None and step.name in _FUNCTIONS:
            return _FUNCTIONS[step.name][0]
        if step is not None and step.name == "**":
            return partial(_power, exponent=float(step.value or 0))
        return partial(_value, self.program)

    @property
    def _only_step(self) -> Instruction | None:
        """The one step that is taken from x, in functions such as tanh(x) and x**3; None in others, such as tanh(1)."""
        return self.program[1] if len(self.program) == 2 and self.program[0].name == "x" else None

    def value(self, y: Float[ndarray, "..."] | float) -> Float[ndarray, "..."]:
        """Return f(y), elementwise."""
        return _on_arrays(self.on_arrays, y)

    def derivative(self, y: Float[ndarray, "..."] | float) -> Float[ndarray, "..."]:
        """Return f'(y), elementwise; at a kink, the derivative on the right."""
        if self.table is not None:
            return _on_arrays(self.table.derivative, y)
        return _on_arrays(lambda z: _pair(self.program, z)[1], y)

    def antiderivative(self, y: Float[ndarray, "..."] | float) -> Float[ndarray, "..."]:
        """Return the integral of f from 0 to y, elementwise (relative error about 1e-12 for smooth f)."""
        return _on_arrays(self._antiderivative, y)

    def _antiderivative(self, y: ndarray) -> ndarray:
        step = self._only_step
        if self.table is not None:
            return self.table.antiderivative(y)
        if len(self.program) == 1:
            return 0.5 * y**2 if self.is_linear else self.value(y) * y
        if step is not None and step.name == "**" and step.value is not None and step.value > 0:
            return _power(y, float(step.value) + 1) / (float(step.value) + 1)
        closed = _ANTIDERIVATIVES.get(self.text.replace(" ", ""))
        return closed(y) if closed is not None else _quadrature(self.value, y)

    @cached_property
    def unshifted(self) -> tuple["ScalarFunction", float]:
        """The function g and the number b with f(x) = g(x + b), where f is g(x + b) or g(x - b); else f itself and 0.

        A layer of neurons, each with a shift of its own, is one call of g in this way.
        """
        if len(self.program) == 4 and self.program[3].name in _FUNCTIONS:
            variable, number, sign, g = self.program
            if (variable.name, number.name) == ("x", "number") and sign.name in ("+", "-"):
                by = float(number.value or 0)
                return scalar_function(f"{g.name}(x)"), by if sign.name == "+" else -by
        return self, 0.0

    @property
    def is_linear(self) -> bool:
        """Whether the function is x itself."""
        return len(self.program) == 1 and self.program[0].name == "x"

    def latex(self, variable: str = "x") -> str:
        """Return LaTeX of f with the given name of its variable; of a table, the number of its knots."""
        if self.table is not None:
            return rf"\operatorname{{pwl}}_{{{len(self.table.knots)}}}\left({variable}\right)"
        return _latex(self.program, variable)


@lru_cache(maxsize=4096)
def scalar_function(text: str) -> ScalarFunction:
    """Return the function of an expression; equal texts give the same object."""
    return ScalarFunction(text)


def shifted(name: str, by: float) -> str:
    """Return the expression of a named function shifted by a number, exactly: "tanh(x + 0.5)"."""
    return f"{name}(x)" if by == 0 else f"{name}(x {'+' if by > 0 else '-'} {abs(float(by))!r})"


@dataclass(frozen=True, eq=False)
class Layer:
    """Many functions by kind: entry c of `functions` is g(y + shifts[c]) with g = kinds[k][0] for c in kinds[k][1]."""

    shifts: Float[ndarray, " c"]
    kinds: tuple[tuple[ScalarFunction, tuple[int, ...]], ...]

    def apply(self, what: str, y: Float[ndarray, "*N c"]) -> Float[ndarray, "*N c"]:
        """Return what ("value" or "derivative") each function gives for its entry of y; one call a kind."""
        y = y + self.shifts
        if len(self.kinds) == 1:
            return np.asarray(getattr(self.kinds[0][0], what)(y))
        found = np.empty_like(y)
        for g, places in self.kinds:
            found[..., places] = getattr(g, what)(y[..., places])
        return found


@lru_cache(maxsize=512)
def layer(functions: tuple[ScalarFunction, ...]) -> Layer:
    """Sort functions by kind, shifts apart."""
    pairs = [f.unshifted for f in functions]
    kinds: dict[ScalarFunction, list[int]] = {}
    for c, (g, _) in enumerate(pairs):
        kinds.setdefault(g, []).append(c)
    return Layer(np.array([by for _, by in pairs]), tuple((g, tuple(places)) for g, places in kinds.items()))


def _quadrature(f: _Unary, y: ndarray, panels: int = 16, nodes: int = 20) -> ndarray:
    """Integrate f from 0 to each y by Gauss-Legendre on equal panels."""
    points, weights = np.polynomial.legendre.leggauss(nodes)
    fractions = ((np.arange(panels)[:, None] + 0.5 * (points + 1)) / panels).ravel()
    return np.asarray(y * (f(y[..., None] * fractions) @ np.tile(0.5 * weights / panels, panels)))
