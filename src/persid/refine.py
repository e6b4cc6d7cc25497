"""Simulation-error refinement: least squares through the differential equation, from an already good fit."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.optimize import least_squares

from persid.basis import Basis
from persid.errors import DataError
from persid.freerun import box
from persid.gram import Gram
from persid.trajectories import Trajectories

PIECE = 100  # samples of one free run; its start is measured (multiple shooting without free starts)
MOST_PIECES = 40
MOST_PARAMETERS = 2000
FAR = 1e3  # residuals in widths of the data are cut off here, where a trial model blows up


def refine(
    data: Trajectories, theta: Float[ndarray, "p n"], gram: Gram, ridge: float, hold: str
) -> Float[ndarray, "p n"]:
    """Return coefficients of least free-run error over pieces of 100 samples, plus the ridge's distance from theta.

    Jacobians are exact: the Runge-Kutta steps are differentiated with their states. Zero coefficients stay zero.

    Raises:
        DataError: more than 2000 coefficients, or coefficients that are shared.
    """
    free = np.flatnonzero((theta != 0).ravel())
    if len(free) > MOST_PARAMETERS or not gram.structure.is_separate:
        raise DataError(f"refine=True works for at most {MOST_PARAMETERS} coefficients, not shared; here {len(free)}")
    x, u, h = _pieces(data)
    limits = box(data)
    width = np.where(limits[:, 1] > limits[:, 0], limits[:, 1] - limits[:, 0], 1.0)
    start = theta.ravel()[free]
    first, _ = _flow(gram.basis, theta, x, u, h, hold, None)
    level = float(np.sqrt((np.clip(np.nan_to_num((first - x[:, 1:]) / width, nan=1), -1, 1) ** 2).mean()))
    # In the units of the ridge, a column's root mean square over that of the left side; the error at the start is the
    # level of noise that the ridge is weighed against.
    units = np.broadcast_to(gram.weights[:, None], theta.shape).ravel()[free]
    size = max(float(np.sqrt(gram.yy.mean() / gram.rows)), np.finfo(float).tiny)
    pull = level * np.sqrt(max(ridge, 1e-8) * x.shape[0]) * units / size

    def residual(w: ndarray) -> ndarray:
        runs, _ = _flow(gram.basis, _filled(theta, free, w), x, u, h, hold, None)
        error = np.clip(np.nan_to_num((runs - x[:, 1:]) / width, nan=FAR), -FAR, FAR)
        return np.concatenate([error.ravel() / np.sqrt(x.shape[1]), pull * (w - start)])

    def jacobian(w: ndarray) -> ndarray:
        _, slopes = _flow(gram.basis, _filled(theta, free, w), x, u, h, hold, free)
        rows = np.nan_to_num(slopes / width[:, None]).reshape(-1, len(free)) / np.sqrt(x.shape[1])
        return np.vstack([rows, np.diag(pull)])

    with np.errstate(all="ignore"):
        found = least_squares(residual, start, jacobian, method="trf", x_scale="jac", max_nfev=30)
    return _filled(theta, free, found.x)


def _filled(theta: ndarray, free: ndarray, w: ndarray) -> ndarray:
    full = np.zeros(theta.size)
    full[free] = w
    return full.reshape(theta.shape)


def _pieces(data: Trajectories) -> tuple[ndarray, ndarray, ndarray]:
    """Return equally long pieces x (s, L, n), u (s, L, m) and their steps (s, L - 1)."""
    length = min(PIECE, min(len(run) for run in data))
    starts = [(run, k) for run in data for k in range(0, len(run) - length + 1, length)]
    chosen = [starts[k] for k in np.unique(np.linspace(0, len(starts) - 1, min(len(starts), MOST_PIECES)).astype(int))]
    cut = [run[k : k + length] for run, k in chosen]
    steps = np.stack([np.diff(piece.t) for piece in cut])
    return np.stack([piece.x for piece in cut]), np.stack([piece.u for piece in cut]), steps


def _flow(
    basis: Basis, theta: ndarray, x: ndarray, u: ndarray, h: ndarray, hold: str, free: ndarray | None
) -> tuple[ndarray, ndarray]:
    """Run all pieces by classical Runge-Kutta; with `free`, carry S = dx/dw along: S' = (dF/dx) S + dF/dw."""
    state, S = x[:, 0], np.zeros((len(x), x.shape[2], 0 if free is None else len(free)))
    states, slopes = [], []
    for k in range(h.shape[1]):
        after = u[:, k] if hold == "zoh" else u[:, k + 1]
        state, S = _step(basis, theta, state, S, u[:, k], after, h[:, k, None], free)
        states.append(state)
        slopes.append(S)
    return np.stack(states, axis=1), np.stack(slopes, axis=1)


def _step(
    basis: Basis, theta: ndarray, x: ndarray, S: ndarray, u0: ndarray, u1: ndarray, h: ndarray, free: ndarray | None
) -> tuple[ndarray, ndarray]:
    inputs = (u0, (u0 + u1) / 2, (u0 + u1) / 2, u1)
    total, slope_total = np.zeros_like(x), np.zeros_like(S)
    k, K = np.zeros_like(x), np.zeros_like(S)
    for v, c, weight in zip(inputs, (0, 0.5, 0.5, 1), (1, 2, 2, 1), strict=True):
        k, K = _rates(basis, theta, x + c * h * k, S + c * h[..., None] * K, v, free)
        total, slope_total = total + weight * k, slope_total + weight * K
    return x + h / 6 * total, S + h[..., None] / 6 * slope_total


def _rates(
    basis: Basis, theta: ndarray, x: ndarray, S: ndarray, u: ndarray, free: ndarray | None
) -> tuple[ndarray, ndarray]:
    phi = np.hstack([basis.values(x), u - basis.u_ref, np.ones((len(x), 1))])
    rate = phi @ theta
    if free is None:
        return rate, S
    p, n = basis.state_columns, x.shape[1]
    owner = np.zeros((p, n))
    owner[np.arange(p), basis.owner] = 1
    J = np.einsum("bp,pi,pk->bik", basis.slopes(x), theta[:p], owner)
    K = J @ S
    column, state = np.divmod(free, n)
    K[:, state, np.arange(len(free))] += phi[:, column]
    return rate, K
