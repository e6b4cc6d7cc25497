"""PersidskiiIdentifier: measurements -> PersidskiiModel, in scikit-learn's shape."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, cast

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from sklearn.base import BaseEstimator, clone
from sklearn.utils.validation import check_is_fitted

from persid.errors import DataError
from persid.identification import diagnostics
from persid.identification import free_runs as freerun
from persid.identification.basis import Basis, Functions, per_state
from persid.identification.bias import noise_bias
from persid.identification.derivatives import embedded, refuse_constant, velocity_names
from persid.identification.diagnostics import FitReport
from persid.identification.estimators import estimator
from persid.identification.gram import Gram, refuse_underdetermined
from persid.identification.koopman import sample_step
from persid.identification.learned import KNOTS, USUAL, learns, simplest
from persid.identification.one_curve import with_curve
from persid.identification.options import check_options, refuse_in_memory_only
from persid.identification.provenance import provenance
from persid.identification.recursion import RECURSION, choose_stride
from persid.identification.regressions import Estimator, Options, Problem, Solution, sparse_coefficients
from persid.identification.scaling import Wanted, choose_basis
from persid.identification.structure import make_structure
from persid.identification.tails import tail_scores
from persid.identification.validation import (
    FOLDS,
    Curve,
    blocks,
    by_fold,
    partition,
    total,
    validation_curve,
)
from persid.measurements.arrays import as_trajectories, refuse_target
from persid.measurements.opening import recordings_of
from persid.measurements.recordings import (
    Measurements,
    Part,
    Recordings,
    is_large,
    segments,
    without_still_inputs,
)
from persid.measurements.strides import side_by_side, strided
from persid.measurements.trajectories import Trajectories
from persid.models.equations import equations

FUNCTIONS = ("x", "x**3", "sinh(x)", "tanh(x)")
_STEPS = "discrete time: a step is {stride} sample(s), {dt:.4g} s"
_LEARNED = "learned functions: piecewise linear, {knots} knots a state"
FALLBACK_RIDGE = 1e-3  # where a single short run leaves nothing to validate on
_OUT_OF_CORE = (
    "read chunk by chunk, {size}: moments and sums are over all samples; the window is chosen on the beginnings of at "
    "most 20 runs, the ridge on free runs over at most 10 segments of up to 1000 samples, and scores are of at most 20 "
    "held-out tails of up to 5000 samples"
)
BLOCKS = 60  # sums that a fit keeps, for `persid.bootstrap` to draw from
MOST_NUMBERS = 8e6  # in all these sums together


class PersidskiiIdentifier(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """Identify x' = A0 (x - x_ref) + sum A f((x - x_ref)/scale) + B (u - u_ref) + b from trajectories.

    Paper: F_x_approximation (Sec. 4.1).

    functions: expressions in x, one list for all states or one list a state; "x" is the linear part, "pwl" stands for
        functions of each state that are learned: piecewise linear, 0 at x_ref, their knots at quantiles of the data.
    knots: of learned functions, "auto" (3, 6 or 9, by blocked validation) or a number.  monotone: whether each of them,
        with its linear part, only rises or only falls.  one_curve: whether all of them are one and the same curve, with
        a factor for each state in each equation.
    method: "weak" (integrals, Simpson; the default), "derivative" (smoothed finite differences, or x' given as y of
        `fit`) or "edmd" (the paper's Koopman road).
    ridge: "auto" (blocked validation on the free-run error) or a strength relative to columns of mean square 1;
        the constant is never penalised. EDMD takes 0 for "auto".
    instruments: whether columns of earlier windows stand in for those of the window itself ("weak" only): unbiased
        where noise acts on the plant, less precise where it does not. A warning of `report_` says when.
    window: samples of a window of the weak form, even; "auto" is the shortest over which the states outrun their noise.
    x_ref, scale: reference point and scales of the functions' arguments, "auto" or numbers (`identification.basis`).
    hold: "zoh", inputs are held from sample to sample, or "paper", they vary between samples.
    constant: whether there is a b.
    pattern: boolean n x n, whether state j may influence state i.  shared: one set of coefficients along a chain.
    velocities: states that are derivatives of others, {"phi": "omega"}: phi' = omega is known, nothing of it is fitted;
        "auto": those that `derivatives` appends (theta, theta_dot), None: none.
    derivatives, delays: append smoothed velocities (1), or copies delayed by 1 ... delays samples, to the states.
    threshold: None, or the share of the largest scaled coefficient of an equation below which coefficients become 0.
    refine: whether to polish the coefficients by least squares through the differential equation.
    lifting: more lifting functions for "edmd", expressions in x, or a function of x (N, n) and u (N, m) that returns
        columns.  gamma: "coordinates" or "literal" [eq:Gamma_cal].
    time: "continuous", or "discrete": x+ in place of x', straight from samples; method, window, hold, velocities and
        refine then play no part.  stride: the samples of one step of that model; "auto" is chosen by free runs.
    holdout: the share of every run that is held out for the scores of `report_`.
    allow_underdetermined: whether to return the smallest of many exact fits instead of refusing.

    After `fit`: model_, report_, gram_, coef_ (n, p), basis_, velocities_ (those whose equations are known), stride_
    (samples of a step, 1 in continuous time), n_features_in_, n_states_in_, n_inputs_in_.

    Examples:
        >>> data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
        >>> fit = ps.PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-4).fit(data)
        >>> bool(fit.score(data) > 0.9)
        True
    """

    def __init__(
        self,
        functions: Functions = FUNCTIONS,
        *,
        knots: int | str = "auto",
        monotone: bool = False,
        one_curve: bool = False,
        method: str = "weak",
        ridge: float | int | str = "auto",
        instruments: bool = False,
        window: int | str = "auto",
        x_ref: object = "auto",
        scale: object = "auto",
        hold: str = "zoh",
        constant: bool = True,
        pattern: object = None,
        shared: bool = False,
        velocities: Any = "auto",
        derivatives: int = 0,
        delays: int = 0,
        threshold: float | int | None = None,
        refine: bool = False,
        lifting: Sequence[str] | Callable[[ndarray, ndarray], object] = (),
        gamma: str = "coordinates",
        time: str = "continuous",
        stride: int | str = "auto",
        holdout: float | int = 0.2,
        allow_underdetermined: bool = False,
    ) -> None:
        self.functions = functions
        self.knots = knots
        self.monotone = monotone
        self.one_curve = one_curve
        self.method = method
        self.ridge = ridge
        self.instruments = instruments
        self.window = window
        self.x_ref = x_ref
        self.scale = scale
        self.hold = hold
        self.constant = constant
        self.pattern = pattern
        self.shared = shared
        self.velocities = velocities
        self.derivatives = derivatives
        self.delays = delays
        self.threshold = threshold
        self.refine = refine
        self.lifting = lifting
        self.gamma = gamma
        self.time = time
        self.stride = stride
        self.holdout = holdout
        self.allow_underdetermined = allow_underdetermined

    def fit(
        self, X: object, y: object = None, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> "PersidskiiIdentifier":
        """Fit the model to Trajectories, an array (N, n), a DataFrame, or a list of them; or, chunk by chunk, to what
        `persid.open_recordings` returns, to a Dask array or to a Dask DataFrame of states.

        y is x' (N, n) in state units per s for method="derivative", and refused otherwise. u (N, m), and t or dt in s,
        go with arrays and DataFrames; a DataFrame may bring its times as a column or an index named t or time.

        Raises:
            DataError: the data or an option cannot be used, times are missing, or y would be ignored.
            UnderdeterminedError: fewer samples than unknown coefficients.
            GeneratorError: the Koopman matrix has no trustworthy logarithm (method="edmd").
        """
        check_options(self)
        refuse_target(None if self._estimator.slopes else y)
        given, notes = self._measured(X, u, t, dt)
        refuse_constant(given)
        measured = without_still_inputs(given)
        data = self._embedded(measured)
        self.stride_ = self._strides(data)
        problem, solution = self._best(data, y)
        self._remember(given, X)
        self._moving = [given.inputs.index(name) for name in measured.inputs]
        self.basis_, self.gram_, self.window_ = problem.basis, solution.gram, problem.regression.window
        self.blocks_ = tuple(solution.blocks.values())
        self.ridge_, self.velocities_ = solution.ridge, self._velocities(data)
        self.coef_ = solution.theta.T
        steps = [_STEPS.format(stride=self.stride_, dt=problem.basis.dt)] if problem.basis.dt is not None else []
        steps += [] if self.knots_ is None else [_LEARNED.format(knots=self.knots_)]
        self.report_ = self._report(problem, solution, (*data.notes, *notes, *steps))
        self.model_ = problem.basis.model(
            solution.theta, domain=problem.box, provenance=provenance(measured, self.report_)
        )
        return self

    def _measured(
        self, X: object, u: object, t: object, dt: float | int | None
    ) -> tuple[Measurements, tuple[str, ...]]:
        """Return the data of a fit, in memory or not."""
        if not is_large(X):
            return as_trajectories(X, u, t, dt), ()
        refuse_in_memory_only(self)
        found = recordings_of(X, u, t, dt)
        return found, (_OUT_OF_CORE.format(size=found),)

    def on_appended(self) -> "PersidskiiIdentifier":
        """Return an unfitted copy of a fit for data as `seen` returns them: states appended, one sample a step."""
        copy = clone(self).set_params(derivatives=0, delays=0, velocities=self.velocities_, stride=1)
        return cast(PersidskiiIdentifier, copy)

    def _embedded(self, measured: Measurements) -> Measurements:
        return measured if isinstance(measured, Recordings) else self._appended(measured)

    def _appended(self, measured: Trajectories) -> Trajectories:
        return embedded(measured, self.derivatives, self.delays)

    def seen(self, measured: Trajectories) -> Trajectories:
        """Return measurements as the fitted model sees them: states appended, and one sample for each of its steps."""
        check_is_fitted(self, "model_")
        return strided(self._appended(measured), self.stride_)

    def _strides(self, data: Measurements) -> int:
        """Return the samples of a step: one in continuous time; given, or chosen."""
        if self.time == "continuous" or not isinstance(data, Trajectories):
            return 1
        if self.stride != "auto":
            return int(self.stride)
        return choose_stride(data, partial(self._problem, data, None), self.hold)

    @property
    def _estimator(self) -> Estimator:
        return RECURSION if self.time == "discrete" else estimator(self.method)

    def _options(self, y: object = None) -> Options:
        embedded = bool(self.derivatives or self.delays)
        return Options(
            hold=self.hold, window=self.window, lifting=self.lifting, gamma=self.gamma, slopes=y, embedded=embedded,
            instruments=self.instruments,
        )  # fmt: skip

    def _best(self, data: Measurements, y: object) -> tuple[Problem, Solution]:
        """Return the problem and its solution; of numbers of knots the smallest that foretells about as well as any."""
        if not learns(self.functions):
            counts: Sequence[int] = (USUAL,)
        elif self.knots != "auto":
            counts = (int(self.knots),)
        else:
            counts = KNOTS if self.ridge == "auto" and self._estimator.additive else (USUAL,)
        problems = (self._problem(data, y, self.stride_, count) for count in counts)
        tried = [(problem, self._solve(problem)) for problem in problems]
        curves = [solution.curve for _, solution in tried]
        best = simplest([min(curve.errors) for curve in curves if curve]) if all(curves) else 0
        self.knots_ = counts[best] if learns(self.functions) else None
        return tried[best]

    def _problem(self, data: Measurements, y: object, stride: int = 1, knots: int = USUAL) -> Problem:
        wanted = self._wanted(knots)
        if self.one_curve:
            ramps = self._posed(data, y, stride, wanted)
            functions = with_curve(per_state(self.functions, len(data.states)), ramps)
            wanted = Wanted(functions, ramps.basis.x_ref, ramps.basis.scale)
        return self._posed(data, y, stride, wanted)

    def _posed(self, data: Measurements, y: object, stride: int, wanted: Wanted) -> Problem:
        if self.time == "discrete" and isinstance(data, Trajectories):
            return self._stepped_problem(data, stride, wanted)
        basis = choose_basis(data, wanted)
        structure = make_structure(basis, self.pattern, self.shared, self.constant, self._velocities(data))
        parts = partition(data, self.holdout)
        regression = self._estimator.regression(data, basis, parts, self._options(y))
        return Problem(data, basis, structure, parts, blocks(parts, _blocks(basis)), regression)

    def _stepped_problem(self, data: Trajectories, stride: int, wanted: Wanted) -> Problem:
        """Return the problem of a recursion: scored on every stride-th sample, fitted to all of them."""
        seen = strided(data, stride)
        basis = choose_basis(seen, wanted, stride * sample_step(data))
        structure = make_structure(basis, self.pattern, self.shared, self.constant, {})
        parts = partition(seen, self.holdout)
        regression = self._estimator.regression(side_by_side(data, stride), basis, parts, self._options())
        return Problem(seen, basis, structure, parts, blocks(parts, _blocks(basis)), regression)

    def _wanted(self, knots: int) -> Wanted:
        return Wanted(self.functions, self.x_ref, self.scale, knots, self.shared, self.one_curve)

    def _velocities(self, data: Measurements) -> dict[str, str]:
        if self.time == "discrete":
            return {}
        if self.velocities != "auto":
            return dict(self.velocities or {})
        measured = data.states[: len(data.states) // (1 + self.derivatives + self.delays)]
        return velocity_names(measured) if self.derivatives else {}

    def _solve(self, problem: Problem) -> Solution:
        grams = problem.grams()
        folds = by_fold(problem.blocks, grams)
        gram = total(list(folds.values()))
        if not self.allow_underdetermined:
            refuse_underdetermined(gram)
        curve = None
        if self.ridge == "auto" and self._estimator.additive:
            curve = validation_curve(problem.data, problem.parts, folds, problem.box, self.hold)
        ridge = self._strength(curve)
        gram = problem.solvable(gram, ridge)
        theta = sparse_coefficients(gram, ridge, self.threshold, monotone=self.monotone)
        theta = self._refined(problem.data, theta, gram, ridge)
        return Solution(theta, self._held_out(problem, folds, ridge), gram, grams, ridge, curve)

    def _strength(self, curve: Curve | None) -> float:
        if self.ridge != "auto":
            return float(self.ridge)
        if curve:
            return float(curve.best)
        return FALLBACK_RIDGE if self._estimator.additive else 0.0

    def _held_out(self, problem: Problem, folds: dict[int, Gram], ridge: float) -> Float[ndarray, "p n"] | None:
        """Fit again without the tails; rows that come from all samples together are made again, too."""
        kept = [gram for fold, gram in folds.items() if fold >= 0]
        if len(kept) == len(folds) or sum(gram.rows for gram in kept) < problem.basis.size:
            return None
        parts = [part for part in problem.parts if part.fold >= 0]
        if not self._estimator.additive:
            regression = self._estimator.regression(problem.data, problem.basis, parts, self._options())
            rest = [replace(part, block=0) for part in problem.blocks if part.fold >= 0]
            problem = replace(problem, regression=regression, parts=parts, blocks=rest)
            kept = list(problem.grams().values())
        gram = problem.solvable(total(kept), ridge, tails=False)
        theta = sparse_coefficients(gram, ridge, self.threshold, monotone=self.monotone)
        return self._refined(problem.data, theta, gram, ridge, parts)

    def _refined(
        self, data: Measurements, theta: ndarray, gram: Gram, ridge: float, parts: Sequence[Part] = ()
    ) -> ndarray:
        if not self.refine or isinstance(data, Recordings):
            return theta
        if parts:
            data = Trajectories(tuple(segments(data, parts)), data.states, data.inputs)
        from persid.identification.refinement import refine

        return refine(data, theta, gram, ridge, self.hold)

    def _report(self, problem: Problem, solution: Solution, notes: tuple[str, ...]) -> FitReport:
        gram, data, K = solution.gram, problem.data, problem.regression.K
        facts = diagnostics.conditioning(gram, solution.theta)
        moved = diagnostics.excitation(data, gram)
        unseen = tail_scores(problem, solution, self.hold)
        remarks = diagnostics.remarks(facts, problem.basis.size, moved, unseen.foretold, solution.curve)
        return FitReport(
            method="one-step" if self.time == "discrete" else self.method,
            hold=self.hold,
            window=problem.regression.window,
            rows=gram.rows,
            columns=problem.basis.size,
            rank=facts.rank,
            ridge=solution.ridge,
            curve=solution.curve,
            condition_raw=facts.raw,
            condition_scaled=facts.scaled,
            largest_coefficient=facts.largest,
            largest_name=facts.largest_name,
            collinear=facts.collinear,
            constant_columns=facts.constant,
            coverage=tuple((float(a), float(b)) for a, b in problem.box),
            whiteness=unseen.whiteness,
            excitation=moved,
            free_run=unseen.free_run,
            one_step=unseen.one_step,
            notes=notes,
            warnings=(*remarks, *self._bias(problem, solution)),
            spectrum=None if K is None else diagnostics.koopman_spectrum(K, sample_step(data)),
        )

    def _bias(self, problem: Problem, solution: Solution) -> tuple[str, ...]:
        """Return what instruments say against the coefficients, where they could have been used and were not."""
        if self.time == "discrete" or self.instruments or not self._estimator.instruments:
            return ()
        model = problem.basis.model(solution.theta)
        bias = noise_bias(problem.data, model, ~solution.gram.structure.known, self.hold)
        return bias.remark(model.states) if bias else ()

    def _remember(self, measured: Measurements, X: object) -> None:
        self.n_features_in_ = self.n_states_in_ = len(measured.states)
        self.n_inputs_in_ = len(measured.inputs)
        if isinstance(X, Trajectories | Recordings) or hasattr(X, "columns"):
            self.feature_names_in_ = np.array(measured.states, dtype=object)

    def _known(self, X: object, u: object = None, t: object = None, dt: float | int | None = None) -> Trajectories:
        """Return data for a fitted estimator: the same states and inputs, seen like those of the fit."""
        check_is_fitted(self, "model_")
        if is_large(X):
            raise DataError("predictions and scores need the data in memory; give some of the runs as Trajectories")
        data = as_trajectories(X, u, t, dt)
        given = (len(data.states), len(data.inputs))
        if given != (self.n_states_in_, self.n_inputs_in_):
            raise DataError(
                f"X has {given[0]} features, but {type(self).__name__} is expecting {self.n_states_in_} features as "
                f"input; inputs: {given[1]} given, {self.n_inputs_in_} expected"
            )
        return self.seen(data.with_inputs([data.inputs[k] for k in self._moving]))

    def predict(
        self, X: object, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> Float[ndarray, "N n"]:
        """Return, for every sample, the state one step later (all runs one below the other).

        In discrete time these are the samples at the steps of the model.
        """
        data = self._known(X, u, t, dt)
        return np.concatenate([freerun.one_step(self.model_, run, self.hold) for run in data])

    def simulate(self, x0: object, t: Float[ndarray, " N"], u: object = None) -> Trajectories:
        """Simulate the model from x0; a blow-up ends the run, with its time in s in `diverged_at`. See the model's."""
        check_is_fitted(self, "model_")
        return self.model_.simulate(x0, t, u)

    def score(
        self, X: object, y: object = None, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> float:
        """Return the R2 of free runs over all runs, the mean over states. One-step R2 says nothing.

        Raises:
            DataError: the data cannot be used, or y would be ignored.
        """
        refuse_target(None if self._estimator.slopes else y)
        return freerun.free_run_score(self.model_, self._known(X, u, t, dt), self.hold).r2_mean

    def get_feature_names_out(self, input_features: object = None) -> ndarray:
        """Return the names of the columns of `coef_`; `input_features` is ignored."""
        check_is_fitted(self, "model_")
        return np.array([column.name for column in self.basis_.columns], dtype=object)

    def equations(self, form: str = "text", digits: int = 4) -> Any:
        """Return one equation a state, as "text", "latex" or "sympy" (a list of sympy.Eq)."""
        check_is_fitted(self, "model_")
        return equations(self.model_, form, digits)

    def __sklearn_is_fitted__(self) -> bool:
        return hasattr(self, "model_")


def _blocks(basis: Basis) -> int:
    """Return how many sums a fit keeps."""
    return int(np.clip(MOST_NUMBERS / basis.size**2, FOLDS + 1, BLOCKS))
