"""The weak form: increments of the state over windows against integrals of the basis functions.

x(t_{k+q}) - x(t_k) = A0 ∫x + sum_j A_j ∫f_j + B ∫u + b (t_{k+q} - t_k)
"""

from collections.abc import Iterator

import numpy as np
from numpy import ndarray

from persid.identification.basis import Basis
from persid.identification.gram import BLOCK, Rows
from persid.measurements.recordings import Measurements, Part, lengths, segments
from persid.measurements.trajectories import Trajectory

NOISE_RATIO = 30.0  # a window is long enough when the state moves by this many standard deviations of its noise
LONGEST_WINDOW = 64
ENOUGH = 20_000  # samples of a run that are enough to judge its noise
MOST_JUDGED = 20  # runs whose noise is judged
EQUAL = 1e-9  # relative spread of steps that counts as none
FEW_TERMS = 4  # up to so many are added one by one, more by differences of running sums


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
    du, h = piece.u - basis.u_ref, np.diff(piece.t)
    values = basis.values(piece.x)
    out = np.empty((count, basis.size))
    _simpson(h, values, window, out[:, :p])
    if hold == "zoh":
        _window_sums(du[:-1] * h[:, None], window, 1, out[:, p:-1])
    else:
        _simpson(h, du, window, out[:, p:-1])
    out[:, -1] = piece.t[window:] - piece.t[:-window]
    return out


def _simpson(h: ndarray, values: ndarray, window: int, out: ndarray) -> None:
    """Integrate over every window of samples with steps h by Simpson's rule for unequal steps on pairs of steps."""
    a, b = h[:-1, None], h[1:, None]
    if np.ptp(h) <= EQUAL * h[0]:
        pairs = values[1:-1] * 4
        pairs += values[:-2]
        pairs += values[2:]
        pairs *= h[0] / 3
    else:
        # The parabola through three points: weights (a+b)/6 * (2 - b/a, (a+b)^2/(ab), 2 - a/b).
        total = (a + b) / 6
        pairs = values[1:-1] * (total * (a + b) ** 2 / (a * b))
        pairs += values[:-2] * (total * (2 - b / a))
        pairs += values[2:] * (total * (2 - a / b))
    _window_sums(pairs, window // 2, 2, out)


def _window_sums(pieces: ndarray, terms: int, stride: int, out: ndarray) -> None:
    """Write pieces[k] + pieces[k + stride] + ... (`terms` of them) to out[k]."""
    count = len(out)
    if terms <= FEW_TERMS:
        out[:] = pieces[:count]
        for j in range(1, terms):
            out += pieces[j * stride : j * stride + count]
        return
    for first in range(stride):
        sums = np.cumsum(pieces[first::stride], axis=0)
        rows = len(out[first::stride])
        out[first::stride] = sums[terms - 1 : terms - 1 + rows]
        out[first + stride :: stride] -= sums[: max(rows - 1, 0)]


def choose_window(data: Measurements) -> int:
    """Return the shortest even window over which every state moves by many times its measurement noise.

    The noise is read off third differences, which smooth motion hardly enters, at the beginnings of at most 20 runs.
    """
    counts = lengths(data)
    longest = min(LONGEST_WINDOW, max(2, min(counts) // 20))
    if longest < 4:
        return 2
    chosen = np.unique(np.linspace(0, len(counts) - 1, min(len(counts), MOST_JUDGED)).astype(int))
    heads = segments(data, [Part(int(r), 0, min(counts[r], ENOUGH), 0) for r in chosen])
    window, runs = 2, [run.x for run in heads]
    while 2 * window <= longest and not _moves_enough(runs, window):
        window *= 2
    return window


def _moves_enough(runs: list[ndarray], window: int) -> bool:
    noise = np.concatenate([np.diff(x, 3, axis=0) for x in runs if len(x) > 3] or [np.zeros((1, runs[0].shape[1]))])
    moves = np.concatenate([x[window:] - x[:-window] for x in runs if len(x) > window])
    sigma = np.sqrt((noise**2).mean(axis=0) / 20)
    return bool((np.sqrt((moves**2).mean(axis=0)) >= NOISE_RATIO * sigma).all())
