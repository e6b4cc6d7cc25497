"""Learned functions that only rise or only fall: least squares in slopes, each piece's slope with a bound at 0."""

from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import lsq_linear

from persid.identification.basis import Basis
from persid.identification.gram import Gram


def of_one_sign(gram: Gram, theta: Float[ndarray, "p n"], ridge: float) -> Float[ndarray, "p n"]:
    """Return the ridge fit in which the slopes of every learned function, its linear part added, have one sign.

    Which one is that of their mean in the fit `theta` without the condition; pieces hold equal shares of the data.
    """
    found, last = theta.copy(), np.arange(len(theta)) == len(theta) - 1
    for i in range(theta.shape[1]):
        used = np.flatnonzero((gram.structure.parameter[:, i] >= 0) & ((gram.weights > 0) | last))
        if len(used):
            found[used, i] = _equation(gram, theta[:, i], ridge, i, used)
    return found


def _equation(gram: Gram, theta: ndarray, ridge: float, i: int, used: ndarray) -> ndarray:
    """Minimise sum (y - phi'theta)^2 / rows + ridge sum (weight theta)^2 (the constant's weight is 0), slopes bounded.

    With T from slopes p to coefficients the terms are |L'T p - L^-1 h|^2 for L L' = C + ridge W^2 (Cholesky).
    """
    T = _from_slopes(gram.basis)[np.ix_(used, used)]
    C = gram.G[np.ix_(used, used)] / gram.rows + ridge * np.diag(gram.weights[used] ** 2)
    scale = 1 / np.sqrt(np.diag(C))
    root = np.linalg.cholesky(scale[:, None] * C * scale + 1e-14 * np.eye(len(used))).T / scale
    target = np.linalg.solve(root.T, gram.H[used, i] / gram.rows)
    slopes = np.linalg.solve(T, theta[used])
    low, high = np.full(len(used), -np.inf), np.full(len(used), np.inf)
    for pieces in _pieces(gram.basis, used):
        (low if slopes[pieces].mean() >= 0 else high)[pieces] = 0.0
    answer: Any = lsq_linear(root @ T, target, (low, high), method="bvls")
    return np.asarray(T @ answer.x)


def _from_slopes(basis: Basis) -> Float[ndarray, "p p"]:
    """Return the matrix from the slopes of all pieces to coefficients: beside x, that of a ramp is what exceeds x's.

    Both are in the argument y = (x - x_ref) / scale, so x itself has the slope theta * scale.
    """
    T = np.eye(basis.size)
    for place, state, ramps in _learned(basis):
        if place is not None:
            T[place, place] = 1 / basis.scale[state]
            T[ramps, place] = -1.0
    return T


def _pieces(basis: Basis, used: ndarray) -> list[ndarray]:
    """Return, for each state with a learned function, the places of its slopes among the columns that are used."""
    every = [np.array([*ramps, *([] if place is None else [place])]) for place, _, ramps in _learned(basis)]
    return [places for one in every if len(places := np.flatnonzero(np.isin(used, one)))]


def _learned(basis: Basis) -> list[tuple[int | None, int, list[int]]]:
    """Return the place of the linear column (None: there is none), the state and the places of ramps, by states."""
    found = []
    for state in range(len(basis.states)):
        mine = [(k, c) for k, c in enumerate(basis.columns) if c.state == state]
        ramps = [k for k, c in mine if c.kind == "function" and (f := basis.terms[c.term][state]) and f.table]
        if ramps:
            found.append((next((k for k, c in mine if c.kind == "linear"), None), state, ramps))
    return found
