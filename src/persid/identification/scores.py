"""Scores: how far ahead a model foretells measurements, and whether that is more than anyone could without a model.

A free run of an unstable plant leaves the data however good the model, and one step ahead every model looks good. So
free runs of several lengths start again and again along the record, and the score that counts is the one over the time
in which the record itself forgets: there "the last value" has become as poor a forecast as the mean. Errors are
measured against the spread of the whole record; a part at rest holds noise only, and noise over noise says nothing.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._text import SECONDS
from persid.identification.free_runs import Simulator, free_run_score, restarted
from persid.identification.windows import noise_of
from persid.measurements.moments import Moments
from persid.measurements.recordings import Measurements, beginnings, evenly
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory

HORIZONS = (4, 16, 64, 256, 1024)  # samples: lengths of the free runs that start again along a record
SHARE = 0.2  # of every run is held out
SHORTEST = 8  # samples of a tail that tells something
LONGEST = 5000  # samples of a run that are scored
FEWEST_RUNS = 5  # of which some are held out whole
RESTARTS = 64  # free runs of one length, at most
LOOKED_AT, LOOKED_INTO = 20, 5000  # runs, and samples of each, that tell how soon a record forgets
MEAN, LAST, LINE = "the mean", "the last value", "a straight line"


@dataclass(frozen=True, eq=False)
class Record:
    """What scores are measured by: moments of the states over a whole record, its noise, and how soon it forgets.

    `noise` is a standard deviation a state; `memory` is in samples, None where the record is too short to tell.
    """

    moments: Moments
    noise: Float[ndarray, " n"]
    memory: int | None

    @classmethod
    def of(cls, data: Measurements) -> "Record":
        """Return the record of measurements; of many or long runs the beginnings tell noise and memory."""
        heads = beginnings(data, LOOKED_INTO, LOOKED_AT)
        states = data.moments.of(slice(len(data.states)))
        return cls(states, noise_of([run.x for run in heads]), _memory(heads, states))

    @property
    def floor(self) -> float:
        """The error over the deviation of a model as good as the noise admits, the root mean square over states."""
        moving = self.moments.deviation > 0
        shares = self.noise[moving] / self.moments.deviation[moving]
        return float(np.sqrt(np.mean(shares**2))) if moving.any() else 0.0

    def moves(self, held: Trajectories) -> float:
        """Return the share of the record's deviation that a part of it has."""
        moving = self.moments.deviation > 0
        shares = np.concatenate([run.x for run in held]).std(axis=0)[moving] / self.moments.deviation[moving]
        return float(np.sqrt(np.mean(shares**2))) if moving.any() else 0.0


def _memory(runs: Sequence[Trajectory], states: Moments) -> int | None:
    """Return the shortest horizon over which the last value errs as much as the mean, each state by its spread."""
    moving = states.deviation > 0
    for horizon in HORIZONS:
        errors = []
        for lead in (horizon // 4, horizon // 2, 3 * horizon // 4, horizon):
            moved = [run.x[lead:] - run.x[:-lead] for run in runs if len(run) > lead]
            if not moved or not moving.any():
                return None
            errors.append(((np.concatenate(moved)[:, moving] / states.deviation[moving]) ** 2).mean())
        if np.mean(errors) >= 1:
            return horizon
    return None


@dataclass(frozen=True)
class Ahead:
    """Free runs of `steps` samples, `runs` of them, restarted along the record. Numbers are one a state.

    `rmse` is in state units, `percent` in % of the record's range, `r2` against its spread. `error` is the root mean
    square over states of error / deviation, so that 1 is the mean's; `whole` marks free runs over all that was held.
    """

    steps: int
    seconds: float
    runs: int
    rmse: tuple[float, ...]
    percent: tuple[float, ...]
    r2: tuple[float, ...]
    error: float
    blow_ups: int
    whole: bool = False

    @property
    def r2_mean(self) -> float:
        """Mean of the R2 of the states."""
        return float(np.mean(self.r2))

    @property
    def length(self) -> str:
        """How far ahead, in words."""
        return self.lasting()

    def lasting(self, unit: str = "s") -> str:
        """Return how far ahead in a unit of time, in words."""
        time = f"{self.seconds / SECONDS[unit]:.3g} {unit}"
        return time if self.whole else f"{time} ({self.steps} samples)"


@dataclass(frozen=True)
class Scores:
    """How a model foretells measurements at several horizons, the free run over all that was held as the last row.

    `basis` says what the scores are on; `unseen` whether the fit has not seen it. `rivals` are errors, at the horizon
    of the headline, of forecasts without a model, `mean_r2` the R2 of the mean there, one a state: below 0 where what
    is scored lies further from the mean than the record does. `floor` is the error of a model as good as the noise
    admits; `moves` the share of the record's deviation that the scored part has.
    """

    basis: str
    unseen: bool
    states: tuple[str, ...]
    rows: tuple[Ahead, ...]
    place: int
    rivals: tuple[tuple[str, float], ...]
    floor: float
    moves: float
    mean_r2: tuple[float, ...] = ()

    @property
    def headline(self) -> Ahead:
        """The row that counts: the horizon over which the record forgets, or else the whole free run."""
        return self.rows[self.place]

    @property
    def whole(self) -> Ahead:
        """The free run over all that was held."""
        return self.rows[-1]

    @property
    def beaten_by(self) -> tuple[str, ...]:
        """The forecasts without a model that are better by more than the noise.

        Both a forecast and the truth carry noise, so squares closer than twice its square are no difference.
        """
        mine = self.headline.error**2
        return tuple(name for name, error in self.rivals if mine > error**2 * (1 + 1e-9) + 2 * self.floor**2)

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why the model is not shown to foretell, in clauses; empty where it is."""
        row, found = self.headline, []
        if not self.unseen:
            found.append("nothing was held out: it is not known how the model foretells data that it has not seen")
        if row.blow_ups:
            found.append(f"{row.blow_ups} of {row.runs} free runs over {row.length} blow up")
        elif self.beaten_by:
            names = " and than ".join(self.beaten_by)
            best = max(1 - error**2 for name, error in self.rivals if name in self.beaten_by)
            r2 = f"R2 {row.r2_mean:.2g}, without a model {best:.2g}"
            found.append(f"over {row.length} the model foretells less than {names} ({r2})")
        means = self.mean_r2 or (0.0,) * len(self.states)
        each = zip(self.states, row.r2, means, strict=True)
        poor = [f"{name} (R2 {r:.2g})" for name, r, mean in each if r < min(mean, 0.0) - self.floor**2]
        if poor and not found:
            found.append(f"over {row.length} the model is worse than the mean for {', '.join(poor[:4])}")
        if self.floor >= NOISY:
            found.append("the record moves hardly more than its noise: there is little to foretell")
        return tuple(found)

    def __str__(self) -> str:
        lines = [f"{self.basis}, free runs restarted along it", "  ahead            R2       error of the range"]
        for row in self.rows:
            percent = ", ".join(f"{p:.2g} %" for p in row.percent[:6])
            mark = "*" if row is self.headline else " "
            lines.append(f"{mark} {row.length:<16} {row.r2_mean:<8.4f} {percent}")
        return "\n".join(lines)


NOISY = 0.5  # noise of this share of the record's deviation leaves little to foretell


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Measurements in two parts: what a fit sees, and what it does not, with what was measured just before each run."""

    train: Trajectories
    held: Trajectories
    before: tuple[Trajectory, ...]
    basis: str


def hold_out(data: Trajectories, share: float = SHARE) -> HeldOut | None:
    """Hold out the tail of every run, or whole runs where they are too short for one; None where neither is possible.

    Whole runs are taken evenly over the record.
    """
    cuts = [len(run) - int(share * len(run)) for run in data]
    if all(len(run) - cut >= SHORTEST for run, cut in zip(data, cuts, strict=True)):
        first, rest = parted(data, cuts, LONGEST)
        return HeldOut(first, rest, tuple(first), f"the last {100 * share:.0f} % of every run, held out")
    if len(data) < FEWEST_RUNS:
        return None
    chosen = set(np.linspace(0, len(data) - 1, max(1, int(share * len(data)))).astype(int).tolist())
    train = tuple(run for k, run in enumerate(data) if k not in chosen)
    held = tuple(run for k, run in enumerate(data) if k in chosen)
    basis = f"{len(held)} of {len(data)} runs, held out"
    return HeldOut(_of(data, train), _of(data, held), tuple(run[:0] for run in held), basis)


def parted(data: Trajectories, cuts: Sequence[int], longest: int) -> tuple[Trajectories, Trajectories]:
    """Return every run up to its cut, and at most `longest` of its samples from there."""
    pairs = list(zip(data, cuts, strict=True))
    rest = tuple(run[cut : cut + longest] for run, cut in pairs)
    return _of(data, tuple(run[:cut] for run, cut in pairs)), _of(data, rest)


def _of(data: Trajectories, runs: tuple[Trajectory, ...]) -> Trajectories:
    return Trajectories(runs, data.states, data.inputs)


def held_out_scores(
    model: Simulator,
    held: Trajectories,
    record: Record,
    *,
    hold: str = "zoh",
    basis: str = "held-out data",
    before: Sequence[Trajectory] | None = None,
    unseen: bool = True,
) -> Scores:
    """Score free runs of a model on measurements, restarted along them, at several horizons.

    `before` is what was measured just before each run, which a straight line is laid through.
    """
    leads = list(before) if before is not None else [run[:0] for run in held]
    longest = max(len(run) for run in held) - 1
    rows, rivals = [], dict[str, ndarray]()
    for steps in (h for h in HORIZONS if h < longest):
        places = list(_places(held, steps))
        pieces = [held[r][a : a + steps + 1] for r, a in places]
        guess, out = restarted(model, pieces, hold, record.moments)
        truth = np.stack([piece.x for piece in pieces])
        seconds = float(np.median([piece.t[-1] - piece.t[0] for piece in pieces]))
        rows.append(_row(truth[:, 1:], guess[:, 1:], steps, seconds, int(out.sum()), record.moments))
        if steps == record.memory:
            rivals = _rivals([_until(held[r], leads[r], a) for r, a in places], pieces, record.moments)
    rows.append(_whole(model, held, record.moments, hold))
    if not rivals:
        rivals = _rivals(leads, list(held), record.moments)
    place = next((k for k, row in enumerate(rows[:-1]) if row.steps == record.memory), len(rows) - 1)
    told = (_errors(rivals, record.moments), record.floor, record.moves(held), _r2(rivals[MEAN]))
    return Scores(basis, unseen, held.states, tuple(rows), place, *told)


def _errors(rivals: Mapping[str, ndarray], record: Moments) -> tuple[tuple[str, float], ...]:
    """Return forecasts with their errors over the deviation, the root mean square over the states that move."""
    moving = record.deviation > 0
    return tuple((name, float(np.sqrt(part[moving].mean())) if moving.any() else 0.0) for name, part in rivals.items())


def _r2(squares: Float[ndarray, " n"]) -> tuple[float, ...]:
    return tuple((1 - squares).tolist())


def scores_of(
    guesses: Sequence[Float[ndarray, "N n"]], held: Trajectories, before: Sequence[Trajectory], basis: str
) -> Scores:
    """Score forecasts of whole runs that were made elsewhere, from the first sample of each on.

    A forecast that is shorter than its run has blown up. `before` is as for `held_out_scores`.
    """
    record = Record.of(held)
    whole = [len(guess) == len(run) for guess, run in zip(guesses, held, strict=True)]
    pairs = [((guess - run.x)[1:], run) for guess, run, good in zip(guesses, held, whole, strict=True) if good]
    squares = np.concatenate([off**2 for off, _ in pairs]).mean(axis=0) if pairs else np.full(len(held.states), np.inf)
    seconds = max(float(run.t[-1] - run.t[0]) for run in held)
    runs = _Runs(max(len(run) for run in held) - 1, seconds, len(held), whole.count(False), whole=True)
    rivals = _rivals(before, list(held), record.moments)
    row = _ahead(squares, record.moments, runs)
    told = (_errors(rivals, record.moments), record.floor, record.moves(held), _r2(rivals[MEAN]))
    return Scores(basis, True, held.states, (row,), 0, *told)


def _places(held: Trajectories, steps: int) -> Iterator[tuple[int, int]]:
    """Yield run and first sample of at most 64 pieces, one behind the other along each run, evenly chosen."""
    every = [(r, a) for r, run in enumerate(held) for a in range(0, len(run) - steps, steps)]
    for k in evenly(len(every), RESTARTS):
        yield every[k]


def _until(run: Trajectory, lead: Trajectory, start: int) -> Trajectory:
    """Return what was measured before a sample of a run."""
    t, x = (np.concatenate([getattr(lead, name), getattr(run, name)[:start]]) for name in ("t", "x"))
    return Trajectory(t, x, np.zeros((len(t), 0)))


def _row(truth: ndarray, guess: ndarray, steps: int, seconds: float, out: int, record: Moments) -> Ahead:
    """Return the row of pieces (s, N, n)."""
    n = truth.shape[-1]
    squares = ((truth - guess) ** 2).reshape(-1, n).mean(axis=0)
    return _ahead(squares, record, _Runs(steps, seconds, len(truth), out))


def _whole(model: Simulator, held: Trajectories, record: Moments, hold: str) -> Ahead:
    found = free_run_score(model, held, hold, record=record)
    steps = max(len(run) for run in held) - 1
    seconds = max(float(run.t[-1] - run.t[0]) for run in held)
    squares = np.array(found.rmse_states) ** 2
    runs = _Runs(steps, seconds, len(held), found.blow_ups + found.unfinished, whole=True)
    return _ahead(squares, record, runs)


@dataclass(frozen=True)
class _Runs:
    """Free runs of some length, how many they are, and how many of them blew up; whether they are whole records."""

    steps: int
    seconds: float
    count: int
    blow_ups: int
    whole: bool = False


def _ahead(squares: ndarray, record: Moments, runs: _Runs) -> Ahead:
    """Return the row of free runs with these squared errors, a state each."""
    spread, width = record.deviation**2, record.high - record.low
    moving = spread > 0
    relative = np.where(moving, squares / np.where(moving, spread, 1.0), 0.0)
    percent = np.where(moving, 100 * np.sqrt(squares) / np.where(width > 0, width, 1.0), 0.0)
    error = float(np.sqrt(relative[moving].mean())) if moving.any() else 0.0
    rmse, off, r2 = (tuple(part.tolist()) for part in (np.sqrt(squares), percent, 1 - relative))
    return Ahead(
        steps=runs.steps,
        seconds=runs.seconds,
        runs=runs.count,
        rmse=rmse,
        percent=off,
        r2=r2,
        error=error,
        blow_ups=runs.blow_ups,
        whole=runs.whole,
    )


def _rivals(before: Sequence[Trajectory], pieces: Sequence[Trajectory], record: Moments) -> dict[str, ndarray]:
    """Return the squared errors over the variance of forecasts that need no model, one a state; 0 where none moves."""
    found: dict[str, list[ndarray]] = {MEAN: [], LAST: [], LINE: []}
    for lead, piece in zip(before, pieces, strict=True):
        ahead = piece.t[1:, None] - piece.t[0]
        slope = _slope(_until(piece, lead[-len(piece) :], 1))
        for name, guess in ((MEAN, record.mean), (LAST, piece.x[0]), (LINE, piece.x[0] + slope * ahead)):
            found[name].append((piece.x[1:] - guess) ** 2)
    moving = record.deviation > 0
    size = np.where(moving, record.deviation, 1.0)
    return {name: np.where(moving, np.concatenate(parts).mean(axis=0) / size**2, 0.0) for name, parts in found.items()}


def _slope(run: Trajectory) -> Float[ndarray, " n"]:
    """Return the slope of the least-squares line through a run, 0 through a single sample."""
    t = run.t - run.t.mean()
    power = float((t**2).sum())
    return t @ run.x / power if power > 0 else np.zeros(run.x.shape[1])
