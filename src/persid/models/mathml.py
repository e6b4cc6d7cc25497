"""The equations of a model as presentation MathML, which browsers set, zoom, read aloud and copy without help."""

from fractions import Fraction
from html import escape

import numpy as np
from jaxtyping import Int
from numpy import ndarray

from persid.models.functions import ScalarFunction
from persid.models.model import PersidskiiModel
from persid_check.expression import Program

_APPLY = "<mo>&#x2061;</mo>"  # not seen, but read aloud: "of"
_TIMES = '<mo lspace="0" rspace=".17em">&#x2062;</mo>'  # not seen, but read aloud: "times"
_OVER = '<mo lspace="0" rspace="0">/</mo>'
_NEGATIVE = '<mo form="prefix">&#x2212;</mo>'
# A term begins with its sign, which without its form would be taken for one of a number, and set too close.
_MINUS, _PLUS = '<mo form="infix">&#x2212;</mo>', '<mo form="infix">+</mo>'
_ATOM, _POWER, _PRODUCT, _SUM = 4, 3, 2, 1  # how tightly a piece binds


def equation(model: PersidskiiModel, state: int, digits: int = 4) -> tuple[str, tuple[str, ...]]:
    """Return the left side of one equation, and each term of the right side with its sign, as elements <math>.

    Terms are elements of their own, since browsers break lines between them but not inside one.
    """
    rate = _left(model, state)
    found: list[str] = []
    for weight, what in _products(model, state):
        sign = (_MINUS if found else _NEGATIVE) if weight < 0 else (_PLUS if found else "")
        number = "" if abs(weight) == 1 and what else _number(abs(weight), digits) + (_TIMES if what else "")
        found.append(_math(sign + number + what))
    return _math(f'<mstyle displaystyle="true">{rate}</mstyle><mo>=</mo>'), tuple(found) or (_math("<mn>0</mn>"),)


def _left(model: PersidskiiModel, state: int) -> str:
    name = _name(model.states[state])
    if model.is_discrete:
        return f"<mrow>{name}<mo>[</mo><mi>k</mi><mo>+</mo><mn>1</mn><mo>]</mo></mrow>"
    above = f'<mi>d</mi><mspace width=".12em"/>{name}'
    return f"<mfrac><mrow>{above}</mrow><mrow><mi>d</mi><mi>t</mi></mrow></mfrac>"


def counts(model: PersidskiiModel) -> Int[ndarray, " n"]:
    """Return the number of terms of each equation."""
    channels = model.channels
    parts = np.hstack([channels.A0, channels.columns, model.B, model.field.b[:, None]])
    return np.asarray(np.count_nonzero(parts, axis=1))


def _math(body: str) -> str:
    return f"<math><mrow>{body}</mrow></math>"


def _products(model: PersidskiiModel, i: int) -> list[tuple[float, str]]:
    """Coefficient and factor of the nonzero terms of one equation."""
    channels = model.channels
    linear = zip(channels.A0[i], model.states, model.x_ref, strict=True)
    found = [(float(a), _shifted(name, float(r))) for a, name, r in linear]
    for a, row, f in zip(channels.columns[i], channels.rows, channels.functions, strict=True):
        found.append((float(a), _of(f, _argument(model, row)) if a else ""))
    forced = zip(model.B[i], model.inputs, model.u_ref, strict=True)
    found += [(float(a), _shifted(name, float(r))) for a, name, r in forced]
    return [(a, what) for a, what in [*found, (float(model.field.b[i]), "")] if a != 0]


def _name(name: str) -> str:
    """A letter with a number behind it gets an index; other names stand upright, as they are."""
    head = name.rstrip("0123456789").rstrip("_")
    if len(head) == 1 and name != head:
        return f"<msub><mi>{escape(head)}</mi><mn>{escape(name[1:].lstrip('_'))}</mn></msub>"
    return f"<mi>{escape(name)}</mi>"


def _number(value: float, digits: int = 6) -> str:
    mantissa, _, exponent = f"{value:.{digits}g}".partition("e")
    if not exponent:
        return f"<mn>{mantissa}</mn>"
    power = f"{_NEGATIVE if exponent[0] == '-' else ''}<mn>{int(exponent.lstrip('+-'))}</mn>"
    return f"<mn>{mantissa}</mn><mo>&#xD7;</mo><msup><mn>10</mn><mrow>{power}</mrow></msup>"


def _signed(value: Fraction) -> str:
    return (_NEGATIVE if value < 0 else "") + _number(abs(float(value)))


def _bracketed(body: str) -> str:
    return f"<mrow><mo>(</mo>{body}<mo>)</mo></mrow>"


def _shifted(name: str, reference: float) -> str:
    if reference == 0:
        return _name(name)
    return _bracketed(f"{_name(name)}{_MINUS if reference > 0 else _PLUS}{_number(abs(reference))}")


def _argument(model: PersidskiiModel, row: ndarray) -> tuple[str, int]:
    """The argument row'(x - x_ref) of a channel, and how tightly it binds."""
    places = np.flatnonzero(row)
    pieces = [_scaled(abs(float(row[k])), _shifted(model.states[k], float(model.x_ref[k]))) for k in places]
    signs = [(_PLUS if n else "") if row[k] > 0 else (_MINUS if n else _NEGATIVE) for n, k in enumerate(places)]
    body = "".join(sign + piece for sign, piece in zip(signs, pieces, strict=True)) or "<mn>0</mn>"
    alone = len(places) == 1 and row[places[0]] == 1
    return body, _ATOM if alone else _SUM


def _scaled(weight: float, body: str) -> str:
    if weight == 1:
        return body
    inverse = 1 / weight
    if inverse > 1 and np.isclose(inverse, round(inverse)):
        return body + _OVER + _number(inverse)
    return _number(weight) + _TIMES + body


def _of(f: ScalarFunction, argument: tuple[str, int]) -> str:
    if f.table is None:
        return _function(f.program, argument)
    return f"<msub><mi>pwl</mi><mn>{len(f.table.knots)}</mn></msub>{_APPLY}{_bracketed(argument[0])}"


def _function(program: Program, argument: tuple[str, int]) -> str:
    """Set a function of an argument, from its postfix program."""
    stack: list[tuple[str, int]] = []

    def taken(level: int) -> str:
        body, binds = stack.pop()
        return f"<mrow>{body}</mrow>" if binds >= level else _bracketed(body)

    for step in program:
        if step.name == "number":
            stack.append((_signed(step.value or Fraction(0)), _ATOM))
        elif step.name == "x":
            stack.append(argument)
        elif step.name in "+-":
            right, left = taken(_PRODUCT), taken(_SUM)
            stack.append((left + (_PLUS if step.name == "+" else _MINUS) + right, _SUM))
        elif step.name == "*":
            right, left = taken(_POWER), taken(_PRODUCT)
            stack.append((left + _TIMES + right, _PRODUCT))
        elif step.name == "/":
            right, left = taken(_SUM), taken(_SUM)
            stack.append((f"<mfrac>{left}{right}</mfrac>", _ATOM))
        elif step.name == "neg":
            stack.append((_NEGATIVE + taken(_PRODUCT), _SUM))
        elif step.name == "**":
            base, exponent = taken(_ATOM), _signed(step.value or Fraction(0))
            stack.append((f"<msup>{base}<mrow>{exponent}</mrow></msup>", _POWER))
        elif step.name == "abs":
            stack.append((f"<mrow><mo>|</mo>{taken(_SUM)}<mo>|</mo></mrow>", _ATOM))
        elif step.name == "sqrt":
            stack.append((f"<msqrt>{taken(_SUM)}</msqrt>", _ATOM))
        else:
            stack.append((f"<mi>{step.name}</mi>{_APPLY}{_bracketed(taken(_SUM))}", _POWER))
    body, binds = stack.pop()
    return body if binds >= _PRODUCT else _bracketed(body)
