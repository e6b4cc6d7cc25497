"""The checker's own sentences: what was proved, and the steps of the proof."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction
from typing import TYPE_CHECKING

from persid_check.format import Stability

if TYPE_CHECKING:
    from persid_check.claims import Setting


def decimal(value: Fraction, *, up: bool = True, digits: int = 6) -> str:
    """Return a decimal text of a number, rounded up or down, never to the nearest."""
    return f"{_quotient(value, up, digits):g}"


def root(value: Fraction, *, digits: int = 6) -> str:
    """Return a decimal upper bound of the square root."""
    context = Context(prec=digits + 6, rounding=ROUND_CEILING)
    bound = context.next_plus(context.sqrt(_quotient(value, True, digits + 6)))
    return f"{Context(prec=digits, rounding=ROUND_CEILING).plus(bound):g}"


def _quotient(value: Fraction, up: bool, digits: int) -> Decimal:
    context = Context(prec=digits, rounding=ROUND_CEILING if up else ROUND_FLOOR)
    return context.divide(Decimal(value.numerator), Decimal(value.denominator))


def vector(values: Sequence[Fraction], digits: int = 6) -> str:
    """Return a tuple of numbers as text, to so many digits."""
    shown = [decimal(value, digits=digits) for value in values[:12]]
    return f"({', '.join(shown)}{', ...' if len(values) > 12 else ''})"


def stability(claim: Stability, everywhere: bool) -> str:
    """Return the sentence of claims G, M, E and R."""
    parts = [_subject(claim), _place(claim), *_estimate(claim)]
    if everywhere:
        parts.append("The same holds, with the same numbers, about every equilibrium of every constant input.")
    return " ".join(part for part in parts if part)


def _subject(claim: Stability) -> str:
    model = claim.subject.model
    return f"The model with {model.n} states, {model.m} inputs and SHA-256 {claim.subject.sha256}"


def _place(claim: Stability) -> str:
    if claim.point is not None:
        where = f"about the one equilibrium x* within {decimal(claim.point.radius)} of {vector(claim.point.x)}"
        where += f" for the constant input u* = {vector(claim.point.u)}"
    else:
        where = f"about x* = x_ref = {vector(claim.subject.model.x_ref)} for u* = u_ref"
        if any(claim.subject.model.b):
            where += ", with the constant b counted as one more input b v (the model itself has v = 1)"
    kind = "regionally input-to-state stable" if claim.subject.claim == "R" else "input-to-state stable (global)"
    return f"is {kind} {where}."


def _estimate(claim: Stability) -> list[str]:
    if claim.subject.claim not in ("E", "R"):
        return []
    rate = decimal(claim.kappa / 2, up=False)
    factor = root(1 / claim.p)
    gain = root(claim.gamma / (claim.kappa * claim.p))
    text = f"|x(t) - x*| <= {factor} sqrt(V(x(0))) exp(-{rate} t) + {gain} sup|u - u*| for all t >= 0."
    if claim.subject.claim == "E":
        return [text]
    sides = ", ".join(f"[{decimal(lo)}, {decimal(hi, up=False)}]" for lo, hi in claim.box[:12])
    return [
        f"Within the box {sides}, from every x(0) with V(x(0)) <= {decimal(claim.level, up=False)} and for"
        f" sup|u - u*| <= {decimal(claim.input_bound, up=False)}, x stays there and {text}"
    ]


def stability_steps(
    claim: Stability, settings: Sequence[Setting], kept: Sequence[int], everywhere: bool
) -> tuple[str, ...]:
    """Return the proof as steps."""
    return ()
