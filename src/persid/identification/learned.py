"""Learned functions: the word `pwl` among the functions of a fit stands for ramps whose knots the data place.

A piecewise linear function of a state with f(0) = 0 is sum_k s_k r_k, where the ramp r_k is the way of y in piece k:
0 at 0, slope 1 in the piece and none elsewhere. So a ramp is a column, a slope is a coefficient, and everything that
fits, proves or draws functions whose coefficients are unknown does so with functions that are unknown.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.models.lookup_tables import WORD, lookup_table

KNOTS = (3, 6, 9)  # tried one after the other; more would be a group of more functions than proofs bear
USUAL = 6  # where nothing is left to choose by
GRID = 256  # knots are multiples of 1/256: arguments are of order 1
TOLERANCE = 1.05  # of numbers of knots whose errors differ by less the smallest is taken


def learns(functions: Sequence[str] | Sequence[Sequence[str]]) -> bool:
    """Whether a list of functions, or one of the lists of states, holds the word."""
    return any(f == WORD or (not isinstance(f, str) and WORD in f) for f in functions)


def without(functions: Sequence[str]) -> list[str]:
    """Return the functions of a state that are given, x where there is none."""
    return [f for f in functions if f != WORD] or ["x"]


def with_ramps(
    functions: Sequence[str], y: Float[ndarray, " N"], count: int, *, beside_x: bool | None = None
) -> list[str]:
    """Return the functions of a state with ramps in place of the word, for arguments y; `count` knots at quantiles.

    Beside x itself (None: where it is among them) the ramp about 0 is left out: all ramps add up to x.
    """
    beside = "x" in functions if beside_x is None else beside_x
    found: list[str] = []
    for f in functions:
        found += ramps(knots(y, count), beside_x=beside) if f == WORD else [f]
    return found


def knots(y: Float[ndarray, " N"], count: int) -> Float[ndarray, " k"]:
    """Return different quantiles of y at equal shares, on a grid."""
    shares = np.arange(1, count + 1) / (count + 1)
    return np.unique(np.round(np.quantile(y, shares) * GRID) / GRID) + 0.0


def ramps(at: Float[ndarray, " k"], *, beside_x: bool) -> list[str]:
    """Return the ramps of the pieces between knots, as tables: clip(y, a, b) - clip(0, a, b)."""
    pieces = pairwise([-np.inf, *at, np.inf])
    return [_ramp(a, b) for a, b in pieces if not (beside_x and a <= 0 < b)]


def _ramp(a: float, b: float) -> str:
    """Return the table of one ramp; half a unit beside an end says that it is flat there."""
    inner = [end for end in (a, b) if np.isfinite(end)]
    around = np.array([inner[0] - 0.5, *inner, inner[-1] + 0.5])
    return lookup_table(around, np.clip(around, a, b) - np.clip(0.0, a, b))


def simplest(errors: Sequence[float]) -> int:
    """Return the first place whose error is within 5 % of the least."""
    return int(np.flatnonzero(np.array(errors) <= TOLERANCE * min(errors))[0])
