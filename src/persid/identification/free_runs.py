"""Free runs: what a model predicts from a first state and the inputs alone, and the scores that speak of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.basis import Basis
from persid.measurements.boxes import box_of, reach, widths
from persid.measurements.moments import Moments, row_moments
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.model import PersidskiiModel
from persid.models.recursion import refuse_other_steps
from persid.models.steps import runge_kutta

Rate = Callable[[ndarray, ndarray], ndarray]  # x' from x and u, or the state one step later

STILL = 1e-12  # a state that moves by less than this share of its size is at rest
MOST_SUBSTEPS = 8
FINER = (2, 4, 8, 16, 32)  # Runge-Kutta steps of a sample that scores try
CLOSE, EXACT = 0.05, 1e-9  # steps are short enough when halving them changes less of the error, or of the deviation


@runtime_checkable
class Simulator(Protocol):
    """Anything that predicts a trajectory from first states, times and inputs."""

    def simulate(self, x0: object, t: Float[ndarray, " N"], u: object = None) -> Trajectories:
        """Return the predicted run."""


@dataclass(frozen=True)
class Score:
    """How well free runs follow the data. `r2` is about one mean of all states together, `r2_states` one a state.

    Where a record is given, R2 is against the spread of all of it: what is left of a tail at rest is noise, and noise
    over noise says nothing. `rmse` is in state units over all states and samples, `rmse_states` one a state;
    `diverged_at` and `stopped_at` hold a time in s, or None, for each run (of its blow-up; or at which the integrator's
    budget was used up with the state still bounded).
    """

    rmse: float
    r2: float
    r2_states: tuple[float, ...]
    diverged_at: tuple[float | None, ...] = ()
    stopped_at: tuple[float | None, ...] = ()
    rmse_states: tuple[float, ...] = ()

    @property
    def blow_ups(self) -> int:
        """Number of runs that diverged."""
        return sum(time is not None for time in self.diverged_at)

    @property
    def unfinished(self) -> int:
        """Number of runs that were stopped because the model is too fast or too stiff to be followed."""
        return sum(time is not None for time in self.stopped_at)

    @property
    def r2_mean(self) -> float:
        """Mean of the R2 of the single states."""
        return float(np.mean(self.r2_states))


def score(
    truth: Float[ndarray, "N n"],
    guess: Float[ndarray, "N n"],
    diverged: tuple[float | None, ...] = (),
    stopped: tuple[float | None, ...] = (),
    record: Moments | None = None,
) -> Score:
    """Return RMSE and both readings of R2 of a prediction, about the mean of the truth or of a whole record."""
    about = row_moments(truth) if record is None else record
    error, spread = ((truth - guess) ** 2).mean(axis=0), about.deviation**2
    pooled = float((spread + (about.mean - about.mean.mean()) ** 2).mean())
    still = (STILL * np.maximum(np.abs(about.low), np.abs(about.high))) ** 2
    states = tuple(_r2(float(e), float(s), float(f)) for e, s, f in zip(error, spread, still, strict=True))
    mean = float(error.mean())
    r2, each = _r2(mean, pooled, float(still.max())), tuple(np.sqrt(error).tolist())
    return Score(float(np.sqrt(mean)), r2, states, diverged, stopped, each)


def _r2(error: float, spread: float, still: float) -> float:
    """Return 1 - error / spread; where nothing moves there is nothing to foretell, and it is 1 or 0."""
    return 1 - error / spread if spread > still else float(error <= still)


def free_run_score(
    model: Simulator, data: Trajectories, hold: str = "zoh", past: int = 1, record: Moments | None = None
) -> Score:
    """Simulate every run from its first `past` states and compare; where it ends early, its last state counts on.

    `record` are the moments of the states of a whole record of which the runs are parts, see `Score`.

    Paper: the RMSE and R2 of Sec. 4 (pooled over states and samples).
    """
    low, high = reach(box_of(data) if record is None else record.box)
    truth, guess, diverged, stopped = [], [], [], []
    for run in data:
        start = run.x[0] if past == 1 else run.x[:past]
        found = model.simulate(start, run.t, input_signal(run.t, run.u, hold))[0]
        filled = np.vstack([found.x, np.repeat(found.x[-1:], len(run) - len(found.x), axis=0)])
        truth.append(run.x[past - 1 :])
        guess.append(np.clip(filled, low, high)[past - 1 :])
        diverged.append(found.diverged_at)
        stopped.append(found.stopped_at)
    return score(np.concatenate(truth), np.concatenate(guess), tuple(diverged), tuple(stopped), record)


def input_signal(t: ndarray, u: ndarray, hold: str) -> ndarray | Callable[[float], ndarray]:
    """Return the held samples, or for hold="paper" the input as a function that is linear between them."""
    if hold == "zoh" or not u.shape[1]:
        return u
    return lambda s: np.array([np.interp(s, t, column) for column in u.T])


def one_step(model: PersidskiiModel, run: Trajectory, hold: str, substeps: int = 2) -> Float[ndarray, "N n"]:
    """Predict, for every sample, the state one step later (the last step is taken as long as the one before it).

    A model in discrete time takes its own step, and `substeps` plays no part.
    """
    if model.dt is not None:
        refuse_other_steps(run.t, model.dt)
    h = np.diff(run.t, append=2 * run.t[-1] - run.t[-2])[:, None]
    after = run.u if hold == "zoh" else np.vstack([run.u[1:], run.u[-1:]])
    with np.errstate(all="ignore"):
        moved = _advance(model.rhs, run.x, h, run.u, after, 0 if model.is_discrete else substeps)
    return np.asarray(np.nan_to_num(moved, nan=0.0, posinf=1e300, neginf=-1e300))


def _advance(rhs: Rate, x: ndarray, h: ndarray, before: ndarray, after: ndarray, substeps: int) -> ndarray:
    """Take one sample step of length h by classical Runge-Kutta, the input going linearly from `before` to `after`.

    Without substeps the right side is the state one step later itself.
    """
    if not substeps:
        return np.asarray(rhs(x, before))
    d = h / substeps
    for k in range(substeps):
        u0, u1 = (before + (after - before) * (j / substeps) for j in (k, k + 1))
        x = runge_kutta(rhs, x, d, (u0, (u0 + u1) / 2, u1))
    return x


def batch_errors(
    basis: Basis, thetas: Float[ndarray, "s k p n"], pieces: list[Trajectory], limits: Float[ndarray, "n 2"], hold: str
) -> tuple[Float[ndarray, "s k"], ndarray]:
    """Run k candidate models on each of s equally long pieces at once.

    Returns the mean squared error, each state measured by its width in `limits`, and whether the run left the reach.
    """
    s, k, p, n = thetas.shape
    flat = thetas.reshape(s * k, p, n)
    batch = _Batch.of(pieces, hold, limits, k)
    # The scale of the right side decides how many Runge-Kutta steps a sample needs.
    substeps = _substeps(basis, flat, batch.truth[:, 0], float(np.median(np.diff(batch.t))))
    guess, out = batch.free(_batch_rhs(basis, flat), substeps)
    error = (((guess - batch.truth) / widths(limits)) ** 2).mean(axis=2)[:, 1:].mean(axis=1)
    return error.reshape(s, k), out.reshape(s, k)


@dataclass(frozen=True, eq=False)
class _Batch:
    """Equally long runs that are repeated side by side; what leaves the reach goes on along its edge."""

    t: Float[ndarray, "s N"]
    truth: Float[ndarray, "s N n"]
    u: Float[ndarray, "s N m"]
    hold: str
    reach: tuple[Float[ndarray, " n"], Float[ndarray, " n"]]

    @classmethod
    def of(cls, pieces: Sequence[Trajectory], hold: str, limits: Float[ndarray, "n 2"], times: int = 1) -> "_Batch":
        """Return the batch of pieces, each `times` times."""
        t, x, u = (np.repeat([getattr(piece, name) for piece in pieces], times, axis=0) for name in ("t", "x", "u"))
        return cls(t, x, u, hold, reach(limits))

    def free(self, rhs: Rate, substeps: int) -> tuple[Float[ndarray, "s N n"], ndarray]:
        """Run from every first state; return the states and who ran away."""
        x, h, u = self.truth[:, 0], np.diff(self.t), self.u
        out, states = np.zeros(len(x), bool), [x]
        with np.errstate(all="ignore"):
            for j in range(h.shape[1]):
                after = u[:, j] if self.hold == "zoh" else u[:, j + 1]
                moved = np.nan_to_num(_advance(rhs, x, h[:, j : j + 1], u[:, j], after, substeps), nan=np.inf)
                out |= ((moved < self.reach[0]) | (moved > self.reach[1])).any(axis=1)
                x = np.where(out[:, None], np.clip(moved, *self.reach), moved)
                states.append(x)
        return np.stack(states, axis=1), out


def restarted(
    model: Any, pieces: Sequence[Trajectory], hold: str, record: Moments
) -> tuple[Float[ndarray, "s N n"], ndarray]:
    """Run a model freely over each of s equally long pieces at once; return its states and which runs ran away.

    Runge-Kutta steps are halved until that changes nothing that counts; a stiff model is followed piece by piece.
    """
    batch = _Batch.of(pieces, hold, record.box)
    if model.is_discrete:
        for piece in pieces:
            refuse_other_steps(piece.t, model.dt)
        return batch.free(model.rhs, 0)
    size = np.where(record.deviation > 0, record.deviation, 1.0)
    coarse, lost = batch.free(model.rhs, 1)
    for substeps in FINER:
        fine, out = batch.free(model.rhs, substeps)
        kept = ~(out | lost)
        changed, error = (np.abs((fine - other)[kept] / size) for other in (coarse, batch.truth))
        if (out == lost).all() and np.max(changed, initial=0) <= max(CLOSE * np.max(error, initial=0), EXACT):
            return fine, out
        coarse, lost = fine, out
    found = [model.simulate(p.x[0], p.t, input_signal(p.t, p.u, hold))[0] for p in pieces]
    full = [np.vstack([f.x, np.repeat(f.x[-1:], len(p) - len(f), axis=0)]) for f, p in zip(found, pieces, strict=True)]
    return np.clip(np.stack(full), *batch.reach), np.array(
        [len(f) < len(p) for f, p in zip(found, pieces, strict=True)]
    )


def _batch_rhs(basis: Basis, thetas: ndarray) -> Rate:
    p = basis.state_columns
    of_state, of_input, constant = thetas[:, :p], thetas[:, p:-1], thetas[:, -1]

    def rhs(x: ndarray, u: ndarray) -> ndarray:
        forced = np.matmul((u - basis.u_ref)[:, None], of_input)[:, 0] if basis.inputs else 0.0
        moved = np.asarray(np.matmul(basis.values(x)[:, None], of_state)[:, 0] + forced + constant)
        return moved if basis.dt is None else basis.kept(x) + moved

    return rhs


def _substeps(basis: Basis, thetas: ndarray, x: ndarray, h: float) -> int:
    """Count the steps a sample needs for |eigenvalue| step < 1, by the median candidate; 0 in discrete time."""
    if basis.dt is not None:
        return 0
    slopes = basis.slopes(x)
    rates = np.zeros((len(x), len(basis.states)))
    np.add.at(rates.T, basis.owner, np.abs(slopes.T * np.abs(thetas[:, : len(basis.owner)]).max(axis=2).T))
    rate = float(np.median(rates.max(axis=1)))
    return int(np.clip(np.ceil(h * rate / 4), 1, MOST_SUBSTEPS))
