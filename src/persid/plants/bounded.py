"""Bounded noise: what coefficients the measurements allow, by linear programmes, without any statistics.

A measured state is off by at most v_i. Then a window's move is off by at most 2 v_i, and its integral of F by at most
the integral of |J| v, to first order (and but for the error of the quadrature): |y_ik - theta_i'X_k| <= e_ik. At a
point phi the value theta_i'phi lies between the smallest and the largest one that these inequalities allow: two linear
programmes a point and equation.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.optimize import linprog

from persid.errors import DataError
from persid.identification.estimates import Windows
from persid.models.model import PersidskiiModel

POINTS = 60  # of those offered at which the programmes are solved
ROWS = 600  # windows that enter them


@dataclass(frozen=True, eq=False)
class Places:
    """States and inputs at which a band is looked at, and the columns phi of the dictionary there."""

    x: Float[ndarray, "N n"]
    u: Float[ndarray, "N m"]
    phi: Float[ndarray, "N p"]


def bounded_band(
    windows: Windows, used: Bool[ndarray, "p n"], bound: Float[ndarray, " n"], model: PersidskiiModel, places: Places
) -> tuple[Int[ndarray, " K"], Float[ndarray, "K n"]]:
    """Return which of the places were looked at, and how far theta'phi can be from the model there.

    Raises:
        DataError: no coefficients are within the bounds: the noise is larger, or functions are missing.
    """
    x, u = places.x, places.u
    chosen = np.unique(np.linspace(0, len(windows.y) - 1, ROWS).astype(int))
    X, y = windows.X[chosen], windows.y[chosen]
    slopes = np.abs([model.jacobian(point) for point in x[:: max(1, len(x) // 200)]]).max(axis=0)
    error = 2 * bound + X[:, -1:] * (slopes @ bound)
    at = np.unique(np.linspace(0, len(x) - 1, POINTS).astype(int))
    away, F, phi = np.zeros((len(at), model.n)), model.rhs(x[at], u[at]), places.phi[at]
    for i in np.flatnonzero(used.any(axis=0)):
        own = used[:, i]
        scale = np.maximum(np.abs(X[:, own]).max(axis=0), 1e-300)
        A = np.vstack([X[:, own], -X[:, own]]) / scale
        b = np.concatenate([y[:, i] + error[:, i], error[:, i] - y[:, i]])
        for k in range(len(at)):
            ends = [_least(sign * phi[k, own] / scale, A, b, model.states[i]) for sign in (1.0, -1.0)]
            away[k, i] = max(F[k, i] - ends[0], -ends[1] - F[k, i])
    return at, away


def _least(c: Float[ndarray, " q"], A: Float[ndarray, "r q"], b: Float[ndarray, " r"], name: str) -> float:
    found = linprog(c, A_ub=A, b_ub=b, bounds=(None, None), method="highs")
    if found.status == 3:  # unbounded: the data say nothing in this direction
        return -np.inf
    if found.fun is None:
        raise DataError(
            f"no coefficients of {name} explain the data within such noise: raise bound=, or give other functions"
        )
    return float(found.fun)
