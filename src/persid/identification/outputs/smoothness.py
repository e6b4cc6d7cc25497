"""Learned curves that are kept smooth while a fit goes on: slopes of neighbouring pieces pull at one another."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.outputs.least_squares import Batch, Parameters


@dataclass(frozen=True)
class Smooth:
    """Add weight / 2 sum (c_(j+1) - c_j)^2 to the cost, c the parameters of neighbouring slopes of every curve.

    Of the parameters, not the slopes: a slope near 0 or 1, where its parameter tells nothing more, is drawn back.
    """

    weight: float

    def cost(self, parameters: Parameters, batch: Batch) -> Float[ndarray, " K"]:
        """Return the term."""
        return np.asarray(self.weight / 2 * ((batch.w @ _rises(parameters).T) ** 2).sum(1))

    def pull(self, parameters: Parameters, batch: Batch) -> tuple[Float[ndarray, "K p"], Float[ndarray, "K p p"]]:
        """Return its gradient and Hesse matrix."""
        rises = _rises(parameters)
        form = self.weight * rises.T @ rises
        return batch.w @ form, np.repeat(form[None], len(batch.w), 0)


def _rises(parameters: Parameters) -> Float[ndarray, "r p"]:
    """Return the matrix from all parameters to the differences c_(j+1) - c_j."""
    every = np.eye(len(parameters.free))[parameters.learned]
    curves = every.reshape(-1, parameters.curves.pieces, len(parameters.free))
    return np.diff(curves, axis=1).reshape(-1, len(parameters.free))
