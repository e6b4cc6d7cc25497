"""Records of inputs and outputs, standardised and cut into pieces that are simulated side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped
from numpy import ndarray

Record = tuple[ndarray, ndarray]  # inputs (N, m) and outputs (N, l); N differs from record to record
SHORTEST, LONGEST = 16, 512  # samples a piece


@dataclass(frozen=True, eq=False)
class Scales:
    """Say what one standardised unit is: u = u_mean + u_scale * standardised, and so for y."""

    u_mean: Float[ndarray, " m"]
    u_scale: Float[ndarray, " m"]
    y_mean: Float[ndarray, " l"]
    y_scale: Float[ndarray, " l"]

    @classmethod
    def of(cls, records: Sequence[Record], centred: bool = True) -> "Scales":
        """Return means and standard deviations; without `centred` y keeps its zero, as an output map needs."""
        u, y = (np.concatenate([record[side] for record in records]) for side in (0, 1))
        y_mean = y.mean(0) if centred else np.zeros(y.shape[1])
        return cls(u.mean(0), _sizes(u - u.mean(0)), y_mean, _sizes(y - y_mean))

    def standardised(self, record: Record) -> Record:
        """Return a record in standard units."""
        u, y = record
        return (u - self.u_mean) / self.u_scale, (y - self.y_mean) / self.y_scale


def _sizes(values: Float[ndarray, "N k"]) -> Float[ndarray, " k"]:
    sizes = np.sqrt((values**2).mean(0))
    return np.where(sizes > 0, sizes, 1.0)


@dataclass(frozen=True, eq=False)
class Pieces:
    """Hold all records cut into S pieces of L samples; the axis of pieces is the last one.

    u at the samples and its rise to the next one (None under a zero-order hold); weight and held say whether a sample
    is fitted or held out (padding is neither). Pieces of a record follow one another; `follows` says which do.
    """

    u: Float[ndarray, "L m S"]
    rise: Float[ndarray, "L m S"] | None
    y: Float[ndarray, "L l S"]
    weight: Bool[ndarray, "L S"]
    held: Bool[ndarray, "L S"]
    record: Int[ndarray, " S"]

    @classmethod
    def of(cls, records: Sequence[Record], hold: str = "zoh", length: int | None = None, kept: float = 1.0) -> "Pieces":
        """Cut records into pieces; the part `kept` of every record is fitted, the rest is held out."""
        length = length or _length(sum(len(u) for u, _ in records))
        u, y = (_cut([record[side] for record in records], length) for side in (0, 1))
        rise = None
        if hold == "foh":
            rise = _cut([np.diff(u, axis=0, append=u[-1:]) for u, _ in records], length)
        fitted = [np.arange(len(u))[:, None] < round(kept * len(u)) for u, _ in records]
        weight, held = (_cut(side, length)[:, 0] for side in (fitted, [~column for column in fitted]))
        record = np.repeat(np.arange(len(records)), [ceil(len(u) / length) for u, _ in records])
        return cls(u, rise, y, weight, held, record)

    def __getitem__(self, part: slice) -> "Pieces":
        rise = None if self.rise is None else self.rise[..., part]
        every = (self.y, self.weight, self.held, self.record)
        return Pieces(self.u[..., part], rise, *(one[..., part] for one in every))

    def samples(self, part: slice) -> "Pieces":
        """Return some samples of every piece."""
        rise = None if self.rise is None else self.rise[part]
        return replace(self, u=self.u[part], rise=rise, y=self.y[part], weight=self.weight[part], held=self.held[part])

    def quiet(self, share: float) -> "Pieces":
        """Return the pieces with that share of the fitted samples held out as well: those of the largest outputs."""
        size = np.abs(self.y).max(1)
        loud = self.weight & (size > np.quantile(size[self.weight], 1 - share))
        return replace(self, weight=self.weight & ~loud, held=self.held | loud)

    @property
    def length(self) -> int:
        """Samples a piece."""
        return len(self.u)

    @property
    def count(self) -> int:
        """Number of pieces."""
        return len(self.record)

    @property
    def follows(self) -> Bool[ndarray, " S"]:
        """Whether a piece goes on with the record of the piece before it."""
        return np.asarray(np.diff(self.record, prepend=-1) == 0)

    @property
    def starts(self) -> Int[ndarray, " records"]:
        """The first piece of every record."""
        return np.flatnonzero(~self.follows)

    @property
    def longest(self) -> int:
        """Samples of the longest record."""
        return int(np.bincount(self.record, (self.weight | self.held).sum(0)).max())

    @property
    def values(self) -> float:
        """Number of measured values that are fitted."""
        return float(float(self.weight.sum()) * self.y.shape[1])


def _length(total: int) -> int:
    """Return samples a piece: a pass costs a Python step for every sample of a piece, and a link for every piece."""
    return int(np.clip(2 ** np.round(np.log2(np.sqrt(total) / 2)), SHORTEST, LONGEST))


def _cut(columns: Sequence[ndarray], length: int) -> Shaped[ndarray, "L k S"]:
    """Return columns (N, k) of all records as (length, k, pieces), padded by zeros."""
    counts = [ceil(len(column) / length) for column in columns]
    full = np.zeros((length, columns[0].shape[1], sum(counts)), columns[0].dtype)
    for column, end, count in zip(columns, np.cumsum(counts), counts, strict=True):
        whole, some = divmod(len(column), length)
        folded = column[: whole * length].reshape(whole, length, column.shape[1])
        full[..., end - count : end - count + whole] = np.moveaxis(folded, 0, -1)
        full[:some, :, end - 1] = column[whole * length :]
    return full
