"""A clock that counts: a look at `time.perf_counter` is a step of 5 ms, about what it takes on a free machine.

With it a time limit in a test, or in a snippet of the documentation, is a budget of steps: the same on every machine,
however busy it is.
"""

import itertools
import time

STEP = 0.005  # s


def install() -> None:
    """Let the clock of this process count."""
    looks = itertools.count()
    time.perf_counter = lambda: STEP * next(looks)
