"""Free runs of an output model over measurements: scores, and the bound that is proved for each."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.errors import PersidError
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.outputs import OutputModel
from persid.verdicts.verdict import Certified, Verdict

START_SHARE, FEWEST, MOST = 0.02, 4, 50  # of a record, that give its initial state


@dataclass(frozen=True, eq=False)
class OutputRun:
    """A record, the model's free run from its first samples, its scores, and y* with the bound of |y - y*|."""

    measured: Trajectory
    simulated: Trajectory
    starts: int
    r2: Float[ndarray, " l"]
    rmse: Float[ndarray, " l"]
    rest: Float[ndarray, " l"] | None
    bound: Float[ndarray, "N l"] | None


def output_runs(model: OutputModel, data: Trajectories, verdict: Verdict) -> list[OutputRun]:
    """Return the free run of every record; the samples that give its start are not scored."""
    return [_run(model, run, verdict) for run in data]


def _run(model: OutputModel, run: Trajectory, verdict: Verdict) -> OutputRun:
    starts = int(np.clip(START_SHARE * len(run), min(FEWEST, len(run)), MOST))
    x0 = model.estimate_state(run.t, run.u, run.x[:starts])
    found = model.simulate(run.t, run.u, x0=x0)[0]
    seen, y = run.x[starts : len(found)], found.x[starts:]
    whole = len(found) == len(run) and len(seen) > 0
    rmse = np.sqrt(((seen - y) ** 2).mean(axis=0)) if whole else np.full(len(model.outputs), np.inf)
    spread = run.x[starts:].std(axis=0)
    r2 = 1 - (rmse / np.where(spread > 0, spread, np.nan)) ** 2
    return OutputRun(run, found, starts, r2, rmse, *_bounds(model, x0, found, verdict))


def _bounds(
    model: OutputModel, x0: ndarray, run: Trajectory, verdict: Verdict
) -> tuple[ndarray | None, ndarray | None]:
    if not (isinstance(verdict, Certified) and isinstance(verdict.certificate, Certificate)):
        return None, None
    certificate = verdict.certificate
    if not certificate.outputs:
        return None, None
    u = certificate.input
    largest = float(np.linalg.norm(run.u - u, axis=1).max(initial=0.0))
    try:
        bound = certificate.output_bound(x0, largest, run.t - run.t[0])
    except PersidError:  # a region that this record leaves
        return None, None
    return model.output(certificate.operating_point, u), bound
