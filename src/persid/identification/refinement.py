"""Simulation-error refinement: least squares through the differential equation, from an already good fit."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.optimize import least_squares

from persid.errors import DataError
from persid.identification.basis import Basis
from persid.identification.free_runs import box
from persid.identification.gram import Gram
from persid.measurements.trajectories import Trajectories

PIECE = 100  # samples of one free run; its start is measured (multiple shooting without free starts)
MOST_PIECES = 40
MOST_PARAMETERS = 2000
FAR = 1e3  # residuals in widths of the data are cut off here, where a trial model blows up


@dataclass(frozen=True, eq=False)
class Pieces:
    """Equally long pieces of the measurements, each run freely from its first sample.

    `h` are the steps in s, `width` the widths of the data, in which errors are measured.
    """

    x: Float[ndarray, "s L n"]
    u: Float[ndarray, "s L m"]
    h: Float[ndarray, "s K"]
    width: Float[ndarray, " n"]
    hold: str

    @classmethod
    def of(cls, data: Trajectories, hold: str) -> "Pieces":
        """Cut at most 40 pieces of at most 100 samples, evenly spread over the data."""
        length = min(PIECE, min(len(run) for run in data))
        starts = [(run, k) for run in data for k in range(0, len(run) - length + 1, length)]
        places = np.linspace(0, len(starts) - 1, min(len(starts), MOST_PIECES)).astype(int)
        cut = [run[k : k + length] for run, k in (starts[place] for place in np.unique(places))]
        x, u, t = (np.stack([getattr(piece, name) for piece in cut]) for name in ("x", "u", "t"))
        limits = box(data)
        width = np.where(limits[:, 1] > limits[:, 0], limits[:, 1] - limits[:, 0], 1.0)
        return cls(x, u, np.diff(t, axis=1), width, hold)

    def errors(self, basis: Basis, theta: Float[ndarray, "p n"]) -> Float[ndarray, " r"]:
        """Return model minus measurement of all samples, in widths of the data; a blow-up counts 1000 a sample."""
        with np.errstate(all="ignore"):
            runs, _ = _flow(basis, theta, self, None)
        return self._relative(runs)

    def slopes(
        self, basis: Basis, theta: Float[ndarray, "p n"], free: Int[ndarray, " k"]
    ) -> tuple[Float[ndarray, " r"], Float[ndarray, "r k"]]:
        """Return the errors and their derivatives by the coefficients of the flat numbers `free`."""
        with np.errstate(all="ignore"):
            runs, slopes = _flow(basis, theta, self, free)
        return self._relative(runs), np.nan_to_num(slopes / self.width[:, None]).reshape(-1, len(free))

    def _relative(self, runs: ndarray) -> ndarray:
        return np.clip(np.nan_to_num((runs - self.x[:, 1:]) / self.width, nan=FAR), -FAR, FAR).ravel()


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
    pieces = Pieces.of(data, hold)
    start, length = theta.ravel()[free], np.sqrt(pieces.x.shape[1])
    level = float(np.sqrt((np.clip(pieces.errors(gram.basis, theta), -1, 1) ** 2).mean()))
    # In the units of the ridge, a column's root mean square over that of the left side; the error at the start is the
    # level of noise that the ridge is weighed against.
    units = np.broadcast_to(gram.weights[:, None], theta.shape).ravel()[free]
    size = max(float(np.sqrt(gram.yy.mean() / gram.rows)), np.finfo(float).tiny)
    pull = level * np.sqrt(max(ridge, 1e-8) * len(pieces.x)) * units / size

    def residual(w: ndarray) -> ndarray:
        errors = pieces.errors(gram.basis, _filled(theta, free, w))
        return np.concatenate([errors / length, pull * (w - start)])

    def jacobian(w: ndarray) -> ndarray:
        _, slopes = pieces.slopes(gram.basis, _filled(theta, free, w), free)
        return np.vstack([slopes / length, np.diag(pull)])

    with np.errstate(all="ignore"):
        found = least_squares(residual, start, jacobian, method="trf", x_scale="jac", max_nfev=30)
    return _filled(theta, free, found.x)


def _filled(theta: ndarray, free: ndarray, w: ndarray) -> ndarray:
    full = np.zeros(theta.size)
    full[free] = w
    return full.reshape(theta.shape)


def _flow(basis: Basis, theta: ndarray, pieces: Pieces, free: ndarray | None) -> tuple[ndarray, ndarray]:
    """Run all pieces by classical Runge-Kutta; with `free`, carry S = dx/dw along: S' = (dF/dx) S + dF/dw."""
    u, h = pieces.u, pieces.h
    state = pieces.x[:, 0]
    mix = _mixing(basis, theta)
    S = np.zeros((*state.shape, 0 if free is None else len(free)))
    states, slopes = [], []
    for k in range(h.shape[1]):
        after = u[:, k] if pieces.hold == "zoh" else u[:, k + 1]
        state, S = _step(basis, theta, mix, state, S, u[:, k], after, h[:, k, None], free)
        states.append(state)
        slopes.append(S)
    return np.stack(states, axis=1), np.stack(slopes, axis=1)


def _mixing(basis: Basis, theta: ndarray) -> ndarray:
    """Return the matrix (p x n n) that makes dF/dx of the slopes of the columns: theta[j, i] at (i, owner of j)."""
    p, n = basis.state_columns, theta.shape[1]
    mix = np.zeros((p, n, n))
    mix[np.arange(p), :, basis.owner] = theta[:p]
    return mix.reshape(p, n * n)


def _step(
    basis: Basis, theta: ndarray, mix: ndarray, x: ndarray, S: ndarray, u0: ndarray, u1: ndarray, h: ndarray,
    free: ndarray | None,
) -> tuple[ndarray, ndarray]:  # fmt: skip
    inputs = (u0, (u0 + u1) / 2, (u0 + u1) / 2, u1)
    total, slope_total = np.zeros_like(x), np.zeros_like(S)
    k, K = np.zeros_like(x), np.zeros_like(S)
    for v, c, weight in zip(inputs, (0, 0.5, 0.5, 1), (1, 2, 2, 1), strict=True):
        inner = S if free is None else S + c * h[..., None] * K
        k, K = _rates(basis, theta, mix, x + c * h * k, inner, v, free)
        total = total + weight * k
        if free is not None:
            slope_total += weight * K
    return x + h / 6 * total, S if free is None else S + h[..., None] / 6 * slope_total


def _rates(
    basis: Basis, theta: ndarray, mix: ndarray, x: ndarray, S: ndarray, u: ndarray, free: ndarray | None
) -> tuple[ndarray, ndarray]:
    phi = np.hstack([basis.values(x), u - basis.u_ref, np.ones((len(x), 1))])
    rate = phi @ theta
    if free is None:
        return rate, S
    n = x.shape[1]
    K = (basis.slopes(x) @ mix).reshape(-1, n, n) @ S
    column, state = np.divmod(free, n)
    K[:, state, np.arange(len(free))] += phi[:, column]
    return rate, K
