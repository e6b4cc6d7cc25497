"""Rates of V and of the state, along solutions (kappa in 1/s) and in steps of dt (kappa the share that V loses)."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray


def fastest(J: Float[ndarray, "n n"], dt: float | None) -> float:
    """Return what no kappa exceeds: twice the decay rate of the linearisation, or its loss 1 - |z|^2 in a step.

    It is -inf where the linearisation is not finite.
    """
    if not np.isfinite(J).all():
        return -np.inf
    eigenvalues = np.linalg.eigvals(J)
    return -2 * float(eigenvalues.real.max()) if dt is None else 1 - float(np.abs(eigenvalues).max()) ** 2


def gentle(kappa: float, dt: float | None) -> float:
    """Return the kappa of half its rate, at which gains are about smallest: kappa/2, or 1 - sqrt(1 - kappa).

    Of x' = -a x + u the gain is 1/sqrt(kappa (2a - kappa)); of x+ = a x + u it is sqrt(r / ((r - a^2)(1 - r))) with
    r = 1 - kappa, smallest at r = a.
    """
    return 0.5 * kappa if dt is None else -float(np.expm1(0.5 * np.log1p(-kappa)))


def loss(rate: float, dt: float | None) -> float:
    """Return the kappa that goes with a rate of the state in 1/s: 2 rate, or 1 - exp(-2 rate dt) in a step."""
    return 2 * rate if dt is None else -float(np.expm1(-2 * rate * dt))
