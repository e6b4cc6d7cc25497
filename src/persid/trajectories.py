"""Trajectories: sampled runs of a system, never paired across their ends."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import overload

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One run: times in s, states and inputs, row k of each belonging to time t[k].

    Under a zero-order hold u[k] acts from t[k] to t[k+1]; the last one is unused. `diverged_at` is the time in s at
    which a simulated run left the range of representable states, None when it did not.
    """

    t: Float[ndarray, " N"]
    x: Float[ndarray, "N n"]
    u: Float[ndarray, "N m"]
    diverged_at: float | None = None

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, eq=False)
class Trajectories(Sequence[Trajectory]):
    """A sequence of runs of one system, with the names of its states and inputs and the repairs made while reading."""

    runs: tuple[Trajectory, ...]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    notes: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.runs)

    def __iter__(self) -> Iterator[Trajectory]:
        return iter(self.runs)

    @overload
    def __getitem__(self, index: int) -> Trajectory: ...
    @overload
    def __getitem__(self, index: slice) -> "Trajectories": ...
    def __getitem__(self, index: int | slice) -> "Trajectory | Trajectories":
        if isinstance(index, slice):
            return Trajectories(self.runs[index], self.states, self.inputs, self.notes)
        return self.runs[index]

    def __post_init__(self) -> None:
        if not self.runs:
            raise DataError("no trajectory was given; at least one run of two samples is needed")
