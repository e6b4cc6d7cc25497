"""Blocked validation: the strength of the ridge is chosen by free runs on blocks that the fit has not seen."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from operator import add

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.free_runs import batch_errors
from persid.identification.gram import Gram
from persid.measurements.recordings import Measurements, Part, lengths, segments
from persid.measurements.trajectories import Trajectories, Trajectory

STRENGTHS = 10.0 ** np.arange(-8, 0.1, 0.5)
FOLDS = 5
SHORTEST = 8  # samples: shorter parts of a run are neither left out nor held out
LONGEST_RUN = 1000  # samples of one validating free run
MOST_WORK = 2e9  # products in all validating free runs together
TOLERANCE = 1.02  # the strongest ridge within 2 % of the best error is taken


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


def partition(data: Measurements, holdout: float, folds: int = FOLDS) -> list[Part]:
    """Cut the last share `holdout` off every run as its tail and the rest into blocks; many runs are left out whole."""
    parts = []
    counts = lengths(data)
    by_run = len(counts) >= folds
    for r, count in enumerate(counts):
        keep = count - int(holdout * count) if holdout * count >= SHORTEST else count
        blocks = 1 if by_run else max(1, min(folds, keep // SHORTEST))
        edges = np.linspace(0, keep, blocks + 1).astype(int)
        parts += [Part(r, int(edges[k]), int(edges[k + 1]), (r + k) % folds) for k in range(blocks)]
        if keep < count:
            parts.append(Part(r, keep, count, -1))
    return parts


def blocks(parts: Sequence[Part], most: int) -> list[Part]:
    """Number the parts by blocks of one fold each, about `most` in all: long parts are cut, short ones go together."""
    folds = sorted({part.fold for part in parts})
    mine = {fold: [part for part in parts if part.fold == fold] for fold in folds}
    found: list[Part] = []
    for fold in folds:
        share = max(1, most // len(folds))
        groups = np.array_split(np.arange(len(mine[fold])), min(share, len(mine[fold])))
        for group in groups:
            pieces = max(1, share // len(groups))
            first = found[-1].block + 1 if found else 0
            found += [cut for k in group for cut in _cut(mine[fold][k], pieces, first)]
    return found


def _cut(part: Part, pieces: int, first: int) -> list[Part]:
    """Cut a part into pieces of some length, each a block."""
    count = max(1, min(pieces, (part.stop - part.start) // SHORTEST))
    edges = np.linspace(part.start, part.stop, count + 1).astype(int).tolist()
    return [Part(part.run, a, b, part.fold, first + k, part.stop) for k, (a, b) in enumerate(pairwise(edges))]


def by_fold(parts: Sequence[Part], grams: Mapping[int, Gram]) -> dict[int, Gram]:
    """Return the Gram of every fold from those of the blocks."""
    fold = {part.block: part.fold for part in parts}
    return {f: total([gram for b, gram in grams.items() if fold[b] == f]) for f in sorted({fold[b] for b in grams})}


def tail(data: Measurements, parts: Sequence[Part], longest: int, most: int) -> Trajectories | None:
    """Return the first `most` held-out tails, cut to `longest` samples; None where the runs are too short for one."""
    held = [part for part in parts if part.fold == -1][:most]
    cut = [Part(part.run, part.start, min(part.stop, part.start + longest), -1) for part in held]
    return Trajectories(tuple(segments(data, cut)), data.states, data.inputs) if held else None


def validation_curve(
    data: Measurements, parts: Sequence[Part], grams: Mapping[int, Gram], limits: Float[ndarray, "n 2"], hold: str
) -> Curve | None:
    """Return the free-run error on left-out blocks for every ridge strength, or None without two blocks.

    `grams` are those of the folds.
    """
    train = {fold: gram for fold, gram in grams.items() if fold >= 0}
    chosen = [part for part in parts if part.fold >= 0 and part.stop - part.start >= SHORTEST]
    if len(train) < 2 or not chosen:
        return None
    everything = total(list(train.values()))
    paths = {}
    for fold, gram in train.items():
        rest = everything - gram
        if rest.rows > 0:
            paths[fold] = rest.path(STRENGTHS)
    pieces, owners = _pieces(data, [part for part in chosen if part.fold in paths], everything)
    thetas = np.stack([paths[fold] for fold in owners])
    errors, out = batch_errors(everything.basis, thetas, pieces, limits, hold)
    # The geometric mean: a block that no model can foretell (a transient seen once) does not drown the others.
    rms = np.exp(0.5 * np.log(np.maximum(errors, np.finfo(float).tiny)).mean(axis=0))
    return Curve(tuple(STRENGTHS.tolist()), tuple(rms.tolist()), tuple(out.mean(axis=0).tolist()))


def total(grams: Sequence[Gram]) -> Gram:
    """Return the Gram of all rows together."""
    return reduce(add, grams)


def _pieces(data: Measurements, parts: list[Part], gram: Gram) -> tuple[list[Trajectory], list[int]]:
    """Choose equally long pieces of the left-out blocks, as many and as long as the allowed work admits."""
    parts = [parts[k] for k in np.unique(np.linspace(0, len(parts) - 1, min(len(parts), 2 * FOLDS)).astype(int))]
    work = len(STRENGTHS) * gram.H.size * len(parts)
    longest = int(max(SHORTEST, min(LONGEST_RUN, MOST_WORK / work)))
    length = min(longest, min(part.stop - part.start for part in parts))
    chosen = [Part(p.run, p.start, p.start + length, p.fold) for p in parts]
    return segments(data, chosen), [p.fold for p in chosen]
