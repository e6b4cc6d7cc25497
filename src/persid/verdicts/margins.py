"""Search for the residual margin of a certified model, and for the certificate of every plant within it."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.certificates.margin import Margin
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.interior_point import Status
from persid.lyapunov.margins import Residuals, complex_radius, largest_margin, resting_bound
from persid.lyapunov.multipliers import Lyapunov, choose
from persid.lyapunov.rates import Question, kappa, smallest_gain
from persid.lyapunov.second_pass import in_use
from persid.lyapunov.shifted_model import Setting
from persid.verdicts import failures as words
from persid.verdicts.failures import Failure, stopped
from persid.verdicts.log import Log
from persid.verdicts.searches import settled, shortened
from persid.verdicts.verdict import Reason

SHARES = (0.9, 0.6)  # of the largest delta at which a certificate is made: with room for rounding
SLOW = (0.1, 0.03, 0.01)  # of the decay rate of the linearisation: what is asked for; a region needs one of them
MARGIN_STATES = 20  # up to so many states it is sought


def residual_margin(setting: Setting, u: Float[ndarray, " m"], log: Log) -> Margin | Failure:
    """Return the residual margin of a model that is certified in a setting, at the constant input u."""
    model, J = setting.model, setting.jacobian
    if not np.isfinite(J).all():
        return Failure(Reason.OUTSIDE, words.NO_SLOPE)
    if len(setting.system.states) < model.n:  # C reads every state, and one has no entry of z
        return stopped(Status.INFEASIBLE)
    x_star = model.x_ref if setting.point is None else setting.point.x
    residuals = Residuals.of(model, setting.system.B.shape[1])
    radius = complex_radius(J, residuals)
    resting = resting_bound(model, x_star, u, residuals, setting.box)
    largest = largest_margin(question_of(setting), residuals, slow_rates(setting)[-1], log.left)
    largest = min(largest, radius, resting)
    if largest <= 0:
        return stopped(Status.TIME if log.left() <= 0 else Status.INFEASIBLE)
    failure = stopped(Status.TIME)
    for share in SHARES:
        near = (residuals.within(share * largest),)
        find = partial(slowly, rates=slow_rates(setting), deviations=near, log=log)
        answer, setting = settled(setting, find, log)
        if isinstance(answer, Certificate):
            known = tuple(name for name, free in zip(model.states, residuals.free, strict=True) if not free)
            return Margin(largest, radius, resting, residuals.width, known, answer)
        failure = answer
    return failure


def slow_rates(setting: Setting) -> list[float]:
    """Return the kappa that are asked for, in 1/s, the largest first; everywhere V' < 0 will do in the end."""
    return [share * setting.fastest for share in SLOW] + ([0.0] if setting.box is None else [])


def margin_by(certificate: Certificate) -> Margin:
    """Return the residual margin that a certificate of plants shows, which a fit has asked for, with its bounds."""
    model, x = certificate.model, certificate.operating_point
    residuals = Residuals.of(model, model.m)
    known = tuple(name for name, free in zip(model.states, residuals.free, strict=True) if not free)
    radius = complex_radius(model.dense().jacobian(x), residuals)
    resting = resting_bound(model, x, certificate.input, residuals)
    margin = Margin(radius, radius, resting, residuals.width, known, certificate)
    return replace(margin, largest=margin.delta)


def question_of(setting: Setting, deviations: tuple[Deviation, ...] = ()) -> Question:
    """Return what is asked of a setting where all plants within deviations are meant."""
    reach = setting.reach
    shape = None if reach is None else 1 / reach**2
    full_P = setting.model.n > 1
    return Question(
        system=setting.system,
        pools=setting.pools,
        upper=setting.upper,
        lower=setting.below,
        full=full_P,
        shape=shape,
        deviations=deviations,
    )


def slowly(setting: Setting, rates: Sequence[float], deviations: tuple[Deviation, ...], log: Log) -> Lyapunov | Failure:
    """Return a Lyapunov function of all plants within deviations, with the first of the rates that is found, and gain.

    A rate of 0 asks for V' < 0 alone. The search begins with what earlier proofs used, which mostly is enough. Near the
    largest margin hardly a form can go where the gain is the smallest: first those go that the rate can spare, for a
    little of it, then the gain is made small with the others.
    """
    question, families = question_of(setting, deviations), setting.families(log.used)
    known = [(group.curve, k) for group, family in zip(setting.found, families, strict=True) for k in family.used]
    for rate in rates:
        found = question.ask(rate, None, families if known else None, log.left)
        if found is not None:
            few = shortened(found, log, known=known)
            best = (smallest_gain(question, kappa(few), few, log.left, {*known, *in_use(few)}) if rate else None) or few
            return choose(best.assembly, best.solution.y, setting.lower)
    return stopped(Status.TIME if log.left() <= 0 else Status.INFEASIBLE)
