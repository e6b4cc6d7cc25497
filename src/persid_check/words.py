"""Numbers and names in words: rounded to the safe side, or marked where there is none; nothing of a text but names."""

import re
from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction

from persid_check.model import Model
from persid_check.reading import Ball

SHOWN = 12  # entries of a list that are printed


def decimal(value: Fraction, *, up: bool = True, digits: int = 6) -> str:
    """Return a decimal text of a number, rounded up or down, never to the nearest."""
    return f"{_quotient(value, up, digits):g}"


def root(value: Fraction, *, digits: int = 6) -> str:
    """Return a decimal upper bound of the square root, 0 of 0."""
    if not value:
        return "0"
    context = Context(prec=digits + 6, rounding=ROUND_CEILING)
    bound = context.next_plus(context.sqrt(_quotient(value, True, digits + 6)))
    return f"{Context(prec=digits, rounding=ROUND_CEILING).plus(bound):g}"


def _quotient(value: Fraction, up: bool, digits: int) -> Decimal:
    context = Context(prec=digits, rounding=ROUND_CEILING if up else ROUND_FLOOR)
    return context.divide(Decimal(value.numerator), Decimal(value.denominator))


def vector(values: Sequence[Fraction]) -> str:
    """A vector, cut short and said so."""
    return f"({marked(values[:SHOWN])}{', ...' if len(values) > SHOWN else ''})"


def counted(number: int, what: str) -> str:
    """Return a number of things in words: 1 input, 2 inputs."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def marked(values: Sequence[Fraction]) -> str:
    """Return numbers to six digits, marked by ~ where they are rounded: no direction of rounding would be safe."""
    shown = []
    for value in values:
        low, high = decimal(value, up=False), decimal(value)
        shown.append(low if low == high else f"~{low}")
    return ", ".join(shown)


def explained(sentence: str) -> str:
    """Return a sentence that says what ~ means where it marks a number."""
    note = " Numbers marked ~ are cut to six digits; the exact ones, in the file, are meant."
    return sentence + (note if re.search(r"~-?[.\d]", sentence) else "")


def input_names(names: Sequence[str]) -> list[str]:
    """Return inputs' own names, quoted; u1, u2, … as they are, but never for another than the first, second, …."""
    return _own_names("u", names)


def state_names(names: Sequence[str]) -> list[str]:
    """Return states' own names, quoted; x1, x2, … as they are, but never for another than the first, second, …."""
    return _own_names("x", names)


def _own_names(letter: str, names: Sequence[str]) -> list[str]:
    return [name if name == f"{letter}{i}" else repr(name) for i, name in enumerate(names, start=1)]


def model_named(model: Model, sha256: str) -> str:
    """Return a model in words: its states and algebraic variables, how many inputs it has, and its hash."""
    sorts = _sort("state", model.states[: model.order])
    if model.algebraic:
        sorts += f", {_sort('algebraic variable', model.states[model.order :])}"
    return f"the model with {sorts}, {counted(model.m, 'input')} and SHA-256 {sha256}"


def _sort(what: str, names: Sequence[str]) -> str:
    shown = ", ".join(repr(name) for name in names[:SHOWN]) + (", ..." if len(names) > SHOWN else "")
    return f"{what}{'' if len(names) == 1 else 's'} {shown} ({len(names)})"


def equilibrium(ball: Ball, name: str = "x*") -> str:
    """Return where the one equilibrium of a ball is; with algebraic variables its name says so."""
    where = f"= {vector(ball.x)} exactly"
    if ball.radius:  # not rounded up: only in the ball itself is it proved to be the one
        where = f"within {marked((ball.radius,))} of {vector(ball.x)} in every {'state' if name == 'x*' else 'entry'}"
    return f"the one equilibrium {name} {where} for the constant input u* = {vector(ball.u)}"
