"""Instruments: earlier windows tell of the columns of a window what its own noise has no part in.

    x(t_{k+q}) - x(t_k) = theta' X_k + e_k

Least squares is biased where X_k knows e_k: measurement noise stands in both, and noise that acts on the plant moves
the states inside the window (symmetric sums telescope to Stratonovich's integral: damping goes to 0), however long the
record. What ended before the window, Z_k, knows nothing of noise without a memory. So, in two stages,

    X^ = Z (Z'Z)^+ Z'X,     theta = (X^'X^)^+ X^'y:     G = X^'X^ = X'Z (Z'Z)^+ Z'X,     H = X^'y = X'Z (Z'Z)^+ Z'y.

Sums of Z'[Z, X, y] add, as those of least squares do.
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

RESOLVED = 1e-12  # share of the largest eigenvalue of Z'Z below which a combination of instruments is left out


def lag(window: int) -> int:
    """Return by how many samples an earlier window begins before a later one: end to end they would share a sample."""
    return window + 1


def earlier(
    X: Float[ndarray, "K p"], states: Sequence[int], inputs: int, window: int
) -> tuple[Float[ndarray, "L z"], Float[ndarray, "L p"]]:
    """Return instruments, and the columns that they are for: of all windows X but those that have no two before them.

    Instruments are the columns of states of the window before, the columns `states` of the one before that, the
    `inputs` of the window itself, and the constant. Those of the second window are more than are needed: they tell
    whether all instruments say the same.
    """
    q, p = lag(window), X.shape[1] - inputs - 1
    last = max(len(X) - 2 * q, 0)
    first, second, own = X[:last], X[q : q + last], X[2 * q :]
    return np.hstack([second[:, :p], first[:, list(states)], own[:, p:]]), own


def two_stages(products: Float[ndarray, "z _"], p: int) -> tuple[Float[ndarray, "p p"], Float[ndarray, "p n"]]:
    """Return G and H of the second stage from Z'[Z, X, y], X of p columns."""
    z = len(products)
    size = np.sqrt(np.maximum(np.diag(products), np.finfo(float).tiny))
    e, V = np.linalg.eigh(products[:, :z] / np.outer(size, size))
    good = e > RESOLVED * e.max(initial=0.0)
    root = (V[:, good] / np.sqrt(e[good])).T @ (products[:, z:] / size[:, None])
    return root[:, :p].T @ root[:, :p], root[:, :p].T @ root[:, p:]
