"""Bounded noise: what coefficients the measurements allow, by linear programmes, without any statistics.

A measured state is off by at most v_i. Then a window's move is off by at most 2 v_i, and its integral of F by at most
the integral of |J| v, to first order, and by the error of the quadrature: |y_ik - theta_i'X_k| <= e_ik. That error is
taken for at most what Simpson's rule and the trapezoids differ by, h/6 |F_0 - 2 F_1 + F_2| a pair of steps: that it is
where an input jumps at the middle sample, and less where F is smooth. Short windows see how F varies, long ones are
moved less by noise; each inequality holds, so windows of several lengths stand side by side. At a point phi the value
theta_i'phi lies between the smallest and the largest one that they allow: two linear programmes a point and equation.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy import ndarray
from scipy.optimize import linprog

from persid.errors import DataError
from persid.identification.estimates import LONGEST, Dictionary
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.model import PersidskiiModel

POINTS = 60  # of those offered at which the programmes are solved
LENGTHS = (2, 8, 32, 128)  # of windows, in steps
ROWS = 200  # windows of each length that enter them


@dataclass(frozen=True, eq=False)
class Places:
    """States and inputs at which a band is looked at, and the columns phi of the dictionary there."""

    x: Float[ndarray, "N n"]
    u: Float[ndarray, "N m"]
    phi: Float[ndarray, "N p"]


def bounded_band(
    data: Trajectories, hold: str, used: Bool[ndarray, "p n"], bound: Float[ndarray, " n"], phi: Dictionary,
    places: Places,
) -> tuple[Int[ndarray, " K"], Float[ndarray, "K n"]]:  # fmt: skip
    """Return which of the places were looked at, and how far theta'phi can be from the model there.

    Raises:
        DataError: no coefficients are within the bounds: the noise is larger, or functions are missing.
    """
    x, u, model = places.x, places.u, phi.model
    slopes = np.abs([model.jacobian(point) for point in x[:: max(1, len(x) // 200)]]).max(axis=0)
    X, y, quadrature = _rows(data, hold, phi)
    error = 2 * bound + X[:, -1:] * (slopes @ bound) + quadrature
    at = np.unique(np.linspace(0, len(x) - 1, POINTS).astype(int))
    away, F, columns = np.zeros((len(at), model.n)), model.rhs(x[at], u[at]), places.phi[at]
    for i in np.flatnonzero(used.any(axis=0)):
        own = used[:, i]
        scale = np.maximum(np.abs(X[:, own]).max(axis=0), 1e-300)
        A = np.vstack([X[:, own], -X[:, own]]) / scale
        b = np.concatenate([y[:, i] + error[:, i], error[:, i] - y[:, i]])
        for k in range(len(at)):
            ends = [_least(sign * columns[k, own] / scale, A, b, model.states[i]) for sign in (1.0, -1.0)]
            away[k, i] = max(F[k, i] - ends[0], -ends[1] - F[k, i])
    return at, away


def _rows(data: Trajectories, hold: str, phi: Dictionary) -> tuple[ndarray, ndarray, ndarray]:
    """Return integrals of the columns over windows of every length, the moves, and how far the integral of F is off."""
    parts = []
    for window in LENGTHS:
        runs = [run[:LONGEST] for run in data if len(run) > window]
        count = sum(len(run) - window for run in runs)
        for run in runs:
            share = max(1, ROWS * (len(run) - window) // count)
            chosen = np.unique(np.linspace(0, len(run) - window - 1, share).astype(int))
            X, y = phi.integrals(run, window, hold), run.x[window:] - run.x[:-window]
            parts.append((X[chosen], y[chosen], _quadrature(run, phi.model, window)[chosen]))
    X, y, quadrature = (np.concatenate(side) for side in zip(*parts, strict=True))
    return X, y, quadrature


def _quadrature(run: Trajectory, model: PersidskiiModel, window: int) -> Float[ndarray, "K n"]:
    """Return how far the integral of F over each window may be off."""
    bends = np.abs(np.diff(model.rhs(run.x), 2, axis=0)) * (run.t[2:] - run.t[:-2])[:, None] / 12
    return np.asarray(np.lib.stride_tricks.sliding_window_view(bends, window - 1, axis=0)[:, :, ::2].sum(axis=2))


def _least(c: Float[ndarray, " q"], A: Float[ndarray, "r q"], b: Float[ndarray, " r"], name: str) -> float:
    found = linprog(c, A_ub=A, b_ub=b, bounds=(None, None), method="highs")
    if found.status == 3:  # unbounded: the data say nothing in this direction
        return -np.inf
    if found.fun is None:
        raise DataError(
            f"no coefficients of {name} explain the data within such noise: raise bound=, or give other functions"
        )
    return float(found.fun)
