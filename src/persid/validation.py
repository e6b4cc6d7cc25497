"""Blocked validation: the strength of the ridge is chosen by free runs on blocks that the fit has not seen."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.freerun import batch_errors
from persid.gram import Gram
from persid.trajectories import Trajectories, Trajectory

STRENGTHS = 10.0 ** np.arange(-8, 0.1, 0.5)
FOLDS = 5
SHORTEST = 8  # samples: shorter parts of a run are neither left out nor held out
LONGEST_RUN = 1000  # samples of one validating free run
MOST_WORK = 2e9  # products in all validating free runs together
TOLERANCE = 1.02  # the strongest ridge within 2 % of the best error is taken


@dataclass(frozen=True)
class Part:
    """Samples [start, stop) of one run; fold -1 is the held-out tail."""

    run: int
    start: int
    stop: int
    fold: int


@dataclass(frozen=True)
class Curve:
    """Free-run error against ridge strength: RMSE in widths of the data (geometric mean
    over the left-out blocks), and the share of runs that blew up."""

    strengths: tuple[float, ...]
    errors: tuple[float, ...]
    blow_ups: tuple[float, ...]

    @property
    def best(self) -> float:
        """The strongest ridge whose error is within 2 % of the smallest."""
        errors = np.array(self.errors)
        return self.strengths[int(np.flatnonzero(errors <= TOLERANCE * errors.min())[-1])]

    def __str__(self) -> str:
        rows = zip(self.strengths, self.errors, self.blow_ups, strict=True)
        lines = [f"{s:8.1e}  {e:9.4g}  {100 * b:5.0f} %" for s, e, b in rows]
        return "\n".join(["   ridge  error  blow-ups", *lines])


def partition(data: Trajectories, holdout: float, folds: int = FOLDS) -> list[Part]:
    """Cut the last share `holdout` off every run as its tail and the rest into blocks; many runs are left out whole."""
    parts = []
    by_run = len(data) >= folds
    for r, run in enumerate(data):
        count = len(run)
        keep = count - int(holdout * count) if holdout * count >= SHORTEST else count
        blocks = 1 if by_run else max(1, min(folds, keep // SHORTEST))
        edges = np.linspace(0, keep, blocks + 1).astype(int)
        parts += [Part(r, int(edges[k]), int(edges[k + 1]), (r + k) % folds) for k in range(blocks)]
        if keep < count:
            parts.append(Part(r, keep, count, -1))
    return parts


def tail(data: Trajectories, parts: Sequence[Part]) -> Trajectories | None:
    """Return the held-out tails, or None where the runs are too short for one."""
    runs = tuple(data[part.run][part.start : part.stop] for part in parts if part.fold == -1)
    return Trajectories(runs, data.states, data.inputs) if runs else None


def validation_curve(
    data: Trajectories, parts: list[Part], grams: list[Gram], limits: Float[ndarray, "n 2"], hold: str
) -> Curve | None:
    """Return the free-run error on left-out blocks for every ridge strength, or None without two blocks."""
    train = [(part, gram) for part, gram in zip(parts, grams, strict=True) if part.fold >= 0]
    folds = sorted({part.fold for part, _ in train})
    chosen = [part for part, _ in train if part.stop - part.start >= SHORTEST]
    if len(folds) < 2 or not chosen:
        return None
    total = _sum([gram for _, gram in train])
    paths = {}
    for fold in folds:
        rest = total - _sum([gram for part, gram in train if part.fold == fold])
        if rest.rows > 0:
            paths[fold] = rest.path(STRENGTHS)
    pieces, owners = _pieces(data, [part for part in chosen if part.fold in paths], total)
    thetas = np.stack([paths[fold] for fold in owners])
    errors, out = batch_errors(total.basis, thetas, pieces, limits, hold)
    # The geometric mean: a block that no model can foretell (a transient seen once) does not drown the others.
    rms = np.exp(0.5 * np.log(np.maximum(errors, np.finfo(float).tiny)).mean(axis=0))
    return Curve(tuple(STRENGTHS.tolist()), tuple(rms.tolist()), tuple(out.mean(axis=0).tolist()))


def _sum(grams: list[Gram]) -> Gram:
    total = grams[0]
    for gram in grams[1:]:
        total = total + gram
    return total


def _pieces(data: Trajectories, parts: list[Part], gram: Gram) -> tuple[list[Trajectory], list[int]]:
    """Choose equally long pieces of the left-out blocks, as many and as long as the allowed work admits."""
    parts = [parts[k] for k in np.unique(np.linspace(0, len(parts) - 1, min(len(parts), 2 * FOLDS)).astype(int))]
    work = len(STRENGTHS) * gram.H.size * len(parts)
    longest = int(max(SHORTEST, min(LONGEST_RUN, MOST_WORK / work)))
    length = min(longest, min(part.stop - part.start for part in parts))
    return [data[p.run][p.start : p.start + length] for p in parts], [p.fold for p in parts]
