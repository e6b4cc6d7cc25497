"""The equations of a vector field and its outputs, written as text or LaTeX."""

import re
from collections.abc import Sequence

import numpy as np
from numpy import ndarray

from persid.models.functions import ScalarFunction
from persid.models.output_equation import OutputEquation
from persid.models.vector_field import VectorField

_TABLE = re.compile(r"pwl\(x;([^)]*)\)")
_NUMBER = re.compile(r"(?<![\w.])\d+\.\d{7,}(?:[eE][+-]?\d+)?")  # what nobody typed, such as a neuron's shift


def lines(field: VectorField, seen: OutputEquation | None, form: str, digits: int) -> list[str]:
    """Return one equation a state, and one an output, as "text" or "latex" with rounded numbers."""
    left = [left_side(field, name, form) for name in field.states]
    found = [_line(name, _products(field, i, form, digits), digits) for i, name in enumerate(left)]
    return [*found, *([] if seen is None else _output_lines(seen, form, digits))]


def term_names(field: VectorField) -> list[str]:
    """Return the names of all terms: states, channels such as tanh(x1/2), inputs, constant."""
    channels = field.channels
    pairs = zip(channels.functions, channels.rows, strict=True)
    found = [_substitute(f.text, _argument(field, row, latex=False), 4) for f, row in pairs]
    return [*field.states, *(name.replace("**", "^").replace("*", " ") for name in found), *field.inputs, "constant"]


def _line(left: str, products: Sequence[tuple[float, str]], digits: int) -> str:
    """Return left = sum of the products that are not zero."""
    text = ""
    for value, what in [pair for pair in products if pair[0] != 0]:
        number = f"{abs(value):.{digits}g}{' ' + what if what else ''}"
        sign = "-" if value < 0 else "+" if text else ""
        text += f" {sign} {number}" if text else f"{sign}{number}"
    return f"{left} = {text or '0'}"


def left_side(field: VectorField, name: str, form: str = "text") -> str:
    """Return the left side of the equation of a state: its derivative, or the state after one step."""
    if field.dt is not None:
        return f"{_tex(name) if form == 'latex' else name}[k+1]"
    return rf"\dot{{{_tex(name)}}}" if form == "latex" else f"d({name})/dt"


def _output_lines(seen: OutputEquation, form: str, digits: int) -> list[str]:
    """Return y = h(C (x - x_ref) + D (u - u_ref) + d), one line an output."""
    lines = []
    for i, name in enumerate(seen.outputs):
        left = _tex(name) if form == "latex" else name
        line = _line(left, _sums(seen.field, seen.C[i], seen.D[i], float(seen.d[i]), form == "latex"), digits)
        if seen.output_map is not None:
            inside, h = line.removeprefix(f"{left} = "), seen.output_map[i]
            line = f"{left} = {h.latex(inside) if form == 'latex' else _substitute(h.text, inside, digits)}"
        lines.append(line)
    return lines


def _sums(
    field: VectorField, states: ndarray, inputs: ndarray, constant: float, latex: bool
) -> list[tuple[float, str]]:
    """Return the factors and names of what is linear in states and inputs, and the constant."""
    names, references = [*field.states, *field.inputs], [*field.x_ref, *field.u_ref]
    pairs = zip([*states, *inputs], names, references, strict=True)
    found = [(float(a), _shifted(name, float(r), latex)) for a, name, r in pairs]
    return [*found, (constant, "")]


def _products(field: VectorField, i: int, form: str, digits: int) -> list[tuple[float, str]]:
    latex = form == "latex"
    channels = field.channels
    linear = _sums(field, channels.A0[i], field.B[i], float(field.b[i]), latex)
    found = []
    for c in np.flatnonzero(channels.columns[i]):
        f = channels.functions[c]
        argument = _argument(field, channels.rows[c], latex)
        body = f.latex(argument) if latex else _substitute(f.text, argument, digits)
        found.append((float(channels.columns[i, c]), _bracketed(body, latex) if _is_sum(f) else body))
    return [*linear[: field.n], *found, *linear[field.n :]]


def _is_sum(f: ScalarFunction) -> bool:
    """Whether a factor before this function would belong to its first term alone."""
    return f.table is None and f.program[-1].name in ("+", "-", "neg")


def _bracketed(body: str, latex: bool) -> str:
    return rf"\left({body}\right)" if latex else f"({body})"


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


def _argument(field: VectorField, row: ndarray, latex: bool) -> str:
    parts = []
    for weight, name, reference in zip(row, field.states, field.x_ref, strict=True):
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
    text = _TABLE.sub(lambda table: f"pwl{table[1].count(':')}(x)", text)  # a table by the number of its knots
    text = _NUMBER.sub(lambda number: f"{float(number.group()):.{digits}g}", text)
    simple = re.fullmatch(r"\w+", argument)
    inside = re.fullmatch(r"\w+\(x\)", text)
    return re.sub(r"\bx\b", lambda _: argument if simple or inside else f"({argument})", text)
