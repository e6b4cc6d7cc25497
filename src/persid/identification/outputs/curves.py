"""Learned curves of neurons: slopes between 0 and 1 by parameters without bounds, one curve for all or one for each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.models.learned_curves import marks

FLATTEST = 1e-4  # least slope, and what the largest stays below 1: more than rounding adds to the slopes of a table


def first_slopes(pieces: int) -> Float[ndarray, " k"]:
    """Return those of the chords of tanh, from which curves begin."""
    if not pieces:
        return np.zeros(0)
    t = marks(pieces)
    return np.asarray(np.diff(np.tanh(t)) / np.diff(t))


@dataclass(frozen=True)
class Curves:
    """Say how many neurons and pieces there are, and whether all neurons share one curve.

    A slope is a + (1 - 2 a) / (1 + exp(-c)), with a = FLATTEST and c its parameter: any curve of slopes in (0, 1) has
    the proof of its neurons, which knows no more of them.
    """

    neurons: int = 0
    pieces: int = 0
    shared: bool = False

    @property
    def size(self) -> int:
        """Number of parameters."""
        return self.pieces * (min(self.neurons, 1) if self.shared else self.neurons)

    def slopes(self, c: Float[ndarray, "K p"]) -> tuple[Float[ndarray, "K q k"], Float[ndarray, "K p e"]]:
        """Return the slopes of every neuron, and the derivatives of all these entries by the parameters."""
        K, q, k, e = len(c), self.neurons, self.pieces, self.neurons * self.pieces
        share, own = (1 + np.tanh(c / 2)) / 2, np.arange(e) % max(self.size, 1)
        F = FLATTEST + (1 - 2 * FLATTEST) * share[:, own]
        D = np.zeros((K, self.size, e))
        D[:, own, np.arange(e)] = (1 - 2 * FLATTEST) * (share * (1 - share))[:, own]
        return F.reshape(K, q, k), D

    def parameters(self, F: Float[ndarray, "K q k"]) -> Float[ndarray, "K p"]:
        """Return the parameters of slopes, those of the first neuron where all share one curve."""
        share = np.clip((F.reshape(len(F), -1)[:, : self.size] - FLATTEST) / (1 - 2 * FLATTEST), 1e-6, 1 - 1e-6)
        return np.asarray(np.log(share / (1 - share)))


NONE = Curves()
