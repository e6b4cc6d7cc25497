"""CertifiedIdentifier: the best model that is certified, of the data and functions of any estimator."""

import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from sklearn.base import BaseEstimator, clone
from sklearn.utils.validation import check_is_fitted

from persid._files import Json
from persid._threads import few_threads
from persid.certificates.certificate import Certificate
from persid.certificates.margin import Margin
from persid.certified_fits.candidates import (
    Candidate,
    Choice,
    Dictionary,
    dictionary,
    estimator_with,
    free_run_error,
    halves,
    lowest_error,
    ranked,
    scored,
    shortened,
    shown,
    trials,
)
from persid.certified_fits.comparison import CertifiedReport
from persid.certified_fits.joint_problem import Demand
from persid.certified_fits.multistart import Line, Result, Task, best_certified, certificate_of, sketch
from persid.errors import DataError
from persid.identification import free_runs as freerun
from persid.identification.estimators import estimator
from persid.identification.gram import Gram
from persid.identification.identifier import PersidskiiIdentifier
from persid.identification.refinement import Pieces
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.margins import Residuals
from persid.lyapunov.shifted_model import undefined
from persid.measurements.arrays import refuse_target
from persid.measurements.trajectories import Trajectories
from persid.models.model import PersidskiiModel
from persid.verdicts.certify import certify
from persid.verdicts.margins import margin_by
from persid.verdicts.verdict import Attempt, Certified, Reason, Undecided, Verdict

SCOPES = ("global", "regional")
RIDGES = (1.0, 1e-2, 1e-4)  # strengths that are tried, in units of the free fit's
LEAST_RIDGE = 1e-8
TRIED_STATES = 6  # several ridges are tried up to this many states
RATING = 10.0  # s, at least, in which a rate and a gain are sought
GAIN_RATES = (0.5, 0.2, 0.05)  # shares of the linear fit's decay rate at which a gain is asked for
KNOWN_SHARE = 0.25  # of the time limit, in which equations of velocities stay known


def rated(
    model: PersidskiiModel,
    verdict: Certified,
    time_limit: float | int,
    progress: Callable[[str], None] | None = None,
    rate: float | int | None = None,
) -> Certified:
    """Return the verdict with a rate and a gain, or in a region with a larger rate, where that is found; else as given.

    `rate` (1/s) is one that is asked for, as by `certify`.

    The multipliers of a fit are those of its data's best model, at the edge of what can be certified; for that model
    `certify` finds larger rates and smaller gains.
    """
    regional = verdict.certificate.scope == "regional"
    domain = "data" if regional else "global"
    found = certify(model, domain=domain, rate=rate, time_limit=time_limit, progress=progress)
    if not isinstance(found, Certified) or found.certificate.claim != ("region" if regional else "rate-and-gain"):
        return verdict
    if (found.certificate.rate or 0.0) <= (verdict.certificate.rate or 0.0):
        return verdict
    return replace(found, attempts=verdict.attempts + found.attempts, margin=larger(verdict.margin, found.margin))


def larger(one: Margin | None, other: Margin | None) -> Margin | None:
    """Return the larger of two residual margins of a model, of which either may be missing."""
    return max((margin for margin in (one, other) if margin is not None), key=lambda margin: margin.delta, default=None)


class CertifiedIdentifier(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """Fit a model under the condition that its input-to-state stability has a proof that the checker accepts.

    estimator: a PersidskiiIdentifier, fitted or not; its method, functions, pattern and other options are taken over.
    scope: "global", or "regional" (the box of the data).
    margin: of the matrix inequality, in scaled units (tr P + sum mu = 1).
    min_rate: None, or the least certified rate of decay in 1/s.  max_gain: None, or the largest certified gain.
    residual_margin: None, or the delta (1/s) of plants that have to be certified with the model: those whose x' differs
        from the model's by at most delta times the distance from the operating point, in half widths of the data.
    fixed: known coefficients, {(state, column): number}; columns are named as by `get_feature_names_out`.
    select: None (the estimator's functions), or "auto": also smaller dictionaries, chosen by validation free runs.
    ridge: "auto" (the free fit's and weaker ones, chosen by validation free runs) or a strength.
    time_limit: seconds for the whole fit, the free one not counted.
    progress: is called with a line of text at each step.

    After `fit`: free_ (the fitted estimator), model_ (certified; where none was found, the free model), certificate_
    (None where none was found), verdict_ (Certified or Undecided), report_, history_, table_, stop_.

    Examples:
        >>> data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> best = ps.CertifiedIdentifier(ps.PersidskiiIdentifier(["x"], ridge=1e-3), ridge=1e-3).fit(data)
        >>> best.verdict_.is_certified
        True
    """

    def __init__(
        self,
        estimator: Any = None,
        *,
        scope: str = "global",
        margin: float | int = 1e-5,
        min_rate: float | int | None = None,
        max_gain: float | int | None = None,
        residual_margin: float | int | None = None,
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
        self.residual_margin = residual_margin
        self.fixed = fixed
        self.select = select
        self.ridge = ridge
        self.time_limit = time_limit
        self.progress = progress

    def fit(
        self, X: object, y: object = None, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> "CertifiedIdentifier":
        """Fit freely, then under the certificate; X, y, u, t and dt are those of the estimator's `fit`.

        Raises:
            DataError: an option or the data cannot be used.
        """
        _check_options(self)
        estimator = PersidskiiIdentifier() if self.estimator is None else self.estimator
        if estimator.time == "discrete":
            raise DataError(
                'a fit under the certificate is one in continuous time; certify the model of time="discrete"'
            )
        if estimator.monotone:
            raise DataError("a fit under the certificate does not keep monotone=True; certify the free fit instead")
        given = {"X": X, "y": y, "u": u, "t": t, "dt": dt}
        self.free_ = clone(estimator).fit(**given)
        data = self.free_._known(X, u=u, t=t, dt=dt)
        began = time.perf_counter()
        deadline = began + self.time_limit
        outside = undefined(self.free_.model_) if self.scope == "global" and self.select is None else ()
        with few_threads(self.free_.model_.n):
            self.table_ = () if outside or y is not None else self._candidates(data, deadline)
            # a velocity whose equation is known makes a mechanical model, and springs need rows of the inequality that
            # are exactly zero, which no interior point has: where no certificate is found, the equation is fitted, too
            known = self.free_.velocities == "auto" and bool(self.free_.velocities_)
            first = began + KNOWN_SHARE * self.time_limit if known else deadline
            found = None if outside else self._final(given, data, self.table_, first)
            given_up = known and found is not None and found[0] is None
            if given_up:
                found = self._final(given, data, self.table_, deadline, keeps=False)
        self.velocities_ = {} if given_up else self.free_.velocities_
        result, history, chosen = found or (None, (), Choice(None, self.free_.ridge_))
        seconds = time.perf_counter() - began
        self.history_, self.ridge_ = history, None if result is None else chosen.ridge
        self.functions_ = chosen.functions
        self._deliver(result, data, seconds, outside)
        return self

    def _final(
        self,
        given: Json,
        data: Trajectories,
        table: tuple[Candidate, ...],
        deadline: float,
        keeps: bool = True,
    ) -> tuple[Result | None, tuple[Line, ...], Choice]:
        """Fit to all data with the best candidate; where that is not certified, with the next ones.

        `keeps`: the equations of velocities stay known; else they are fitted.
        """
        history: tuple[Line, ...] = ()
        choice = Choice(None, self.free_.ridge_)
        for choice in ranked(table, self.free_.ridge_ if self.ridge == "auto" else float(self.ridge)):
            fitted = self.free_
            if not keeps or choice.functions not in (None, self._dictionary):
                again = estimator_with(self.free_, choice.functions or self._dictionary)
                fitted = (again if keeps else again.set_params(velocities=None)).fit(**given)
            result, lines = self._certified(fitted, choice.ridge, data, deadline)
            history += lines
            if result is not None or time.perf_counter() > deadline:
                return result, history, choice
        return None, history, choice

    def _certified(
        self, fitted: PersidskiiIdentifier, ridge: float, data: Trajectories, deadline: float
    ) -> tuple[Result | None, tuple[Line, ...]]:
        history: tuple[Line, ...] = ()
        for demand in self._demands(fitted):
            task = self._task(fitted, ridge, demand, deadline)
            score = partial(free_run_error, data=shortened(data), hold=self.free_.hold)
            result, lines = best_certified(replace(task, score=score, pieces=Pieces.of(data, self.free_.hold)))
            history += lines
            if result is not None and self._meets(result.certificate):
                return result, history
        return None, history

    def _task(self, fitted: PersidskiiIdentifier, ridge: float, demand: Demand, deadline: float) -> Task:
        gram: Gram = fitted.gram_
        box = fitted.model_.domain
        provenance = fitted.model_.provenance | {"fitted_under": "certificate", "ridge": ridge}

        def make(theta: Float[ndarray, "p n"]) -> PersidskiiModel:
            return gram.basis.model(theta, domain=box, provenance=provenance)

        return Task(
            gram=gram,
            ridge=ridge,
            fixed=_fixed(self.fixed, fitted),
            demand=demand,
            make=make,
            box=box if self.scope == "regional" else None,
            deadline=deadline,
            progress=self.progress or (lambda line: None),
        )

    def _demands(self, fitted: PersidskiiIdentifier) -> Iterator[Demand]:
        """Yield what the inequality has to show: a gain needs some rate, and several are tried."""
        rate = 0.0 if self.min_rate is None else float(self.min_rate)
        near: tuple[Deviation, ...] = ()
        if self.residual_margin is not None:
            model = fitted.model_
            near = (Residuals.of(model, model.m).within(float(self.residual_margin)),)
        if self.max_gain is None:
            yield Demand(float(self.margin), 2.0 * rate * (1 + 1e-6), None, near)
            return
        fastest = -float(np.linalg.eigvals(fitted.model_.jacobian(fitted.model_.x_ref)).real.max())
        tried = [rate] if rate else [share * (fastest if fastest > 0 else 1.0) for share in GAIN_RATES]
        for chosen in tried:
            kappa = 2.0 * chosen * (1 + 1e-6)
            yield Demand(float(self.margin), kappa, 0.9 * float(self.max_gain) ** 2 * kappa, near)

    def _meets(self, certificate: Certificate) -> bool:
        """Whether the accepted certificate shows the rate and the gain that were asked for."""
        if self.min_rate is None and self.max_gain is None:
            return True
        slow = self.min_rate is not None and (certificate.rate or 0.0) < self.min_rate
        strong = self.max_gain is not None and (certificate.gain or np.inf) > self.max_gain
        return not (slow or strong)

    @property
    def _dictionary(self) -> Dictionary:
        return dictionary(self.free_.functions, len(self.free_.model_.states))

    def _candidates(self, data: Trajectories, deadline: float) -> tuple[Candidate, ...]:
        """Fit candidates to the first part of every run, and score them on the rest."""
        ridges = [float(self.ridge)] if self.ridge != "auto" else self._ridges(len(data.states))
        parts, table = halves(data), list[Candidate]()
        if parts is None or (self.select is None and len(ridges) < 2):
            return ()
        until = deadline - 0.5 * self.time_limit  # half of the time is for the candidates
        for choice in trials(self._dictionary, ridges, table, self.select == "auto"):
            left = until - time.perf_counter()
            if left <= 0:
                break
            table.append(self._candidate(choice, *parts, 0.5 * left, lowest_error(table)))
        return tuple(table)

    def _candidate(
        self, choice: Choice, train: Trajectories, test: Trajectories, limit: float, bar: float
    ) -> Candidate:
        """Fit one candidate to the first part; where functions are selected, polish it, and prove it if it leads."""
        began = time.perf_counter()
        functions = choice.functions or self._dictionary
        fitted = estimator_with(self.free_, functions).set_params(derivatives=0, delays=0).fit(train)
        train, test = (part.with_inputs(fitted.model_.inputs) for part in (train, test))
        selecting = self.select == "auto"
        task = self._task(fitted, choice.ridge, next(self._demands(fitted)), began + limit)
        found = sketch(replace(task, pieces=Pieces.of(train, self.free_.hold)) if selecting else task)
        error, r2, certified = np.inf, -np.inf, None
        if found is not None:
            model = task.make(found.theta)
            error, r2 = scored(model, test, self.free_.hold)
            if selecting and error < bar:
                certified = certificate_of(task, found.frame, model, found.point) is not None
        excess = np.inf if found is None else found.excess
        names, seconds = shown(functions, self.free_.model_.states), time.perf_counter() - began
        return Candidate(
            functions=functions,
            names=names,
            ridge=choice.ridge,
            feasible=found is not None,
            certified=certified,
            error=error,
            r2=r2,
            excess=excess,
            seconds=seconds,
        )

    def _ridges(self, n: int) -> list[float]:
        strengths = [max(self.free_.ridge_ * share, LEAST_RIDGE) for share in RIDGES]
        return list(dict.fromkeys(strengths)) if n <= TRIED_STATES else [self.free_.ridge_]

    def _deliver(self, result: Result | None, data: Trajectories, seconds: float, outside: tuple[str, ...]) -> None:
        attempts = tuple(
            Attempt(f"fit, {line.start}", "certified" if line.certified else line.stop, line.seconds)
            for line in self.history_
        )
        self.model_ = self.free_.model_ if result is None else result.model
        runs = shortened(data)
        free, certified = (
            freerun.free_run_score(model, runs, self.free_.hold) for model in (self.free_.model_, self.model_)
        )
        best = next((line for line in reversed(self.history_) if line.certified), None)
        if result is None:
            self.stop_ = "No certified model was found; model_ is the free fit, which has no certificate."
            reason = Reason.TIME if seconds >= self.time_limit else Reason.STALLED  # nothing is proved by finding none
            if outside:
                reason, self.stop_ = Reason.OUTSIDE, f"{_UNDEFINED.format('; '.join(outside[:4]))} {self.stop_}"
            self.verdict_: Verdict = Undecided(reason, self.stop_, attempts)
        else:
            self.stop_ = "" if best is None else best.stop
            proved = Certified(result.certificate, attempts)
            if self.residual_margin is not None:
                proved = self._beside_plants(result, attempts, max(self.time_limit - seconds, RATING))
            unasked = self.min_rate is None and self.max_gain is None
            if self.scope == "regional" and unasked:
                proved = rated(result.model, proved, max(self.time_limit - seconds, RATING), self.progress)
            self.verdict_ = proved
        self.certificate_ = self.verdict_.certificate if isinstance(self.verdict_, Certified) else None
        excess = None if result is None else result.excess
        self.report_ = CertifiedReport(
            free=free,
            certified=None if result is None else certified,
            ridge=self.ridge_,
            excess=excess,
            stop=self.stop_,
            seconds=seconds,
            history=self.history_,
            table=self.table_,
        )

    def _beside_plants(self, result: Result, attempts: tuple[Attempt, ...], time_limit: float) -> Certified:
        """Return the verdict on a model by a certificate of its own, and that of the plants near it as its margin."""
        margin = margin_by(result.certificate)
        domain = "data" if self.scope == "regional" else "global"
        own = certify(result.model, domain=domain, time_limit=time_limit, progress=self.progress)
        if isinstance(own, Certified) and isinstance(own.certificate, Certificate) and self._meets(own.certificate):
            return replace(own, attempts=attempts + own.attempts, margin=larger(margin, own.margin))
        return Certified(result.certificate, attempts, margin=margin)

    def predict(
        self, X: object, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> Float[ndarray, "N n"]:
        """Return, for every sample, the state one step later (all runs one below the other)."""
        check_is_fitted(self, "model_")
        data = self.free_._known(X, u, t, dt)
        return np.concatenate([freerun.one_step(self.model_, run, self.free_.hold) for run in data])

    def simulate(self, x0: object, t: Float[ndarray, " N"], u: object = None) -> Trajectories:
        """Simulate the model from x0; see the model's."""
        check_is_fitted(self, "model_")
        return self.model_.simulate(x0, t, u)

    def score(
        self, X: object, y: object = None, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> float:
        """Return the R2 of free runs over all runs, the mean over states; y is refused."""
        check_is_fitted(self, "model_")
        refuse_target(None if estimator(self.free_.method).slopes else y)
        return freerun.free_run_score(self.model_, self.free_._known(X, u, t, dt), self.free_.hold).r2_mean


_UNDEFINED = (
    "It is not proved that {} is defined and continuous for all states, which a global claim needs; ask for a region: "
    'scope="regional".'
)


def _fixed(fixed: Mapping[tuple[str, str], float | int] | None, fitted: PersidskiiIdentifier) -> Float[ndarray, "p n"]:
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
    for name in ("margin", "min_rate", "max_gain", "residual_margin", "time_limit"):
        number = getattr(estimator, name)
        if number is not None and not (np.isfinite(number) and number > 0):
            raise DataError(f"{name}={number!r}; needed is a positive number")
    if estimator.ridge != "auto" and (isinstance(estimator.ridge, str) or not estimator.ridge >= 0):
        raise DataError(f'ridge={estimator.ridge!r}; needed is "auto" or a number >= 0')
