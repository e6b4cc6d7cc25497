"""Polish: a fit under the certificate, moved on to the least error of its free runs, always under the certificate.

The regression weighs equations, sample by sample; what counts is how far the model's own runs stray. Their errors r(w)
over pieces of the data are least squares as well, and Gauss and Newton's quadratic of them takes the regression's place
in the descent, held near the current coefficients by the regression's matrix (Levenberg and Marquardt):

    f(v) = n |r + J (v - w)|^2 / (2 |r|^2) + damping (v - w)'M (v - w) / 2

M is made smaller where the regression is so sure that it would hold all coefficients still, as one is that has nothing
left to explain (EDMD with as many columns as its model has).

Noise in a regressor, which draws regressions towards wrong and often unstable coefficients, does no such harm here.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from persid.certified_fits.bilinear import Fit, Point
from persid.certified_fits.descent import descend
from persid.certified_fits.joint_problem import Frame
from persid.identification.refinement import Pieces

MOST_COEFFICIENTS = 300  # the errors' derivatives by more of them take too long
ROUNDS = 12
STEPS = 60  # of one round's descent
DAMPING = 0.1  # at first
EASED, HARDENED = 0.2, 10.0  # factors of the damping after a round that lowers the error, and after one that does not
MOST_DAMPING = 1e3
GAIN = 0.005  # share of the squared error that a round has to gain for another one to follow


@dataclass(frozen=True, eq=False)
class _Place:
    """A strictly feasible point with the errors of its free runs, and their derivatives by its coefficients."""

    point: Point
    errors: Float[ndarray, " r"]
    slopes: Float[ndarray, "r K"]

    @property
    def cost(self) -> float:
        """The sum of the squared errors."""
        return float(self.errors @ self.errors)

    def weight(self, M: Float[ndarray, "K K"], n: int) -> float:
        """Return the largest share by which the errors weigh a coefficient, compared with a regression of matrix M."""
        return float(n / self.cost * ((self.slopes**2).sum(axis=0) / np.maximum(np.diag(M), 1e-300)).max())

    def quadratic(self, damping: float, M: Float[ndarray, "K K"], n: int) -> Fit:
        """Return the quadratic that the next descent minimises."""
        scale = n / self.cost
        H = scale * (self.slopes.T @ self.slopes) + damping * M
        g = scale * (self.slopes.T @ self.errors)
        size = 1 / np.sqrt(np.maximum(np.diag(H), 1e-300))
        move = size * np.linalg.lstsq(H * size * size[:, None], size * g, rcond=1e-12)[0]
        return Fit(H, self.point.w - move)


def polish(
    frame: Frame, point: Point, pieces: Pieces, left: Callable[[], float], rounds: int = ROUNDS
) -> tuple[Point, ...]:
    """Return strictly feasible points of falling free-run error, the best one first and without the given one.

    `left` tells the seconds that are left. Frames of more than 300 unknown coefficients are left as they are.
    """
    if len(point.w) > MOST_COEFFICIENTS:
        return ()
    moved, free = _moved(frame)
    basis, n = frame.gram.basis, frame.gram.H.shape[1]

    def place(at: Point) -> _Place:
        errors, slopes = pieces.slopes(basis, frame.theta(at.w), free)
        return _Place(at, errors, slopes @ moved)

    here, damping, found = place(point), DAMPING, []
    if not here.cost > 0:
        return ()
    M = frame.fit.M * min(1.0, here.weight(frame.fit.M, n))
    for _ in range(rounds):
        if left() <= 0 or damping > MOST_DAMPING or not here.cost > 0:
            break
        aim = here.quadratic(damping, M, n)
        end = descend(frame.inequality, aim, here.point, tolerance=1e-2, time_limit=left(), steps=STEPS).point
        if end is None:
            break
        errors = pieces.errors(basis, frame.theta(end.w))
        gain = 1 - float(errors @ errors) / here.cost
        damping *= EASED if gain > 0 else HARDENED
        if gain > 0:
            found.append(end)
            if gain < GAIN:
                break
            here = place(end)
    return tuple(reversed(found))


def _moved(frame: Frame) -> tuple[Float[ndarray, "k K"], Int[ndarray, " k"]]:
    """Return how the coefficients depend on the unknowns, and the flat numbers of those that do."""
    K = len(frame.fit.w0)
    still = frame.theta(np.zeros(K))
    slopes = np.stack([(frame.theta(unit) - still).ravel() for unit in np.eye(K)], axis=1)
    free = np.flatnonzero(np.abs(slopes).any(axis=1))
    return slopes[free], free
