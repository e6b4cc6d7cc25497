"""The equations of a model, to read: as text, LaTeX or SymPy."""

import re
from importlib import import_module
from typing import Any

import numpy as np

from persid.errors import DataError
from persid.models.functions import scalar_function
from persid.models.model import PersidskiiModel


def equations(model: PersidskiiModel, form: str = "text", digits: int = 4) -> Any:
    """Return one equation a state: "text" and "latex" as strings with rounded numbers, "sympy" as exact sympy.Eq.

    Raises:
        DataError: an unknown form.
        ModelError: a sparse model is too large to be written out.
    """
    model = model.dense()
    if form == "sympy":
        return _sympy(model)
    if form not in ("text", "latex"):
        raise DataError(f'form={form!r}; choose "text", "latex" or "sympy"')
    return "\n".join(_line(model, i, form, digits) for i in range(model.n))


def term_names(model: PersidskiiModel) -> list[str]:
    """Return the names of all terms: states, channels such as tanh(x1/2), inputs, constant."""
    channels = model.channels
    pairs = zip(channels.functions, channels.rows, strict=True)
    found = [_substitute(f.text, _argument(model, row, latex=False)) for f, row in pairs]
    return [*model.states, *(name.replace("**", "^").replace("*", " ") for name in found), *model.inputs, "constant"]


def _line(model: PersidskiiModel, i: int, form: str, digits: int) -> str:
    pieces = [(value, what) for value, what in _products(model, i, form) if value != 0]
    text = ""
    for value, what in pieces:
        number = f"{abs(value):.{digits}g}"
        sign = "-" if value < 0 else "+" if text else ""
        text += (
            f" {sign} {number}{' ' + what if what else ''}" if text else f"{sign}{number}{' ' + what if what else ''}"
        )
    name = model.states[i]
    left = rf"\dot{{{_tex(name)}}}" if form == "latex" else f"d({name})/dt"
    return f"{left} = {text or '0'}"


def _products(model: PersidskiiModel, i: int, form: str) -> list[tuple[float, str]]:
    latex = form == "latex"
    channels = model.channels
    linear = zip(channels.A0[i], model.states, model.x_ref, strict=True)
    found = [(float(a), _shifted(n, float(r), latex)) for a, n, r in linear]
    for c in np.flatnonzero(channels.columns[i]):
        f = channels.functions[c]
        argument = _argument(model, channels.rows[c], latex)
        body = f.latex(argument) if latex else _substitute(f.text, argument)
        found.append((float(channels.columns[i, c]), body))
    found += [
        (float(a), _shifted(n, float(r), latex)) for a, n, r in zip(model.B[i], model.inputs, model.u_ref, strict=True)
    ]
    return [*found, (float(model.b[i]), "")]


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


def _substitute(text: str, argument: str) -> str:
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
