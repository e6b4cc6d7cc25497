"""Free runs of an output model over measurements: scores, and the bound that is proved for each."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json
from persid.certificates.certificate import Certificate
from persid.errors import PersidError
from persid.identification.scores import Scores, scores_of
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.outputs import OutputModel
from persid.verdicts.verdict import Certified, Verdict

START_SHARE, FEWEST, MOST = 0.02, 4, 50  # of a record, that give its initial state


@dataclass(frozen=True, eq=False)
class OutputRun:
    """A record, the model's free run from its first samples, its scores, and y* with the bound of |y - y*|.

    `steady` is what that bound tends to for inputs as large as the record's, in the unit of each output.
    """

    measured: Trajectory
    simulated: Trajectory
    starts: int
    r2: Float[ndarray, " l"]
    rmse: Float[ndarray, " l"]
    rest: Float[ndarray, " l"] | None
    bound: Float[ndarray, "N l"] | None
    steady: Float[ndarray, " l"] | None


@dataclass(frozen=True, eq=False)
class OutputScores:
    """Say of every output how free runs over all records miss it: RMSE in its unit, in % of its range, and R2."""

    outputs: tuple[str, ...]
    rmse: Float[ndarray, " l"]
    percent: Float[ndarray, " l"]
    r2: Float[ndarray, " l"]

    @classmethod
    def of(cls, runs: Sequence[OutputRun], outputs: tuple[str, ...]) -> "OutputScores":
        """Return the scores of records together, against the spread about their common mean."""
        seen = np.concatenate([run.measured.x[run.starts :] for run in runs])
        square = sum(run.rmse**2 * (len(run.measured) - run.starts) for run in runs) / len(seen)
        spread, range_ = seen.var(axis=0), np.ptp(seen, axis=0)
        rmse = np.sqrt(square)
        with np.errstate(divide="ignore", invalid="ignore"):
            return cls(outputs, rmse, 100 * rmse / range_, 1 - square / spread)

    def rows(self) -> list[tuple[str, str]]:
        """Return a line for each output."""
        each = zip(self.outputs, self.rmse, self.percent, self.r2, strict=True)
        return [(name, f"R2 {r2:.4f}, RMSE {rmse:.4g} ({part:.2g} % of its range)") for name, rmse, part, r2 in each]

    @classmethod
    def from_dict(cls, data: Json) -> "OutputScores":
        """Return what `to_dict` was called on; what was not finite is NaN."""
        return cls(tuple(data), *(_columns(data, name) for name in ("rmse", "percent", "r2")))

    def to_dict(self) -> Json:
        """Return the scores by output; what is not finite is None. `from_dict` is the way back."""
        names = ("rmse", "percent", "r2")
        return {
            name: {key: _finite(float(getattr(self, key)[i])) for key in names} for i, name in enumerate(self.outputs)
        }


def _columns(data: Json, name: str) -> Float[ndarray, " l"]:
    return np.array([np.nan if entry[name] is None else entry[name] for entry in data.values()])


def run_scores(runs: Sequence[OutputRun], model: OutputModel, unseen: bool) -> Scores:
    """Return the scores of free runs beside forecasts without a model, which know the same first samples."""
    pieces = [run.measured[run.starts - 1 :] for run in runs]
    held = Trajectories(tuple(pieces), model.outputs, model.dynamics.inputs)
    before = [run.measured[: run.starts - 1] for run in runs]
    what = "what was kept from the fit" if unseen else "what was fitted"
    return scores_of([run.simulated.x[run.starts - 1 :] for run in runs], held, before, what)


def output_doubts(scores: Scores, unseen: bool, held_out: float | None) -> tuple[str, ...]:
    """Return why an output model is not shown to foretell, in clauses; none where it is.

    `held_out` is the error of the fit on the part that it was chosen by, over the outputs' spread; it counts where the
    scores are of data that the fit has seen.
    """
    found = list(scores.doubts)
    if not unseen and held_out is not None and not held_out < 1:
        found.append(f"on the part that was held out it is off by {held_out:.3g} of the outputs' spread")
    if found:
        found[-1] += ": the proof is about the model, not about the plant"
    return tuple(found)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def output_runs(model: OutputModel, data: Trajectories, verdict: Verdict | None = None) -> list[OutputRun]:
    """Return the free run of every record; the samples that give its start are not scored."""
    return [_run(model, run, verdict) for run in data]


def _run(model: OutputModel, run: Trajectory, verdict: Verdict | None) -> OutputRun:
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
    model: OutputModel, x0: ndarray, run: Trajectory, verdict: Verdict | None
) -> tuple[ndarray | None, ndarray | None, ndarray | None]:
    if not (isinstance(verdict, Certified) and isinstance(verdict.certificate, Certificate)):
        return None, None, None
    certificate = verdict.certificate
    if not certificate.outputs:
        return None, None, None
    u = certificate.input
    largest = float(np.linalg.norm(run.u - u, axis=1).max(initial=0.0))
    try:
        bound = certificate.output_bound(x0, largest, run.t - run.t[0])
        steady = certificate.output_bound(certificate.operating_point, largest, np.zeros(1))[0]
    except PersidError:  # a region that this record leaves
        return None, None, None
    return model.output(certificate.operating_point, u), bound, steady
