"""Deviations: a plant differs from its model by L w, of which only the size is known.

    x' = F(x, u) + L w(t),   |w|^2 <= |C zeta|^2 + epsilon^2,   zeta = (x - x*, channel values less those at x*, u - u*)

With half the gradient of V equal to E'z, V' gains 2 z'E L w; and with a multiplier s > 0 (the S-procedure)

    [ -Q - kappa W - s C'C   -E L ]
    [          .              s I ]  > 0    =>    V' <= -kappa V + s epsilon^2   for every such plant.

For one deviation and a given V the multiplier is no loss (Petersen's lemma). In the inequality s is one more unknown: a
weighted sum of pairs of the rows of C and of the unit rows of w. Specification: docs/ledger.md, sections 1 and 5.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid.errors import ModelError

NEGLIGIBLE = 1e-14  # share of the largest eigenvalue, in units of the diagonal, that is rounding


@dataclass(frozen=True, eq=False)
class Deviation:
    """L w with |w|^2 <= |C zeta|^2 + epsilon^2; zeta = (all states, all channels, inputs) of the model."""

    L: Float[ndarray, "n r"]
    C: Float[ndarray, "c Z"]
    epsilon: float = 0.0

    @classmethod
    def of_residual(
        cls, width: Float[ndarray, " n"], free: Bool[ndarray, " n"], delta: float, size: int, epsilon: float = 0.0
    ) -> "Deviation":
        """Return |g / width| <= delta |(x - x*) / width|, g in the equations that are `free`; zeta has `size` entries.

        The numbers delta / width are rounded up, so that the bound is at least what its delta says.
        """
        C = np.zeros((len(width), size))
        C[:, : len(width)] = np.diag(np.nextafter(delta / width, np.inf))
        return cls(np.diag(width)[:, np.flatnonzero(free)], C, epsilon)

    @classmethod
    def of_row(cls, i: int, n: int, S: Float[ndarray, "Z Z"]) -> "Deviation":
        """Return the ellipsoid of coefficients d with (d'zeta)^2 <= zeta'S zeta, S >= 0, of equation i of n."""
        unit = np.sqrt(np.diag(S))
        unit[unit == 0] = 1.0
        values, vectors = np.linalg.eigh(S / unit / unit[:, None])
        kept = values > values[-1] * NEGLIGIBLE
        C = (np.sqrt(values[kept])[:, None] * vectors[:, kept].T) * unit
        return cls(np.eye(n)[:, [i]], np.where(np.diag(S) > 0, C, 0.0))

    def times(self, rho: float) -> "Deviation":
        """Return the same with a bound that is rho times as large."""
        return replace(self, C=rho * self.C, epsilon=rho * self.epsilon)

    def columns(self, states: Sequence[int], channels: Sequence[int], inputs: int) -> Float[ndarray, "c N"]:
        """Return the columns of C at the entries (z, u - u*) of an inequality that holds these states and channels.

        Raises:
            ModelError: C reads another one.
        """
        n, size = len(self.L), self.C.shape[1]
        at = [*states, *(n + c for c in channels), *range(size - inputs, size)]
        if self.C[:, np.setdiff1d(np.arange(size), at)].any():
            raise ModelError("a deviation reads a state or a function that takes no part in the inequality")
        return self.C[:, at]
