"""Derivatives: x' at the samples, given or smoothed, against the columns there."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.identification.basis import Basis
from persid.identification.derivatives import local_polynomial
from persid.identification.gram import BLOCK, Rows
from persid.identification.regressions import Estimator, Options, Regression
from persid.identification.windows import choose_window
from persid.measurements.recordings import Measurements, Part
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory


def slope_regression(data: Measurements, basis: Basis, parts: Sequence[Part], options: Options) -> Regression:
    """Return the regression of derivatives.

    Raises:
        DataError: the data are not in memory, or the slopes that were given do not belong to them.
    """
    if not isinstance(data, Trajectories):
        raise DataError('method="derivative" needs the data in memory')
    slopes = with_slopes(data, _slopes(data, options), options.hold)
    return Regression(slopes, partial(derivative_rows, basis=basis))


ESTIMATOR = Estimator(slope_regression, in_memory=True, slopes=True)


def _slopes(data: Trajectories, options: Options) -> list[ndarray]:
    """Return x' at every sample: the one given, or the derivative of local cubics."""
    if options.slopes is None:
        half = max(2, choose_window(data) // 2)
        return [local_polynomial(run.t, run.x, half)[1] for run in data]
    given = options.slopes if isinstance(options.slopes, list | tuple) else [options.slopes]
    slopes = [np.asarray(dot, float) for dot in given]
    if options.embedded or [dot.shape for dot in slopes] != [run.x.shape for run in data]:
        raise DataError("y needs the derivative x' of every measured sample, in the shape of X, and no embedding")
    return slopes


def with_slopes(data: Trajectories, slopes: Sequence[Float[ndarray, "_ n"]], hold: str) -> Trajectories:
    """Return runs of (x, x') side by side, with the inputs that go with x'.

    A derivative at a sample where a held input jumps lies half way between those of its two sides.
    """
    runs = []
    for run, dot in zip(data, slopes, strict=True):
        u = run.u if hold == "paper" else (run.u + np.vstack([run.u[:1], run.u[:-1]])) / 2
        runs.append(Trajectory(run.t, np.hstack([run.x, dot]), u))
    return Trajectories(tuple(runs), (*data.states, *(f"d({name})/dt" for name in data.states)), data.inputs)


def derivative_rows(run: Trajectory, count: int, basis: Basis) -> Iterator[Rows]:
    """Yield blocks of rows (columns at the samples, x') for the first `count` samples of a run of (x, x')."""
    n = len(basis.states)
    for begin in range(0, count, BLOCK):
        chosen = slice(begin, min(begin + BLOCK, count))
        x, u = run.x[chosen, :n], run.u[chosen]
        yield np.hstack([basis.values(x), u - basis.u_ref, np.ones((len(x), 1))]), run.x[chosen, n:]
