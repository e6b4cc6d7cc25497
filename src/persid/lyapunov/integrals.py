"""Constants of sector forms that bound their integrals: what rates, gains and regions need.

For a form l of a curve phi,  (d/2) y^2 <= integral of l'phi from 0 to y <= c y l'phi(y)  on the domain. Both constants
are estimated here on samples, moved to the safe side, rounded to dyadics, and believed only when the checker
proves them.
"""

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid.lyapunov.sectors import Curve

LARGEST = 64.0  # a form with a larger c is no density worth having
ABOVE = 1 / 64  # relative distance of c from what the samples show
BELOW = 1 / 1024  # of d, on which faces of regions stand
SLOWLY = 0.75  # share to which a rise may fall from octave to octave for a limit not to be believed
UP, DOWN = 2.0**-10, 2.0**-12  # steps of c, and of d within its power of two


def upper_constants(curve: Curve, forms: Float[ndarray, "K d"]) -> Float[ndarray, " K"]:
    """Return c for each form, NaN where none up to LARGEST is seen; 1/2 exactly for multiples of y.

    A ratio that rises to the end has the bound 1 of forms that do not fall, or none.
    """
    y, phi, integral = _sampled(curve)
    with np.errstate(all="ignore"):
        ratio = (integral @ forms.T) / (y[:, None] * (phi @ forms.T))
        c = np.ceil(np.nanmax(ratio, axis=0, initial=0.0) * (1 + ABOVE) / UP) * UP
        if curve.domain is None:
            rises = np.any([_rises(np.abs(y[side]), ratio[side]) for side in (y > 0, y < 0)], axis=0)
            c = np.where(rises, np.where(c <= 1 + ABOVE, 1.0, np.nan), c)
    c = np.where(np.isfinite(c) & (c <= LARGEST), c, np.nan)
    return np.where((forms[:, 1:] == 0).all(axis=1), 0.5, c)


def _rises(y: Float[ndarray, " N"], ratio: Float[ndarray, "N K"]) -> Bool[ndarray, " K"]:
    """Whether a ratio still rises as a logarithm does at the last sample, by as much from y/2 to y as from y/4 to y/2.

    Of y / (1 + y^2) the integral is log(1 + y^2) / 2, where y times it stays below 1.
    """
    if not len(y):
        return np.zeros(ratio.shape[1], bool)
    before, middle, last = (ratio[np.searchsorted(y, share * y[-1])] for share in (0.25, 0.5, 1.0))
    return np.asarray((last - middle > SLOWLY * (middle - before)) & (last - middle > ABOVE / 16 * last))


def lower_constants(curve: Curve, forms: Float[ndarray, "K d"]) -> Float[ndarray, " K"]:
    """Return d >= 0 for each form."""
    y, _, integral = _sampled(curve)
    with np.errstate(all="ignore"):
        ratio = np.nanmin(2 * (integral @ forms.T) / y[:, None] ** 2, axis=0, initial=np.inf)
    ratio = np.where(np.isfinite(ratio), ratio, 0.0)
    size = np.exp2(np.floor(np.log2(np.maximum(ratio, 1e-300))))
    worth = ratio > 1e-2 * np.abs(forms).max(axis=1)
    return np.where(worth, np.floor(ratio * (1 - BELOW) / size / DOWN) * DOWN * size, 0.0)


def _sampled(curve: Curve, count: int = 800) -> tuple[ndarray, ndarray, ndarray]:
    """Return y, phi(y) and the integral of phi from 0 to y on both sides of 0, where the values stay moderate."""
    nodes, weights = np.polynomial.legendre.leggauss(6)
    low, high = (1e6, 1e6) if curve.domain is None else (-float(curve.domain[0]), float(curve.domain[1]))
    sides = []
    for sign, end in ((1.0, high), (-1.0, low)):
        y = sign * np.concatenate([[0.0], np.geomspace(min(1e-3, 1e-3 * end), end, count)])
        middle, half = (y[1:] + y[:-1]) / 2, np.diff(y) / 2
        with np.errstate(all="ignore"):
            inner = curve.values((middle[:, None] + half[:, None] * nodes).ravel())
            pieces = np.einsum("kqd,q->kd", inner.reshape(count, len(nodes), curve.size), weights)
            integral = np.cumsum(pieces * half[:, None], axis=0)
            phi = curve.values(y[1:])
        usable = (np.abs(phi) < 1e100).all(axis=1) & np.isfinite(integral).all(axis=1)
        sides.append((y[1:][usable], phi[usable], integral[usable]))
    y, phi, integral = (np.concatenate(parts) for parts in zip(*sides, strict=True))
    return y, phi, integral
