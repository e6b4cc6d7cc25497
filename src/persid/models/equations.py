"""The equations of a model, to read: as text, LaTeX or SymPy."""

import re
from collections.abc import Sequence
from importlib import import_module
from typing import Any

import numpy as np
from numpy import ndarray

from persid.errors import DataError
from persid.models.functions import scalar_function
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel


def equations(model: PersidskiiModel | OutputModel, form: str = "text", digits: int = 4) -> Any:
    """Return one equation a state, and one an output: "text" and "latex" as strings with rounded numbers.

    With "sympy" it is a list of exact sympy.Eq.

    Raises:
        DataError: an unknown form.
        ModelError: a sparse model is too large to be written out.
    """
    seen = model if isinstance(model, OutputModel) else None
    model = (model.dynamics if isinstance(model, OutputModel) else model).dense()
    if form == "sympy":
        return [*_sympy(model), *([] if seen is None else _sympy_outputs(seen))]
    if form not in ("text", "latex"):
        raise DataError(f'form={form!r}; choose "text", "latex" or "sympy"')
    lines = [_line(_left(model.states[i], form), _products(model, i, form, digits), digits) for i in range(model.n)]
    return "\n".join([*lines, *([] if seen is None else _output_lines(seen, form, digits))])


_NUMBER = re.compile(r"(?<![\w.])\d+\.\d{7,}(?:[eE][+-]?\d+)?")  # what nobody typed, such as a neuron's shift


def term_names(model: PersidskiiModel) -> list[str]:
    """Return the names of all terms: states, channels such as tanh(x1/2), inputs, constant."""
    channels = model.channels
    pairs = zip(channels.functions, channels.rows, strict=True)
    found = [_substitute(f.text, _argument(model, row, latex=False), 4) for f, row in pairs]
    return [*model.states, *(name.replace("**", "^").replace("*", " ") for name in found), *model.inputs, "constant"]


def _line(left: str, products: Sequence[tuple[float, str]], digits: int) -> str:
    """Return left = sum of the products that are not zero."""
    text = ""
    for value, what in [pair for pair in products if pair[0] != 0]:
        number = f"{abs(value):.{digits}g}{' ' + what if what else ''}"
        sign = "-" if value < 0 else "+" if text else ""
        text += f" {sign} {number}" if text else f"{sign}{number}"
    return f"{left} = {text or '0'}"


def _left(name: str, form: str) -> str:
    return rf"\dot{{{_tex(name)}}}" if form == "latex" else f"d({name})/dt"


def _output_lines(seen: OutputModel, form: str, digits: int) -> list[str]:
    """Return y = h(C (x - x_ref) + D (u - u_ref) + d), one line an output."""
    lines = []
    for i, name in enumerate(seen.outputs):
        left = _tex(name) if form == "latex" else name
        line = _line(left, _sums(seen.dynamics, seen.C[i], seen.D[i], float(seen.d[i]), form == "latex"), digits)
        if seen.output_map is not None:
            inside, h = line.removeprefix(f"{left} = "), seen.output_map[i]
            line = f"{left} = {h.latex(inside) if form == 'latex' else _substitute(h.text, inside, digits)}"
        lines.append(line)
    return lines


def _sums(
    model: PersidskiiModel, states: ndarray, inputs: ndarray, constant: float, latex: bool
) -> list[tuple[float, str]]:
    """Return the factors and names of what is linear in states and inputs, and the constant."""
    names, references = [*model.states, *model.inputs], [*model.x_ref, *model.u_ref]
    pairs = zip([*states, *inputs], names, references, strict=True)
    found = [(float(a), _shifted(name, float(r), latex)) for a, name, r in pairs]
    return [*found, (constant, "")]


def _products(model: PersidskiiModel, i: int, form: str, digits: int) -> list[tuple[float, str]]:
    latex = form == "latex"
    channels = model.channels
    linear = _sums(model, channels.A0[i], model.B[i], float(model.b[i]), latex)
    found = []
    for c in np.flatnonzero(channels.columns[i]):
        f = channels.functions[c]
        argument = _argument(model, channels.rows[c], latex)
        body = f.latex(argument) if latex else _substitute(f.text, argument, digits)
        found.append((float(channels.columns[i, c]), body))
    return [*linear[: model.n], *found, *linear[model.n :]]


def _tex(name: str) -> str:
    head = name.rstrip("0123456789")
    number = name[len(head) :]
    if len(head) == 1:
        return f"{head}_{{{number}}}" if number else head
    return rf"\mathrm{{{name.replace('_', chr(92) + '_')}}}"


def _shifted(name: str, reference: float, latex: bool) -> str:
    name = _tex(name) if latex else name
    if reference == 0:
        return name
    return f"({name} {'-' if reference > 0 else '+'} {abs(reference):.6g})"


def _argument(model: PersidskiiModel, row: Any, latex: bool) -> str:
    parts = []
    for weight, name, reference in zip(row, model.states, model.x_ref, strict=True):
        if weight:
            body = _shifted(name, float(reference), latex)
            parts.append(body if weight == 1 else _scaled(float(weight), body, latex))
    return " + ".join(parts) or "0"


def _scaled(weight: float, body: str, latex: bool) -> str:
    inverse = 1 / weight
    if np.isclose(inverse, round(inverse)) and abs(inverse) > 1:
        return rf"\frac{{{body}}}{{{inverse:.6g}}}" if latex else f"{body}/{inverse:.6g}"
    return f"{weight:.6g} {body}" if latex else f"{weight:.6g}*{body}"


def _substitute(text: str, argument: str, digits: int) -> str:
    text = _NUMBER.sub(lambda number: f"{float(number.group()):.{digits}g}", text)
    simple = re.fullmatch(r"\w+", argument)
    inside = re.fullmatch(r"\w+\(x\)", text)
    return re.sub(r"\bx\b", lambda _: argument if simple or inside else f"({argument})", text)


def _sympy(model: PersidskiiModel) -> list[Any]:
    sympy = import_module("sympy")

    t = sympy.Symbol("t")
    x = [sympy.Function(name)(t) for name in model.states]
    dx = [symbol - sympy.Float(r, 17) if r else symbol for symbol, r in zip(x, model.x_ref, strict=True)]
    du = [sympy.Symbol(n) - (sympy.Float(r, 17) if r else 0) for n, r in zip(model.inputs, model.u_ref, strict=True)]
    channels = model.channels
    arguments = [sum(_number(w) * d for w, d in zip(row, dx, strict=True) if w) for row in channels.rows]
    values = [_sympy_function(f.text, y) for f, y in zip(channels.functions, arguments, strict=True)]
    result = []
    for i in range(model.n):
        right = sum((_number(a) * d for a, d in zip(channels.A0[i], dx, strict=True)), sympy.Integer(0))
        right += sum(_number(a) * v for a, v in zip(channels.columns[i], values, strict=True))
        right += sum(_number(a) * d for a, d in zip(model.B[i], du, strict=True)) + _number(model.b[i])
        result.append(sympy.Eq(x[i].diff(t), right))
    return result


def _sympy_outputs(seen: OutputModel) -> list[Any]:
    sympy = import_module("sympy")

    model, t = seen.dynamics, sympy.Symbol("t")
    x = [sympy.Function(name)(t) - _number(r) for name, r in zip(model.states, model.x_ref, strict=True)]
    u = [sympy.Symbol(name) - _number(r) for name, r in zip(model.inputs, model.u_ref, strict=True)]
    found = []
    for i, name in enumerate(seen.outputs):
        pairs = zip([*seen.C[i], *seen.D[i]], [*x, *u], strict=True)
        y = sum((_number(a) * v for a, v in pairs), _number(seen.d[i]))
        y = y if seen.output_map is None else _sympy_function(seen.output_map[i].text, y)
        found.append(sympy.Eq(sympy.Function(name)(t), y))
    return found


def _number(value: float) -> Any:
    sympy = import_module("sympy")

    return (
        sympy.Integer(int(value)) if float(value).is_integer() and abs(value) < 2**53 else sympy.Float(float(value), 17)
    )


def _sympy_function(text: str, argument: Any) -> Any:
    sympy = import_module("sympy")

    x = sympy.Symbol("x")
    names = {
        "x": x, "arcsinh": sympy.asinh, "arctan": sympy.atan, "abs": sympy.Abs, "expm1": lambda y: sympy.exp(y) - 1,
        "log1p": lambda y: sympy.log(1 + y), "softsign": lambda y: y / (1 + sympy.Abs(y)),
        "softplus": lambda y: sympy.log(1 + sympy.exp(y)), "relu": lambda y: sympy.Max(y, 0),
        "sat": lambda y: sympy.Max(-1, sympy.Min(1, y)), "deadzone": lambda y: y - sympy.Max(-1, sympy.Min(1, y)),
    }  # fmt: skip
    scalar_function(text)  # the closed grammar: nothing else reaches the parser
    return sympy.sympify(text, locals=names).subs(x, argument)
