"""Bias: whether noise has moved the coefficients of least squares, as instruments tell.

With theta of least squares and theta~ of instruments (`instruments`), over the same short windows, a' (theta - theta~)
is 0 but for chance where the columns of a window know nothing of its noise. The direction a = X'X_i, X_i the integral
of the equation's own state, is the one along which noise works: what a window adds to x_i stands in that integral, too.
Its size over its spread from block to block is Student's t (Hausman's test, 1978, in one direction).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy import stats

from persid.errors import UnderdeterminedError
from persid.identification.estimates import Dictionary, estimate, windows_of
from persid.identification.windows import WITH_INSTRUMENTS, choose_window
from persid.measurements.recordings import Measurements, beginnings
from persid.models.model import PersidskiiModel

DOUBT = 0.01  # a test sees with about this probability what is not there
MATTERS = 0.05  # of the size of x': a smaller one does not matter
SAMPLES, RUNS = 20_000, 20  # of the beginnings that are looked at
COLUMNS = 60  # more are not compared


@dataclass(frozen=True, eq=False)
class Bias:
    """In which equations noise has moved least squares, and by what share of the size of x' (root mean square)."""

    found: Bool[ndarray, " n"]
    size: Float[ndarray, " n"]

    def remark(self, states: Sequence[str]) -> tuple[str, ...]:
        """Return what there is to say, with what to do."""
        if not self.found.any():
            return ()
        names = ", ".join(name for name, mine in zip(states, self.found, strict=True) if mine)
        share = f"{100 * self.size[self.found].max():.0f} %"
        return (
            f"noise that acts on the plant, or a sensor's, has moved what is fitted to the derivative of {names} by "
            f"about {share} of its size, and longer records do not mend that: fit with instruments=True",
        )


def noise_bias(data: Measurements, model: PersidskiiModel, free: Bool[ndarray, " n"], hold: str) -> Bias | None:
    """Return the bias of least squares for the functions of a model; None where the data are too few to tell."""
    phi = Dictionary(model)
    if phi.size > COLUMNS or not free.any():
        return None
    runs, window = beginnings(data, SAMPLES, RUNS), choose_window(data, WITH_INSTRUMENTS)
    used = np.tile(free, (phi.size, 1))
    try:
        windows = windows_of(runs, phi, window, hold, True)
        theirs, mine = estimate(windows, used), estimate(replace(windows, Z=windows.X), used)
    except UnderdeterminedError:
        return None
    X, moved = windows.X, mine.theta - theirs.theta
    change = np.einsum("kp,pn,kn->n", X, moved, X[:, : model.n])
    spread = np.einsum("nbp,kp,kn->nb", mine.influence - theirs.influence, X, X[:, : model.n], optimize=True)
    error = np.sqrt((spread**2).sum(axis=1) * windows.blocks / (windows.blocks - 1))
    size = np.linalg.norm(X @ moved, axis=0) / np.maximum(np.linalg.norm(X @ theirs.theta, axis=0), 1e-300)
    quantile = stats.t.ppf(1 - DOUBT / 2 / free.sum(), windows.blocks - 1)
    return Bias(free & (np.abs(change) > quantile * error) & (size > MATTERS), size)
