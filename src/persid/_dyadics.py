"""Dyadic numbers [mantissa, exponent], as certificates store them."""

from collections.abc import Iterable, Sequence
from fractions import Fraction

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import RoundingError

SLACK = 1 / 64  # relative distance that gamma, p and the level keep from what the rounded multipliers just allow


def _floor(number: float) -> float:
    """Return a dyadic of few bits a little below a number (above, in size, a negative one)."""
    fraction, exponent = np.frexp(number * (1 - SLACK) if number > 0 else number * (1 + SLACK))
    return float(np.ldexp(np.floor(np.ldexp(fraction, 20)), int(exponent) - 20))


BITS = 40  # of the mantissa to which multipliers are rounded


def value(pair: Sequence[int]) -> float:
    """Return the float nearest to a dyadic [mantissa, exponent]."""
    return float(np.ldexp(float(pair[0]), pair[1]))


def exact(pair: Sequence[int]) -> Fraction:
    """Return a dyadic [mantissa, exponent] as a fraction."""
    return Fraction(pair[0]) * Fraction(2) ** pair[1]


def is_dyadic(number: Fraction) -> bool:
    """Whether a fraction is an integer over a power of two."""
    return number.denominator & (number.denominator - 1) == 0


def dyadic(number: float | Fraction, bits: int | None = None) -> list[int]:
    """Return [mantissa, exponent] of a number, exactly, or of one rounded to a number of bits first.

    Raises:
        RoundingError: it is no dyadic number.
    """
    number = number if bits is None else float(rounded(np.array(float(number)), bits))
    numerator, denominator = number.as_integer_ratio()
    if denominator & (denominator - 1):
        raise RoundingError(f"{number} is no dyadic number")
    zeros = max((numerator & -numerator).bit_length() - 1, 0)
    return [numerator >> zeros, zeros + 1 - denominator.bit_length()]


def dyadics(numbers: Iterable[float], bits: int | None = None) -> list[list[int]]:
    """Return the dyadics of numbers."""
    return [dyadic(float(number), bits) for number in numbers]


def rounded(numbers: Float[ndarray, "*shape"], bits: int = BITS) -> Float[ndarray, "*shape"]:
    """Return numbers rounded to the floats that `dyadic` writes."""
    fraction, exponent = np.frexp(numbers)
    return np.asarray(np.ldexp(np.round(np.ldexp(fraction, bits)), exponent - bits))
