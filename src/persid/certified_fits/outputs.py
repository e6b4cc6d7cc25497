"""OutputIdentifier: a certified model of a system of which only inputs and outputs are measured."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from sklearn.base import BaseEstimator
from sklearn.utils.validation import check_is_fitted

from persid._threads import few_threads
from persid.certified_fits.output_demands import Demand
from persid.errors import DataError, ModelError
from persid.identification.outputs.answer import ROOM, Answer, Demands, answered, demanded
from persid.identification.outputs.known import Known
from persid.identification.outputs.selection import Candidate, Question
from persid.measurements.arrays import as_trajectories, refuse_target
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.files import load_model
from persid.models.outputs import OutputModel
from persid.models.stable_fit import ACTIVATIONS, StableFit
from persid.verdicts.outputs import certify_fit
from persid.verdicts.verdict import Verdict

EVEN = 1e-2  # of the step, by which sampling times may vary
ROUNDS = 3  # in which outputs are scaled to the gains asked for
INSIDE = 0.95  # of the gain asked for, at which a fit below it begins
TOLD = 10  # steps between two lines of progress


Onward = Callable[[StableFit, ndarray | None], tuple[StableFit, float]]


@dataclass(frozen=True)
class OutputReport:
    """Report how a model of inputs and outputs was chosen.

    Errors are root-mean-square errors of free runs in units of the spread of the outputs: `error` on all data,
    `held_out` and `linear` on the last quarter of every record, for the chosen candidate and the best linear model;
    `free` for the best model of the same size without a condition, where it was asked for. `seeds` are the least
    held-out errors that the single seeds reached with the chosen order and number of neurons.
    """

    candidates: tuple[Candidate, ...]
    chosen: Candidate
    error: float
    held_out: float
    linear: float
    free: float | None
    seeds: tuple[float, ...]
    remarks: tuple[str, ...]
    interrupted: bool

    @property
    def price(self) -> float | None:
        """By which factor the condition raised the held-out error; below 1 where it lowered it."""
        return None if self.free is None else self.held_out / self.free


class OutputIdentifier(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """Fit x' = A x + A1 f(R x + beta) + B u, y = h(C x + D u + d) to inputs and outputs; the states are nobody's.

    Models are stable by construction, and each carries its own proof, which `persid_check` decides. Order, neurons,
    ridge, feedthrough and seed are chosen by free runs on the last quarter of every record.

    order: number of states, or "auto".  neurons: number of functions f, or "auto"; 0 is a linear model.
    functions: what f may be: "tanh", "softsign", "arctan", and "pwl", a piecewise linear curve whose slopes are learnt
        with the model, none of them negative. Which one it is the held-out samples decide.
    one_curve: the neurons share one learned curve; else each has its own.
    feedthrough: whether D is fitted, or "auto".
    hold: "zoh" (inputs are held) or "foh" (straight lines between samples).
    output: h, None or "abs" (a sensor that ignores the sign).
    measured: names of outputs that are states themselves: they become the first states, without feedthrough and in
        their own units; the other states stay latent.
    fixed: known coefficients in the equations of measured states, {(state, column): number}, in the user's units.
        Columns are measured states, inputs, or "f": all neurons, which can only be known to add 0.
    certified: False fits without the condition; the verdict then depends on what `certify` finds.
    min_rate: None, or a rate of decay in 1/s that is certified.
    max_output_gain: None, or the largest gain of the outputs that is certified, in their unit per unit of the inputs:
        one number, or one for each output. Where the fit's is larger, it goes on below that gain.
    seeds: random starts for every size.  random_state: the first of them.
    warm_start: True continues from the fit before, where there is one; an `OutputModel` of a fit, or its file, from
        that one. Order, neurons and multipliers are kept, and nothing is searched. Errors named held out are then those
        of the earlier model on the new records.
    compare: also fit the chosen size without the condition, for `report_.price`.
    time_limit: seconds for the proof, beyond the fit's own.

    Example:
        >>> import numpy as np
        >>> import persid as ps
        >>> t, u = 0.1 * np.arange(200), np.sign(np.sin(0.7 * np.arange(200)))[:, None]
        >>> y = ps.PersidskiiModel([[-1.0]], [], [[1.0]]).simulate([0.0], t, u)[0].x
        >>> fit = ps.OutputIdentifier(order=1, neurons=0, time_limit=0).fit(y, u=u, dt=0.1)
        >>> fit.verdict_.is_certified, np.allclose(fit.fit_.A, -1.0, rtol=1e-3)
        (True, True)

    After `fit`: model_ (OutputModel), fit_ (StableFit), verdict_, certificate_ (None where there is none), report_.
    """

    def __init__(
        self,
        order: int | str = "auto",
        neurons: int | str = "auto",
        *,
        functions: Sequence[str] = ("tanh",),
        one_curve: bool = False,
        feedthrough: bool | str = "auto",
        hold: str = "zoh",
        output: str | None = None,
        measured: Sequence[str] = (),
        fixed: Mapping[tuple[str, str], float | int] | None = None,
        certified: bool = True,
        min_rate: float | int | None = None,
        max_output_gain: object = None,
        seeds: int = 3,
        random_state: int = 0,
        warm_start: bool | OutputModel | str | Path = False,
        compare: bool = False,
        time_limit: float | int = 60.0,
    ) -> None:
        self.order = order
        self.neurons = neurons
        self.functions = functions
        self.one_curve = one_curve
        self.feedthrough = feedthrough
        self.hold = hold
        self.output = output
        self.measured = measured
        self.fixed = fixed
        self.certified = certified
        self.min_rate = min_rate
        self.max_output_gain = max_output_gain
        self.seeds = seeds
        self.random_state = random_state
        self.warm_start = warm_start
        self.compare = compare
        self.time_limit = time_limit

    def fit(
        self,
        X: object,
        y: object = None,
        *,
        u: object = None,
        t: object = None,
        dt: float | int | None = None,
        progress: Callable[[str], None] | None = None,
    ) -> "OutputIdentifier":
        """Fit to outputs X: Trajectories (outputs in place of states), arrays, tables, or lists of them.

        Ctrl-C ends the search; the best model so far is delivered, and `report_.interrupted` says so.

        Raises:
            DataError: an option cannot be used, or records are too short, constant, or sampled unevenly.
        """
        refuse_target(y)
        data = as_trajectories(X, u, t, dt)
        step = _step(data)
        demand = Demand.of(self.min_rate, self.max_output_gain, len(data.states))
        names = _output_names(data.states)
        if strange := [name for name in self.measured if name not in names]:
            raise DataError(f"measured= names {strange[0]!r}, which is none of the outputs ({', '.join(names)})")
        self._known_entries(data, 0)  # names are refused before anything is fitted
        question = replace(self._question(step), outputs=names)
        tell = _told(progress)
        records = [(run.u, run.x) for run in data]
        with few_threads(4):
            answer = answered(records, step, question, tell, self._earlier())
            if answer.unstable and self.certified and not answer.interrupted:
                free = answered(records, step, replace(question, certified=False), tell)
                answer = replace(free, remarks=(answer.remarks[0], *free.remarks))
            least = self._free(answer, records, step, question, tell) if self.compare else None
        known = self._known_entries(data, answer.candidate.neurons)
        self._deliver(
            answer, data, least, demand, known,
            lambda fit, gains: demanded(fit, records, step, question, Demands(gains, known), tell),
        )  # fmt: skip
        return self

    def _known_entries(self, data: Trajectories, neurons: int) -> Known | None:
        """Return the coefficients that are known of the measured states, where there are some."""
        if not self.fixed:
            return None
        return Known.of(self.fixed, tuple(self.measured), _output_names(data.states), data.inputs, neurons)

    def _question(self, step: float) -> Question:
        _check_options(self)
        kappa = 2 * ROOM * float(self.min_rate or 0.0) * step
        return Question(
            order=None if self.order == "auto" else int(self.order),
            neurons=None if self.neurons == "auto" else int(self.neurons),
            feedthrough=None if self.feedthrough == "auto" and not self.measured else self.feedthrough is True,
            functions=tuple(self.functions),
            one_curve=self.one_curve,
            output_map=self.output,
            hold=self.hold,
            certified=self.certified,
            kappa=kappa,
            seeds=tuple(range(self.random_state, self.random_state + self.seeds)),
        )

    def _earlier(self) -> StableFit | None:
        """Return the fit before, or the one of the model that is given, where it is to be continued."""
        if isinstance(self.warm_start, bool):
            return getattr(self, "_unit", None) if self.warm_start else None
        given = self.warm_start
        model = given if isinstance(given, OutputModel) else load_model(given)
        if not isinstance(model, OutputModel):
            raise DataError("warm_start= is a model of states; give one that was fitted to inputs and outputs")
        try:
            return model.to_fit().in_unit_coordinates()
        except ModelError as error:
            raise DataError(f"warm_start= cannot be used: {error}") from None

    def _free(
        self,
        answer: Answer,
        records: Sequence[tuple[ndarray, ndarray]],
        step: float,
        question: Question,
        tell: Callable[[str, float], None],
    ) -> float | None:
        chosen = answer.candidate
        same = replace(
            question, certified=False, order=chosen.order, neurons=chosen.neurons, feedthrough=chosen.feedthrough
        )
        return None if answer.interrupted else answered(records, step, same, tell).candidate.held_out

    def _deliver(
        self, answer: Answer, data: Trajectories, free: float | None, demand: Demand, known: Known | None,
        onward: Onward,
    ) -> None:  # fmt: skip
        """Certify the answer, or what keeps the entries that are known; where gains are too large, what keeps them."""
        self.n_features_in_, self.n_inputs_in_ = len(data.states), len(data.inputs)
        named = replace(answer.fit, inputs=data.inputs, outputs=_output_names(data.states))
        if known is not None:
            named = replace(onward(named, None)[0], inputs=named.inputs, outputs=named.outputs)
        verdict = self._verdict(named, answer.candidate.seed, demand, known)
        error, remarks = answer.error, list(answer.remarks)
        if demand.gains is not None and 1 < demand.excess(verdict) < np.inf and self._unit.M is not None:
            kept, _ = onward(demand.met(self._unit, verdict, INSIDE), demand.gains)
            kept = replace(kept, inputs=named.inputs, outputs=named.outputs)
            verdict = self._verdict(kept, answer.candidate.seed, demand, known)
        for _ in range(ROUNDS):  # what is certified may be a little more than what the fit kept
            if not 1 < demand.excess(verdict) < np.inf:
                break
            verdict = self._verdict(demand.met(self._unit, verdict), answer.candidate.seed, demand, known)
        if self._unit.C is not answer.fit.C:
            error = self._error(data)
            asked = "what is known is" if known is not None else "the gains asked for are"
            remarks.append(f"{asked} kept: error {error:.3g} (else {answer.error:.3g})")
        remarks += demand.missed(verdict, self.model_.outputs)
        self.verdict_, self.certificate_ = verdict, getattr(verdict, "certificate", None)
        chosen = answer.candidate
        size = (chosen.order, chosen.neurons)
        alike = [one for one in answer.candidates if (one.order, one.neurons) == size]
        seeds = {one.seed: one.held_out for one in reversed(alike)}  # the best of them stands first
        self.report_ = OutputReport(
            candidates=answer.candidates,
            chosen=chosen,
            error=error,
            held_out=chosen.held_out,
            linear=answer.linear,
            free=free,
            seeds=tuple(sorted(seeds.values())),
            remarks=tuple(remarks),
            interrupted=answer.interrupted,
        )

    def _verdict(self, fit: StableFit, seed: int, demand: Demand, known: Known | None) -> Verdict:
        """Keep the fit with its model, and return the verdict on it."""
        under = "certificate" if fit.M is not None else None
        self._unit, fit = fit, fit.with_states(self.measured) if self.measured else fit
        fit = fit if known is None else known.put_in(fit)
        self.fit_, self.model_ = fit, OutputModel.from_fit(fit, {"fitted_under": under, "seed": seed})
        return certify_fit(fit, self.model_, time_limit=float(self.time_limit), min_rate=demand.rate)

    def _error(self, data: Trajectories) -> float:
        """Return the error of free runs from the fitted states over the records, in units of the outputs' spread."""
        gap = [
            self.model_.simulate(run.t, run.u, x0=x0)[0].x - run.x for run, x0 in zip(data, self.fit_.x0, strict=True)
        ]
        scale = np.concatenate([run.x for run in data]).std(axis=0)
        return float(np.sqrt(((np.concatenate(gap) / scale) ** 2).mean()))

    def predict(
        self, X: object, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> Float[ndarray, "N l"]:
        """Return free runs from states estimated from every run's first samples (all runs one below the other)."""
        return np.concatenate([self._free_run(run) for run in self._known(X, u, t, dt)])

    def score(
        self, X: object, y: object = None, *, u: object = None, t: object = None, dt: float | int | None = None
    ) -> float:
        """Return the R2 of free runs, the mean over outputs; the first samples, which tell the state, do not count."""
        data, k = self._known(X, u, t, dt), self._start
        measured = np.concatenate([run.x[k:] for run in data])
        gap = np.concatenate([self._free_run(run)[k:] for run in data]) - measured
        spread = ((measured - measured.mean(0)) ** 2).sum(0)
        return float((1 - (gap**2).sum(0) / spread).mean())

    def simulate(
        self, t: Float[ndarray, " N"], u: object = None, *, x0: object = None, y_init: object = None
    ) -> Trajectories:
        """Return the outputs at the times t (s); see `OutputModel.simulate`."""
        check_is_fitted(self, "model_")
        return self.model_.simulate(t, u, x0=x0, y_init=y_init)

    @property
    def _start(self) -> int:
        return max(5, 3 * self.model_.dynamics.n)

    def _free_run(self, run: Trajectory) -> Float[ndarray, "N l"]:
        found = self.model_.simulate(run.t, run.u, y_init=run.x[: self._start])[0].x
        return np.vstack([found, np.full((len(run) - len(found), found.shape[1]), np.inf)])

    def _known(self, X: object, u: object, t: object, dt: float | int | None) -> Trajectories:
        check_is_fitted(self, "model_")
        data = as_trajectories(X, u, t, dt)
        given, wanted = (len(data.states), len(data.inputs)), (self.n_features_in_, self.n_inputs_in_)
        if given != wanted:
            raise DataError(
                f"{given[0]} outputs and {given[1]} inputs were given; the model has {wanted[0]} and {wanted[1]}"
            )
        return data


def _step(data: Sequence[Trajectory]) -> float:
    steps = np.concatenate([np.diff(run.t) for run in data])
    step = float(np.median(steps))
    if np.abs(steps - step).max() > EVEN * step:
        raise DataError(
            f"samples are {steps.min():.4g} to {steps.max():.4g} s apart; resample the records at equal steps"
        )
    return step


def _output_names(given: tuple[str, ...]) -> tuple[str, ...]:
    """Return the outputs' names; those that arrays have by default are names of latent states here."""
    plain = tuple(f"x{i + 1}" for i in range(len(given)))
    return tuple(f"y{i + 1}" for i in range(len(given))) if given == plain else given


def _check_options(given: OutputIdentifier) -> None:
    for name, least in (("order", 1), ("neurons", 0)):
        value = getattr(given, name)
        if value != "auto" and (not isinstance(value, int | np.integer) or value < least):
            raise DataError(f'{name} is {value!r}; it is "auto" or a whole number of at least {least}')
    if isinstance(given.functions, str) or not given.functions or not set(given.functions) <= set(ACTIVATIONS):
        raise DataError(f"functions is {given.functions!r}; it is a list of {', '.join(ACTIVATIONS)}")
    if given.hold not in ("zoh", "foh"):
        raise DataError(f'hold is {given.hold!r}; it is "zoh" or "foh"')
    if given.output not in (None, "abs"):
        raise DataError(f'output is {given.output!r}; it is None or "abs"')
    if given.feedthrough not in ("auto", True, False):
        raise DataError(f'feedthrough is {given.feedthrough!r}; it is "auto", True or False')
    if given.measured and (given.feedthrough is True or given.output is not None):
        raise DataError("measured= goes with outputs that are states: without output= and without feedthrough=")
    if given.seeds < 1:
        raise DataError(f"seeds is {given.seeds}; at least one start is needed")


def _told(progress: Callable[[str], None] | None) -> Callable[[str, float], None]:
    """Return what tells of new stages, and of every so many steps, in a line of text."""
    count, last = 0, ""

    def tell(stage: str, error: float) -> None:
        nonlocal count, last
        count += 1
        if progress and (stage != last or count % TOLD == 0):
            progress(f"{stage}: step {count}, error {error:.3g}")
        last = stage

    return tell
