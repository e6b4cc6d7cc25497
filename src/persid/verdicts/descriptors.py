"""The verdict on a model with algebraic variables: its equations have one solution, and V falls along all runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.certificates.facts import with_proved
from persid.certificates.witness import find_unposed, find_witness
from persid.errors import ModelError
from persid.lyapunov.frame import Frame
from persid.lyapunov.interior_point import Status
from persid.lyapunov.operating_points import OperatingPoint, find_operating_point, vector
from persid.lyapunov.points import points_of
from persid.lyapunov.sectors import Place
from persid.lyapunov.shifted_model import is_reference, place, undefined
from persid.lyapunov.solvability import solving
from persid.lyapunov.strips import on_box
from persid.models.descriptor import DescriptorModel
from persid.verdicts import failures as words
from persid.verdicts.facts import About, by_box, by_facts, by_strips
from persid.verdicts.failures import Failure, stopped
from persid.verdicts.log import ALL_STATES, Log
from persid.verdicts.verdict import Certified, Reason, Refuted, Undecided, Verdict
from persid_check.model import model_of
from persid_check.search.prover import prove_continuous


@dataclass(frozen=True, eq=False)
class Question:
    """A question: the model at input u near some variables ("auto": its reference), a rate, a gain for each input.

    The claim is "strongest" or "incremental". With a box of the states or of all variables a region in it is asked for,
    with `auto` the largest region that is found: all states where that is proved.
    """

    model: DescriptorModel
    near: object
    u: Float[ndarray, " m"]
    rate: float | int | None
    each: bool
    claim: str
    box: Float[ndarray, "k 2"] | None
    auto: bool


def decide(asked: Question, log: Log) -> Verdict:
    """Return the verdict on a model about the equilibrium nearest to where it is asked for."""
    model, u = asked.model, asked.u
    near = None if isinstance(asked.near, str) and asked.near == "auto" else _variables(model, asked.near, u)
    with log.attempt("equilibria at the nominal input") as outcome:
        points = find_operating_point(model.rows, u, near=near)
        outcome.append(f"{len(points)} found and proved")
    answer = _answer(asked, points, log) if points else Failure(Reason.OUTSIDE, words.NO_POINT)
    if isinstance(answer, Failure):
        return Undecided(answer.reason, answer.detail, tuple(log.attempts))
    return answer


def _answer(asked: Question, points: Sequence[OperatingPoint], log: Log) -> Certified | Refuted | Failure:
    """Answer for all states, unless a region is asked for; then in the model's own box, if there is one."""
    if asked.auto:
        with log.share(ALL_STATES):
            everywhere = _global(asked, points, log)
        return everywhere if isinstance(everywhere, Certified) else _region(asked, points, log)
    if asked.box is not None:
        return _in_box(asked, points, asked.box, log)
    verdict, box = _global(asked, points, log), asked.model.rows.domain
    if not isinstance(verdict, Failure) or box is None or asked.claim != "strongest":
        return verdict
    regional = _in_box(asked, points, box, log)
    return regional if isinstance(regional, Certified) else verdict


def _global(asked: Question, points: Sequence[OperatingPoint], log: Log) -> Certified | Refuted | Failure:
    """Answer for all states."""
    model, nearest = asked.model, points[0]
    with log.attempt("witnesses against stability") as outcome:
        witness = find_witness(model, asked.u, points)
        outcome.append("none" if witness is None else witness.kind)
    if witness is not None:
        return Refuted(witness, tuple(log.attempts))
    if missing := undefined(model.rows):
        return words.not_defined(missing)
    point = None if is_reference(model.rows, nearest) else nearest
    frame = _frame(model, point)
    frame = frame.monotone if asked.claim == "incremental" else frame
    with log.attempt("equations that have one solution") as outcome:
        values = solving(frame, log.left)
        outcome.append("not proved" if values is None else "proved")
    if values is None:
        return _unposed(asked, points, log)
    with log.attempt("facts and equations") as outcome:
        about = About(model, point, model.jacobian(nearest.x))
        found, fastest = by_facts(about, replace(frame, solving=values), asked.rate, asked.each, log)
        outcome.append(_word(found))
    return found if isinstance(found, Failure) else Certified(found, tuple(log.attempts), fastest)


def _unposed(asked: Question, points: Sequence[OperatingPoint], log: Log) -> Refuted | Failure:
    """Refute that the equations tell what their variables are, where two solutions are found."""
    witness = None
    with log.attempt("several solutions of the equations") as outcome:
        witness = find_unposed(asked.model, asked.u, points) if log.left() > 0 else None
        outcome.append("none" if witness is None else witness.kind)
    return Failure(Reason.NOT_FOUND, words.NOT_SOLVABLE) if witness is None else Refuted(witness, tuple(log.attempts))


def _region(asked: Question, points: Sequence[OperatingPoint], log: Log) -> Certified | Failure:
    """Certify the largest region that is found about the first equilibrium that allows one."""
    model, failures = asked.model, []
    for nearest in points:
        point = None if is_reference(model.rows, nearest) else nearest
        about = About(model, point, model.jacobian(nearest.x))
        with log.attempt("region of strips, with equations that have one solution in them") as outcome:
            found = by_strips(about, _candidates(model, point), asked.rate, asked.each, log)
            outcome.append(_word(found))
        if isinstance(found, Certificate):
            return Certified(found, tuple(log.attempts))
        failures.append(found)
    return failures[0]


def _in_box(
    asked: Question, points: Sequence[OperatingPoint], box: Float[ndarray, "k 2"], log: Log
) -> Certified | Failure:
    """Certify the largest region in a box that is found, about the first equilibrium inside it that allows one."""
    model, failures = asked.model, list[Failure]()
    for nearest in points:
        if not (nearest.reach(box) > 0).all() or log.left() <= 0:
            continue
        k, rows = len(box), model.rows
        sides = Place.about(nearest.x[:k], rows.x_ref[:k], nearest.radius, box).box or ()
        frame = on_box(_candidates(model, nearest), sides)
        if missing := _ended(frame):
            return words.not_defined(missing, words.UNDEFINED_IN_BOX)
        with log.attempt("region in the box, with equations that have one solution in it") as outcome:
            about = About(model, nearest, model.jacobian(nearest.x))
            found = by_box(about, frame, asked.rate, asked.each, log)
            outcome.append(_word(found))
        if isinstance(found, Certificate):
            return Certified(found, tuple(log.attempts))
        failures.append(found)
    none = stopped(Status.TIME) if log.left() <= 0 else Failure(Reason.OUTSIDE, words.NOT_INSIDE)
    return failures[0] if failures else none


def _ended(frame: Frame) -> list[str]:
    """Return functions that are not proved continuous where a frame looks at them."""
    curves = dict.fromkeys(point.curve for point in frame.points)
    doubtful = (c for c in curves if not prove_continuous(c.exact, c.domain, c.shift))
    return list(dict.fromkeys(f for curve in doubtful for f in curve.functions))


def _word(found: Certificate | Failure) -> str:
    return f"certified, {found.claim}" if isinstance(found, Certificate) else found.reason.name.lower()


def _candidates(model: DescriptorModel, point: OperatingPoint | None) -> Frame:
    """Return the frame of a model, with candidate forms on all of R."""
    points = points_of(model.rows, place(model.rows, point, None))
    return Frame(model_of(model.canonical, algebraic=True), points, point is None and bool(model.b.any()))


def _frame(model: DescriptorModel, point: OperatingPoint | None) -> Frame:
    """Return the frame of a model on all of R^n, with the forms that are proved."""
    return with_proved(_candidates(model, point))


def _variables(model: DescriptorModel, near: object, u: Float[ndarray, " m"]) -> Float[ndarray, " N"]:
    """Return all variables for a state, or for all of them."""
    if isinstance(near, Sequence | ndarray) and len(near) == model.n:
        x = vector("operating_point", near, model.n)
        try:
            return np.concatenate([x, model.solve(x, u)])
        except ModelError:
            return np.concatenate([x, model.rows.x_ref[model.n :]])
    return vector('operating_point, if not "auto",', near, model.rows.n)
