"""Windows: over how many samples the states outrun their measurement noise."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.measurements.recordings import Measurements, beginnings, lengths

NOISE_RATIO = 30.0  # a window is long enough when the state moves by this many standard deviations of its noise
WITH_INSTRUMENTS = 2.5  # the same for instruments, which long windows weaken; noise on the plant itself moves so much
LONGEST_WINDOW = 64
ENOUGH = 20_000  # samples of a run that are enough to judge its noise
MOST_JUDGED = 20  # runs whose noise is judged


def choose_window(data: Measurements, ratio: float = NOISE_RATIO) -> int:
    """Return the shortest even window over which every state moves by `ratio` times its measurement noise.

    The noise is read off third differences, which smooth motion hardly enters, at the beginnings of at most 20 runs.
    """
    counts = lengths(data)
    longest = min(LONGEST_WINDOW, max(2, min(counts) // 20))
    if longest < 4:
        return 2
    window, runs = 2, [run.x for run in beginnings(data, ENOUGH, MOST_JUDGED)]
    while 2 * window <= longest and not _moves_enough(runs, window, ratio):
        window *= 2
    return window


def noise_of(runs: list[ndarray]) -> Float[ndarray, " n"]:
    """Return the standard deviation of every state's measurement noise, read off third differences."""
    noise = np.concatenate([np.diff(x, 3, axis=0) for x in runs if len(x) > 3] or [np.zeros((1, runs[0].shape[1]))])
    return np.asarray(np.sqrt((noise**2).mean(axis=0) / 20))


def _moves_enough(runs: list[ndarray], window: int, ratio: float) -> bool:
    moves = np.concatenate([x[window:] - x[:-window] for x in runs if len(x) > window])
    sigma = noise_of(runs)
    return bool((np.sqrt((moves**2).mean(axis=0)) >= ratio * sigma).all())
