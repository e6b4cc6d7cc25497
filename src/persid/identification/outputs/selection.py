"""Choose order, neurons, ridge, feedthrough and seed by free runs on the last part of every record, held out."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.identification.outputs import least_squares, starts
from persid.identification.outputs.latent import Latent
from persid.identification.outputs.least_squares import Batch, Fit, Parameters, Task, Term
from persid.identification.outputs.records import Pieces, Record
from persid.identification.outputs.runs import moments
from persid.identification.outputs.smoothness import Smooth
from persid.identification.outputs.starts import Freedom
from persid.identification.outputs.subspace import linear_starts
from persid.models.lookup_tables import WORD

KEPT = 0.75  # of every record is fitted while choosing
SELECTED = 4000  # samples on which choices are made, at most
LINEAR_STARTS, LINEAR_STEPS = 3, 60
ORDERS = 6  # tried at most
FAIR = 0.02  # held-out error, in units of the spread, below which a pair of states more is not tried
BETTER = 0.97  # a larger or freer model has to lower the held-out error to this share
RUNGS = ((25, 12), (50, 4), (100, 1))  # steps, and how many candidates go on
SHARE = 3  # one in so many goes on, at most
LONG_RUNGS = ((12, 20), (20, 10), (50, 3), (60, 1))  # where there are more candidates, on longer records
GROWN_RUNGS = ((12, 3), (50, 1))
GROWN = 6  # random neurons of a kind that are tried beside those of the best candidate
HOPELESS = 3.0  # times the least held-out error, of these or of an earlier race after as many steps: none goes on
SETTLED = 3e-4  # relative gain of the cost in one step, below which a candidate changes no choice
RIDGES = (2e-2, 2e-4)  # in units of the linear model's mean square error
SIZES = ((2, 0), (4, 0), (8, 0))  # numbers of neurons, and of those that harden
PIECES = 8  # of a learned curve
CURVES = 2  # neurons with which learned curves begin
SMOOTH = 1e-3  # weight of their smoothness, in units of the linear model's mean square error
CURVE_STARTS = 4  # random starts of learned curves for every seed: their shape is one thing more that can go astray
MOST = 8  # neurons tried
HARDENING = ((1, 1), (2, 1), (4, 2))  # tried where loud samples are held out, which tell how a model extrapolates
LOUD = 0.05  # of the fitted samples, held out too where there are more samples than the search takes
LEAST_DECAY = 1e-3  # 1/sample: poles of an unstable linear model are moved to here, or to where
LEAK = 0.01  # is the share by which a mode decays over the longest record: what integrates hardly leaks
FINE = 0.5  # |pole| times a substep, at most
FINEST = 8  # substeps a sample


@dataclass(frozen=True)
class Question:
    """Say which models are looked for; None is "to be chosen". kappa is a rate per sample; outputs are names.

    functions are those of the neurons, one kind a candidate; `one_curve` says that neurons share what they learn.
    """

    order: int | None = None
    neurons: int | None = None
    feedthrough: bool | None = None
    functions: tuple[str, ...] = ("tanh",)
    one_curve: bool = False
    output_map: str | None = None
    hold: str = "zoh"
    certified: bool = True
    kappa: float = 0.0
    ridges: tuple[float, ...] = RIDGES
    seeds: tuple[int, ...] = (0, 1, 2)
    outputs: tuple[str, ...] = ()

    @property
    def through(self) -> bool:
        """Whether D is free in the search: also where it is to be chosen; at the end D = 0 is tried."""
        return self.feedthrough is not False


@dataclass(frozen=True)
class Candidate:
    """Report one candidate: what it is, and its errors in standard units, fitted and held out.

    The first `hardening` of its neurons were fitted as s - f(s). `function` is f.
    """

    order: int
    neurons: int
    feedthrough: bool
    ridge: float
    seed: int
    error: float
    held_out: float
    steps: int
    hardening: int = 0
    function: str = "tanh"


@dataclass(eq=False)
class Group:
    """Hold candidates of one size, which are fitted together."""

    neurons: int
    freedom: Freedom
    ridges: Float[ndarray, " K"]
    seeds: tuple[int, ...]
    task: Task
    fit: Fit

    @property
    def order(self) -> int:
        """Number of states."""
        return int(self.fit.batch.x0.shape[2])

    def candidates(self) -> list[tuple[Candidate, "Group", int]]:
        """Return the candidates with their places."""
        size, batch = (self.order, self.neurons, self.freedom.through), self.fit.batch
        ends = (self.fit.steps, batch.hardening, batch.activation)
        found = zip(self.ridges, self.seeds, self.fit.error, self.fit.held_out, strict=True)
        return [
            (Candidate(*size, float(r), s, float(e), float(h), *ends), self, k) for k, (r, s, e, h) in enumerate(found)
        ]


@dataclass(frozen=True, eq=False)
class Winner:
    """Hold one fitted point with its parametrisation, and how its ridge and substeps were chosen."""

    parameters: Parameters
    batch: Batch
    ridge: float
    substeps: int
    candidate: Candidate
    terms: tuple[Term, ...] = ()

    @property
    def latent(self) -> Latent:
        """The model, a batch of one."""
        return self.parameters.latent(self.batch)[0]


@dataclass(frozen=True, eq=False)
class LinearFit:
    """Hold the best linear model of an order, and its errors."""

    latent: Latent
    error: float
    held_out: float
    start: Float[ndarray, "K n S"]
    freedom: Freedom

    @property
    def slowest(self) -> float:
        """Largest real part of a pole, per sample."""
        return float(np.linalg.eigvals(self.latent.A[0]).real.max())


def selected_part(records: Sequence[Record], most: int = SELECTED) -> list[Record]:
    """Return the first samples of the records, about `most` together, in shares of their lengths."""
    total = sum(len(u) for u, _ in records)
    share = min(1.0, most / total)
    return [(u[: ceil(share * len(u))], y[: ceil(share * len(u))]) for u, y in records]


def linear_fit(records: Sequence[Record], pieces: Pieces, n: int, question: Question, kept: float = KEPT) -> LinearFit:
    """Return the best linear model of order n by output error, from several subspace starts.

    Raises:
        DataError: the records are too short for the order.
    """
    through = question.through
    head = [(u[: round(kept * len(u))], y[: round(kept * len(u))]) for u, y in records]
    found = linear_starts(head, n, through)[:LINEAR_STARTS]
    if not found:
        longest = max(len(u) for u, _ in records)
        raise DataError(
            f"the longest record has {longest} samples, too few for a model of order {n}; "
            "give longer records or a smaller order"
        )
    latent = starts.stacked([starts.latent_of(linear, question.output_map) for linear in found])
    for freedom in (Freedom(through), Freedom(through, offset=True)):
        parameters, batch = starts.free_batch(latent, freedom)
        task = Task(pieces, parameters, np.zeros(batch.w.shape), substeps_for(latent), SETTLED)
        fit = least_squares.fitted(task, least_squares.begun(task, batch), LINEAR_STEPS)
        best = int(np.argmin(fit.cost))
        if not outlasts(parameters.latent(fit.batch)[0].A[best], pieces):
            break
    if not np.isfinite(fit.cost[best]):
        raise DataError(f"no linear model of order {n} follows the records; look at their scales and sampling time")
    one = slice(best, best + 1)
    return LinearFit(
        parameters.latent(fit.batch[one])[0], float(fit.error[best]), float(fit.held_out[best]), fit.start[one], freedom
    )


def outlasts(A: Float[ndarray, "n n"], pieces: Pieces) -> bool:
    """Whether a mode takes longer than the records: what its rate is offset by is then no offset of the outputs."""
    return bool(np.linalg.eigvals(A).real.max() * pieces.longest > -1)


def substeps_for(latent: Latent) -> int:
    """Return the Runge-Kutta steps a sample that the fastest pole needs."""
    fastest = max(np.abs(np.linalg.eigvals(A)).max() for A in latent.A)
    return int(np.clip(ceil(fastest / FINE), 1, FINEST))


def linear_fits(records: Sequence[Record], pieces: Pieces, question: Question) -> Iterator[LinearFit]:
    """Yield linear models of the order that is asked for, or of orders 1, 2, … until more states do not help."""
    if question.order is not None:
        yield linear_fit(records, pieces, question.order, question)
        return
    found: list[LinearFit] = []
    for n in range(1, ORDERS + 1):
        try:
            found.append(linear_fit(records, pieces, n, question))
        except DataError:
            if not found:
                raise
            return
        yield found[-1]
        if n - best_order(found) >= 2:
            return


def best_order(found: Sequence[LinearFit]) -> int:
    """Return the smallest order whose held-out error cannot be lowered notably by more states."""
    least = min(fit.held_out for fit in found)
    return next(fit.latent.n for fit in found if BETTER * fit.held_out <= least)


def stabilised(linear: LinearFit, pieces: Pieces, question: Question) -> LinearFit:
    """Return a stable model near a linear one: poles moved to the left, then refitted under stability."""
    w, V = np.linalg.eig(linear.latent.A[0])
    bound = -min(LEAST_DECAY, LEAK / pieces.longest) - question.kappa / 2
    if w.real.max() <= bound:
        return linear
    A = (V @ np.diag(np.minimum(w.real, bound) + 1j * w.imag) @ np.linalg.inv(V)).real
    W = linear.latent.W.copy()
    W[0, :, : len(A)] = A
    moved = replace(linear.latent, W=W)
    parameters, batch, _ = starts.stable_batch(moved, linear.freedom, question.kappa)
    task = Task(pieces, parameters, np.zeros((1, parameters.width)), substeps_for(moved))
    fit = least_squares.fitted(task, least_squares.begun(task, batch), LINEAR_STEPS)
    found = parameters.latent(fit.batch)[0]
    return LinearFit(found, float(fit.error[0]), float(fit.held_out[0]), fit.start, linear.freedom)


@dataclass(frozen=True)
class Kind:
    """Say of which kind the neurons of a group are: how many, how many of them harden, and their function."""

    neurons: int
    hardening: int = 0
    function: str = "tanh"

    @property
    def learned(self) -> bool:
        """Whether the function is learnt."""
        return self.neurons > 0 and self.function == WORD

    def seeds(self, seeds: Sequence[int]) -> list[int]:
        """Return the random starts for these seeds."""
        some = CURVE_STARTS if self.learned else 1
        return [some * seed + k for seed in seeds for k in range(some)]


def group_of(linear: LinearFit, kind: Kind, question: Question, pieces: Pieces, ridges: Sequence[float]) -> Group:
    """Return candidates with neurons, one for every ridge and random start, before their first step."""
    q = kind.neurons
    pairs = [(ridge, seed) for ridge in ridges for seed in kind.seeds(question.seeds)] if q else [(0.0, 0)]
    seen = moments(linear.latent, pieces, linear.start, 2)
    white = starts.whitened(linear.latent, seen.mean, seen.cov)
    effect = 0.0 if question.certified else 0.01
    curve, freedom = PIECES if kind.learned else 0, replace(linear.freedom, one_curve=question.one_curve)
    drawn = [seed for _, seed in pairs]
    latent = starts.with_neurons(
        white, q, drawn, effect, activation=kind.function, hardening=kind.hardening, pieces=curve
    )
    parameters: Parameters
    if question.certified:
        parameters, batch, _ = starts.stable_batch(latent, freedom, question.kappa)
    else:
        parameters, batch = starts.free_batch(latent, freedom)
    weights = np.array([ridge for ridge, _ in pairs])
    ridge = ridge_of(latent, weights * linear.error**2)
    terms = (Smooth(SMOOTH * linear.error**2),) if kind.learned else ()
    task = Task(pieces, parameters, ridge, substeps_for(latent), SETTLED, terms)
    one = least_squares.begun(replace(task, ridge=ridge[:1]), batch[slice(1)])  # neurons have little effect, or none
    fit = least_squares.begun(task, batch, near=(one.start, one.flow))
    return Group(q, freedom, weights, tuple(seed for _, seed in pairs), task, fit)


def ridge_of(latent: Latent, weights: Float[ndarray, " K"]) -> Float[ndarray, "K d"]:
    """Return the ridge: it acts on A1 and R."""
    W, V, F, O = (np.zeros_like(part[:1]) for part in (latent.W, latent.V, latent.F, latent.O))  # noqa: E741
    W[:, :, latent.n : latent.n + latent.q] = 1.0
    V[:, :, :-1] = 1.0
    return np.asarray(weights[:, None] * np.concatenate([part.ravel() for part in (W, V, F, O)]))


def raced(
    groups: list[Group], tell: Callable[[float], None], rungs: Sequence[tuple[int, int]], record: Sequence[float] = ()
) -> list[float]:
    """Fit all candidates for some steps, go on with the best, and so on; return the least held-out error of each rung.

    Beside the best on held-out samples go on those that follow the fitted ones best: on its way to a better model a
    candidate may foretell less for a while.

    `record` are those of an earlier race: who trails far behind is given up.
    """
    least: list[float] = []
    for steps, survivors in rungs:
        for group in groups:
            least_squares.fitted(group.task, group.fit, steps, lambda fit: tell(float(np.nanmin(fit.held_out))))
        ranking = ranked(groups)
        least.append(ranking[0][0].held_out)
        most = HOPELESS * min([least[-1], *record[len(least) - 1 : len(least)]])
        places = min(survivors, ceil(len(ranking) / SHARE))
        learning = sorted(ranking, key=lambda one: one[0].error)[: ceil(places / SHARE)]
        chosen = {(id(group), k) for _, group, k in (*ranking[:places], *learning)}
        for candidate, group, k in ranking:
            group.fit.ended[k] |= (id(group), k) not in chosen or candidate.held_out > most
    return least


def ranked(groups: Sequence[Group]) -> list[tuple[Candidate, Group, int]]:
    """Return all candidates, the smallest held-out error first."""
    return sorted((one for group in groups for one in group.candidates()), key=lambda one: one[0].held_out)


def again(group: Group, k: int, weaker: float = 1.0, feedthrough: bool = True) -> Group:
    """Return one candidate before it is fitted on, with a weaker ridge or with D = 0."""
    one, parameters, batch = slice(k, k + 1), group.task.parameters, group.fit.batch[slice(k, k + 1)]
    n, m, l = group.order, group.task.pieces.u.shape[1], group.task.pieces.y.shape[1]  # noqa: E741
    if not feedthrough:
        through = starts.entries_of_feedthrough(len(parameters.free), n, m, l)
        parameters = replace(parameters, free=parameters.free & ~through)
        batch = replace(batch, w=np.where(through, 0.0, batch.w))
    task = replace(group.task, parameters=parameters, ridge=group.task.ridge[one] / weaker)
    fit = least_squares.begun(task, batch, least_squares.NEAR, (group.fit.start[one], group.fit.flow[one]))
    freedom = replace(group.freedom, through=feedthrough)
    return Group(group.neurons, freedom, group.ridges[one] / weaker, group.seeds[one], task, fit)


def grown(group: Group, k: int, hardens: bool) -> Group:
    """Return one candidate with one more random neuron, before it is fitted on."""
    one, before, first = slice(k, k + 1), group.task, GROWN * (group.seeds[k] + group.neurons)
    latent = before.parameters.latent(group.fit.batch[one])[0]
    seen = moments(latent, before.pieces, group.fit.start[one], before.substeps)
    seeds = range(first, first + GROWN)
    parameters, batch = starts.grown(
        before.parameters, group.fit.batch[one], mean=seen.mean, cov=seen.cov, seeds=seeds, hardens=hardens,
        freedom=group.freedom,
    )  # fmt: skip
    count = len(batch.w)
    weights = np.full(count, before.ridge[k].max(initial=0.0))
    task = replace(before, parameters=parameters, ridge=ridge_of(parameters.latent(batch)[0], weights))
    fit = least_squares.begun(task, batch, near=(group.fit.start[one], group.fit.flow[one]))
    return Group(group.neurons + 1, group.freedom, group.ridges[[k] * count], group.seeds[k : k + 1] * count, task, fit)


def winner_of(group: Group, k: int) -> Winner:
    """Return one candidate of a group."""
    candidate = group.candidates()[k][0]
    one = slice(k, k + 1)
    return Winner(
        group.task.parameters,
        group.fit.batch[one],
        float(group.task.ridge[k].max(initial=0.0)),
        group.task.substeps,
        candidate,
        group.task.terms,
    )
