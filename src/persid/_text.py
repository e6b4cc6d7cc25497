"""_text."""

from decimal import ROUND_CEILING, ROUND_FLOOR, Context


def below(number: float, digits: int = 4) -> str:
    """Return a number as text, rounded down: a rate must not look better than what is proved."""
    return f"{Context(prec=digits, rounding=ROUND_FLOOR).create_decimal_from_float(number).normalize():g}"


def above(number: float, digits: int = 4) -> str:
    """Return a number as text, rounded up: a gain must not look smaller than what is proved."""
    return f"{Context(prec=digits, rounding=ROUND_CEILING).create_decimal_from_float(number).normalize():g}"
