"""The verdict on a model: certified, refuted, or undecided with its reason, by the attempts that cost least first."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy import ndarray

from persid._threads import few_threads
from persid.certificates.certificate import Certificate
from persid.certificates.obstruction import Obstruction, find_obstruction
from persid.certificates.stability import write
from persid.certificates.witness import find_witness
from persid.errors import ModelError, RejectedError, RoundingError
from persid.lyapunov.interior_point import Status
from persid.lyapunov.multipliers import Lyapunov, choose
from persid.lyapunov.operating_points import OperatingPoint, find_operating_point, vector
from persid.lyapunov.rates import Question, best_rate, smallest_gain
from persid.lyapunov.search import search
from persid.lyapunov.shifted_model import Setting, undefined
from persid.models.model import PersidskiiModel
from persid.networks.certificate import NetworkCertificate, NetworkObstruction, certify_network, is_large
from persid.verdicts.evidence import simulated
from persid.verdicts.verdict import RATED, RATED_STATES, Attempt, Certified, Reason, Refuted, Undecided, Verdict

FULL_P_STATES = 50  # a full P is tried up to this many states
RATE_SHARE = 0.5  # the gain is made small at this share of the best rate

Progress = Callable[[str], None]


@dataclass(frozen=True, eq=False)
class _Failure:
    """Why an attempt found no certificate."""

    reason: Reason
    detail: str
    obstruction: Obstruction | NetworkObstruction | None = None

    def undecided(self, asked: "_Asked", log: "_Log") -> Undecided:
        evidence = None
        # where a function ends, a run that goes on tells nothing
        if log.limit > 0 and not is_large(asked.model) and not undefined(asked.model):
            with log.attempt("simulations from bounded states") as outcome:
                evidence = simulated(asked.model, asked.u)
                outcome.append(f"{evidence.diverged} of {evidence.runs} diverged")
        return Undecided(self.reason, self.detail, tuple(log.attempts), self.obstruction, evidence)


@dataclass
class _Log:
    """Collects attempts with their times, and reports them as they happen."""

    limit: float  # in s
    progress: Progress
    attempts: list[Attempt] = field(default_factory=list)
    best: Certificate | None = None  # what an interruption leaves
    began: float = field(default_factory=lambda: time.perf_counter())

    def left(self) -> float:
        """Seconds until the time limit."""
        return self.began + self.limit - time.perf_counter()

    @contextmanager
    def attempt(self, what: str) -> Iterator[list[str]]:
        """Time an attempt; its outcome is what the caller appends to the list."""
        outcome: list[str] = []
        started = time.perf_counter()
        try:
            self.progress(what)
            yield outcome
        finally:
            self.attempts.append(Attempt(what, outcome[0] if outcome else "interrupted", time.perf_counter() - started))


def certify(
    model: PersidskiiModel,
    *,
    operating_point: Any = "auto",
    u_op: Any = None,
    domain: Any = "global",
    gains: str = "joint",
    time_limit: float | int = 60.0,
    progress: Progress | None = None,
) -> Verdict:
    """Decide whether a model is input-to-state stable about its operating point.

    Global questions are tried first: what refutes, then a Lyapunov function on all of R^n, its rate and gain. Where
    these leave a model undecided that has a box of data, a region inside that box is certified.

    Args:
        model: the model; the verdict is about it, not about the plant.
        operating_point: "auto" (the equilibrium nearest to x_ref) or a state; the equilibrium nearest to it is meant.
        u_op: the nominal constant input, (m,), default u_ref.
        domain: "global"; "data" for a region in the model's box of data only; or a box [[lo, hi], …].
        gains: "joint" for one gain from sup|u - u*|, as small as is found; "each" for a gain of every input, made small
            where inputs act alike: certificate.gains, and certificate.bound(x0, [sup|u_1 - u_1*|, …], t).
        time_limit: seconds after which the search stops with what it has; with 0 nothing is simulated either.
        progress: is called with a line of text at each step.

    Returns:
        Certified with a certificate, or Refuted with a witness, that `persid_check` has accepted; else Undecided. After
        Ctrl-C the best that was reached: a certificate without a rate, or Undecided.

    Raises:
        ModelError: an argument does not fit the model.
    """
    if not time_limit >= 0:
        raise ModelError(f"time_limit is {time_limit!r}; needed are seconds, at least 0")
    if gains not in ("joint", "each"):
        raise ModelError(f'gains is "joint" or "each", not {gains!r}')
    log = _Log(float(time_limit), progress or (lambda line: None))
    near, box = _near(model, operating_point), _box(model, domain)
    u = model.u_ref if u_op is None else vector("u_op", u_op, model.m)
    try:
        with (
            few_threads(model.n),
            np.errstate(all="ignore"),
        ):  # samples overflow, slopes are infinite: what is not finite proves nothing
            return _decide(_Asked(model, near, u, box, gains == "each"), log)
    except KeyboardInterrupt:
        if log.best is not None:
            return Certified(log.best, tuple(log.attempts))
        return Undecided(Reason.INTERRUPTED, "Run it again and let it finish.", tuple(log.attempts))


@dataclass(frozen=True, eq=False)
class _Asked:
    """A question: the model at input u near a state (None: x_ref), in a box (None: globally), a gain for each input."""

    model: PersidskiiModel
    near: ndarray | None
    u: ndarray
    box: ndarray | None
    each: bool


def _decide(asked: _Asked, log: _Log) -> Verdict:
    """Answer the global question, unless a box is given; then the regional one, where there is a box."""
    if asked.model.is_sparse and asked.box is None:
        found = _by_weights(asked, log)
        if isinstance(found, NetworkCertificate):
            return Certified(found, tuple(log.attempts))
        if is_large(asked.model):
            return found.undecided(asked, log)
    asked = replace(asked, model=asked.model.dense())
    with log.attempt("equilibria at the nominal input") as outcome:
        points = find_operating_point(asked.model, asked.u, near=asked.near)
        outcome.append(f"{len(points)} found and proved")
    verdict = None if asked.box is not None else _global(asked, points, log)
    if isinstance(verdict, Certified | Refuted):
        return verdict
    box = asked.model.domain if asked.box is None else asked.box
    regional = verdict if box is None else _regional(asked, points, box, log)
    if isinstance(regional, Certificate):
        return Certified(regional, tuple(log.attempts))
    failure = verdict or regional or _FAILURES[Status.TIME]
    if points and isinstance(regional, _Failure) and failure.reason is Reason.OUTSIDE:  # a region was asked for
        failure = regional
    return failure.undecided(asked, log)


def _near(model: PersidskiiModel, operating_point: Any) -> ndarray | None:
    """Return the state near which the operating point is meant, None for the one nearest to x_ref."""
    if isinstance(operating_point, str) and operating_point == "auto":
        return None
    return vector('operating_point, if not "auto",', operating_point, model.n)


def _box(model: PersidskiiModel, domain: Any) -> ndarray | None:
    """Return the box that a regional question names, None for a global one."""
    if isinstance(domain, str):
        if domain not in ("global", "data"):
            raise ModelError(f'domain is "global", "data" or a box [[lo, hi], …], not {domain!r}')
        if domain == "data" and model.domain is None:
            raise ModelError('domain="data" needs a model with a box of data; give the box as [[lo, hi], …]')
        return model.domain if domain == "data" else None
    try:
        box = np.array(domain, float)
    except (TypeError, ValueError):
        box = np.zeros(0)
    if box.shape != (model.n, 2) or not (np.isfinite(box).all() and (box[:, 0] < box[:, 1]).all()):
        raise ModelError(f"a box needs one finite [lo, hi] with lo < hi for each of the {model.n} states")
    return box


def _global(asked: _Asked, points: tuple[OperatingPoint, ...], log: _Log) -> Certified | Refuted | _Failure:
    """Refute if that is cheap; else try a diagonal P, then a full P where the size allows it."""
    with log.attempt("witnesses against stability") as outcome:
        witness = find_witness(asked.model, asked.u, points)
        outcome.append("none" if witness is None else witness.kind)
    if witness is not None:
        return Refuted(witness, tuple(log.attempts))
    if not points:
        return _Failure(Reason.OUTSIDE, _NO_POINT)
    if missing := undefined(asked.model):
        return _Failure(Reason.OUTSIDE, _UNDEFINED.format("; ".join(missing[:4])))
    if log.left() <= 0:
        return _FAILURES[Status.TIME]
    setting, failure = Setting.of(asked.model, points[0]), _FAILURES[Status.TIME]
    for kind in _kinds(asked.model):
        with log.attempt(f"global Lyapunov function, {kind} P") as outcome:
            answer = _settled(setting, partial(_margin, setting, kind == "full", log), log)
            outcome.append(_word(answer))
        if isinstance(answer, Certificate):
            log.best = answer
            return Certified(_rated(asked, setting, kind == "full", answer, log), tuple(log.attempts))
        failure = answer
    if log.left() > 0:
        found = _by_weights(asked, log)
        if isinstance(found, NetworkCertificate):
            return Certified(found, tuple(log.attempts))
    return failure


def _by_weights(asked: _Asked, log: _Log) -> NetworkCertificate | _Failure:
    """Certify with V = sum w_k |x_k - x*_k| (claim L1), where argument rows are positive multiples of unit vectors."""
    model = asked.model
    nominal = bool((asked.u == model.u_ref).all())
    at_reference = nominal and (asked.near is None or bool((asked.near == model.x_ref).all()))
    with log.attempt("a weighted l1 norm") as outcome:
        found = certify_network(model, at_reference, log.progress)
        answer = found if isinstance(found, NetworkCertificate) else _Failure(Reason.NOT_FOUND, _LARGE)
        if isinstance(found, NetworkObstruction):
            answer = _Failure(Reason.INFEASIBLE, _LARGE, found)
        outcome.append(_word(answer))
    return answer


def _kinds(model: PersidskiiModel) -> tuple[str, ...]:
    return ("diagonal", "full") if 1 < model.n <= FULL_P_STATES else ("diagonal",)


def _rated(asked: _Asked, setting: Setting, full_P: bool, certificate: Certificate, log: _Log) -> Certificate:
    """Return a certificate with rate and gain (claim E) where there is one and time for it, else the one given."""
    if certificate.claim == "M" or setting.model.n > RATED_STATES or log.left() <= 0:
        return certificate
    with log.attempt(RATED) as outcome:
        answer = _settled(setting, partial(_rate_and_gain, asked, setting, full_P, None, log), log)
        outcome.append(_word(answer))
    return answer if isinstance(answer, Certificate) else certificate


def _regional(asked: _Asked, points: tuple[OperatingPoint, ...], box: ndarray, log: _Log) -> Certificate | _Failure:
    """Certify the largest region in the box that is found, about the first equilibrium inside it that allows one."""
    answer = _Failure(Reason.OUTSIDE, "No equilibrium at the nominal input was found and proved inside the box.")
    for point in points:
        reach = np.minimum(point.x - box[:, 0], box[:, 1] - point.x) - 3 * point.radius
        if not (reach > 0).all():
            continue
        if missing := undefined(asked.model, point, box):
            return _Failure(Reason.OUTSIDE, _UNDEFINED_IN_BOX.format("; ".join(missing[:4])))
        if log.left() <= 0:
            return _FAILURES[Status.TIME]
        setting = Setting.of(asked.model, point, box)
        for kind in _kinds(asked.model):
            with log.attempt(f"region in the box, {kind} P") as outcome:
                tried = _settled(setting, partial(_rate_and_gain, asked, setting, kind == "full", reach, log), log)
                outcome.append(_word(tried))
            if isinstance(tried, Certificate):
                return tried
            answer = tried
    return answer


def _word(answer: Certificate | NetworkCertificate | _Failure) -> str:
    return answer.reason.name.lower() if isinstance(answer, _Failure) else f"certified, claim {answer.claim}"


def _settled(setting: Setting, find: Callable[[], Lyapunov | _Failure], log: _Log) -> Certificate | _Failure:
    """Find, prove what is used, write and check; what is not proved leaves the pools, and the search is made again."""
    unproved: list[str] = []
    while log.left() > 0:
        try:
            found = find()
            if not isinstance(found, Lyapunov):
                lacking = found.reason in (Reason.NOT_FOUND, Reason.INFEASIBLE) and unproved
                return _Failure(Reason.FORM, _UNPROVED.format("; ".join(unproved[:4]))) if lacking else found
            log.progress("proving properties of the functions")
            dropped = setting.without_unproved(found)
            if not dropped:
                log.progress("checking in exact arithmetic")
                return Certificate.accept(write(setting.model, found, setting.point, setting.box, reach=setting.reach))
        except (RejectedError, RoundingError) as error:
            return _Failure(Reason.ROUNDING, str(error))
        for line in dropped:
            log.progress(f"not proved and dropped: {line}")
        unproved += dropped
    return _FAILURES[Status.TIME]


def _margin(setting: Setting, full_P: bool, log: _Log) -> Lyapunov | _Failure:
    """Return a Lyapunov function with V' < 0 and no rate asked for."""
    found = search(setting.system, setting.pools, full_P=full_P, time_limit=log.left(), progress=log.progress)
    if found.status is Status.FEASIBLE:
        return choose(found.assembly, found.solution.y)
    if found.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    obstruction = find_obstruction(setting.model, found) if found.status is Status.INFEASIBLE else None
    if obstruction is not None:
        return _Failure(Reason.INFEASIBLE, _TRY, obstruction)
    return _FAILURES.get(found.status, _FAILURES[Status.STALLED])


def _rate_and_gain(
    asked: _Asked, setting: Setting, full_P: bool, reach: ndarray | None, log: _Log
) -> Lyapunov | _Failure:
    """Return a Lyapunov function of nearly the best rate times RATE_SHARE, its gain made small at that rate."""
    J = setting.jacobian
    if not np.isfinite(J).all():
        return _Failure(Reason.OUTSIDE, _NO_SLOPE)
    fastest = -2 * float(np.linalg.eigvals(J).real.max())
    if fastest <= 0:
        return _Failure(Reason.OUTSIDE, "The linearisation at the operating point is not exponentially stable.")
    system, shape = setting.system, None if reach is None else 1 / reach**2
    if len(system.states) < system.n:  # claims E and R keep every state; no form lets this one be kept
        return _FAILURES[Status.INFEASIBLE]
    units = setting.units if asked.each else None
    if units is not None:
        system = replace(system, B=system.B * units)
    question = Question(system, setting.pools, setting.upper, setting.below, full_P, shape)
    best = best_rate(question, fastest, log.left)
    if best is None:
        return _FAILURES[Status.TIME if log.left() <= 0 else Status.INFEASIBLE]
    gentle = smallest_gain(question, RATE_SHARE * best.assembly.target.kappa, best, log.left) or best
    return choose(gentle.assembly, gentle.solution.y, setting.lower, units)


_LARGE = "It is a weighted l1 norm; for other Lyapunov functions a model of at most 400 states is needed."
_TRY = "Fit with more ridge or fewer functions, or ask for a regional claim."
_NO_POINT = "No equilibrium at the nominal input was found and proved; name a state near it, or another input (u_op)."
_UNDEFINED = (
    "It is not proved that {} is defined and continuous for all states, which a global claim needs; ask for a region"
    ' where it is: domain="data", or a box [[lo, hi], …].'
)
_UNDEFINED_IN_BOX = "It is not proved that {} is defined and continuous in the whole box; give a smaller one."
_NO_SLOPE = "A slope at the operating point is not finite, or not known in floating point."
_UNPROVED = "Without it the search finds nothing: {}. Simpler functions, or a smaller box, are easier to prove."
_FAILURES = {
    Status.INFEASIBLE: _Failure(Reason.NOT_FOUND, _TRY),
    Status.STALLED: _Failure(Reason.STALLED, "The margin is close to zero: a little more ridge usually decides it."),
    Status.TIME: _Failure(Reason.TIME, "Give more time (time_limit)."),
}
