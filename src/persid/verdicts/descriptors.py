"""The verdict on a model with algebraic variables: its equations have one solution, and V falls along all runs."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.certificates.facts import proved
from persid.certificates.witness import find_witness
from persid.errors import ModelError
from persid.lyapunov.frame import Frame
from persid.lyapunov.operating_points import OperatingPoint, find_operating_point, vector
from persid.lyapunov.points import points_of
from persid.lyapunov.shifted_model import is_reference, place, undefined
from persid.lyapunov.solvability import solving
from persid.models.descriptor import DescriptorModel
from persid.verdicts import failures as words
from persid.verdicts.facts import About, by_facts, by_strips
from persid.verdicts.failures import Failure
from persid.verdicts.log import ALL_STATES, Log
from persid.verdicts.verdict import Certified, Reason, Refuted, Undecided, Verdict
from persid_check.model import model_of


@dataclass(frozen=True, eq=False)
class Question:
    """A question: the model at input u near some variables ("auto": its reference), a rate, a gain for each input.

    The claim is "strongest" or "incremental" of all states, or "region" for the largest region that is found: all
    states where that is proved.
    """

    model: DescriptorModel
    near: object
    u: Float[ndarray, " m"]
    rate: float | int | None
    each: bool
    claim: str


def decide(asked: Question, log: Log) -> Verdict:
    """Return the verdict on a model about the equilibrium nearest to where it is asked for."""
    model, u = asked.model, asked.u
    near = None if isinstance(asked.near, str) and asked.near == "auto" else _variables(model, asked.near, u)
    with log.attempt("equilibria at the nominal input") as outcome:
        points = find_operating_point(model.rows, u, near=near)
        outcome.append(f"{len(points)} found and proved")
    if not points:
        return _undecided(Failure(Reason.OUTSIDE, words.NO_POINT), log)
    if asked.claim != "region":
        return _global(asked, points, log)
    with log.share(ALL_STATES):
        everywhere = _global(asked, points, log)
    return everywhere if isinstance(everywhere, Certified) else _region(asked, points, log)


def _global(asked: Question, points: Sequence[OperatingPoint], log: Log) -> Verdict:
    """Return the verdict for all states."""
    model, nearest = asked.model, points[0]
    with log.attempt("witnesses against stability") as outcome:
        witness = find_witness(model, asked.u, points)
        outcome.append("none" if witness is None else witness.kind)
    if witness is not None:
        return Refuted(witness, tuple(log.attempts))
    if missing := undefined(model.rows):
        return _undecided(Failure(Reason.OUTSIDE, words.UNDEFINED.format("; ".join(missing[:4]))), log)
    point = None if is_reference(model.rows, nearest) else nearest
    frame = _frame(model, point)
    frame = frame.monotone if asked.claim == "incremental" else frame
    with log.attempt("equations that have one solution") as outcome:
        values = solving(frame, log.left)
        outcome.append("not proved" if values is None else "proved")
    if values is None:
        return _undecided(Failure(Reason.NOT_FOUND, words.NOT_SOLVABLE), log)
    with log.attempt("facts and equations") as outcome:
        about = About(model, point, model.jacobian(nearest.x))
        found, fastest = by_facts(about, replace(frame, solving=values), asked.rate, asked.each, log)
        outcome.append(f"certified, {found.claim}" if isinstance(found, Certificate) else found.reason.name.lower())
    if isinstance(found, Failure):
        return _undecided(found, log)
    return Certified(found, tuple(log.attempts), fastest)


def _region(asked: Question, points: Sequence[OperatingPoint], log: Log) -> Certified | Undecided:
    """Certify the largest region that is found about the first equilibrium that allows one."""
    model, failures = asked.model, []
    for nearest in points:
        point = None if is_reference(model.rows, nearest) else nearest
        about = About(model, point, model.jacobian(nearest.x))
        with log.attempt("region of strips, with equations that have one solution in them") as outcome:
            found = by_strips(about, _candidates(model, point), asked.rate, asked.each, log)
            outcome.append(f"certified, {found.claim}" if isinstance(found, Certificate) else found.reason.name.lower())
        if isinstance(found, Certificate):
            return Certified(found, tuple(log.attempts))
        failures.append(found)
    return _undecided(failures[0], log)


def _candidates(model: DescriptorModel, point: OperatingPoint | None) -> Frame:
    """Return the frame of a model, with candidate forms on all of R."""
    points = points_of(model.rows, place(model.rows, point, None))
    return Frame(model_of(model.canonical, algebraic=True), points, point is None and bool(model.b.any()))


def _frame(model: DescriptorModel, point: OperatingPoint | None) -> Frame:
    """Return the frame of a model on all of R^n, with the forms that are proved."""
    frame = _candidates(model, point)
    return replace(frame, points=tuple(map(proved, frame.points)))


def _undecided(failure: Failure, log: Log) -> Undecided:
    return Undecided(failure.reason, failure.detail, tuple(log.attempts))


def _variables(model: DescriptorModel, near: object, u: Float[ndarray, " m"]) -> Float[ndarray, " N"]:
    """Return all variables for a state, or for all of them."""
    if isinstance(near, Sequence | ndarray) and len(near) == model.n:
        x = vector("operating_point", near, model.n)
        try:
            return np.concatenate([x, model.solve(x, u)])
        except ModelError:
            return np.concatenate([x, model.rows.x_ref[model.n :]])
    return vector('operating_point, if not "auto",', near, model.rows.n)
