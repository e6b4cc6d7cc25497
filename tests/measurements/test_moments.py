"""Moments: ranges, means and steps of measurements, in blocks of rows, with the memory of one block."""

import tracemalloc

import numpy as np
import pytest

import persid as ps
from persid.measurements.moments import BLOCK, row_moments, run_moments


@pytest.mark.parametrize("count", [1, BLOCK - 1, BLOCK, BLOCK + 1, 3 * BLOCK + 7])
def test_blocks_add_up(count: int) -> None:
    """Moments by blocks are those of all rows at once, and a change between two blocks counts once."""
    rows = np.random.default_rng(0).normal(1e3, 1.0, (count, 3))
    rows[:, 1], rows[:, 2] = 0.1, np.arange(count) >= BLOCK
    found = row_moments(rows)
    assert found.count == count
    assert np.array_equal(found.box, np.column_stack([rows.min(axis=0), rows.max(axis=0)]))
    assert found.mean == pytest.approx(rows.mean(axis=0), rel=1e-12)
    assert found.spread == pytest.approx(((rows - rows.mean(axis=0)) ** 2).sum(axis=0), rel=1e-12, abs=1e-20)
    assert (found.mean[1], found.spread[1], found.changes[1]) == (0.1, 0.0, 0)
    assert found.changes[[0, 2]].tolist() == [count - 1, int(count > BLOCK)]


def test_a_long_run_is_not_copied() -> None:
    """The moments of a run take far less memory than the run."""
    x = np.random.default_rng(0).normal(size=(40 * BLOCK, 4))
    (run,) = ps.Trajectories.from_arrays(x, np.zeros((len(x), 1)), dt=0.1)
    tracemalloc.start()
    found = run_moments([run])
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(found.mean) == 5
    assert most < x.nbytes / 4
