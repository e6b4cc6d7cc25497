"""The weak form: increments of the state over windows against integrals of the basis functions.

x(t_{k+q}) - x(t_k) = A0 ∫x + sum_j A_j ∫f_j + B ∫u + b (t_{k+q} - t_k)
"""

from collections.abc import Iterator

import numpy as np
from numpy import ndarray

from persid.basis import Basis
from persid.gram import BLOCK, Rows
from persid.trajectories import Trajectories, Trajectory

NOISE_RATIO = 30.0  # a window is long enough when the state moves by this many standard deviations of its noise
LONGEST_WINDOW = 64


def window_rows(
    run: Trajectory, basis: Basis, window: int, hold: str, start: int = 0, stop: int | None = None
) -> Iterator[Rows]:
    """Yield blocks of rows (integrals of the columns, increments of x) over the windows that begin in [start, stop).

    States are integrated by Simpson's rule (any spacing; the window is even); inputs held from sample to sample are
    summed exactly (hold="zoh") or integrated like the states (hold="paper": they vary between samples).
    """
    last = len(run) - window if stop is None else min(stop, len(run) - window)
    for begin in range(start, last, BLOCK):
        piece = run[begin : min(begin + BLOCK, last) + window]
        yield _integrals(piece, basis, window, hold), piece.x[window:] - piece.x[:-window]


def _integrals(piece: Trajectory, basis: Basis, window: int, hold: str) -> ndarray:
    count, p = len(piece) - window, basis.state_columns
    du = piece.u - basis.u_ref
    values = basis.values(piece.x) if hold == "zoh" else np.hstack([basis.values(piece.x), du])
    out = np.empty((count, basis.size))
    simpson = _simpson(piece.t, values, window)
    out[:, : simpson.shape[1]] = simpson
    if hold == "zoh" and du.shape[1]:
        total = np.vstack([np.zeros(du.shape[1]), np.cumsum(du[:-1] * np.diff(piece.t)[:, None], axis=0)])
        out[:, p:-1] = total[window:] - total[:-window]
    out[:, -1] = piece.t[window:] - piece.t[:-window]
    return out


def _simpson(t: ndarray, values: ndarray, window: int) -> ndarray:
    """Integrate over [t_k, t_{k+window}] for every k by Simpson's rule for unequal steps on pairs of steps."""
    h = np.diff(t)
    a, b = h[:-1], h[1:]
    # The parabola through three points: weights (a+b)/6 * (2 - b/a, (a+b)^2/(ab), 2 - a/b).
    total = (a + b) / 6
    weights = (total * (2 - b / a), total * (a + b) ** 2 / (a * b), total * (2 - a / b))
    pairs = weights[0][:, None] * values[:-2]
    pairs += weights[1][:, None] * values[1:-1]
    pairs += weights[2][:, None] * values[2:]
    if window == 2:
        return pairs
    count = len(t) - window
    return sum((pairs[j : j + count] for j in range(2, window, 2)), start=pairs[:count].copy())


def choose_window(data: Trajectories) -> int:
    """Return the shortest even window over which every state moves by many times its measurement noise.

    The noise is read off third differences, which smooth motion hardly enters.
    """
    longest = min(LONGEST_WINDOW, max(2, min(len(run) for run in data) // 20))
    window = 2
    while 2 * window <= longest and not _moves_enough(data, window):
        window *= 2
    return window


def _moves_enough(data: Trajectories, window: int) -> bool:
    noise = np.concatenate([np.abs(np.diff(run.x, 3, axis=0)) for run in data if len(run) > 3] or [np.zeros((1, 1))])
    moves = np.concatenate([np.abs(run.x[window:] - run.x[:-window]) for run in data if len(run) > window])
    sigma = np.sqrt((noise**2).mean(axis=0) / 20)
    return bool((np.sqrt((moves**2).mean(axis=0)) >= NOISE_RATIO * sigma).all())
