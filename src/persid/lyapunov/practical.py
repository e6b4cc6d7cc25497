"""Practical stability: forms that are sector forms far from 0 alone, products with constants, integrals with offsets.

Where a function leaves its sector near 0, no V falls everywhere; but far out it may. With forms l of a curve phi that
hold for |y| >= r,

    (l'phi)(k'phi) + c >= 0,     int_0^y l'phi >= -o,     int_0^y l'phi <= c y l'phi + e        for all y,

so V' <= -kappa V + gamma |v|^2 + c_0, and every run comes into a ball about x_ref whose size is made small here.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache
from itertools import combinations

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import rounded
from persid.lyapunov.barrier import as_near_as, minimise
from persid.lyapunov.cones import facets, interior
from persid.lyapunov.frame import Frame, Unknown
from persid.lyapunov.integrals import _sampled
from persid.lyapunov.points import Form, Known, Point, steepness
from persid.lyapunov.proposals import NEAR, Candidate, feasible, with_gain
from persid.lyapunov.sectors import RELAXATION, Curve, _directions, sizes

FORMS = 4  # of a curve that hold far out
SAMPLES = 2000
MANY = 3  # functions of one argument, from which on their sums in the equations are split, not the functions themselves
ROOM_OF_SLOPES = 2.0**-8  # of the slopes of a sum far out, by which its sector is wider
SAFETY = 1 + 1 / 32  # what samples show is made larger by so much, so that few pieces prove it
LARGEST = 64.0  # a form with a larger c is no density worth having
RADII = tuple(2.0**k for k in range(-4, 13))  # beyond which forms hold, in units of the functions
SHARES = (1 / 16, 1 / 256)  # of the rate of the model at which a first ball is sought
STEPS = 24  # towards a smaller one
CLOSER = 0.98  # share of the square that makes a step worth it
WEIGHT = 1 / 16  # of an input of its own size beside what stays without inputs
SHORT = 5  # bits of a rate
Left = Callable[[], float]


@dataclass(frozen=True, eq=False)
class Rough(Frame):
    """A frame whose forms of kind "offset" hold far out: they make densities, and products with constants.

    `constants` has that of each product (p, k, j) of two forms at a point that may be used.
    """

    constants: dict[tuple[int, int, int], float] = field(default_factory=dict)

    def unknowns(self, kappa: Fraction, *, across: bool) -> list[Unknown]:
        """Return P, densities, products of sector forms, products with constants, and identities."""
        known = (*self._values(), *self._constants(), *self._identities())
        return [*self._quadratic(kappa), *self._densities(kappa), *known]

    @property
    def constants_seen(self) -> dict[tuple[int, int, int], float]:
        """The constant that samples show of each product of two forms at a point, one of which holds far out alone."""
        found = {}
        for p, point in enumerate(self.points):
            usable = [k for k, form in enumerate(point.forms) if form.kind != "one-signed" and self._joins(point, form)]
            for k, j in combinations(usable, 2):
                pair = point.forms[k], point.forms[j]
                c = constant_of(point.curve, pair[0].form, pair[1].form)
                if c and any(form.kind == "offset" for form in pair):  # c = 0 is only for sector forms
                    found[p, k, j] = c
        return found

    @staticmethod
    def _joins(point: Point, form: Known) -> bool:
        """Whether a form may stand in a product with a constant: of many functions only y and those of the sums."""
        return len(point.channels) < MANY or form.kind == "offset" or not any(form.form[1:])

    def _constants(self) -> Iterator[Unknown]:
        for p, k, j in self.constants:
            point = self.points[p]
            rows = (point.reads(point.forms[i].form, self.places) for i in (k, j))
            yield self._fact(("constant", p, k, j), *rows)

    def supply(self, unknown: Unknown, kappa: float) -> float:
        """Return what an unknown adds to kappa p times the square of the ball: 2 tau c, or 2 kappa mu (e + o)."""
        match unknown.label:
            case ("constant", p, k, j):
                return 2 * self.constants[p, k, j]
            case ("mu", p, k):
                form = self.points[p].forms[k]
                return float(2 * kappa * (form.e + form.offset))
        return 0.0


def rough_frame(frame: Frame, r: float) -> Rough:
    """Return a frame with forms that hold for |y| >= r, beside those that hold everywhere and vanish at 0."""
    points = []
    for point in frame.points:
        at_0 = point.curve.values(np.zeros(1))[0]
        resting = (form for form in point.forms if not float(at_0 @ np.array(form.form)))
        sums = point.sums if len(point.channels) >= MANY else ()
        far = split_forms(point.curve, sums, r) if sums else far_forms(point.curve, r)
        points.append(replace(point, forms=(*resting, *far)))
    return Rough(frame.model, tuple(points), frame.lone, identities=frame.identities)


def with_slopes_bounded(point: Point) -> Point:
    """Return a point of many functions with s y - f, s the largest slope of f, for each of them whose slope has one.

    Sums alone leave the values of single functions free; candidates of a curve are too few to hold one for each.
    """
    if len(point.channels) < MANY:
        return point
    known = {form.form for form in point.forms}
    axes = np.eye(len(point.channels) + 1)[1:]
    steepest = [steepness(point.curve, tuple(axis.tolist())) for axis in axes]
    forms = [tuple((s * np.eye(len(axis))[0] - axis).tolist()) for s, axis in zip(steepest, axes, strict=True)]
    added = (Known(form, "nondecreasing") for form in forms if form[0] < np.inf and form not in known)
    return replace(point, forms=(*point.forms, *added))


def _steepest(curve: Curve) -> float:
    """Return the largest |a| of the functions f(a y)."""
    return max((abs(float(factor)) for factor in curve.factors), default=1.0)


@lru_cache(maxsize=4096)
def split_forms(curve: Curve, sums: tuple[Form, ...], r: float) -> tuple[Known, ...]:
    """Return forms of each sum g = a'f, as a function with slopes within a sector beyond r and a bounded part.

    Beyond r, low <= g(y)/y <= high: g - low y and high y - g have the sign of y there.
    """
    y, phi, integral = _sampled_once(curve)
    far = np.abs(y) >= r / _steepest(curve)
    found = list[Known | None]()
    for a in sums:
        slopes = (phi[far, 1:] @ np.array(a)) / y[far]
        width = ROOM_OF_SLOPES * (float(np.abs(slopes).max(initial=0.0)) or 1.0)
        low, high = float(slopes.min()) - width, float(slopes.max()) + width
        found += [_known(y, phi, integral, _short(np.array(form))) for form in ((-low, *a), (high, *(-v for v in a)))]
    return tuple(each for each in found if each is not None)


@lru_cache(maxsize=4096)
def far_forms(curve: Curve, r: float) -> tuple[Known, ...]:
    """Return facets of the conic hull of the curve beyond r, with offsets and bounds of their integrals."""
    if curve.fixed:
        return ()
    y, phi, integral = _sampled_once(curve)
    unit, far = sizes(curve), np.abs(y) >= r / _steepest(curve)
    V = _directions((np.sign(y)[:, None] * phi / unit)[far])
    deepest = interior(V)
    if not len(V) or (V @ deepest).min() <= 0:
        return ()
    relaxed = (facets(V) + RELAXATION * deepest) / unit
    found = (_known(y, phi, integral, _short(form)) for form in relaxed[:FORMS])
    return tuple(each for each in found if each is not None)


def _short(form: Float[ndarray, " d"]) -> Form:
    """Round to a few bits, relative to the largest entry."""
    grid = np.exp2(np.ceil(np.log2(np.abs(form).max())) - 16)
    return tuple((np.round(form / grid) * grid + 0.0).tolist())


def _known(y: ndarray, phi: ndarray, integral: ndarray, form: Form) -> Known | None:
    """Return a form with its offset, and c and e of its integral; None where the integral has no lower bound."""
    l, total = np.array(form), integral @ np.array(form)  # noqa: E741
    offset = _largest(y, -total)
    if offset is None:
        return None
    moment = y * (phi @ l)
    ends = [np.argmin(y), np.argmax(y)]
    if not any(form[1:]) or (moment[ends] <= 0).any():
        return Known(form, "offset", offset=offset)
    c = _up(float((total[ends] / moment[ends]).max()) * SAFETY)
    e = _largest(y, total - c * moment)
    return (
        Known(form, "offset", offset=offset)
        if e is None or c > LARGEST
        else Known(form, "offset", c, offset=offset, e=e)
    )


@lru_cache(maxsize=16384)
def constant_of(curve: Curve, k: Form, j: Form) -> float | None:
    """Return c with (k'phi)(j'phi) + c >= 0, None where samples show none."""
    y, phi, _ = _sampled_once(curve)
    return _largest(y, -(phi @ np.array(k)) * (phi @ np.array(j)))


@lru_cache(maxsize=256)
def _sampled_once(curve: Curve) -> tuple[ndarray, ndarray, ndarray]:
    return _sampled(curve, SAMPLES)


def _largest(y: ndarray, values: ndarray) -> float | None:
    """Return at least the largest of values, 0 where none is positive; None where they go on growing at an end."""
    at = int(values.argmax())
    if values[at] <= 0:
        return 0.0
    return None if y[at] in (y.min(), y.max()) else _up(float(values[at]) * SAFETY)


def _up(number: float) -> float:
    """Round up to a few bits."""
    if number <= 0:
        return 0.0
    grid = np.exp2(np.ceil(np.log2(number)) - 12)
    return float(np.ceil(number / grid) * grid)


@dataclass(frozen=True, eq=False)
class Ball:
    """A ball that a candidate proves with forms beyond r; in its square an input of its own size counts a little."""

    candidate: Candidate
    r: float
    kappa: float
    square: float


def smallest_balls(frame: Frame, rate: float, left: Left) -> list[Ball]:
    """Return balls over radii of the forms and rates, the smallest first; what samples show of forms is believed."""
    starts = (_ball(frame, r, share * rate, left) for share in SHARES for r in RADII if left() > 0)
    best = next((ball for ball in starts if ball is not None), None)
    found, factors = [] if best is None else [best], [(2.0, 1.0), (1.0, 2.0), (1.4, 1.0), (1.0, 0.5), (0.7, 1.0)]
    for _ in range(STEPS):
        if best is None or left() <= 0 or not factors:
            break
        a, b = factors[0]
        tried = _ball(frame, best.r * a, best.kappa * b, left)
        if tried is not None and tried.square < CLOSER * best.square:
            best = tried
            found.append(best)
        else:
            factors.pop(0)
    return found[::-1]


def _ball(frame: Frame, r: float, kappa: float, left: Left) -> Ball | None:
    """Return the smallest ball with forms beyond r at a rate."""
    far = rough_frame(frame, r)
    return ball_of(replace(far, constants=far.constants_seen), r, kappa, left)


def ball_of(frame: Rough, r: float, kappa: float, left: Left) -> Ball | None:
    """Return the smallest ball that a frame with forms beyond r proves at a rate."""
    candidate = feasible(frame, Fraction(float(rounded(np.array(kappa), SHORT))), left, across=False)
    return None if candidate is None else _shrunk(candidate, frame, r, left)


def _shrunk(candidate: Candidate, frame: Rough, r: float, left: Left) -> Ball:
    """Minimise kappa times the square of the ball, with Pt > I and gamma I in M, gamma counted a little."""
    matrices, kappa = candidate.matrices, float(candidate.kappa)
    inputs = matrices.units[frame.entries : frame.width]
    cost = np.array([frame.supply(each, kappa) for each in candidate.solvable.unknowns]) * matrices.sizes
    size = float(min(inputs**2, default=1.0)) * (1.0 if frame.lone else WEIGHT)
    region, w, unit = with_gain(candidate)
    if not np.isfinite(region.value(w)):
        return Ball(candidate, r, kappa, np.inf)
    objective = np.append(candidate.N.T @ cost, unit * size if len(inputs) else 1e-3)
    found = minimise(region, objective, w, enough=as_near_as(NEAR), left=left)
    return Ball(replace(candidate, w=found.w[:-1]), r, kappa, found.objective / kappa)
