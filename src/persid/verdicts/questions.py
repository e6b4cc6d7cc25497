"""Questions about a model, and their answers by the attempts that cost least first."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.certificates.margin import Margin
from persid.certificates.witness import find_witness
from persid.lyapunov import decay
from persid.lyapunov.arrays import HOST, Arrays
from persid.lyapunov.frame import Frame
from persid.lyapunov.interior_point import Status
from persid.lyapunov.operating_points import OperatingPoint, find_operating_point
from persid.lyapunov.shifted_model import Setting, undefined
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.networks.certificate import NetworkCertificate, NetworkObstruction, certify_network
from persid.verdicts import failures as words
from persid.verdicts.evidence import simulated
from persid.verdicts.facts import (
    About,
    by_facts,
    by_strips,
    frame_of,
    has_zero_rows,
    on_strips,
    with_products,
    with_slopes,
)
from persid.verdicts.failures import Failure, stopped
from persid.verdicts.log import ALL_STATES, Log
from persid.verdicts.margins import MARGIN_STATES, residual_margin
from persid.verdicts.practical import practically
from persid.verdicts.searches import SHORTENED_STATES, fastest, margin, rate_and_gain, settled, sketched
from persid.verdicts.verdict import RATED, RATED_STATES, Certified, Reason, Refuted, Undecided, Verdict
from persid_check.model import MAX_CHANNELS, MAX_STATES

ESCAPES = ("unstable-linear-part", "marginal-direction", "cooperative-growth")  # witnesses of runs without bound
FULL_P_STATES = 50  # a full P is tried right after a diagonal one up to this many states,
PAIRS = 25  # and last of all up to as many, n, as leave half of the memory to so many times n^4 bytes: its n^2 entries
# are n^2 pairs and more, and a step holds their Schur complement and what it is made of
Way = Callable[[], "Certified | NetworkCertificate | Failure"]
FACTS_STATES = 60  # facts across functions are tried up to this many states
PRACTICAL_STATES = 20  # a ball is sought up to this many states
SLOPED = 20  # and slopes along solutions, the dearest, up to so many states and functions together
RATING = 0.8  # of the time goes to rate and gain, before a V without a rate is proved
FULL_RATED_STATES = 20  # and stands in every rate and gain up to this many; at 50 it takes five times as long


@dataclass(frozen=True, eq=False)
class Question:
    """A question: the model at input u near a state (None: x_ref), in a box (None: globally), a gain for each input, a
    rate (None: half of the best one).

    With `outputs` these are bounded where a certificate has a rate.
    """

    model: PersidskiiModel
    near: ndarray | None
    u: ndarray
    box: ndarray | None
    each: bool
    rate: float | int | None
    outputs: OutputModel | None = None
    claim: str = "strongest"
    arrays: Arrays = HOST
    auto: bool = False  # a region is asked for, and its bounds are for the search to choose


def decide(asked: Question, log: Log) -> Verdict:
    """Answer the global question, unless a box is given; then the regional one, where there is a box."""
    if asked.model.is_sparse and asked.box is None and not asked.auto:
        found = _by_weights(asked, log)
        if isinstance(found, NetworkCertificate):
            return Certified(found, tuple(log.attempts))
        if asked.model.is_large:
            return _undecided(found, asked, log)
    if not _is_readable(asked.model):
        return Undecided(Reason.OUTSIDE, words.TOO_LARGE, tuple(log.attempts))
    asked = replace(asked, model=asked.model.dense())
    with log.attempt("equilibria at the nominal input") as outcome:
        points = find_operating_point(asked.model, asked.u, near=asked.near)
        outcome.append(f"{len(points)} found and proved")
    if asked.auto:
        widest = _widest(asked, points, log)
        return widest if isinstance(widest, Certified) else _undecided(widest, asked, log)
    verdict = None if asked.box is not None else _global(asked, points, log)
    if asked.claim == "practical" and not isinstance(verdict, Certified):
        verdict = _practical(asked, verdict, log)
    if isinstance(verdict, Certified | Refuted):
        return verdict
    box = asked.model.domain if asked.box is None and asked.claim == "strongest" else asked.box
    regional = verdict if box is None else _regional(asked, points, box, log)
    if isinstance(regional, Certified):
        return regional
    failure = verdict or regional or stopped(Status.TIME)
    if points and isinstance(regional, Failure) and failure.reason is Reason.OUTSIDE:  # a region was asked for
        failure = regional
    return _undecided(failure, asked, log)


def _is_readable(model: PersidskiiModel) -> bool:
    """Whether the checker reads a model with so many states, inputs and functions of them."""
    return max(model.n, model.m) <= MAX_STATES and len(model.channels.functions) <= MAX_CHANNELS


def _widest(asked: Question, points: tuple[OperatingPoint, ...], log: Log) -> Certified | Failure:
    """Certify for all states, the largest region there is, where that takes little time; else in strips."""
    with log.share(ALL_STATES):
        everywhere = _global(asked, points, log)
    return everywhere if isinstance(everywhere, Certified) else _by_strips(asked, points, log)


def _undecided(failure: Failure, asked: Question, log: Log) -> Undecided:
    """Return the verdict of a failure, with what simulations do."""
    evidence = None
    # where a function ends, a run that goes on tells nothing
    if log.limit > 0 and not asked.model.is_large and not undefined(asked.model):
        with log.attempt("simulations from bounded states") as outcome:
            evidence = simulated(asked.model, asked.u, asked.box)
            moving = f", {evidence.moving} still moving" if evidence.moving else ""
            outcome.append(f"{evidence.diverged} of {evidence.runs} diverged{moving}")
    return Undecided(failure.reason, failure.detail, tuple(log.attempts), failure.obstruction, evidence)


def _global(asked: Question, points: tuple[OperatingPoint, ...], log: Log) -> Certified | Refuted | Failure:
    """Refute if that is cheap; else try ways to certify, the cheap ones first, until one has the rate asked for.

    Where functions can have no margin, forces of springs, facts are: nothing else can succeed.
    """
    with log.attempt("witnesses against stability") as outcome:
        witness = find_witness(asked.model, asked.u, points)
        outcome.append("none" if witness is None else witness.kind)
    if witness is not None:
        return Refuted(witness, tuple(log.attempts))
    if not points:
        return Failure(Reason.OUTSIDE, words.NO_POINT)
    if missing := undefined(asked.model):
        return words.not_defined(missing)
    if log.left() <= 0:
        return stopped(Status.TIME)
    setting = Setting.of(asked.model, points[0], arrays=asked.arrays)
    if asked.claim == "incremental":
        return _between_solutions(asked, setting, log)
    forms = partial(_by_forms, asked, setting, _kinds(asked.model), log)
    failure, slower = stopped(Status.TIME), list[Certified]()
    rate = asked.rate if asked.rate and decay.loss(asked.rate, asked.model.dt) < setting.fastest else 0.0
    for way in _ways(asked, setting, forms, log):
        if log.left() <= 0:
            break
        answer = way()
        if isinstance(answer, Failure):
            failure = answer if way is forms else failure
            continue
        found = answer if isinstance(answer, Certified) else Certified(answer, tuple(log.attempts))
        if (found.best_rate or 0.0) >= rate:
            return found
        slower.append(found)
    return max(slower, key=lambda found: found.best_rate or 0.0) if slower else failure


def _ways(asked: Question, setting: Setting, forms: Way, log: Log) -> Iterator[Way]:
    """Yield the ways to certify in their order; of many states a full P, which may take all the time, comes last."""
    yield from _usual_ways(asked, setting, forms, log)
    if FULL_P_STATES < asked.model.n <= largest_full(asked.arrays.memory):
        yield partial(_by_forms, asked, setting, ("full",), log)


def largest_full(memory: int) -> int:
    """Return the number of states up to which a full P is tried with so many bytes of memory."""
    return max(FULL_P_STATES, int((memory / 2 / PAIRS) ** 0.25))


def _usual_ways(asked: Question, setting: Setting, forms: Way, log: Log) -> Iterator[Way]:
    """Yield the ways to certify: products of forms are one of them."""
    discrete = asked.model.is_discrete
    if asked.outputs is not None or not 1 < asked.model.n <= FACTS_STATES:
        yield forms
        if not discrete:
            yield partial(_by_weights, asked, log)
        return
    frame = frame_of(setting)
    facts: Way = partial(_by_facts, asked, setting, frame, log)
    others: list[Way] = [] if discrete else [partial(_by_weights, asked, log)]
    yield from [facts, forms, *others] if not discrete and has_zero_rows(frame) else [forms, *others, facts]
    if not discrete:
        yield partial(_by_products, asked, setting, frame, log)
    sloped = with_slopes(setting, frame)
    if 0 < len(sloped.slopes) <= SLOPED - asked.model.n and setting.fastest > 0:
        yield partial(_by_facts, asked, setting, sloped, log)


def _between_solutions(asked: Question, setting: Setting, log: Log) -> Certified | Failure:
    """Certify with nondecreasing forms and V = x'P x: what they prove about x* holds between any two solutions."""
    if not asked.model.is_discrete and asked.outputs is None and asked.model.n <= FACTS_STATES:
        frame = frame_of(setting).monotone
        if has_zero_rows(frame):
            found = _by_facts(asked, setting, frame, log)
            between = isinstance(found, Failure) or getattr(found.certificate, "is_incremental", False)
            return found if between else stopped(Status.INFEASIBLE)
    setting, failure = setting.monotone, stopped(Status.TIME)
    for kind in _kinds(asked.model):
        if log.left() <= 0:
            break
        with log.attempt(f"any two solutions, {kind} P") as outcome:
            find = partial(rate_and_gain, full_P=kind == "full", rate=asked.rate, each=asked.each, log=log)
            answer, setting = settled(setting, find, log, asked.outputs)
            outcome.append(_word(answer))
        if isinstance(answer, Certificate) and answer.is_incremental:
            return _beside_the_best(asked, setting, answer, log)
        failure = answer if isinstance(answer, Failure) else Failure(Reason.FORM, words.NOT_RISING)
    return failure


def _by_forms(asked: Question, setting: Setting, kinds: Sequence[str], log: Log) -> Certified | Failure:
    """Certify with products of forms inside each group and a P of these kinds, one after the other.

    Of small models a V without a rate is proved only where no rate is: it need only be known that there is one.
    """
    failure, sketches = stopped(Status.TIME), _may_have_rate(setting)
    for kind in kinds:
        full_P, what = kind == "full", f"global Lyapunov function, {kind} P"
        prove = partial(settled, setting, partial(margin, full_P=full_P, log=log), log, asked.outputs)
        rated = None
        if sketches:
            with log.attempt(what) as outcome:
                lacking = sketched(setting, full_P, log)
                outcome.append("found" if lacking is None else _word(lacking))
            if lacking is not None:
                failure = lacking
                continue
            log.best = lambda prove=prove: prove()[0]
            with log.share(RATING):
                rated, setting = _rated(asked, setting, full_P, log)
        if rated is None:
            with log.attempt(what) as outcome:
                answer, setting = prove()
                outcome.append(_word(answer))
            if isinstance(answer, Failure):
                failure = answer
                continue
            log.best = lambda answer=answer: answer
            if not sketches:
                rated, setting = _rated(asked, setting, full_P, log)
            rated = Certified(answer, tuple(log.attempts)) if rated is None else rated
        return _with_margin(asked, setting, rated, log)
    return failure


def _may_have_rate(setting: Setting) -> bool:
    """Whether a small model may have a rate, which keeps every state."""
    small = setting.model.n <= SHORTENED_STATES and len(setting.system.states) == setting.model.n
    return small and bool(np.isfinite(setting.jacobian).all()) and setting.fastest > 0


def _by_facts(asked: Question, setting: Setting, frame: Frame, log: Log) -> Certified | Failure:
    """Certify with facts across channels, and with rows that are exactly zero; slopes or identities, too."""
    along = "slopes from step to step" if asked.model.is_discrete else "slopes along solutions"
    what = along if frame.sloped else "facts across functions, rows that are zero"
    what = "products of states that cancel" if frame.identities else what
    with log.attempt(what) as outcome:
        found, fastest = by_facts(About.of(setting), frame, asked.rate, asked.each, log)
        outcome.append(_word(found))
    return found if isinstance(found, Failure) else Certified(found, tuple(log.attempts), fastest)


def _by_products(asked: Question, setting: Setting, frame: Frame, log: Log) -> Certified | Failure:
    """Certify with products of states that cancel in V': few of them first."""
    answer: Certified | Failure = stopped(Status.INFEASIBLE)
    for known in with_products(setting, frame):
        answer = _by_facts(asked, setting, known, log) if log.left() > 0 else stopped(Status.TIME)
        if isinstance(answer, Certified):
            break
    return answer


def _practical(asked: Question, verdict: Refuted | Failure | None, log: Log) -> Certified | Refuted | Failure | None:
    """Certify that every run comes into a ball about x_ref, where the nominal input is u_ref; else keep the verdict."""
    if isinstance(verdict, Refuted) and verdict.witness.kind in ESCAPES:
        return verdict
    if asked.outputs is not None or (asked.u != asked.model.u_ref).any():
        return verdict
    if asked.model.n > PRACTICAL_STATES or log.left() <= 0:
        return verdict
    if missing := undefined(asked.model):
        return verdict if isinstance(verdict, Refuted) else words.not_defined(missing)
    with log.attempt("a ball about x_ref that every run comes into") as outcome:
        answer = practically(asked.model, asked.each, log)
        outcome.append(_word(answer))
    if isinstance(answer, Certificate):
        return Certified(answer, tuple(log.attempts))
    return replace(verdict, attempts=tuple(log.attempts)) if isinstance(verdict, Refuted) else verdict


def _by_weights(asked: Question, log: Log) -> NetworkCertificate | Failure:
    """Certify with V = sum w_k |x_k - x*_k| (claim L1), where argument rows are positive multiples of unit vectors."""
    model = asked.model
    nominal = bool((asked.u == model.u_ref).all())
    at_reference = nominal and (asked.near is None or bool((asked.near == model.x_ref).all()))
    with log.attempt("a weighted l1 norm") as outcome:
        found = certify_network(model, at_reference, log.progress)
        answer = found if isinstance(found, NetworkCertificate) else Failure(Reason.NOT_FOUND, words.LARGE)
        if isinstance(found, NetworkObstruction):
            answer = Failure(Reason.INFEASIBLE, words.LARGE, found)
        outcome.append(_word(answer))
    return answer


def _kinds(model: PersidskiiModel) -> tuple[str, ...]:
    return ("diagonal", "full") if 1 < model.n <= FULL_P_STATES else ("diagonal",)


def _rated(asked: Question, setting: Setting, full_P: bool, log: Log) -> tuple[Certified | None, Setting]:
    """Return the verdict by a certificate with rate and gain where there is one and time for it, and what is proved.

    Up to a size P is full there even if a diagonal one shows stability: rate and gain then are the same in all
    orthogonal coordinates.
    """
    n = setting.model.n
    if len(setting.system.states) < n or log.left() <= 0 or (n > RATED_STATES and asked.arrays is HOST):
        return None, setting
    with log.attempt(RATED) as outcome:
        full_P = full_P or 1 < n <= FULL_RATED_STATES
        find = partial(rate_and_gain, full_P=full_P, rate=asked.rate, each=asked.each, log=log)
        answer, setting = settled(setting, find, log, asked.outputs)
        outcome.append(_word(answer))
    return (_beside_the_best(asked, setting, answer, log) if isinstance(answer, Certificate) else None), setting


def _beside_the_best(asked: Question, setting: Setting, certificate: Certificate, log: Log) -> Certified:
    """Return the verdict by a certificate with a rate, and beside it the proof of the best rate that was found."""
    found = None
    log.best = lambda: certificate
    with log.attempt("the best rate") as outcome:
        answer, _ = settled(setting, partial(fastest, log=log), log, asked.outputs)
        outcome.append(_word(answer))
    if isinstance(answer, Certificate) and (answer.rate or 0.0) > (certificate.rate or 0.0):
        found = answer
    return Certified(certificate, tuple(log.attempts), found)


def _with_margin(asked: Question, setting: Setting, found: Certified, log: Log) -> Certified:
    """Return a verdict with the residual margin, where the certificate is one of states and there is time."""
    unasked = asked.outputs is not None or setting.model.is_discrete  # deviations of a step are not sought
    if unasked or setting.model.n > MARGIN_STATES or log.left() <= 0:
        return found
    with log.attempt("residual margin") as outcome:
        answer = residual_margin(setting, asked.u, log)
        margin = answer if isinstance(answer, Margin) else None
        outcome.append(_word(answer.certificate if isinstance(answer, Margin) else answer))
    return replace(found, attempts=tuple(log.attempts), margin=margin)


def _regional(asked: Question, points: tuple[OperatingPoint, ...], box: ndarray, log: Log) -> Certified | Failure:
    """Certify the largest region in the box that is found, about the first equilibrium inside it that allows one."""
    first: Failure | None = None  # of the equilibrium that was asked about, the nearest one
    for point in points:
        if not (point.reach(box) > 0).all():
            continue
        if missing := undefined(asked.model, point, box):
            return first or words.not_defined(missing, words.UNDEFINED_IN_BOX)
        if log.left() <= 0:
            return first or stopped(Status.TIME)
        setting = Setting.of(asked.model, point, box, asked.arrays)
        for kind in _kinds(asked.model):
            with log.attempt(f"region in the box, {kind} P") as outcome:
                find = partial(rate_and_gain, full_P=kind == "full", rate=asked.rate, each=asked.each, log=log)
                tried, setting = settled(setting, find, log, asked.outputs)
                outcome.append(_word(tried))
            if isinstance(tried, Certificate):
                return _with_margin(asked, setting, _beside_the_best(asked, setting, tried, log), log)
            failure = tried
        first = first or failure
    return first or Failure(Reason.OUTSIDE, words.NOT_INSIDE)


def _by_strips(asked: Question, points: tuple[OperatingPoint, ...], log: Log) -> Certified | Failure:
    """Certify the largest region that is found about the first equilibrium that allows one."""
    failure = Failure(Reason.OUTSIDE, words.NO_POINT)
    for k, point in enumerate(points):
        with log.attempt("region of strips, their widths chosen for its volume") as outcome:
            setting = Setting.of(asked.model, point)
            for frame in on_strips(setting, frame_of(setting)):
                answer = by_strips(About.of(setting), frame, asked.rate, asked.each, log, asked.outputs)
                if isinstance(answer, Certificate) or log.left() <= 0:
                    break
            outcome.append(_word(answer))
        if isinstance(answer, Certificate):
            return Certified(answer, tuple(log.attempts))
        failure = answer if k == 0 else failure
    return failure


def _word(answer: Certificate | NetworkCertificate | Failure) -> str:
    return answer.reason.name.lower() if isinstance(answer, Failure) else f"certified, {answer.claim}"
