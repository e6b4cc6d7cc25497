"""CertifiedIdentifier: the best model that is certified, of the data and functions of any estimator."""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import combinations
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from sklearn.base import BaseEstimator, clone
from sklearn.utils.validation import check_is_fitted

from persid import freerun
from persid.certificate import Certificate, value
from persid.certify import Attempt, Certified, Reason, Undecided, Verdict
from persid.errors import DataError
from persid.frame import Demand
from persid.freerun import Score
from persid.identify import PersidskiiIdentifier
from persid.model import PersidskiiModel
from persid.refine import Pieces
from persid.starts import Line, Result, Task, best_certified, sketch
from persid.trajectories import Trajectories, Trajectory

SCOPES = ("global", "regional")
RIDGES = (1.0, 1e-2, 1e-4)  # strengths that are tried, in units of the free fit's
LEAST_RIDGE = 1e-8
TRIED_STATES = 6  # several ridges are tried up to this many states
VALIDATED = 0.2  # share of every run that candidates are scored on
SHORTEST = 16  # samples of a run, below which nothing is kept for scores
LONGEST = 3000  # samples of one scored free run
SIMILAR = 1.02  # of candidates within 2 % of the best error, the first counts: the simplest, most regular one
GAIN_RATES = (0.5, 0.2, 0.05)  # shares of the linear fit's decay rate at which a gain is asked for


@dataclass(frozen=True, eq=False)
class Candidate:
    """One choice of functions and ridge, fitted under the certificate to the first part of every run.

    `feasible` says whether a fit that satisfies the matrix inequality in floating point was found (proofs are made of
    the final fit alone); `error` is the free-run RMSE on the rest, in widths of the data; `excess` the growth of the
    residuals over the free fit with the same functions and ridge.
    """

    functions: tuple[str, ...]
    ridge: float
    feasible: bool
    error: float
    excess: float
    seconds: float


@dataclass(frozen=True, eq=False)
class CertifiedReport:
    """The free fit and the certified one side by side: free runs over all of the data, and how the search went.

    `price` is the certified model's RMSE over the free one's; None where nothing was certified or the free model blows
    up. `stop` is the sentence with which the best descent ended.
    """

    free: Score
    certified: Score | None
    ridge: float | None
    excess: float | None
    stop: str
    seconds: float
    history: tuple[Line, ...]
    table: tuple[Candidate, ...]

    @property
    def price(self) -> float | None:
        """RMSE of the certified model over that of the free one."""
        if self.certified is None or self.free.blow_ups or not self.free.rmse > 0:
            return None
        return self.certified.rmse / self.free.rmse

    def __str__(self) -> str:
        lines = [f"free       {_score_text(self.free)}", f"certified  {_score_text(self.certified)}"]
        if self.price is not None:
            lines.append(f"price      RMSE times {self.price:.3f}; residuals +{100 * (self.excess or 0.0):.2g} %")
        lines += [f"{self.stop} ({self.seconds:.1f} s)", *(_line_text(line) for line in self.history)]
        return "\n".join([*lines, *(_candidate_text(candidate) for candidate in self.table)])


def _score_text(score: Score | None) -> str:
    if score is None:
        return "none found"
    blown = f", {score.blow_ups} runs blow up" if score.blow_ups else ""
    return f"RMSE {score.rmse:.4g}, R2 " + " ".join(f"{r:.3f}" for r in score.r2_states) + blown


def _line_text(line: Line) -> str:
    end = "certified" if line.certified else "not certified"
    cost = f"residuals +{100 * line.excess:.3g} %, {line.steps} steps, {line.seconds:.1f} s"
    return f"  {line.start}: {end}, {cost}. {line.stop}"


def _candidate_text(row: Candidate) -> str:
    end = f"validation error {row.error:.4g}" if row.feasible else "no feasible fit"
    return f"  {', '.join(row.functions)}; ridge {row.ridge:.1e}: {end}, {row.seconds:.1f} s"


@dataclass(frozen=True, eq=False)
class Delivery:
    """What a run delivers: a model with its verdict, and the comparison of both fits where there were two."""

    model: PersidskiiModel
    verdict: Verdict
    comparison: dict[str, Any] | None = None


def deliver(
    free: Any,
    verdict: Verdict,
    data: Trajectories,
    time_limit: float = 60.0,
    progress: Callable[[str], None] | None = None,
) -> Delivery:
    """Keep a free fit that is certified globally; else deliver a fit under the certificate where one is found."""
    if isinstance(verdict, Certified) and verdict.certificate.scope == "global":
        return Delivery(free.model_, verdict)
    fit = CertifiedIdentifier(free, time_limit=max(time_limit, 1e-3), progress=progress).fit(data)
    found = fit.verdict_.is_certified
    return Delivery(
        fit.model_ if found else free.model_,
        fit.verdict_ if found else verdict,
        _comparison(fit.report_, type(verdict).__name__.lower()),
    )


def _comparison(report: CertifiedReport, verdict: str) -> dict[str, Any]:
    """Return both fits side by side in plain numbers, as `run.json` keeps them."""
    scores = (("free", report.free, verdict), ("under the certificate", report.certified, "certified"))
    fits = [
        {"name": name, "verdict": word, "rmse": s.rmse, "r2": list(s.r2_states), "blow_ups": s.blow_ups}
        for name, s, word in scores
        if s is not None
    ]
    history = [
        {
            "start": line.start,
            "certified": line.certified,
            "excess": line.excess,
            "seconds": line.seconds,
            "stop": line.stop,
        }
        for line in report.history
    ]
    table = [
        {"functions": list(row.functions), "ridge": row.ridge, "feasible": row.feasible, "error": row.error}
        for row in report.table
    ]
    return {"fits": fits, "price": report.price, "stop": report.stop, "history": history, "candidates": table}


class CertifiedIdentifier(BaseEstimator):
    """Fit a model under the condition that its input-to-state stability has a proof that the checker accepts.

    estimator: a PersidskiiIdentifier, fitted or not; its method, functions, pattern and other options are taken over.
    scope: "global", or "regional" (the box of the data).
    margin: of the matrix inequality, in scaled units (tr P + sum mu = 1).
    min_rate: None, or the least certified rate of decay in 1/s.  max_gain: None, or the largest certified gain.
    fixed: known coefficients, {(state, column): number}; columns are named as by `get_feature_names_out`.
    select: None (the estimator's functions), or "auto": also smaller dictionaries, chosen by validation free runs.
    ridge: "auto" (the free fit's and weaker ones, chosen by validation free runs) or a strength.
    time_limit: seconds for the whole fit, the free one not counted.
    progress: is called with a line of text at each step.

    After `fit`: free_ (the fitted estimator), model_ (certified; where none was found, the free model), certificate_
    (None where none was found), verdict_ (Certified or Undecided), report_, history_, table_, stop_.
    """

    def __init__(
        self,
        estimator: Any = None,
        *,
        scope: str = "global",
        margin: float | int = 1e-5,
        min_rate: float | int | None = None,
        max_gain: float | int | None = None,
        fixed: Mapping[tuple[str, str], float | int] | None = None,
        select: str | None = None,
        ridge: float | int | str = "auto",
        time_limit: float | int = 60.0,
        progress: Callable[[str], None] | None = None,
    ) -> None:
        self.estimator = estimator
        self.scope = scope
        self.margin = margin
        self.min_rate = min_rate
        self.max_gain = max_gain
        self.fixed = fixed
        self.select = select
        self.ridge = ridge
        self.time_limit = time_limit
        self.progress = progress

    def fit(
        self, X: Any, y: Any = None, *, u: Any = None, t: Any = None, dt: float | int | None = None
    ) -> "CertifiedIdentifier":
        """Fit freely, then under the certificate; X, y, u, t and dt are those of the estimator's `fit`.

        Raises:
            DataError: an option or the data cannot be used.
        """
        _check_options(self)
        estimator = PersidskiiIdentifier() if self.estimator is None else self.estimator
        given = {"u": u, "t": t, "dt": dt}
        self.free_ = clone(estimator).fit(X, y, **given)
        data = self.free_._known(X, **given)
        began = time.perf_counter()
        deadline = began + self.time_limit
        table = tuple(self._candidates(data, deadline)) if y is None else ()
        self.table_ = table
        result, history, chosen = self._final(X, y, given, data, table, deadline)
        seconds = time.perf_counter() - began
        self.history_, self.ridge_ = history, None if result is None else chosen.ridge
        self._deliver(result, data, seconds)
        return self

    def _final(
        self, X: Any, y: Any, given: dict[str, Any], data: Trajectories, table: tuple[Candidate, ...], deadline: float
    ) -> tuple[Result | None, tuple[Line, ...], "_Choice"]:
        """Fit to all data with the best candidate; where that is not certified, with the next ones."""
        history: tuple[Line, ...] = ()
        choice = _Choice(None, self.free_.ridge_)
        for choice in _ranked(table, self.free_.ridge_ if self.ridge == "auto" else float(self.ridge)):
            fitted = self.free_ if choice.functions is None else _with(self.free_, choice.functions).fit(X, y, **given)
            result, lines = self._certified(fitted, choice.ridge, data, deadline)
            history += lines
            if result is not None or time.perf_counter() > deadline:
                return result, history, choice
        return None, history, choice

    def _certified(
        self, fitted: Any, ridge: float, data: Trajectories, deadline: float
    ) -> tuple[Result | None, tuple[Line, ...]]:
        history: tuple[Line, ...] = ()
        for demand in self._demands(fitted):
            task = self._task(fitted, ridge, demand, deadline)
            score = partial(_error, data=_shortened(data), hold=self.free_.hold)
            result, lines = best_certified(replace(task, score=score, pieces=Pieces.of(data, self.free_.hold)))
            history += lines
            if result is not None and self._meets(result.certificate):
                return result, history
        return None, history

    def _task(self, fitted: Any, ridge: float, demand: Demand, deadline: float) -> Task:
        gram, box = fitted.gram_, fitted.model_.domain
        provenance = fitted.model_.provenance | {"fitted_under": "certificate", "ridge": ridge}

        def make(theta: Float[ndarray, "p n"]) -> PersidskiiModel:
            return gram.basis.model(theta, domain=box, provenance=provenance)

        return Task(
            gram, ridge, _fixed(self.fixed, fitted), demand, make, box if self.scope == "regional" else None,
            deadline, self.progress or (lambda line: None),
        )  # fmt: skip

    def _demands(self, fitted: Any) -> Iterator[Demand]:
        """Yield what the inequality has to show: a gain needs some rate, and several are tried."""
        rate = 0.0 if self.min_rate is None else float(self.min_rate)
        if self.max_gain is None:
            yield Demand(float(self.margin), 2.0 * rate * (1 + 1e-6))
            return
        fastest = -float(np.linalg.eigvals(fitted.model_.jacobian(fitted.model_.x_ref)).real.max())
        tried = [rate] if rate else [share * (fastest if fastest > 0 else 1.0) for share in GAIN_RATES]
        for chosen in tried:
            kappa = 2.0 * chosen * (1 + 1e-6)
            yield Demand(float(self.margin), kappa, 0.9 * float(self.max_gain) ** 2 * kappa)

    def _meets(self, certificate: Certificate) -> bool:
        """Whether the accepted certificate shows the rate and the gain that were asked for."""
        if self.min_rate is None and self.max_gain is None:
            return True
        kappa, gamma, p = (value(certificate.content[name]) for name in ("kappa", "gamma", "p"))
        slow = self.min_rate is not None and kappa / 2 < self.min_rate
        strong = self.max_gain is not None and np.sqrt(gamma / (kappa * p)) > self.max_gain
        return not (slow or strong)

    def _candidates(self, data: Trajectories, deadline: float) -> Iterator[Candidate]:
        """Fit candidates to the first part of every run, and score them on the rest."""
        names = _names(self.free_)
        dictionaries = _dictionaries(names) if self.select == "auto" else [names]
        ridges = [float(self.ridge)] if self.ridge != "auto" else self._ridges(len(data.states))
        parts = _split(data)
        if parts is None or len(dictionaries) * len(ridges) < 2:
            return
        train, test = parts
        trials = [(functions, ridge) for ridge in ridges for functions in dictionaries]
        for k, (functions, ridge) in enumerate(trials):
            began = time.perf_counter()
            # Half of the time is for the candidates, and no candidate takes more than its share of what is left.
            left = (deadline - began - 0.5 * self.time_limit) / (len(trials) - k)
            if left <= 0:
                return
            fitted = _with(self.free_, functions).set_params(derivatives=0, delays=0).fit(train)
            found = sketch(self._task(fitted, ridge, next(self._demands(fitted)), began + left))
            error, excess = np.inf, np.inf
            if found is not None:
                error = _error(fitted.gram_.basis.model(found.theta), test, self.free_.hold)
                excess = found.excess
            yield Candidate(functions, ridge, found is not None, error, excess, time.perf_counter() - began)

    def _ridges(self, n: int) -> list[float]:
        strengths = [max(self.free_.ridge_ * share, LEAST_RIDGE) for share in RIDGES]
        return list(dict.fromkeys(strengths)) if n <= TRIED_STATES else [self.free_.ridge_]

    def _deliver(self, result: Result | None, data: Trajectories, seconds: float) -> None:
        attempts = tuple(
            Attempt(f"fit, {line.start}", "certified" if line.certified else line.stop, line.seconds)
            for line in self.history_
        )
        self.model_ = self.free_.model_ if result is None else result.model
        self.certificate_ = None if result is None else result.certificate
        runs = _shortened(data)
        free, certified = (
            freerun.free_run_score(model, runs, self.free_.hold) for model in (self.free_.model_, self.model_)
        )
        best = next((line for line in reversed(self.history_) if line.certified), None)
        if result is None:
            self.stop_ = "No certified model was found; model_ is the free fit, which has no certificate."
            reason = Reason.TIME if seconds >= self.time_limit else Reason.STALLED  # nothing is proved by finding none
            self.verdict_: Verdict = Undecided(reason, self.stop_, attempts)
        else:
            self.stop_ = "" if best is None else best.stop
            self.verdict_ = Certified(result.certificate, attempts)
        excess = None if result is None else result.excess
        self.report_ = CertifiedReport(
            free,
            None if result is None else certified,
            self.ridge_,
            excess,
            self.stop_,
            seconds,
            self.history_,
            self.table_,
        )

    def predict(self, X: Any, *, u: Any = None, t: Any = None, dt: float | int | None = None) -> Float[ndarray, "N n"]:
        """Return, for every sample, the state one step later (all runs one below the other)."""
        check_is_fitted(self, "model_")
        data = self.free_._known(X, u, t, dt)
        return np.concatenate([freerun.one_step(self.model_.rhs, run, self.free_.hold) for run in data])

    def simulate(self, x0: Any, t: Any, u: Any = None) -> Trajectories:
        """Simulate the model from x0; see the model's."""
        check_is_fitted(self, "model_")
        return self.model_.simulate(x0, t, u)

    def score(self, X: Any, y: Any = None, *, u: Any = None, t: Any = None, dt: float | int | None = None) -> float:
        """Return the R2 of free runs over all runs, the mean over states; y is ignored."""
        check_is_fitted(self, "model_")
        return freerun.free_run_score(self.model_, self.free_._known(X, u, t, dt), self.free_.hold).r2_mean


@dataclass(frozen=True)
class _Choice:
    functions: tuple[str, ...] | None
    ridge: float


def _ranked(table: tuple[Candidate, ...], fallback: float) -> list[_Choice]:
    """Order feasible candidates by their error, the first one within 2 % of the best in front."""
    good = sorted((row for row in table if row.feasible and np.isfinite(row.error)), key=lambda row: row.error)
    if not good:
        return [_Choice(None, fallback)]
    first = next(row for row in table if row in good and row.error <= SIMILAR * good[0].error)
    return [_Choice(row.functions, row.ridge) for row in [first, *(row for row in good if row is not first)]][:4]


def _names(fitted: Any) -> tuple[str, ...]:
    functions = fitted.functions
    return tuple(functions) if all(isinstance(f, str) for f in functions) else ()


def _dictionaries(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Return the sets of functions that hold the linear part, small ones first."""
    others = [name for name in names if name != "x"]
    if not names or len(others) > 5:
        return [names]
    sets = [chosen for size in range(len(others) + 1) for chosen in combinations(others, size)]
    return [("x", *chosen) for chosen in sets] if "x" in names else [chosen for chosen in sets if chosen]


def _with(fitted: Any, functions: tuple[str, ...]) -> Any:
    """Return an unfitted estimator like a fitted one, with its ridge and other functions (its own where empty)."""
    made = clone(fitted).set_params(ridge=fitted.ridge_, holdout=0.0)
    return made.set_params(functions=list(functions)) if functions else made


def _shortened(data: Trajectories) -> Trajectories:
    """Return the first samples of every run, as many as are scored."""
    return Trajectories(tuple(run[:LONGEST] for run in data), data.states, data.inputs)


def _split(data: Trajectories) -> tuple[Trajectories, Trajectories] | None:
    """Return the first part of every run and the rest, or None where the runs are too short."""
    if min(len(run) for run in data) * VALIDATED < SHORTEST:
        return None
    cuts = [len(run) - int(VALIDATED * len(run)) for run in data]
    first = tuple(run[:cut] for run, cut in zip(data, cuts, strict=True))
    rest = tuple(run[cut : cut + LONGEST] for run, cut in zip(data, cuts, strict=True))
    return Trajectories(first, data.states, data.inputs), Trajectories(rest, data.states, data.inputs)


def _error(model: PersidskiiModel, data: Trajectories, hold: str) -> float:
    """Return the free-run RMSE in widths of the data, each state counting alike."""
    limits = freerun.box(data)
    width = np.where(limits[:, 1] > limits[:, 0], limits[:, 1] - limits[:, 0], 1.0)
    errors = [_run_error(model, run, hold, width) for run in data]
    return float(np.sqrt(np.mean(errors)))


def _run_error(model: PersidskiiModel, run: Trajectory, hold: str, width: ndarray) -> float:
    found = model.simulate(run.x[0], run.t, freerun.input_signal(run.t, run.u, hold))[0]
    if len(found) < len(run):
        return np.inf
    return float((((found.x - run.x) / width) ** 2).mean())


def _fixed(fixed: Mapping[tuple[str, str], float | int] | None, fitted: Any) -> Float[ndarray, "p n"]:
    """Return the given coefficients as an array, NaN where none is given."""
    names, states = list(fitted.get_feature_names_out()), list(fitted.model_.states)
    array = np.full(fitted.gram_.H.shape, np.nan)
    for (state, column), number in (fixed or {}).items():
        if state not in states or column not in names:
            raise DataError(f"fixed names ({state!r}, {column!r}); states are {states}, columns {names}")
        array[names.index(column), states.index(state)] = float(number)
    return array


def _check_options(estimator: CertifiedIdentifier) -> None:
    if estimator.scope not in SCOPES:
        raise DataError(f"scope={estimator.scope!r}; choose one of {', '.join(SCOPES)}")
    if estimator.select not in (None, "auto"):
        raise DataError(f'select={estimator.select!r}; needed is None or "auto"')
    for name in ("margin", "min_rate", "max_gain", "time_limit"):
        number = getattr(estimator, name)
        if number is not None and not (np.isfinite(number) and number > 0):
            raise DataError(f"{name}={number!r}; needed is a positive number")
    if estimator.ridge != "auto" and (isinstance(estimator.ridge, str) or not estimator.ridge >= 0):
        raise DataError(f'ridge={estimator.ridge!r}; needed is "auto" or a number >= 0')
