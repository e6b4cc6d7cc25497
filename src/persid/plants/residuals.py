"""Residuals: how far the measurements are from what a model says of x', window by window.

Over a window of length T the mean of g = x' - F(x, u) is (x(t + T) - x(t) - ∫F) / T: what the plant does beyond the
model there, with the noise of two measurements over T. Where |g| <= delta |x - x*| + epsilon at each time, the mean is
at most delta times the mean distance, plus epsilon; so each window is set against that.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certificates.margin import Margin
from persid.identification.estimators.weak import integrate
from persid.identification.windows import choose_window
from persid.measurements.recordings import Measurements, beginnings
from persid.models.model import PersidskiiModel

LONGEST = 20_000  # samples of a run that are looked at
MOST_RUNS = 40
LOW = 0.5  # a smaller share inside is no basis for speaking of the plant


@dataclass(frozen=True, eq=False)
class Measured:
    """Residuals |g / width| (1/s) and distances |(x - x*) / width| of windows that do not overlap, `seconds` long."""

    distance: Float[ndarray, " K"]
    size: Float[ndarray, " K"]
    seconds: float

    def share(self, delta: float, epsilon: float = 0.0) -> float:
        """Return the share of the windows with |g| <= delta |x - x*| + epsilon."""
        return float((self.size <= delta * self.distance + epsilon).mean()) if len(self.size) else 0.0

    def epsilon(self, delta: float, share: float = 0.95) -> float:
        """Return the smallest epsilon (1/s) with which this share of the windows is inside."""
        return max(0.0, float(np.quantile(self.size - delta * self.distance, share))) if len(self.size) else 0.0


def measured_residuals(model: PersidskiiModel, margin: Margin, data: Measurements, hold: str = "zoh") -> Measured:
    """Return the residuals of a certified model on measurements, in the units of its margin; known equations have none.

    Looked at are the beginnings of the first runs, up to 20,000 samples each.
    """
    window, x_star = choose_window(data), margin.certificate.operating_point
    free = np.array([name not in margin.known for name in model.states])
    distance, size, steps = [], [], []
    for run in beginnings(data, LONGEST, MOST_RUNS):
        if len(run) <= window:
            continue
        moved = np.empty((len(run) - window, model.n + model.m))
        integrate(run.t, model.rhs(run.x), run.u - model.u_ref, window, hold, moved)
        foretold = moved[:, : model.n] + moved[:, model.n :] @ model.B.T
        T = run.t[window:] - run.t[:-window]
        g = (run.x[window:] - run.x[:-window] - foretold) / T[:, None] / margin.width
        away = np.linalg.norm((run.x - x_star) / margin.width, axis=1)
        means = np.convolve(away, np.ones(window + 1) / (window + 1), "valid")
        distance.append(means[::window])
        size.append(np.linalg.norm(g[::window, free], axis=1))
        steps.append(T[::window])
    if not steps:
        return Measured(np.zeros(0), np.zeros(0), 0.0)
    return Measured(np.concatenate(distance), np.concatenate(size), float(np.median(np.concatenate(steps))))


def doubt(measured: Measured, margin: Margin) -> str | None:
    """Return in one clause that a certificate must not be read as one of the plant, where few residuals fit into it."""
    share = measured.share(margin.delta)
    if share >= LOW or not len(measured.size):
        return None
    return (
        f"only {100 * share:.0f} % of the measured residuals lie within the residual margin: the certificate must not "
        "be read as one of the plant"
    )


def inside(measured: Measured, margin: Margin) -> str:
    """Return in one clause how many of the measured residuals lie within a margin, and what all but 5 % need."""
    epsilon = measured.epsilon(margin.delta)
    return (
        f"{100 * measured.share(margin.delta):.0f} % of {len(measured.size)} windows of the measurements "
        f"({measured.seconds:.3g} s each) lie within it; with a constant part of {epsilon:.3g} 1/s, 95 %"
    )
