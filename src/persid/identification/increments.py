"""Increments: how much of the states' moves over windows columns of a regression leave, and what else would explain it.

x(t_{k+q}) - x(t_k) is fitted by least squares to integrals of columns over the same windows, at most 2000 of them.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.basis import Basis
from persid.identification.estimators.weak import window_rows
from persid.measurements.recordings import evenly
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory

MOST_ROWS = 2000
LONGEST_LAG = 128  # samples of dead time
LAGGED = 0.25  # of the shortest run is dead time, at most
AS_GOOD = 1.5  # times the smallest squared residual
LATER = 0.7  # of the squared residual is left, at most, where a dead time is worth a trial
EXPLAINS = 0.5  # of the squared residual is left, at most, where a product is worth a word
MOST_PRODUCTS = 100


def left_over(columns: Float[ndarray, "N p"], moved: Float[ndarray, "N n"]) -> float:
    """Return the share of some increments that least squares on columns leaves, the mean over states."""
    sizes = np.linalg.norm(columns, axis=0)
    if not np.isfinite(sizes).all():  # an exponential of an argument far from order 1
        return np.inf
    scaled = columns / np.where(sizes > 0, sizes, 1.0)
    theta = np.linalg.lstsq(scaled, moved, rcond=None)[0]
    power = (moved**2).sum(axis=0)
    squares = ((moved - scaled @ theta) ** 2).sum(axis=0)
    return float((squares / np.where(power > 0, power, 1.0)).mean())


def increments(
    data: Sequence[Trajectory], basis: Basis, window: int, hold: str = "zoh"
) -> tuple[Float[ndarray, "N p"], Float[ndarray, "N n"]]:
    """Return integrals of the columns and increments of the states over windows, evenly chosen; none in short runs."""
    pairs = [pair for run in data if len(run) > window for pair in window_rows(run, None, basis, window, hold)]
    if not pairs:
        return np.zeros((0, basis.size)), np.zeros((0, len(basis.states)))
    columns, moved = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    chosen = evenly(len(moved), MOST_ROWS)
    return columns[chosen], moved[chosen]


def dead_times(data: Trajectories, basis: Basis, window: int) -> dict[str, float]:
    """Return the dead times in s of the inputs that seem to have one, one input after the other."""
    step = float(np.median(np.concatenate([np.diff(run.t) for run in data])))
    most = int(min(LONGEST_LAG, LAGGED * min(map(len, data))))
    lags = [0] * len(data.inputs)
    for k in range(len(lags)):
        tried = []
        for lag in range(most + 1):
            late = [_late(run, [*lags[:k], lag, *lags[k + 1 :]], most) for run in data]
            tried.append(left_over(*increments(late, basis, window)))
        # The first lag that is about as good as the best: what repeats itself fits again a period later.
        first = int(np.flatnonzero(np.array(tried) <= AS_GOOD * min(tried))[0])
        lags[k] = first if tried[first] < LATER * tried[0] else 0
    return {name: lag * step for name, lag in zip(data.inputs, lags, strict=True) if lag}


def _late(run: Trajectory, lags: Sequence[int], most: int) -> Trajectory:
    """Return a run without its first `most` samples, every input from so many samples earlier."""
    u = np.column_stack([run.u[most - lag : len(run) - lag, k] for k, lag in enumerate(lags)])
    return Trajectory(run.t[most:], run.x[most:], u)


def best_product(data: Trajectories, basis: Basis, window: int) -> tuple[str, float, float] | None:
    """Return the product of two states, or of a state and an input, that explains most of what a basis leaves.

    Beside it, the shares of the squared increments that are left with it and without it; None where it leaves more
    than half of the latter.
    """
    names = [*data.states, *data.inputs]
    pairs = [(i, j) for i, j in combinations(range(len(names)), 2) if i < len(data.states)][:MOST_PRODUCTS]
    columns, moved = increments(data, basis, window)
    if not pairs or not len(moved):
        return None
    runs = [Trajectory(run.t, run.x, _products(run, pairs)) for run in data]
    wide = replace(basis, inputs=tuple(f"{names[i]} {names[j]}" for i, j in pairs), u_ref=np.zeros(len(pairs)))
    products = increments(runs, wide, window, "paper")[0][:, basis.state_columns : -1]
    left = [left_over(np.column_stack([columns, product]), moved) for product in products.T]
    best = int(np.argmin(left))
    without = left_over(columns, moved)
    return (wide.inputs[best], left[best], without) if left[best] < EXPLAINS * without else None


def _products(run: Trajectory, pairs: Sequence[tuple[int, int]]) -> Float[ndarray, "N k"]:
    both = np.hstack([run.x, run.u])
    return np.column_stack([both[:, i] * both[:, j] for i, j in pairs])
