"""From records to a fitted model in the user's units, with the multipliers of its proof."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.identification.outputs import least_squares, refit, selection, strides
from persid.identification.outputs.gains import Limit
from persid.identification.outputs.known import Kept, Known
from persid.identification.outputs.least_squares import Fit, Stable, Task, Term
from persid.identification.outputs.records import Pieces, Record, Scales
from persid.identification.outputs.remarks import LEAKS, remarks_on
from persid.identification.outputs.runs import moments
from persid.identification.outputs.selection import BETTER, Candidate, Group, Kind, LinearFit, Question, Winner
from persid.models.lookup_tables import WORD
from persid.models.stable_fit import StableFit

Tell = Callable[[str, float], None]
FEWER = 100.0  # by which a ridge is weakened where that helps
FINAL_STEPS, FINAL_WORK = 100, 60_000_000  # steps on all data, and samples times steps times parameters
BARRIERS = (1e-1, 1e-2, 1e-3)  # weights of the barrier that keeps gains, in units of the cost at its start
SQUARES = (1e3, 1e6, 1e9)  # weights of what misses a known entry, in the same unit
ROOM = 1.2  # of the rate that is asked for, for the fit: at a fit's own rate the gains that are proved have no bound
GROWTH = 20  # all data are reached in stages, each of so many times the samples of the one before
REFINED = 1.02  # halved substeps may raise the error to this share; else the fit goes on with them
EXACT, EXACTEST = 1e-6, 128  # share to which the error that is told is exact; most substeps a sample
UNSTABLE = 0.5  # an unstable linear model has to lower the error of the best stable one to this share to be believed


@dataclass(frozen=True, eq=False)
class Answer:
    """Hold the fit that is delivered, every candidate, the errors of linear and free models, and remarks.

    Errors are root-mean-square in standard units (1 is the spread of the outputs), on the held-out part of the records.
    `unstable` says that the records belong to an unstable plant; what is to be done then is to fit without condition.
    """

    fit: StableFit
    candidate: Candidate
    candidates: tuple[Candidate, ...]
    linear: float
    error: float
    remarks: tuple[str, ...] = ()
    interrupted: bool = False
    unstable: bool = False


def answered(
    records: Sequence[Record],
    dt: float,
    question: Question,
    tell: Tell = lambda stage, error: None,
    start: StableFit | None = None,
) -> Answer:
    """Choose a model by held-out free runs, or take an earlier fit as `start`, and fit it to all data.

    An interrupt (Ctrl-C) ends the search: the best model so far is delivered, and the answer says so.

    Raises:
        DataError: the records are too short, or constant, or the earlier fit is of another kind.
    """
    _checked(records, question)
    scales = Scales.of(records, centred=question.output_map is None)
    standard = [scales.standardised(record) for record in records]
    if start is None:
        found = _searched(standard, question, tell)
    else:
        winner = refit.winner_of(start, records, scales, dt, question)
        found = _Found(winner, (winner.candidate,), np.nan, (), False)
    winner, interrupted = found.winner, found.interrupted
    if not interrupted:
        winner, interrupted = _on_all(winner, standard, question, tell)
    fit, error = _delivered(winner, standard, scales, dt, question)
    names = question.outputs or tuple(f"y{i + 1}" for i in range(records[0][1].shape[1]))
    said = remarks_on(fit, winner.candidate.held_out, max(len(u) for u, _ in records), names)
    unstable = bool(found.remarks)
    return Answer(
        fit=fit,
        candidate=winner.candidate,
        candidates=found.table,
        linear=found.linear,
        error=error,
        remarks=(*found.remarks, *said),
        interrupted=interrupted,
        unstable=unstable,
    )


@dataclass(frozen=True, eq=False)
class Demands:
    """What a fit is to keep: gains of the outputs below these, entries that are known; None where nothing is asked."""

    gains: Float[ndarray, " l"] | None = None
    known: Known | None = None


def demanded(
    start: StableFit, records: Sequence[Record], dt: float, question: Question, demands: Demands, tell: Tell
) -> tuple[StableFit, float]:
    """Return a fit to all data that goes on from one and keeps what is demanded.

    A logarithmic barrier keeps gains, its weight falling in stages; squares keep known entries, their weight rising.
    """
    scales = Scales.of(records, centred=question.output_map is None)
    standard = [scales.standardised(record) for record in records]
    winner = refit.winner_of(start, records, scales, dt, question)
    pieces = Pieces.of(standard, question.hold)
    ridge = selection.ridge_of(winner.latent, np.array([winner.ridge]))
    task = Task(pieces, winner.parameters, ridge, winner.substeps)
    unit = float(least_squares.begun(task, winner.batch).cost[0])
    steps = int(np.clip(FINAL_WORK / (pieces.values * len(winner.parameters.free)), 10, FINAL_STEPS))
    for barrier, square in zip(BARRIERS, SQUARES, strict=True):
        terms: list[Term] = []
        if demands.gains is not None:
            terms.append(Limit(demands.gains / scales.y_scale, scales.u_scale, question.kappa / ROOM, barrier * unit))
        if demands.known is not None:
            terms.append(Kept(demands.known.in_standard_units(scales, dt), square * unit))
        staged = replace(task, terms=tuple(terms))
        fit = least_squares.begun(staged, winner.batch)
        if fit.ended[0]:
            break
        least_squares.fitted(staged, fit, steps, lambda fit: tell("demands", float(fit.error[0])))
        winner = replace(winner, batch=fit.batch)
    return _delivered(winner, standard, scales, dt, question)


@dataclass(frozen=True, eq=False)
class _Found:
    """Hold what a search found: the winner, all candidates, the error of the best linear model, and remarks."""

    winner: Winner
    table: tuple[Candidate, ...]
    linear: float
    remarks: tuple[str, ...]
    interrupted: bool


def _searched(standard: list[Record], question: Question, tell: Tell) -> _Found:
    """Search on the first samples of the records, or on every so-many-th; the last quarter of them is held out."""
    stride = strides.stride_of(standard, sum(len(u) for u, _ in standard) // selection.SELECTED)
    question = replace(question, kappa=question.kappa * stride)
    part = selection.selected_part([strides.thinned(record, stride, question.hold) for record in standard])
    pieces = Pieces.of(part, question.hold, kept=selection.KEPT)
    loud = sum(len(u) for u, _ in part) < sum(len(u) for u, _ in standard)
    pieces = pieces.quiet(selection.LOUD) if loud else pieces
    linear: list[LinearFit] = []
    search = _Search(pieces, part, question, tell)
    search.loud = loud
    interrupted = False
    try:
        for one in selection.linear_fits(part, pieces, question):
            linear.append(one)
            tell("linear models", one.held_out)
        search.run(linear)
    except KeyboardInterrupt:
        if not linear:
            raise
        search.settle(linear)
        interrupted = True
    least = min(one.held_out for one in linear)
    winner = strides.at_full_rate(search.winner(), stride)
    return _Found(winner, tuple(search.table), least, tuple(search.remarks), interrupted)


def _checked(records: Sequence[Record], question: Question) -> None:
    u, y = (np.concatenate([record[side] for record in records]) for side in (0, 1))
    for k, column in enumerate(y.T):
        if np.ptp(column) == 0:
            raise DataError(
                f"output {question.outputs[k] if question.outputs else k + 1} is constant ({column[0]:g}) in all "
                "records; there is nothing to learn of it"
            )
    n, q, m, l = question.order or 1, question.neurons or 0, u.shape[1], y.shape[1]  # noqa: E741
    unknown = n * n + 2 * n * q + q + n * m + l * (n + 1) + n * len(records)
    fitted = int(selection.KEPT * y.size)
    if fitted < unknown:
        raise DataError(
            f"{y.size} measured values, of which {fitted} are fitted, cannot tell the {unknown} numbers of a model of "
            f"order {n} with {q} neurons; give more samples, or a smaller order or fewer neurons"
        )


class _Search:
    """The search over orders, neurons, ridges, seeds and feedthrough; what it found stays when it is interrupted."""

    def __init__(self, pieces: Pieces, part: list[Record], question: Question, tell: Tell) -> None:
        self.pieces, self.part, self.question, self.tell = pieces, part, question, tell
        self.groups: list[Group] = []
        self.loud = False
        self.record: list[float] = []  # least held-out errors of the rungs of the first race
        self.remarks: list[str] = []

    @property
    def table(self) -> list[Candidate]:
        """All candidates, the best first."""
        return [candidate for candidate, _, _ in selection.ranked(self.groups)]

    def run(self, linear: Sequence[LinearFit]) -> None:
        """Race the candidates of the best orders, then try more states, a weaker ridge, and no feedthrough."""
        stable = [self._stabilised(one) for one in linear]
        first = selection.best_order(stable)
        chosen = [k for k, one in enumerate(stable) if one.latent.n in (first, first + 1)]
        for k in chosen:
            self._doubt(linear[k], stable[k])
        some = [stable[k] for k in chosen]
        if kinds := self._kinds():
            self._race(some, kinds)
        if curves := self._curves():
            some = [one for one in some if not self.groups or one.latent.n == self._best()[0].order]
            self._race(some, curves, selection.RIDGES[:1])
        while self.question.order is None and (self._climbs(linear) or (self._is_coarse() and self._climbs(linear))):
            pass
        best, group, k = self._best()
        for _ in range(2):
            if best.neurons:
                weaker = self._again(selection.again(group, k, FEWER, group.freedom.through))
                if not weaker.fit.held_out[0] < BETTER * best.held_out:
                    break
                best, group, k = weaker.candidates()[0]
        while self.question.neurons is None and self._grows():
            pass
        group, k = self._best()[1:]
        if self.question.feedthrough is None and self.pieces.u.shape[1]:
            self._again(selection.again(group, k, feedthrough=False))

    def settle(self, linear: Sequence[LinearFit]) -> None:
        """Take the best linear model, where the search was interrupted before there was a candidate."""
        if not self.groups:
            least = selection.best_order(linear)
            best = self._stabilised(next(one for one in linear if one.latent.n == least))
            self.groups.append(selection.group_of(best, Kind(0), self.question, self.pieces, (0.0,)))

    def winner(self) -> Winner:
        """Return the best candidate with its parameters."""
        return selection.winner_of(*self._best()[1:])

    def _best(self) -> tuple[Candidate, Group, int]:
        """Return the smallest of the candidates whose held-out error no other one lowers notably."""
        ranking = selection.ranked(self.groups)
        good = [one for one in ranking if BETTER * one[0].held_out <= ranking[0][0].held_out]
        return min(good, key=lambda one: one[1].task.parameters.free.sum())

    def _kinds(self) -> list[Kind]:
        """Return numbers of neurons of every given function, with how many of them harden, and none."""
        given = [function for function in self.question.functions if function != WORD]
        none = [] if self.question.neurons else [Kind(0)]
        return [*none, *(Kind(q, hard, function) for function in given for q, hard in self._sizes())]

    def _sizes(self) -> list[tuple[int, int]]:
        """Return numbers of neurons, none of them 0, with how many of them harden."""
        asked, certified = self.question.neurons, self.question.certified
        if asked is not None:
            return sorted({(asked, 0), (asked, (asked + 1) // 2 * certified)}) if asked else []
        sizes = (*selection.SIZES, *(selection.HARDENING if self.loud and certified else ()))
        return [(q, hard) for q, hard in sizes if 20 * q < self.pieces.values]

    def _curves(self) -> list[Kind]:
        """Return few neurons whose function is learnt; any of them may harden, since its shape does not tell."""
        q, few = self.question.neurons, self.pieces.values <= 20 * (selection.CURVES + selection.PIECES)
        if WORD not in self.question.functions or (few if q is None else q == 0):
            return []
        q = selection.CURVES if q is None else q
        return [Kind(q, hard, WORD) for hard in range(q * self.question.certified + 1)]

    def _stabilised(self, linear: LinearFit) -> LinearFit:
        return selection.stabilised(linear, self.pieces, self.question) if self.question.certified else linear

    def _doubt(self, linear: LinearFit, stable: LinearFit) -> None:
        """Say so where a linear model is unstable and foretells far better than the stable one."""
        grows = linear.slowest * max(len(u) for u, _ in self.part) > LEAKS  # else it integrates
        if linear.held_out < UNSTABLE * stable.held_out and grows:
            pole, ratio = linear.slowest, stable.held_out / linear.held_out
            self.remarks.append(
                f"the best linear model of order {linear.latent.n} is unstable (a pole at {pole:+.3g} per sample) and "
                f"foretells the held-out part {ratio:.1f} times better than the best stable one"
            )

    def _race(self, linear: Sequence[LinearFit], kinds: Sequence[Kind], ridges: Sequence[float] = ()) -> None:
        groups = [
            selection.group_of(one, kind, self.question, self.pieces, ridges or self.question.ridges)
            for one in linear
            for kind in kinds
        ]
        self.groups += groups
        rungs = selection.LONG_RUNGS if self.loud else selection.RUNGS
        least = selection.raced(groups, lambda error: self.tell("search", error), rungs, self.record)
        self.record = self.record or least

    def _climbs(self, linear: Sequence[LinearFit]) -> bool:
        """Try one state more than was tried, with the size of the best candidate; whether that was better.

        Linear models need not gain by a state that a nonlinear one needs: what is left of both is mostly the
        nonlinearity.
        """
        best = self._best()[0]
        n = 1 + max(one.order for one in self.groups)
        if n > selection.ORDERS:
            return False
        found = next((one for one in linear if one.latent.n == n), None)
        try:
            found = found or selection.linear_fit(self.part, self.pieces, n, self.question)
        except DataError:
            return False
        stable = self._stabilised(found)
        self._doubt(found, stable)
        kind = Kind(best.neurons, best.hardening, best.function)
        self._race([stable], [kind], [best.ridge] if best.neurons else ())
        return self._best()[0].held_out < BETTER * best.held_out

    def _is_coarse(self) -> bool:
        """Whether it is worth while to try two states more where one does not help: poles come in pairs."""
        return self._best()[0].held_out > selection.FAIR

    def _grows(self) -> bool:
        """Try one neuron more beside those of the best candidate; whether that lowered the held-out error notably."""
        best, group, k = self._best()
        if not 0 < best.neurons < selection.MOST:
            return False
        kinds = (False, True) if self.loud and self.question.certified else (False,)
        grown = [selection.grown(group, k, hardens) for hardens in kinds]
        self.groups += grown
        selection.raced(grown, lambda error: self.tell("one neuron more", error), selection.GROWN_RUNGS)
        return self._best()[0].held_out < BETTER * best.held_out

    def _again(self, group: Group) -> Group:
        """Return a group, fitted on and kept."""
        self.groups.append(group)
        steps = selection.RUNGS[-2][0]
        least_squares.fitted(group.task, group.fit, steps, lambda fit: self.tell("refit", float(fit.held_out[0])))
        return group


def _on_all(winner: Winner, standard: Sequence[Record], question: Question, tell: Tell) -> tuple[Winner, bool]:
    """Return the winner fitted to all samples, in stages, with substeps as short as the model needs.

    The second value says that the fit was interrupted; the winner is as good as it had become.
    """
    total, size = sum(len(u) for u, _ in standard), selection.SELECTED
    while True:
        size = min(size * GROWTH, total) if size < total else total
        part = selection.selected_part(standard, size)
        pieces = Pieces.of(part, question.hold)
        steps = int(np.clip(FINAL_WORK / (size * len(winner.parameters.free)), 10, FINAL_STEPS))
        winner, interrupted = _refitted(winner, pieces, steps, tell)
        if size >= total or interrupted:
            return winner, interrupted


def _refitted(winner: Winner, pieces: Pieces, steps: int, tell: Tell) -> tuple[Winner, bool]:
    """Return the winner after steps on these pieces, and whether they were interrupted."""
    ridge = selection.ridge_of(winner.latent, np.array([winner.ridge]))
    task = Task(pieces, winner.parameters, ridge, winner.substeps, terms=winner.terms)
    fit, interrupted = None, False
    try:
        own = replace(winner.batch, w=winner.batch.w.copy(), x0=winner.batch.x0.copy())
        fit = least_squares.begun(task, own, least_squares.NEAR)
        if fit.ended[0]:
            return winner, False
        task, fit = _refined(task, fit)
        while True:
            least_squares.fitted(task, fit, steps, lambda fit: tell("all data", float(fit.error[0])))
            finer, check = _refined(task, fit)
            if finer is task:
                break
            task, fit, steps = finer, check, steps // 2
    except KeyboardInterrupt:
        interrupted = True
    return winner if fit is None else replace(winner, batch=fit.batch, substeps=task.substeps), interrupted


def _refined(task: Task, fit: Fit) -> tuple[Task, Fit]:
    """Return the task with substeps that are short enough for a fit, and the fit with them."""
    while task.substeps < selection.FINEST:
        finer, check = _halved(task, fit)
        if check.error[0] <= REFINED * fit.error[0]:
            break
        task, fit = finer, check
    return task, fit


def _exact(task: Task, fit: Fit) -> tuple[Task, Fit]:
    """Return both with substeps so short that the error is that of the equations, which are delivered.

    Half the step leaves a sixteenth of what a method of fourth order is off, so a change by 15 d leaves d.
    """
    while task.substeps < EXACTEST:
        before = fit.error[0]
        task, fit = _halved(task, fit)
        if abs(fit.error[0] - before) <= 15 * EXACT * before:
            break
    return task, fit


def _halved(task: Task, fit: Fit) -> tuple[Task, Fit]:
    """Return both with twice as many substeps."""
    finer = replace(task, substeps=2 * task.substeps)
    return finer, least_squares.begun(finer, fit.batch, least_squares.NEAR, (fit.start, fit.flow))


def _delivered(
    winner: Winner, standard: Sequence[Record], scales: Scales, dt: float, question: Question
) -> tuple[StableFit, float]:
    """Return the fit in the user's units, and its error on all data in standard units.

    A sample takes dt seconds: rates are divided by it. Inputs and outputs are scaled back; states keep their
    coordinates, in which P = I, and so do the rows and shifts of the neurons.
    """
    pieces = Pieces.of(standard, question.hold)
    task = Task(pieces, winner.parameters, np.zeros((1, 1)), winner.substeps)
    task = replace(task, ridge=np.zeros_like(least_squares.theta_of(winner.latent)))
    task, fit = _exact(task, least_squares.begun(task, winner.batch))
    own = winner.latent
    seen = moments(own, pieces, fit.start, task.substeps)
    latent, n, m, hard = own.in_activations(), own.n, own.m, slice(0, own.hardening)
    proof = winner.parameters.proved(winner.batch) if isinstance(winner.parameters, Stable) else None
    rows, R = latent.O[0] * scales.y_scale[:, None], latent.R[0].copy()
    if proof is not None:  # the integral of s - f is that of s, which goes to P, less that of f
        proof.M[0, hard] *= -1
    return StableFit(
        A=latent.A[0] / dt,
        R=R,
        beta=latent.V[0, :, n].copy(),
        A1=latent.A1[0] / dt,
        B=latent.B[0] / scales.u_scale / dt,
        b=latent.b[0] / dt,
        C=rows[:, :n].copy(),
        D=rows[:, n : n + m] / scales.u_scale,
        d=rows[:, -1] + scales.y_mean,
        u_ref=scales.u_mean.copy(),
        x0=winner.batch.x0[0].copy(),
        x_mean=seen.mean,
        x_cov=seen.cov,
        noise=np.sqrt(seen.noise) * scales.y_scale,
        dt=dt,
        activation=latent.activation,
        F=latent.F[0].copy() if latent.F.size else None,
        output_map=question.output_map,
        hold=question.hold,
        M=None if proof is None else proof.M[0],
        T=None if proof is None else proof.T[0] / dt,
        kappa=question.kappa / dt if proof is not None else 0.0,
        P=None if proof is None or not own.hardening else np.eye(n) - (R[hard].T * proof.M[0, hard]) @ R[hard],
    ), float(fit.error[0])
