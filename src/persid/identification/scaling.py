"""Scaling: whether functions stand in the model as they were written, or with arguments of order 1.

A function of order 1 in its argument makes well-conditioned columns: sin((x - x_ref)/scale) with a scale from the data.
Where somebody wrote the law of the plant, that scale is wrong: sin(2 x) is no multiple of sin(x). So both are fitted to
the same windows of the data, and what was written is taken where it leaves a hundredth of the residual.
"""

from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.basis import Basis, Functions, is_auto, make_basis
from persid.identification.estimators.weak import window_rows
from persid.identification.windows import choose_window
from persid.measurements.recordings import Measurements, beginnings
from persid.measurements.trajectories import Trajectories

EXACT = 0.01  # of the squared residual is left where what was written is the law
MOST_COLUMNS = 100  # a larger basis is not tried twice
MOST_ROWS = 2000
LONGEST = 2000  # samples of a run, of at most 20, that are looked at


def choose_basis(data: Measurements, functions: Functions, x_ref: Any = "auto", scale: Any = "auto") -> Basis:
    """Return the basis with the automatic scales, or with scale 1 where that is exact.

    Raises:
        DataError: functions, x_ref or scale do not fit the states.
    """
    scaled = make_basis(data, functions, x_ref, scale)
    if not is_auto(scale) or (scaled.scale == 1).all() or not scaled.terms or scaled.size > MOST_COLUMNS:
        return scaled
    looked_at = beginnings(data, LONGEST)
    window = choose_window(looked_at)
    best, left = scaled, EXACT * _residual(looked_at, scaled, window)
    for reference in ["auto", 0.0] if is_auto(x_ref) and scaled.x_ref.any() else [x_ref]:
        written = make_basis(data, functions, reference, 1.0)
        with np.errstate(all="ignore"):
            residual = _residual(looked_at, written, window)
        if residual < left:
            best, left = written, EXACT * residual
    return best


def _residual(data: Trajectories, basis: Basis, window: int) -> float:
    """Return the share of the increments over windows that least squares on a basis leaves, the mean over states."""
    rows = [rows for run in data if len(run) > window for rows in window_rows(run, None, basis, window, "zoh")]
    if not rows:
        return np.inf
    columns, moved = (np.concatenate(parts) for parts in zip(*rows, strict=True))
    chosen = np.unique(np.linspace(0, len(moved) - 1, min(len(moved), MOST_ROWS)).astype(int))
    return _left(columns[chosen], moved[chosen])


def _left(columns: Float[ndarray, "N p"], moved: Float[ndarray, "N n"]) -> float:
    sizes = np.linalg.norm(columns, axis=0)
    if not np.isfinite(sizes).all():  # an exponential of an argument far from order 1
        return np.inf
    scaled = columns / np.where(sizes > 0, sizes, 1.0)
    theta = np.linalg.lstsq(scaled, moved, rcond=None)[0]
    power = (moved**2).sum(axis=0)
    squares = ((moved - scaled @ theta) ** 2).sum(axis=0)
    return float((squares / np.where(power > 0, power, 1.0)).mean())
