"""Moments: ranges, means and steps of measurements, which add up over pieces wherever these lie."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import reduce
from operator import add

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from persid.measurements.trajectory import Trajectory

BLOCK = 4096  # rows; a block of some 50 columns stays in the processor's cache


@dataclass(frozen=True, eq=False)
class Moments:
    """Of every column over `count` rows: range, mean, `spread` = sum of squares about the mean, number of changes."""

    count: int
    low: Float[ndarray, " k"]
    high: Float[ndarray, " k"]
    mean: Float[ndarray, " k"]
    spread: Float[ndarray, " k"]
    changes: Int[ndarray, " k"]

    def __add__(self, other: "Moments") -> "Moments":
        """Moments of both sets of rows together (the update of Chan, Golub and LeVeque, 1979)."""
        count, far = self.count + other.count, other.mean - self.mean
        mean = self.mean + far * (other.count / count)
        spread = self.spread + other.spread + far**2 * (self.count * other.count / count)
        low, high = np.minimum(self.low, other.low), np.maximum(self.high, other.high)
        return Moments(count, low, high, mean, spread, self.changes + other.changes)

    def of(self, columns: slice | list[int]) -> "Moments":
        """Return those of some columns."""
        parts = (getattr(self, name)[columns] for name in ("low", "high", "mean", "spread", "changes"))
        return Moments(self.count, *parts)

    @property
    def box(self) -> Float[ndarray, "k 2"]:
        """The smallest box that holds all rows."""
        return np.column_stack([self.low, self.high])

    @property
    def deviation(self) -> Float[ndarray, " k"]:
        """Standard deviation of every column."""
        return np.sqrt(self.spread / self.count)


@dataclass(frozen=True)
class Steps:
    """Steps in time in s: the shortest, the longest, their sum and number."""

    low: float
    high: float
    total: float
    count: int

    def __add__(self, other: "Steps") -> "Steps":
        low, high = min(self.low, other.low), max(self.high, other.high)
        return Steps(low, high, self.total + other.total, self.count + other.count)

    @property
    def mean(self) -> float:
        """Mean step in s."""
        return self.total / max(self.count, 1)


NO_STEPS = Steps(np.inf, 0.0, 0.0, 0)


def row_moments(rows: Float[ndarray, "N k"]) -> Moments:
    """Return the moments of at least one row; a column that never varies has its own value as mean."""
    return reduce(add, (_block_moments(rows, start) for start in range(0, len(rows), BLOCK)))


def _block_moments(rows: Float[ndarray, "N k"], start: int) -> Moments:
    """Return the moments of the block that begins at `start`; a change counts in the block that it leads to."""
    block, before = rows[start : start + BLOCK], rows[max(start - 1, 0) : start + BLOCK]
    low, high, mean = block.min(axis=0), block.max(axis=0), block.mean(axis=0)
    mean = np.where(low == high, low, mean)
    changes = (before[1:] != before[:-1]).sum(axis=0)
    return Moments(len(block), low, high, mean, ((block - mean) ** 2).sum(axis=0), changes)


def run_moments(runs: Iterable[Trajectory]) -> Moments:
    """Return the moments of states and inputs, side by side, over whole runs."""
    return reduce(add, (_beside(row_moments(run.x), row_moments(run.u)) for run in runs))


def _beside(left: Moments, right: Moments) -> Moments:
    """Return the moments of columns beside others, of the same rows."""
    names = ("low", "high", "mean", "spread", "changes")
    return Moments(left.count, *(np.concatenate([getattr(left, name), getattr(right, name)]) for name in names))


def run_steps(runs: Iterable[Trajectory]) -> Steps:
    """Return the steps in time of whole runs."""
    return reduce(add, (steps_of(np.diff(run.t)) for run in runs))


def steps_of(h: Float[ndarray, " N"]) -> Steps:
    """Return the summary of steps in s."""
    return Steps(float(h.min()), float(h.max()), float(h.sum()), len(h)) if len(h) else NO_STEPS
