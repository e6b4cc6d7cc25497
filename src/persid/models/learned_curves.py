"""Learned curves: piecewise linear functions on one fixed grid, by their slopes.

With knots t_1 < … < t_(k-1), t_0 = -inf and t_k = inf, f(s) = sum_j slope_j w_j(s), where

    w_j(s) = clip(s, t_(j-1), t_j) - clip(0, t_(j-1), t_j)

is the way of s in piece j. So f(0) = 0 and f' is the slope of the piece. The grid does not move: what reads a curve
is scaled and shifted instead.
"""

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from persid.models.lookup_tables import lookup_table

REACH = 2.25  # the outermost knots: standard deviations of what a curve reads, where a fit begins


@lru_cache(maxsize=64)
def knots(pieces: int) -> Float[ndarray, " k_less_1"]:
    """Return the knots between so many pieces, at equal distances."""
    return np.linspace(-REACH, REACH, pieces - 1)


@lru_cache(maxsize=64)
def marks(pieces: int) -> Float[ndarray, " k_plus_1"]:
    """Return the knots and a place beyond each of the outermost: two places on every piece."""
    t = knots(pieces)
    return np.concatenate([t[:1] - 1, t, t[-1:] + 1])


def way(s: Float[ndarray, "..."], pieces: int) -> Float[ndarray, "... k"]:
    """Return the ways of s in the pieces."""
    if not pieces:
        return np.zeros((*s.shape, 0))
    low, high = np.append(-np.inf, knots(pieces)), np.append(knots(pieces), np.inf)
    return np.asarray(np.clip(s[..., None], low, high) - np.clip(0.0, low, high))


def value(s: Float[ndarray, "*_ q S"], slopes: Float[ndarray, "*_ q k"]) -> Float[ndarray, "*_ q S"]:
    """Return f(s), a curve for every row."""
    at = _places(s, slopes)
    ends = np.concatenate([knots(slopes.shape[-1])[:1], knots(slopes.shape[-1])])
    begun = (way(ends, slopes.shape[-1]) @ slopes[..., None])[..., 0]  # f at the beginnings of pieces
    return np.asarray((begun - ends * slopes).ravel()[at] + slopes.ravel()[at] * s)


def slope(s: Float[ndarray, "*_ q S"], slopes: Float[ndarray, "*_ q k"]) -> Float[ndarray, "*_ q S"]:
    """Return f'(s), a curve for every row; at a knot, the slope on the right."""
    return np.asarray(slopes.ravel()[_places(s, slopes)])


def _places(s: Float[ndarray, "*_ q S"], slopes: Float[ndarray, "*_ q k"]) -> Int[ndarray, "*_ q S"]:
    """Return where the piece of each s stands among the slopes of all rows."""
    k = slopes.shape[-1]
    at = np.fmin(np.fmax((s + REACH) * ((k - 2) / (2 * REACH)) + 1, 0), k - 1).astype(np.int64)  # NaN too
    first = (k * np.arange(slopes.size // k)).reshape(slopes.shape[:-1])
    return np.asarray(at + first[..., None])


def table(slopes: Float[ndarray, " k"], shift: float) -> str:
    """Return f(x + shift) as a table."""
    t = marks(len(slopes))
    return lookup_table(t - shift, way(t, len(slopes)) @ slopes)
