"""Numbers as text, rounded to the safe side."""

from decimal import ROUND_CEILING, ROUND_FLOOR, Context


def below(number: float, digits: int = 4) -> str:
    """Return a number as text, rounded down: a rate must not look better than what is proved."""
    return _text(number, digits, ROUND_FLOOR)


def above(number: float, digits: int = 4) -> str:
    """Return a number as text, rounded up: a gain must not look smaller than what is proved."""
    return _text(number, digits, ROUND_CEILING)


def _text(number: float, digits: int, rounding: str) -> str:
    rounded = Context(prec=digits, rounding=rounding).create_decimal_from_float(number).normalize()
    return f"{rounded:f}" if 0 <= rounded.adjusted() < digits else f"{rounded:g}"  # 40, not 4e+1
