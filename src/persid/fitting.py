"""From prepared data to coefficients: Gram matrices part by part, ridge, thresholds; the same for every estimator."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.basis import Basis
from persid.derivatives import derivative_rows
from persid.gram import ILL_CONDITIONED, Gram, Rows, accumulate, condition_number, with_root
from persid.koopman import Lifting, doubtful_eigenvalues, edmd, gamma, koopman_generator, sample_step
from persid.structure import Structure
from persid.trajectories import Trajectories
from persid.validation import Curve, Part
from persid.weak import window_rows

RowsOf = Callable[[Part], Iterator[Rows]]
MOST_THRESHOLDS = 10  # rounds of sequential thresholding


@dataclass(frozen=True, eq=False)
class Problem:
    """Data cut into parts, and how a part becomes rows of a regression."""

    data: Trajectories
    basis: Basis
    structure: Structure
    parts: list[Part]
    rows: RowsOf

    def grams(self) -> list[Gram]:
        """Return the Gram of every part, each from one pass over its samples."""
        return [accumulate(self.rows(part), self.basis, self.structure) for part in self.parts]

    def gram(self, parts: Sequence[Part], grams: Sequence[Gram], ridge: float) -> Gram:
        """Return the Gram of some parts together, with a triangular factor where it stays ill-conditioned."""
        total = grams[0]
        for gram in grams[1:]:
            total = total + gram
        if (
            total.structure.is_separate
            and ridge < ILL_CONDITIONED**-2
            and condition_number(total.scaled) > ILL_CONDITIONED
        ):
            return with_root(total, (block for part in parts for block in self.rows(part)))
        return total


def weak_rows(data: Trajectories, basis: Basis, window: int, hold: str) -> RowsOf:
    """Rows of the weak form."""
    return lambda part: window_rows(data[part.run], basis, window, hold, part.start, part.stop)


def slope_rows(data: Trajectories, basis: Basis, slopes: Sequence[ndarray], hold: str) -> RowsOf:
    """Rows of the regression of derivatives."""
    return lambda part: derivative_rows(data[part.run], slopes[part.run], basis, hold, part.start, part.stop)


def koopman_rows(
    data: Trajectories, basis: Basis, lifting: Lifting, parts: Sequence[Part], hold: str, reading: str
) -> RowsOf:
    """Rows whose left sides are the vector field that the generator of the given parts implies at every sample."""
    used = Trajectories(tuple(data[p.run][p.start : p.stop] for p in parts), data.states, data.inputs)
    K = edmd(used, lifting, hold)
    doubtful = doubtful_eigenvalues(used, lifting, K, hold)
    L = koopman_generator(K, sample_step(data), samples=used.samples - len(used), hold=hold, doubtful=doubtful)
    n = len(basis.states)
    theta = None
    if reading == "literal":
        x, u = (np.concatenate([getattr(run, name) for run in used]) for name in ("x", "u"))
        theta = gamma(L, lifting, x, u, "literal").T

    def rows(part: Part) -> Iterator[Rows]:
        run = data[part.run][part.start : part.stop]
        phi = lifting.columns(run.x, run.u)
        yield phi, lifting.values(run.x, run.u) @ L[:, :n] if theta is None else phi @ theta

    return rows


def sparse_coefficients(gram: Gram, ridge: float, share: float | None) -> Float[ndarray, "p n"]:
    """Return the ridge fit; coefficients below `share` of the largest scaled one are set to 0, the rest fitted again.

    A negative coefficient of a state's own function in its own equation is never dropped: it is the damping that a
    Lyapunov function lives on.
    """
    theta = gram.solve(ridge)
    for _ in range(MOST_THRESHOLDS if share else 0):
        small = _small(gram, theta, share or 0.0)
        if not (small & (gram.structure.parameter >= 0)).any():
            break
        parameter = np.where(small, -1, gram.structure.parameter)
        gram = replace(gram, structure=Structure(_renumbered(parameter), len(np.unique(parameter[parameter >= 0]))))
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


def _renumbered(parameter: ndarray) -> ndarray:
    used, numbered = np.unique(parameter, return_inverse=True)
    return numbered.reshape(parameter.shape) - int(used[0] == -1)


def training(parts: Sequence[Part], grams: Sequence[Gram]) -> tuple[list[Part], list[Gram]]:
    """Return the parts that are not held out, with their Grams."""
    kept = [(part, gram) for part, gram in zip(parts, grams, strict=True) if part.fold >= 0]
    return [part for part, _ in kept], [gram for _, gram in kept]


@dataclass(frozen=True, eq=False)
class Solution:
    """Coefficients with what they were computed from; `held_out` are those of the fit without the tails."""

    theta: Float[ndarray, "p n"]
    held_out: Float[ndarray, "p n"] | None
    gram: Gram
    ridge: float
    curve: Curve | None
