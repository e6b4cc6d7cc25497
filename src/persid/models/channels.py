"""models.channels."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.models.functions import ScalarFunction
from persid.models.sparse import Sparse


@dataclass(frozen=True, eq=False)
class Term:
    """One term A f(R (x - x_ref)); `f` has one function per row of R, and R = None is the identity."""

    f: tuple[ScalarFunction, ...]
    R: Float[ndarray, "k n"] | Sparse | None
    A: Float[ndarray, "n k"] | Sparse

    def arguments(self, dx: Float[ndarray, "*N n"]) -> Float[ndarray, "*N k"]:
        """Return R dx."""
        return dx if self.R is None else dx @ self.R.T

    def values(self, dx: Float[ndarray, "*N n"]) -> Float[ndarray, "*N k"]:
        """Return f(R dx)."""
        return self._apply("value", self.arguments(dx))

    def derivatives(self, dx: Float[ndarray, "*N n"]) -> Float[ndarray, "*N k"]:
        """Return f'(R dx)."""
        return self._apply("derivative", self.arguments(dx))

    def _apply(self, what: str, y: ndarray) -> ndarray:
        if len(set(self.f)) == 1:
            return getattr(self.f[0], what)(y)
        return np.stack([getattr(f, what)(y[..., k]) for k, f in enumerate(self.f)], axis=-1)


@dataclass(frozen=True, eq=False)
class Channels:
    """The scalar channels of a model, linear terms merged: x' = A0 dx + sum_c columns[:, c] f_c(rows[c] dx) + ..."""

    A0: Float[ndarray, "n n"]
    rows: Float[ndarray, "c n"]
    columns: Float[ndarray, "n c"]
    functions: tuple[ScalarFunction, ...]
