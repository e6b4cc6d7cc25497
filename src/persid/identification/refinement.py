"""Simulation-error refinement: least squares through the differential equation, from an already good fit."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy.optimize import least_squares

from persid.errors import DataError
from persid.identification.basis import Basis
from persid.identification.gram import Gram
from persid.measurements.boxes import box_of, widths
from persid.measurements.trajectories import Trajectories
from persid.models.steps import runge_kutta

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
        return cls(x, u, np.diff(t, axis=1), widths(box_of(data)), hold)

    def errors(self, basis: Basis, theta: Float[ndarray, "p n"]) -> Float[ndarray, " r"]:
        """Return model minus measurement of all samples, in widths of the data; a blow-up counts 1000 a sample."""
        with np.errstate(all="ignore"):
            runs, _ = _flow(basis, theta, self, np.zeros(0, int))
        return self._relative(runs)

    def slopes(
        self, basis: Basis, theta: Float[ndarray, "p n"], free: Int[ndarray, " k"]
    ) -> tuple[Float[ndarray, " r"], Float[ndarray, "r k"]]:
        """Return the errors and their derivatives by the coefficients of the flat numbers `free`."""
        with np.errstate(all="ignore"):
            runs, slopes = _flow(basis, theta, self, free)
        return self._relative(runs), np.nan_to_num(slopes / self.width[:, None]).reshape(-1, len(free))

    def _relative(self, runs: ndarray) -> ndarray:
        return np.asarray(np.clip(np.nan_to_num((runs - self.x[:, 1:]) / self.width, nan=FAR), -FAR, FAR).ravel())


def refine(
    data: Trajectories, theta: Float[ndarray, "p n"], gram: Gram, ridge: float, hold: str
) -> Float[ndarray, "p n"]:
    """Return coefficients of least free-run error over pieces of 100 samples, plus the ridge's distance from theta.

    Jacobians are exact: the Runge-Kutta steps are differentiated with their states. Zero and known coefficients stay.

    Raises:
        DataError: more than 2000 coefficients, or coefficients that are shared.
    """
    free = np.flatnonzero(((theta != 0) & (gram.structure.parameter >= 0)).ravel())
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
    full = theta.copy()
    full.ravel()[free] = w
    return full


def _flow(basis: Basis, theta: ndarray, pieces: Pieces, free: Int[ndarray, " k"]) -> tuple[ndarray, ndarray]:
    """Return the runs of all pieces and their derivatives by the coefficients `free`: S = dx/dw is carried along."""
    u, h, rate = pieces.u, pieces.h, _rate(basis, theta, free)
    Z = np.zeros((len(pieces.x), theta.shape[1], 1 + len(free)))
    Z[:, :, 0] = pieces.x[:, 0]
    found = []
    for k in range(h.shape[1]):
        before, after = u[:, k], u[:, k] if pieces.hold == "zoh" else u[:, k + 1]
        Z = runge_kutta(rate, Z, h[:, k, None, None], (before, (before + after) / 2, after))
        found.append(Z)
    both = np.stack(found, axis=1)
    return both[..., 0], both[..., 1:]


def _rate(basis: Basis, theta: ndarray, free: Int[ndarray, " k"]) -> Callable[[ndarray, ndarray], ndarray]:
    """Return the right side of x' = F(x, u; w) and S' = (dF/dx) S + dF/dw, for Z = (x, S)."""
    n, mix = theta.shape[1], _mixing(basis, theta)
    column, state = np.divmod(free, n)

    def rate(Z: ndarray, u: ndarray) -> ndarray:
        x, found = np.ascontiguousarray(Z[:, :, 0]), np.empty_like(Z)
        phi = np.hstack([basis.values(x), u - basis.u_ref, np.ones((len(x), 1))])
        found[:, :, 0] = phi @ theta
        if len(free):
            found[:, :, 1:] = (basis.slopes(x) @ mix).reshape(-1, n, n) @ Z[:, :, 1:]
            found[:, state, 1 + np.arange(len(free))] += phi[:, column]
        return found

    return rate


def _mixing(basis: Basis, theta: ndarray) -> ndarray:
    """Return the matrix (p x n n) that makes dF/dx of the slopes of the columns: theta[j, i] at (i, owner of j)."""
    p, n = basis.state_columns, theta.shape[1]
    mix = np.zeros((p, n, n))
    mix[np.arange(p), :, basis.owner] = theta[:p]
    return mix.reshape(p, n * n)
