"""Records of inputs and outputs, standardised and cut into pieces that are simulated side by side."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
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

    u at the samples and its rise to the next one (zero under a zero-order hold); weight and held are 1 where a sample
    is fitted or held out and 0 elsewhere (padding is neither). Pieces of a record follow one another.
    """

    u: Float[ndarray, "L m S"]
    rise: Float[ndarray, "L m S"]
    y: Float[ndarray, "L l S"]
    weight: Float[ndarray, "L S"]
    held: Float[ndarray, "L S"]
    record: Int[ndarray, " S"]

    @classmethod
    def of(cls, records: Sequence[Record], hold: str = "zoh", length: int | None = None, kept: float = 1.0) -> "Pieces":
        """Cut records into pieces; the part `kept` of every record is fitted, the rest is held out."""
        total = sum(len(u) for u, _ in records)
        length = length or _length(total)
        parts = [_cut(u, y, hold, length, round(kept * len(u))) for u, y in records]
        u, rise, y, weight, held = (np.concatenate(columns, -1) for columns in zip(*parts, strict=True))
        record = np.repeat(np.arange(len(parts)), [part[0].shape[-1] for part in parts])
        return cls(u, rise, y, weight, held, record)

    @property
    def length(self) -> int:
        """Samples a piece."""
        return len(self.u)

    @property
    def starts(self) -> Int[ndarray, " records"]:
        """The first piece of every record."""
        return np.flatnonzero(np.diff(self.record, prepend=-1))

    @property
    def values(self) -> float:
        """Number of measured values that are fitted."""
        return float(float(self.weight.sum()) * self.y.shape[1])

    def fitted_to_all(self) -> "Pieces":
        """Return the same pieces with nothing held out."""
        return replace(self, weight=self.weight + self.held, held=0 * self.held)


def _length(total: int) -> int:
    """Return samples a piece: a pass costs a Python step for every sample of a piece, and a link for every piece."""
    return int(np.clip(2 ** np.round(np.log2(np.sqrt(total) / 2)), SHORTEST, LONGEST))


def _cut(u: Float[ndarray, "N m"], y: Float[ndarray, "N l"], hold: str, length: int, kept: int) -> tuple[ndarray, ...]:
    rise = np.diff(u, axis=0, append=u[-1:]) if hold == "foh" else 0 * u
    k = np.arange(len(u))
    columns = (u, rise, y, (k < kept).astype(float), (k >= kept).astype(float))
    return tuple(_folded(column, length) for column in columns)


def _folded(column: ndarray, length: int) -> ndarray:
    """Return (N, …) as (length, …, pieces), padded by the last row (weights: by zero)."""
    missing = -len(column) % length
    padding = np.repeat(column[-1:] if column.ndim > 1 else np.zeros(1), missing, axis=0)
    full = np.concatenate([column, padding])
    return np.ascontiguousarray(np.moveaxis(full.reshape(len(full) // length, length, *column.shape[1:]), 0, -1))
