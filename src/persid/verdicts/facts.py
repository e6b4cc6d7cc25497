"""Searches with facts across channels, and with rows that are exactly zero, that end in a proof."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import rounded
from persid.certificates.certificate import Certificate
from persid.certificates.facts import prove_facts, with_proved, with_squares
from persid.errors import RejectedError, RoundingError
from persid.lyapunov import decay
from persid.lyapunov.coordinates import Coordinates
from persid.lyapunov.frame import Frame
from persid.lyapunov.identities import Pairs, with_identities
from persid.lyapunov.interior_point import Status
from persid.lyapunov.operating_points import OperatingPoint
from persid.lyapunov.points import Point, points_of
from persid.lyapunov.proposals import Candidate, best_rate, feasible, smallest_gain, system_of
from persid.lyapunov.reaching import with_reaches
from persid.lyapunov.shifted_model import Setting, place
from persid.lyapunov.solvability import solved
from persid.lyapunov.strips import Search, Sublevel, enlarged, in_strips, of_linearisation
from persid.lyapunov.system import scaling
from persid.lyapunov.zero_rows import reduced
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.verdicts import failures as words
from persid.verdicts.failures import Failure, stopped
from persid.verdicts.log import Log
from persid.verdicts.searches import ABOVE
from persid.verdicts.verdict import Reason
from persid_check.model import model_of

SLOWEST = 1 / 2048  # share of the linearisation's rate at which a region is sought
FASTER = (1 / 8, 1 / 32, 1 / 128, 1 / 512)  # shares that are tried afterwards
KEPT = 0.99  # share of the volume that a faster rate has to leave
COARSE = 20  # bits of coordinates
PAIRS: tuple[Pairs, ...] = ("states", "degree", "all")
DENSITIES = 3  # of a point that stand in V where proofs of their integrals are made for strips
NARROWER = 1 - 1 / 64  # times the widths of strips in which a proof has no margin left
SEARCHING = 0.7  # share of the time for the widths of strips


def frame_of(setting: Setting) -> Frame:
    """Return the frame of a setting on all of R^n, with candidate forms."""
    model, point = setting.model, setting.point
    points = points_of(model, place(model, point, None))
    return Frame(model_of(model.canonical, discrete=True), points, point is None and bool(model.b.any()))


def with_slopes(setting: Setting, frame: Frame) -> Frame:
    """Return a frame with values of functions in V and their slopes, in coordinates that are well scaled."""
    better = Coordinates.of(setting.system, setting.jacobian)
    rows = () if better is None else rounded(better.S, COARSE)
    basis = tuple({int(i): Fraction(float(row[i])) for i in np.flatnonzero(row)} for row in rows)
    return replace(frame, sloped=True, basis=basis)


def with_products(setting: Setting, frame: Frame) -> list[Frame]:
    """Return the frame with identities of polynomials, few of them first: of a state and a function, then of two.

    Those of the largest degree serve functions that have forms, such as cubes of many rows, of which few are apart.
    """
    formed = any(any(form.form[1:]) for point in frame.points for form in point.forms)
    found = [with_identities(frame, setting.point, pairs) for pairs in (PAIRS if formed else PAIRS[:-1])]
    known = [0, *(len(each.identities) for each in found)]
    return [each for each, fewer in zip(found, known, strict=False) if len(each.identities) > fewer]


def on_strips(setting: Setting, frame: Frame) -> list[Frame]:
    """Return the frames in which a region is sought, in their order: with all identities, then without any."""
    known = with_identities(frame, setting.point, "all")
    return [known, frame] if known.identities else [frame]


def has_zero_rows(frame: Frame) -> bool:
    """Whether functions stand in V' so that no certificate has a margin in them, as forces of springs do."""
    found = reduced(frame.unknowns(Fraction(0), across=False), range(frame.n, frame.entries))
    return found is not None and bool(found.zero)


@dataclass(frozen=True, eq=False)
class About:
    """What is certified: a model about a point (None: its reference), and its linearisation there."""

    model: PersidskiiModel | DescriptorModel
    point: OperatingPoint | None
    jacobian: Float[ndarray, "n n"]

    @property
    def following(self) -> Float[ndarray, "k n"] | None:
        """How algebraic variables follow the states in the linearisation, None without such variables."""
        if not isinstance(self.model, DescriptorModel):
            return None
        return self.model.following(self.model.rows.x_ref if self.point is None else self.point.x)

    @classmethod
    def of(cls, setting: Setting) -> "About":
        """Return what a setting is about."""
        return cls(setting.model, setting.point, setting.jacobian)


def by_facts(
    about: About, frame: Frame, rate: float | int | None, each: bool, log: Log
) -> tuple[Certificate | Failure, Certificate | None]:
    """Certify with facts across channels and rows that are exactly zero: with rate and gain, or stability alone.

    Returns:
        The certificate, whose gain is small at the rate asked for or at half of the best one, or why there is none; and
        the certificate of the best rate, where that is another. With `each` every input has a gain of its own.
    """
    frame = with_proved(frame)
    if frame.sloped:
        frame = replace(frame, points=tuple(map(with_squares, frame.points)))
    stable = feasible(frame, Fraction(0), log.left, across=True)
    limit = decay.fastest(about.jacobian, about.model.dt)
    best = None if stable is None else best_rate(frame, limit if limit > 0 else stable.speed, log.left)
    if best is None:
        if stable is None:
            return stopped(Status.TIME if log.left() <= 0 else Status.INFEASIBLE), None
        return certificate_of(about, stable, each, log), None
    half, asked = decay.gentle(float(best.kappa), about.model.dt), decay.loss(ABOVE * (rate or 0.0), about.model.dt)
    aim = min(Fraction(max(half, asked)), best.kappa)
    gentle = smallest_gain(
        (feasible(frame, aim, log.left, across=True) if aim < best.kappa else None) or best, log.left
    )
    found = certificate_of(about, gentle, each, log)
    fastest = certificate_of(about, best, each, log) if gentle.kappa < best.kappa else None
    return found, fastest if isinstance(fastest, Certificate) else None


def certificate_of(
    about: About, found: Candidate, each: bool, log: Log, outputs: OutputModel | None = None
) -> Certificate | Failure:
    """Return the certificate of a candidate, or why it was lost in exact arithmetic."""
    try:
        proposal = with_reaches(found.proposal(), log.left)
        if proposal is None:
            return Failure(Reason.NOT_FOUND, words.NO_REACH)
        log.progress("checking in exact arithmetic")
        return prove_facts(about.model, proposal, about.point, each=each, outputs=outputs)
    except (RejectedError, RoundingError) as error:
        return Failure(Reason.ROUNDING, str(error))


def by_strips(
    about: About, frame: Frame, rate: float | int | None, each: bool, log: Log, outputs: OutputModel | None = None
) -> Certificate | Failure:
    """Certify the largest region that strips of the functions' own arguments allow, about a stable equilibrium.

    In the states: what is large for the outputs is not asked. These are bounded in the region, if there are any.

    Widths are sought at the rate (1/s) that is asked for, if there is a region then, else at one that costs no volume;
    then the largest rate is taken that leaves most of the volume.
    """
    J = about.jacobian
    limit, dt = decay.fastest(J, about.model.dt), about.model.dt
    if limit <= 0:
        return Failure(Reason.OUTSIDE, words.NO_DECAY)
    units = scaling(system_of(frame)).states[: frame.order]
    slowest = _power_of_two(limit * SLOWEST) if rate is None else Fraction(decay.loss(ABOVE * rate, dt))
    reserve = (1 - SEARCHING) * log.left()
    shape = of_linearisation(J, units, discrete=dt is not None)
    search = Search(frame, slowest, shape, lambda: log.left() - reserve, about.following)
    best = search.run() if slowest < limit else None
    if best is None and rate is not None:
        return by_strips(about, frame, None, each, log, outputs)
    if best is None:
        return stopped(Status.TIME if log.left() <= 0 else Status.INFEASIBLE)
    found = _proved_in_strips(about, best, slowest, each, log, outputs)
    if not isinstance(found, Certificate) and log.left() > 0:  # so wide that rounding leaves no margin
        narrower = search.region(tuple(NARROWER * h for h in search.widths))
        if narrower is not None:
            found = _proved_in_strips(about, narrower, slowest, each, log, outputs)
    return found


def _proved_in_strips(
    about: About, best: Sublevel, slowest: Fraction, each: bool, log: Log, outputs: OutputModel | None
) -> Certificate | Failure:
    """Certify a region that was found, with what is proved of the functions in its strips."""
    known = replace(best.candidate.frame, points=tuple(_with_densities_of(best.candidate)))
    known_frame = solved(with_proved(known), log.left)
    if known_frame is None:
        return stopped(Status.TIME if log.left() <= 0 else Status.INFEASIBLE)
    return _fastest(about, known_frame, best.volume, slowest, each=each, log=log, outputs=outputs)


def by_box(about: About, frame: Frame, rate: float | int | None, each: bool, log: Log) -> Certificate | Failure:
    """Certify the largest region that is found in the strips of a frame, at a rate (1/s) or at what costs little."""
    limit = decay.fastest(about.jacobian, about.model.dt)
    if limit <= 0:
        return Failure(Reason.OUTSIDE, words.NO_DECAY)
    known = solved(with_proved(frame), log.left)
    if known is None:
        return Failure(Reason.NOT_FOUND, words.NOT_SOLVABLE_IN_BOX)
    slowest = _power_of_two(limit * SLOWEST) if rate is None else Fraction(decay.loss(ABOVE * rate, about.model.dt))
    best = enlarged(known, slowest, in_strips(known, about.following), log.left) if slowest < limit else None
    if best is None and rate is not None:
        return by_box(about, frame, None, each, log)
    if best is None:
        return stopped(Status.TIME) if log.left() <= 0 else Failure(Reason.NOT_FOUND, words.SMALLER)
    return _fastest(about, known, best.volume, slowest, each=each, log=log)


def _fastest(
    about: About, frame: Frame, volume: float, slowest: Fraction, *, each: bool, log: Log,
    outputs: OutputModel | None = None,
) -> Certificate | Failure:  # fmt: skip
    """Certify a region in the strips of a frame with the largest rate that leaves most of a volume."""
    limit, within = decay.fastest(about.jacobian, about.model.dt), in_strips(frame, about.following)
    failure = stopped(Status.INFEASIBLE)
    for kappa in sorted({slowest, *(_power_of_two(limit * share) for share in FASTER)}, reverse=True):
        if kappa < slowest:
            break
        found = enlarged(frame, kappa, within, log.left)
        if found is not None and (found.volume >= KEPT * volume or kappa == slowest):
            answer = certificate_of(about, found.candidate, each, log, outputs)
            if isinstance(answer, Certificate):
                return answer
            failure = answer
    return failure


def _with_densities_of(candidate: Candidate) -> Iterator[Point]:
    """Yield the points of a candidate with densities that take little proof: those that count most in it.

    The integral of a nondecreasing form is at most y g, which costs nothing: at slow rates a sharper bound wins little.
    """
    y = candidate.N @ candidate.w
    sizes = {each.label[1:]: y[k] for k, each in enumerate(candidate.solvable.unknowns) if each.label[0] == "mu"}
    for p, point in enumerate(candidate.frame.points):
        most = sorted(range(len(point.forms)), key=lambda k: -sizes.get((p, k), 0.0))[:DENSITIES]
        free = (replace(form, c=1.0) if form.kind == "nondecreasing" else form for form in point.forms)
        forms = (form if k in most else replace(form, c=np.nan) for k, form in enumerate(free))
        yield replace(point, forms=tuple(forms))


def _power_of_two(number: float) -> Fraction:
    return Fraction(float(np.exp2(np.round(np.log2(number)))))
