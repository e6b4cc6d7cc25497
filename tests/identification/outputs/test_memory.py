"""Memory of a fit is set by the block that is computed at a time, not by the number of samples."""

import tracemalloc

import numpy as np
import pytest
from scipy.signal import lfilter

from persid.identification.outputs.answer import answered
from persid.identification.outputs.selection import Question

BUDGET = 100  # bytes for each further sample: the records in standard units, cut into pieces, and what makes them


def peak(samples: int) -> int:
    """Return the largest memory of a fit to one record, in bytes, beside the record itself."""
    u = np.repeat(np.random.default_rng(0).normal(size=(samples // 10, 1)), 10, 0)
    y = lfilter([0.1], [1.0, -0.9], np.tanh(u), axis=0)
    tracemalloc.start()
    try:
        answered([(u, y)], 0.1, Question(order=2, neurons=1, feedthrough=True, seeds=(0,), ridges=(2e-2,)))
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


@pytest.mark.long
@pytest.mark.parametrize(("few", "many"), [(30_000, 60_000), pytest.param(60_000, 160_000, marks=pytest.mark.slow)])
def test_memory_of_a_fit_grows_by_a_fixed_number_of_bytes_a_sample(few: int, many: int) -> None:
    """With more samples the peak grows by no more than the budget for each further one."""
    assert peak(many) - peak(few) <= BUDGET * (many - few)
