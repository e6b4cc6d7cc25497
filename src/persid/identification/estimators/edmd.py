"""EDMD: the vector field that the generator of a Koopman matrix implies at every sample, against the columns there."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.identification.basis import Basis
from persid.identification.gram import BLOCK, Rows
from persid.identification.koopman import (
    Lifting,
    doubtful_eigenvalues,
    edmd,
    gamma,
    koopman_generator,
    make_lifting,
    sample_step,
)
from persid.identification.regressions import Estimator, Options, Regression
from persid.measurements.recordings import Measurements, Part, segments
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory


def koopman_regression(data: Measurements, basis: Basis, parts: Sequence[Part], options: Options) -> Regression:
    """Return the regression of the vector field that the generator of the given parts implies at every sample."""
    lifting, hold = make_lifting(basis, options.lifting), options.hold
    K = edmd(data, lifting, hold, parts)
    doubtful = doubtful_eigenvalues(data, lifting, K, hold, parts)
    pairs = sum(part.stop - part.start - 1 for part in parts)
    L = koopman_generator(K, sample_step(data), samples=pairs, hold=hold, doubtful=doubtful)
    theta = _literal(L, data, lifting, parts) if options.gamma == "literal" else None
    rows = partial(_field_rows, lifting=lifting, L=L[:, : len(basis.states)], theta=theta)
    return Regression(data, rows, K=K)


ESTIMATOR = Estimator(koopman_regression, additive=False, lifts=True)


def _literal(L: ndarray, data: Measurements, lifting: Lifting, parts: Sequence[Part]) -> Float[ndarray, "p n"]:
    if not isinstance(data, Trajectories):
        raise DataError('gamma="literal" needs the data in memory; use gamma="coordinates", or read fewer of them')
    used = segments(data, parts)
    x, u = (np.concatenate([getattr(run, name) for run in used]) for name in ("x", "u"))
    return gamma(L, lifting, x, u, "literal").T


def _field_rows(segment: Trajectory, count: int, lifting: Lifting, L: ndarray, theta: ndarray | None) -> Iterator[Rows]:
    for begin in range(0, count, BLOCK):
        run = segment[begin : min(begin + BLOCK, count)]
        phi = lifting.columns(run.x, run.u)
        yield phi, lifting.values(run.x, run.u) @ L if theta is None else phi @ theta
