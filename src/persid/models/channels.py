"""models.channels."""

from dataclasses import dataclass

from jaxtyping import Float
from numpy import ndarray

from persid.models.functions import ScalarFunction, layer
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
        return layer(self.f).apply("value", self.arguments(dx))

    def derivatives(self, dx: Float[ndarray, "*N n"]) -> Float[ndarray, "*N k"]:
        """Return f'(R dx)."""
        return layer(self.f).apply("derivative", self.arguments(dx))


@dataclass(frozen=True, eq=False)
class Channels:
    """The scalar channels of a model, linear terms merged: x' = A0 dx + sum_c columns[:, c] f_c(rows[c] dx) + ..."""

    A0: Float[ndarray, "n n"]
    rows: Float[ndarray, "c n"]
    columns: Float[ndarray, "n c"]
    functions: tuple[ScalarFunction, ...]
