"""The search for practical stability that ends in a proof: a ball about x_ref into which every run comes."""

from dataclasses import replace

from persid.certificates.certificate import Certificate
from persid.certificates.facts import proved, proved_far
from persid.lyapunov.frame import Frame
from persid.lyapunov.interior_point import Status
from persid.lyapunov.practical import ball_of, rough_frame, smallest_balls, with_slopes_bounded
from persid.lyapunov.proposals import system_of
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import scaling
from persid.models.model import PersidskiiModel
from persid.verdicts.facts import About, certificate_of, frame_of, with_products
from persid.verdicts.failures import Failure, stopped
from persid.verdicts.log import Log

PROVED = 4  # balls that are tried to be proved, the smallest first
SEARCHING = 0.6  # share of the time for balls on samples


def practically(model: PersidskiiModel, each: bool, log: Log) -> Certificate | Failure:
    """Certify that every run comes into a ball about x_ref, as small as is found; no equilibrium is needed."""
    setting = Setting.of(model, None)
    frame = frame_of(setting)
    frame = replace(frame, points=tuple(proved(with_slopes_bounded(point)) for point in frame.points))
    failure = stopped(Status.INFEASIBLE)
    for known in (frame, *with_products(setting, frame)):
        answer = _ball(setting, known, each, log)
        if isinstance(answer, Certificate):
            return answer
        failure = answer
    return stopped(Status.TIME) if log.left() <= 0 else failure


def _ball(setting: Setting, frame: Frame, each: bool, log: Log) -> Certificate | Failure:
    """Certify the smallest ball that what a frame knows can prove."""
    reserve = (1 - SEARCHING) * log.left()
    failure = stopped(Status.INFEASIBLE)
    for seen in smallest_balls(frame, scaling(system_of(frame)).rate, lambda: log.left() - reserve)[:PROVED]:
        far = proved_far(rough_frame(frame, seen.r))
        ball = ball_of(far, seen.r, seen.kappa, log.left)
        answer = failure if ball is None else certificate_of(About.of(setting), ball.candidate, each, log)
        if isinstance(answer, Certificate):
            return answer
        failure = answer
    return failure
