"""Look-up tables: piecewise linear functions by their knots and values, `pwl(x; knot: value, …)` in the grammar."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from numpy.typing import ArrayLike

from persid.errors import ModelError
from persid_check.expression import MAX_KNOTS, ExpressionError, Table, table_of

WORD = "pwl"  # of a table in the grammar; alone, among the functions of a fit, of one that is to be learned


@dataclass(frozen=True, eq=False)
class LookupTable:
    """A function with given values at its knots, linear between them and beyond, where the end pieces go on."""

    knots: Float[ndarray, " k"]
    values: Float[ndarray, " k"]

    @classmethod
    def of(cls, table: Table) -> "LookupTable":
        """Return the table of exact knots and values."""
        return cls(*np.array([[float(t), float(v)] for t, v in table]).T)

    @cached_property
    def slopes(self) -> Float[ndarray, " pieces"]:
        """The slope of each piece."""
        return np.asarray(np.diff(self.values) / np.diff(self.knots))

    def _pieces(self, y: ndarray) -> ndarray:
        """Return the piece of each y: at a knot, the one on the right."""
        return np.clip(np.searchsorted(self.knots, y, side="right") - 1, 0, len(self.slopes) - 1)

    def value(self, y: Float[ndarray, "..."]) -> Float[ndarray, "..."]:
        """Return f(y)."""
        k = self._pieces(y)
        return np.asarray(self.values[k] + self.slopes[k] * (y - self.knots[k]))

    def derivative(self, y: Float[ndarray, "..."]) -> Float[ndarray, "..."]:
        """Return f'(y); at a knot, the slope on the right."""
        return np.asarray(self.slopes[self._pieces(y)])

    def antiderivative(self, y: Float[ndarray, "..."]) -> Float[ndarray, "..."]:
        """Return the integral of f from 0 to y."""
        return np.asarray(self._area(y) - self._area(np.zeros_like(y)))

    @cached_property
    def _areas(self) -> ndarray:
        means = (self.values[1:] + self.values[:-1]) / 2
        return np.append(0.0, np.cumsum(means * np.diff(self.knots)))

    def _area(self, y: ndarray) -> ndarray:
        """Return the integral from the first knot."""
        k = self._pieces(y)
        way = y - self.knots[k]
        return np.asarray(self._areas[k] + way * (self.values[k] + self.slopes[k] * way / 2))


def lookup_table(knots: ArrayLike, values: ArrayLike) -> str:
    """Return the expression of a table: `pwl(x; knot: value, …)`, to stand wherever a function of a model may.

    It is linear between the knots, and goes on beyond them with the slopes of its first and last piece: repeat a value
    at the end for one that stays. Numbers are written so that they are read back exactly.

    >>> import persid as ps
    >>> ps.lookup_table([-1, 0, 2], [-0.5, 0, 0])
    'pwl(x; -1: -0.5, 0: 0, 2: 0)'

    Raises:
        ModelError: lengths differ, the knots do not rise, a number is not finite, or there are fewer than 2 knots or
            more than the 64 that a file may have.
    """
    t, v = np.asarray(knots, float), np.asarray(values, float)
    if t.ndim != 1 or t.shape != v.shape:
        raise ModelError(f"knots have shape {t.shape} and values {v.shape}; needed is one value a knot")
    if not 2 <= len(t) <= MAX_KNOTS:
        raise ModelError(f"{len(t)} knots; a table has 2 to {MAX_KNOTS}: keep those where the slope changes")
    if not (np.isfinite(t).all() and np.isfinite(v).all() and (np.diff(t) > 0).all()):
        raise ModelError("every knot and value must be finite, and every knot larger than the one before")
    return f"pwl(x; {', '.join(f'{_short(a)}: {_short(b)}' for a, b in zip(t, v, strict=True))})"


def _short(number: float) -> str:
    """Return the shortest text that is read back as the same binary64."""
    return repr(float(number) + 0.0).removesuffix(".0")


def read_table(text: str) -> LookupTable | None:
    """Return the table that an expression is, None where it is another function or none at all."""
    if not text.lstrip().startswith(WORD):
        return None
    try:
        table = table_of(text)
    except ExpressionError:
        return None
    return None if table is None else LookupTable.of(table)
