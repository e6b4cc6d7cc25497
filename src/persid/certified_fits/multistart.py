"""Starts: from a Gram matrix to the best model that is certified, by descents from several starts in several frames."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.certificates.stability import prove as certified
from persid.certified_fits.bilinear import Point
from persid.certified_fits.descent import Descent, Stop, descend
from persid.certified_fits.joint_problem import Coefficients, Demand, Frame
from persid.certified_fits.polish import polish
from persid.errors import RejectedError, RoundingError
from persid.identification.gram import Gram
from persid.identification.refinement import Pieces
from persid.identification.structure import Structure
from persid.lyapunov.operating_points import OperatingPoint, find_operating_point, prove
from persid.lyapunov.sectors import groups
from persid.lyapunov.shifted_model import place
from persid.models.model import PersidskiiModel

FULL_P_STATES = 12  # a full P takes part up to this many states
PATH = (1e-4, 1e-3, 1e-2, 1e-1, 1.0)  # stronger ridges whose fits are starts as well
ENOUGH = 0.05  # a fit whose residuals grow by less than this share needs no other start
DAMPING = 1e-2  # of the linear start: its functions get -DAMPING P^-1
BEATEN = "It satisfies the matrix inequality, but follows the data no better than the best so far; it was not proved."
PROVED = 3  # polished points that are tried to be proved, the best first
SKETCHED = 6  # rounds that polish a sketch
RATES = 8  # halvings of the rate that a regional proof tries

Make = Callable[[Coefficients], PersidskiiModel]


@dataclass(frozen=True, eq=False)
class Task:
    """What is fitted, what has to be shown about it, and until when (`time.perf_counter`).

    `score` is the free-run error by which certified results are compared; None compares their residuals. Fits are
    polished on `pieces` of the data, where these are given.
    """

    gram: Gram
    ridge: float
    fixed: Coefficients
    demand: Demand
    make: Make
    box: Float[ndarray, "n 2"] | None = None
    deadline: float = np.inf
    progress: Callable[[str], None] = lambda line: None
    score: Callable[[PersidskiiModel], float] | None = None
    pieces: Pieces | None = None

    def left(self) -> float:
        """Seconds until the deadline."""
        return self.deadline - time.perf_counter()

    def frame(self, full_P: bool, anchor: ndarray | None) -> Frame:
        """Return a frame of this task."""
        return Frame(
            gram=self.gram,
            ridge=self.ridge,
            fixed=self.fixed,
            full_P=full_P,
            demand=self.demand,
            anchor=anchor,
            box=self.box,
        )


@dataclass(frozen=True, eq=False)
class Line:
    """One descent: start, how it ended, growth of the residuals, whether a proof was accepted, seconds, steps."""

    start: str
    stop: str
    excess: float
    certified: bool
    seconds: float
    steps: int


@dataclass(frozen=True, eq=False)
class Result:
    """A certified model, its certificate, the growth of its residuals over the free fit, its error by the score.

    `point` of `frame` is where it was found.
    """

    model: PersidskiiModel
    certificate: Certificate
    excess: float
    error: float
    frame: Frame
    point: Point

    @property
    def theta(self) -> Coefficients:
        """The coefficients of the model."""
        return self.frame.theta(self.point.w)


@dataclass(frozen=True, eq=False)
class _End:
    """How one start ended: its descent, its certified result, and whether it was left unproved as no better."""

    descent: Descent
    result: Result | None = None
    beaten: bool = False


def best_certified(task: Task) -> tuple[Result | None, tuple[Line, ...]]:
    """Return the certified model of smallest error among those found, None where none was, and the history.

    Every start runs in turn until a fit loses next to nothing or the time is over; a later start counts, and is proved,
    only where it is better, so the result is never worse than the best certified start. The best one is then polished.
    """
    best: Result | None = None
    lowest = np.inf
    lines: list[Line] = []

    def so_far() -> Result | None:
        return best

    for name, frame, theta in _attempts(task, so_far):
        began = time.perf_counter()
        task.progress(f"fitting under the certificate, {name}")
        end = _descent(task, frame, theta, np.inf if best is None else best.error)
        descent, best = end.descent, end.result or best
        excess = np.inf if descent.point is None else frame.excess(frame.theta(descent.point.w))
        if end.result is not None or end.beaten:
            lowest = min(lowest, excess)
        stop = BEATEN if end.beaten else descent.stop.value
        lines.append(Line(name, stop, excess, end.result is not None, time.perf_counter() - began, descent.steps))
        if task.left() <= 0 or lowest < ENOUGH:
            break
    if best is not None and task.pieces is not None and task.left() > 0:
        best, line = _polished(task, best, task.pieces)
        lines.append(line)
    return best, tuple(lines)


def _polished(task: Task, best: Result, pieces: Pieces) -> tuple[Result, Line]:
    """Return the best of the polished points that is certified and better, else the result as it was."""
    began = time.perf_counter()
    task.progress("lowering the free-run error under the certificate")
    points, found = polish(best.frame, best.point, pieces, task.left), best
    for point in points[:PROVED]:
        model, error = _judged(task, best.frame, point)
        result = _proved(task, best.frame, point, model, error) if error < best.error else None
        if result is not None:
            found = result
            break
    words = (
        "No certified step lowers its free-run error.",
        "Its free runs follow the data better than those of any start.",
    )
    stop = words[found is not best]
    line = Line("best so far, polished by free runs", stop, found.excess, found is not best, 0.0, len(points))
    return found, replace(line, seconds=time.perf_counter() - began)


@dataclass(frozen=True, eq=False)
class Sketch:
    """A strictly feasible fit that is not proved: a point of a frame."""

    frame: Frame
    point: Point

    @property
    def theta(self) -> Coefficients:
        """The coefficients."""
        return self.frame.theta(self.point.w)

    @property
    def excess(self) -> float:
        """The growth of the residuals over the free fit."""
        return self.frame.excess(self.theta)


def sketch(task: Task) -> Sketch | None:
    """Return the first strictly feasible fit, polished where the task has pieces; None where none is found."""
    for name, frame, theta in _attempts(task, lambda: None):
        task.progress(f"trying under the certificate, {name}")
        try:
            descent = descend(frame.inequality, frame.fit, frame.start(theta, task.left()), time_limit=task.left())
        except np.linalg.LinAlgError:
            continue
        if descent.point is not None:
            better = () if task.pieces is None else polish(frame, descent.point, task.pieces, task.left, SKETCHED)
            return Sketch(frame, (*better, descent.point)[0])
        if task.left() <= 0:
            break
    return None


def _attempts(task: Task, best: Callable[[], Result | None]) -> Iterator[tuple[str, Frame, Coefficients]]:
    """Yield starts: about every equilibrium, the best one's, the free fit's; from afar while nothing is found."""
    gram, n = task.gram, task.gram.H.shape[1]
    everywhere = task.box is None and _has_constant(gram)
    free = gram.solve(task.ridge)
    for full in (True, False) if 1 < n <= FULL_P_STATES else (False,):
        word = "full P" if full else "diagonal P"
        if everywhere:
            yield f"free fit, every equilibrium, {word}", task.frame(full, None), free
        if full == (1 < n <= FULL_P_STATES):
            yield from _fewer_functions(task, full, (-1,))
        if everywhere:
            yield from _about_best(task, best, full)
        if (anchor := _anchor(task, free)) is not None:
            yield f"free fit, its equilibrium, {word}", task.frame(full, anchor), free
        if best() is not None:
            break
    if best() is not None and task.pieces is not None:  # where it began matters little once it is polished
        return
    full = 1 < n <= FULL_P_STATES
    yield from _fewer_functions(task, full, range(len(gram.basis.terms)) if len(gram.basis.terms) > 1 else ())
    if best() is not None:
        return
    for ridge in (r for r in PATH if r > 3 * task.ridge):
        theta = gram.solve(ridge)
        if (anchor := _anchor(task, theta)) is not None:
            yield f"fit of ridge {ridge:.0e}, its equilibrium", task.frame(full, anchor), theta
        if best() is not None:
            return
    frame = task.frame(full, None if everywhere else _inside(task, gram.basis.x_ref))
    yield "linear fit, damped", frame, damped_linear(frame)
    yield from _about_best(task, best, full)


def _fewer_functions(task: Task, full_P: bool, kept_ones: Iterable[int]) -> Iterator[tuple[str, Frame, Coefficients]]:
    """Yield fits with one function only, or none (-1): what is left out asks nothing of the certificate."""
    basis = task.gram.basis
    kinds = np.array([column.kind == "function" for column in basis.columns])
    terms = np.array([column.term for column in basis.columns])
    for kept in kept_ones:
        left_out = kinds & (terms != kept)
        fixed = np.where(left_out[:, None] & np.isnan(task.fixed), 0.0, task.fixed)
        lean = replace(task, fixed=fixed)
        name = "linear part" if kept < 0 else f"linear part and {_term_name(task, kept)}"
        everywhere = task.box is None and _has_constant(task.gram)
        frame = lean.frame(full_P, None if everywhere else _inside(task, basis.x_ref))
        yield f"{name}, {'full' if full_P else 'diagonal'} P", frame, frame.theta(frame.fit.w0)


def _term_name(task: Task, term: int) -> str:
    return next(f.text for f in task.gram.basis.terms[term] if f is not None)


def _about_best(
    task: Task, best: Callable[[], Result | None], full_P: bool
) -> Iterator[tuple[str, Frame, Coefficients]]:
    found = best()
    anchor = None if found is None else _anchor(task, found.theta)
    if found is not None and anchor is not None:
        word = "full" if full_P else "diagonal"
        yield f"best so far, its equilibrium, {word} P", task.frame(full_P, anchor), found.theta


def _inside(task: Task, point: ndarray) -> ndarray:
    """Return a point, moved to the centre of the box where it lies outside."""
    if task.box is None or ((point > task.box[:, 0]) & (point < task.box[:, 1])).all():
        return point
    return np.asarray(task.box.mean(axis=1))


def _has_constant(gram: Gram) -> bool:
    return bool((gram.structure.parameter[-1] >= 0).any())


def _anchor(task: Task, theta: Coefficients) -> Float[ndarray, " n"] | None:
    """Return the equilibrium of coefficients nearest to x_ref (and inside the box), None where there is none."""
    basis = task.gram.basis
    if not _has_constant(task.gram):
        return basis.x_ref
    for point in find_operating_point(basis.model(theta, domain=task.box)):
        if task.box is None or ((point.x > task.box[:, 0]) & (point.x < task.box[:, 1])).all():
            return point.x
    return None


def damped_linear(frame: Frame) -> Coefficients:
    """Return the linear fit, made Hurwitz by a shift, with a little of -P^-1 f for every function f.

    With V = x'Px + 2 mu sum of integrals, small mu and a small factor e, x'P(-e P^-1 f) = -e x'f outweighs the rest.
    """
    import scipy.linalg as sla

    gram, basis = frame.gram, frame.gram.basis
    kinds = np.array([column.kind for column in basis.columns])
    parameter = np.where((kinds == "function")[:, None], -1, gram.structure.parameter)
    theta = replace(gram, structure=Structure.of(parameter, gram.structure.given), root=None).solve(frame.ridge)
    states = [column.state for column in basis.columns[: basis.state_columns]]
    linear = np.flatnonzero(kinds == "linear")
    A0 = basis.model(theta).A0
    scale = float(np.abs(A0).max()) or 1.0
    worst = float(np.linalg.eigvals(A0).real.max())
    if worst > -1e-2 * scale:
        A0 = A0 - (worst + 0.05 * scale) * np.eye(len(A0))
    theta[linear] = A0.T[[states[j] for j in linear]]
    P = sla.solve_continuous_lyapunov(A0.T, -np.eye(len(A0))) if frame.full_P else np.eye(len(A0))
    inverse = np.linalg.inv(P)
    inverse *= DAMPING * scale / np.abs(inverse).max()
    for j in np.flatnonzero(kinds == "function"):
        theta[j] = -inverse[:, states[j]]
    return np.where(
        np.isfinite(frame.fixed), frame.fixed, np.where(gram.structure.parameter >= 0, theta, gram.structure.given)
    )


def _descent(task: Task, frame: Frame, theta: Coefficients, bar: float) -> _End:
    """Descend from coefficients and, where the error is below a bar, prove the end.

    Where the proof fails, once more with ten times the margin.
    """
    try:
        start = frame.start(theta, task.left())
        descent = descend(frame.inequality, frame.fit, start, time_limit=task.left())
        for _ in range(2):
            if descent.point is None:
                break
            model, error = _judged(task, frame, descent.point)
            if np.isfinite(bar) and not error < bar:
                return _End(descent, beaten=True)
            result = _proved(task, frame, descent.point, model, error)
            if result is not None:
                return _End(descent, result)
            frame = replace(frame, demand=replace(frame.demand, delta=10 * frame.demand.delta))
            again = frame.start(frame.theta(descent.point.w), task.left())
            descent = descend(frame.inequality, frame.fit, again, time_limit=task.left())
        return _End(descent)
    except np.linalg.LinAlgError:
        return _End(Descent(Stop.STALLED, None, np.inf, 0, ()))


def _judged(task: Task, frame: Frame, point: Point) -> tuple[PersidskiiModel, float]:
    """Return the model of a point and its error by the task's score."""
    theta = frame.theta(point.w)
    model = task.make(theta)
    return model, frame.excess(theta) if task.score is None else task.score(model)


def _proved(task: Task, frame: Frame, point: Point, model: PersidskiiModel, error: float) -> Result | None:
    """Return the certified result of a point, None where the proof fails."""
    certificate = certificate_of(task, frame, model, point)
    if certificate is None:
        return None
    return Result(model, certificate, frame.excess(frame.theta(point.w)), error, frame, point)


def certificate_of(task: Task, frame: Frame, model: PersidskiiModel, point: Point) -> Certificate | None:
    """Return the certificate of a model, made of its own multipliers, once the checker accepts it; else None."""
    anchor = None if frame.anchor is None else prove(model, frame.anchor, model.u_ref)
    points = (anchor,) if anchor is not None else find_operating_point(model)[:1]
    for equilibrium in points:
        try:
            found = _certified(task, frame, model, point, equilibrium)
            if found is not None:
                return found
        except (RejectedError, RoundingError):
            continue
    return None


def _certified(
    task: Task, frame: Frame, model: PersidskiiModel, point: Point, equilibrium: OperatingPoint
) -> Certificate | None:
    lyapunov = frame.lyapunov(model, point.y, groups(model.channels, place(model, equilibrium, task.box)))
    if lyapunov is None:
        return None
    if task.box is None:
        return certified(model, lyapunov, equilibrium)
    rate = lyapunov.kappa or frame.units.rate
    for _ in range(RATES):
        rated = replace(lyapunov, kappa=rate)
        if rated.is_sound:
            return certified(model, rated, equilibrium, task.box)
        rate /= 4
    return None
