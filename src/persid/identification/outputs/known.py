"""Coefficients of measured states that are known, kept while a fit goes on, and exact in what is delivered."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from persid.errors import DataError
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.least_squares import Batch, Parameters, beside, slopes_of
from persid.identification.outputs.records import Scales
from persid.models.stable_fit import StableFit

NEURONS = "f"  # the name of the column of all neurons together; what they add can only be known to be nothing


@dataclass(frozen=True, eq=False)
class Known:
    """Hold the known entries of G = (C A C^+, C B, C A1): the rates of measured states by themselves, inputs, neurons.

    C are the rows of the measured outputs. With y = C x + d and N a basis of what C does not see, x = C^+ (y - d) +
    N'z, so these are the columns of y, u and f in y' = C A x + C A1 f + C B u + C b. `mask` says which are known.
    """

    rows: Int[ndarray, " k"]
    values: Float[ndarray, "k c"]
    mask: Bool[ndarray, "k c"]

    @classmethod
    def of(
        cls, fixed: Mapping[tuple[str, str], float | int], measured: Sequence[str], outputs: Sequence[str],
        inputs: Sequence[str], neurons: int,
    ) -> "Known":  # fmt: skip
        """Return the entries that {(state, column): number} names; columns are measured states, inputs, or "f".

        Raises:
            DataError: a state is not measured, a column is unknown, or neurons are to add something known.
        """
        columns, k = [*measured, *inputs, NEURONS], len(measured)
        values, mask = np.zeros((k, len(columns))), np.zeros((k, len(columns)), bool)
        for (state, column), number in fixed.items():
            if state not in measured or column not in columns:
                raise DataError(
                    f"fixed= names ({state!r}, {column!r}); states are those of measured= ({', '.join(measured)}), "
                    f"columns {', '.join(columns)}"
                )
            if column == NEURONS and number != 0:
                raise DataError(f"fixed= has {number} for ({state!r}, {NEURONS!r}); what neurons add can only be 0")
            place = list(measured).index(state), columns.index(column)
            values[place], mask[place] = float(number), True
        every = np.r_[np.arange(len(columns) - 1), np.full(neurons, len(columns) - 1)]
        return cls(np.array([list(outputs).index(name) for name in measured], int), values[:, every], mask[:, every])

    def in_standard_units(self, scales: Scales, dt: float) -> "Known":
        """Return the same entries per sample, in standard units."""
        y = scales.y_scale[self.rows]
        neurons = np.ones(self.values.shape[1] - len(y) - len(scales.u_scale))
        return replace(self, values=self.values * dt * np.concatenate([y, scales.u_scale, neurons]) / y[:, None])

    def missed(self, latent: Latent) -> Float[ndarray, "K e"]:
        """Return by how much every model misses the known entries."""
        one = latent.in_activations()
        C = one.C[:, self.rows]
        G = C @ np.concatenate([one.A @ np.linalg.pinv(C), one.B, one.A1], 2)
        return np.asarray((G - self.values)[:, self.mask])

    def put_in(self, fit: StableFit) -> StableFit:
        """Return a fit whose first states are the measured ones, with the known entries exactly so."""
        k, m = len(self.rows), fit.B.shape[1]
        A, B, A1 = fit.A.copy(), fit.B.copy(), fit.A1.copy()
        parts = np.split(self.values, [k, k + m], 1), np.split(self.mask, [k, k + m], 1)
        for matrix, values, mask in zip((A[:k, :k], B[:k], A1[:k]), *parts, strict=True):
            matrix[mask] = values[mask]
        return replace(fit, A=A, B=B, A1=A1)


@dataclass(frozen=True, eq=False)
class Kept:
    """Keep known entries by their squares, of this weight: a term of a fit."""

    known: Known
    weight: float

    def cost(self, parameters: Parameters, batch: Batch) -> Float[ndarray, " K"]:
        """Return weight |missed|^2 / 2."""
        return np.asarray(self.weight / 2 * (self.known.missed(parameters.latent(batch)[0]) ** 2).sum(1))

    def pull(self, parameters: Parameters, batch: Batch) -> tuple[Float[ndarray, "K p"], Float[ndarray, "K p p"]]:
        """Return gradient and Gauss-Newton form, by differences."""
        missed, forms, pulls = self.known.missed(parameters.latent(batch)[0]), [], []
        for k, gap in enumerate(missed):
            moved, h = beside(batch, k)
            slopes = slopes_of(self.known.missed(parameters.latent(moved)[0]), h)
            forms.append(self.weight * slopes @ slopes.T)
            pulls.append(self.weight * slopes @ gap)
        return np.array(pulls), np.array(forms)
