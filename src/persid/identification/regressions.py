"""From prepared data to coefficients: Gram matrices part by part, ridge, thresholds; the same for every estimator."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.basis import Basis
from persid.identification.gram import (
    Gram,
    Rows,
    Triangle,
    accumulate,
    condition_number,
    triangle,
    with_root,
)
from persid.identification.monotone import of_one_sign
from persid.identification.structure import Structure
from persid.identification.validation import Curve
from persid.measurements.boxes import box_of
from persid.measurements.recordings import Measurements, Part, block_sums
from persid.measurements.trajectory import Trajectory

RowsOf = Callable[[Trajectory, int], Iterator[Rows]]  # of a segment, and how many of its samples rows begin at
MOST_THRESHOLDS = 10  # rounds of sequential thresholding


@dataclass(frozen=True, eq=False)
class Regression:
    """How samples become rows: the rows of a segment, which may need `overlap` samples behind those they begin at.

    `data` are what the segments are cut from; `window` is the length of windows in samples, and `K` the Koopman matrix,
    where there is one.
    """

    data: Measurements
    rows: RowsOf
    overlap: int = 0
    window: int | None = None
    K: Float[ndarray, "l l"] | None = None


@dataclass(frozen=True, eq=False)
class Options:
    """What estimators are asked: `hold` of the inputs, `window` in samples or "auto", further `lifting` functions and
    the reading of eq:Gamma_cal, `slopes` x' where they were given for samples that were not `embedded`, and whether
    columns of earlier windows shall serve as `instruments`."""

    hold: str
    window: int | str = "auto"
    lifting: Sequence[str] | Callable[[ndarray, ndarray], object] = ()
    gamma: str = "coordinates"
    slopes: object = None
    embedded: bool = False
    instruments: bool = False


@dataclass(frozen=True)
class Estimator:
    """A method of identification: how samples become rows of a regression on the columns of a basis.

    `additive`: rows know nothing of other samples, so that blocks can be left out, added up and drawn again. One that
    is not (its rows are read off a matrix of all samples) is made again for every choice of parts.
    `in_memory`: it needs all samples at once.  `slopes`: x' may be given.  `lifts`: so may further lifting functions.
    `instruments`: columns of earlier windows may take the place of those of the window itself.
    `rival`: the method that is tried where free runs of this one foretell less than the mean does.
    """

    regression: Callable[[Measurements, Basis, Sequence[Part], Options], Regression]
    additive: bool = True
    in_memory: bool = False
    slopes: bool = False
    lifts: bool = False
    instruments: bool = False
    rival: str | None = None


@dataclass(frozen=True, eq=False)
class Problem:
    """Data cut into parts (tails and folds) and further into blocks, and how they become rows of a regression."""

    data: Measurements
    basis: Basis
    structure: Structure
    parts: Sequence[Part]
    blocks: Sequence[Part]
    regression: Regression

    @cached_property
    def box(self) -> Float[ndarray, "n 2"]:
        """The smallest box that holds all states of the data."""
        return box_of(self.data)

    def grams(self) -> dict[int, Gram]:
        """Return the Gram of every block, from one pass over the samples."""
        work = partial(_gram, rows=self.regression.rows, basis=self.basis, structure=self.structure)
        return block_sums(self.regression.data, self.blocks, work, self.regression.overlap)

    def solvable(self, gram: Gram, ridge: float, tails: bool = True) -> Gram:
        """Return the Gram of all blocks (or of those that are no tails) with its triangular factor, by a second pass,
        where it would otherwise be too ill-conditioned for this ridge."""
        limit = gram.ill_conditioned
        if not gram.structure.is_separate or ridge >= limit**-2 or condition_number(gram.scaled) <= limit:
            return gram
        used = [replace(part, block=0) for part in self.parts if tails or part.fold >= 0]
        work = partial(_triangle, rows=self.regression.rows)
        return with_root(gram, block_sums(self.regression.data, used, work, self.regression.overlap)[0])


def _gram(segment: Trajectory, count: int, rows: RowsOf, basis: Basis, structure: Structure) -> Gram:
    return accumulate(rows(segment, count), basis, structure)


def _triangle(segment: Trajectory, count: int, rows: RowsOf) -> Triangle:
    return triangle(rows(segment, count))


def sparse_coefficients(
    gram: Gram, ridge: float, share: float | None, *, monotone: bool = False
) -> Float[ndarray, "p n"]:
    """Return the ridge fit; coefficients below `share` of the largest scaled one are set to 0, the rest fitted again.

    With `monotone` it is the fit whose learned functions only rise or only fall, and there is no share.

    A negative coefficient of a state's own function in its own equation is never dropped: it is the damping that a
    Lyapunov function lives on.
    """
    theta = gram.solve(ridge)
    if monotone:
        return of_one_sign(gram, theta, ridge)
    for _ in range(MOST_THRESHOLDS if share else 0):
        small = _small(gram, theta, share or 0.0)
        if not (small & (gram.structure.parameter >= 0)).any():
            break
        parameter = np.where(small, -1, gram.structure.parameter)
        gram = replace(gram, structure=Structure.of(parameter, gram.structure.given))
        theta = gram.solve(ridge)
    return theta


def _small(gram: Gram, theta: ndarray, share: float) -> ndarray:
    size = np.abs(theta) * gram.weights[:, None]
    keep = size >= share * size.max(axis=0)
    owner = gram.basis.owner
    own = np.arange(len(owner)), owner
    keep[own] |= theta[own] < 0
    keep[-1] = True
    kept = np.unique(gram.structure.parameter[keep])
    return ~np.isin(gram.structure.parameter, kept)


@dataclass(frozen=True, eq=False)
class Solution:
    """Coefficients with what they were computed from; `held_out` are those of the fit without the tails.

    `blocks` are the Grams of which `gram` is the sum.
    """

    theta: Float[ndarray, "p n"]
    held_out: Float[ndarray, "p n"] | None
    gram: Gram
    blocks: Mapping[int, Gram]
    ridge: float
    curve: Curve | None
