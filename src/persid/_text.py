"""Numbers as text, rounded to the safe side; and the units of time that they are printed in."""

import math
from decimal import ROUND_CEILING, ROUND_FLOOR, Context

SECONDS = {"ms": 1e-3, "s": 1.0, "min": 60.0, "h": 3600.0, "d": 86400.0}  # in a unit of time


def below(number: float, digits: int = 4) -> str:
    """Return a number as text, rounded down: a rate must not look better than what is proved."""
    return _text(number, digits, ROUND_FLOOR)


def above(number: float, digits: int = 4) -> str:
    """Return a number as text, rounded up: a gain must not look smaller than what is proved."""
    return _text(number, digits, ROUND_CEILING)


def pace(rate: float, unit: str = "s") -> str:
    """Return a proved rate in 1/s as text, a number per unit of time, rounded down."""
    return below(rate if unit == "s" else math.nextafter(rate * SECONDS[unit], 0))


def _text(number: float, digits: int, rounding: str) -> str:
    rounded = Context(prec=digits, rounding=rounding).create_decimal_from_float(number).normalize()
    return f"{rounded:f}" if 0 <= rounded.adjusted() < digits else f"{rounded:g}"  # 40, not 4e+1
