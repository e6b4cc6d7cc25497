"""Discrete time: the state one step later, fitted straight from samples; no generator, and no logarithm.

    x_{k+q} - x_k = (A0 - I) dx_k + sum_j A_j f_j(dx_k / scale) + B du + b,           du the mean input of the q samples

for every k, so that a stride of q samples is one step of the model and all samples are used. It is EDMD's one-step map
restricted to the coordinates. Where x itself is no column of a state, x_{k+q} - x_ref stands on the left.

Measurement noise stands in the columns too, and pulls the fit towards 0 (attenuation): the less a state moves in a
step, the more. So a longer stride has less bias, and sees less of what is fast. `choose_stride` asks free runs.
"""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from persid.identification.basis import Basis
from persid.identification.gram import Rows
from persid.identification.regressions import Estimator, Options, Problem, Regression
from persid.identification.validation import by_fold, validation_curve
from persid.measurements.recordings import Measurements, Part
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory

STRIDES = (1, 2, 5, 10, 20, 50)  # samples of a step that are tried
SHORTEST = 60  # steps of the longest run that a stride has to leave
AS_GOOD = 1.05  # times the smallest error: the shortest such stride is taken


def recursion(data: Measurements, basis: Basis, parts: Sequence[Part], options: Options) -> Regression:
    """Return the regression of the state one step later on the columns, `data` being samples side by side."""
    n = len(basis.states)
    stride = data.runs[0].x.shape[1] // n if isinstance(data, Trajectories) else 1
    return Regression(data, partial(step_rows, basis=basis, stride=stride), 1)


RECURSION = Estimator(recursion, in_memory=True)


def step_rows(run: Trajectory, count: int, basis: Basis, stride: int) -> Iterator[Rows]:
    """Yield rows (columns at a sample, its move in one step) for samples side by side, a block for each of them."""
    n, m = len(basis.states), len(basis.inputs)
    last = min(count, len(run) - 1)
    for o in range(stride):
        x, after = run.x[:last, o * n : (o + 1) * n], run.x[1 : last + 1, o * n : (o + 1) * n]
        whole = np.isfinite(after).all(axis=1) & np.isfinite(x).all(axis=1)
        x, u = x[whole], run.u[:last, o * m : (o + 1) * m][whole]
        columns = np.hstack([basis.values(x), u - basis.u_ref, np.ones((len(x), 1))])
        yield columns, after[whole] - basis.kept(x)


def moves(data: Sequence[Trajectory], basis: Basis) -> Rows:
    """Return the columns at the samples of runs, and what the states move by in the step from each."""
    pairs = [pair for run in data for pair in step_rows(run, len(run), basis, 1)]
    columns, moved = (np.concatenate(parts) for parts in zip(*pairs, strict=True))
    return columns, moved


def choose_stride(data: Trajectories, problem_of: Callable[[int], Problem], hold: str) -> int:
    """Return the shortest stride whose free runs over left-out blocks err about as little as those of any other."""
    errors: dict[int, float] = {}
    longest = max(len(run) for run in data)
    for stride in (q for q in STRIDES if q == 1 or longest // q >= SHORTEST):
        problem = problem_of(stride)
        folds = by_fold(problem.blocks, problem.grams())
        curve = validation_curve(problem.data, problem.parts, folds, problem.box, hold, whole=True)
        if curve is None:
            break
        errors[stride] = min(curve.errors)
    best = min(errors.values(), default=0.0)
    return next((q for q, error in errors.items() if error <= AS_GOOD * best), 1)
