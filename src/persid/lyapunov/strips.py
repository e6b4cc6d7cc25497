"""Regions that fit the model: a strip for each row that functions read, as wide as makes the region large.

    maximise the volume of {V <= 1}   with   M > 0 on the strips -h_g < r_g'x < h_g,   Pt - r_g r_g' / h_g^2 > 0

Functions are known better on narrow strips, and faces are farther away on wide ones. For given widths the mean of V
over points of the last level set, which is linear in the unknowns, is made small, again and again: with points where
the old V is 1 and the new one is less on average, the set grows. The widths first grow together, then one by one.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property, lru_cache

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import rounded
from persid.lyapunov.barrier import Region, as_near_as, definite, faces, minimise
from persid.lyapunov.frame import Frame
from persid.lyapunov.integrals import _sampled
from persid.lyapunov.points import Row
from persid.lyapunov.proposals import ROOM, Candidate, Left, feasible
from persid.lyapunov.sectors import Curve
from persid.lyapunov.solvability import solved
from persid_check.search.prover import prove_continuous

DIRECTIONS = 600  # in which a level set is looked at
RADII = 60  # bisections of the distance to it
SWEEPS = 4  # times that the mean of V is made small for given widths
GROWTH = 1.5  # of all widths together
PATIENCE = 3  # times that wider strips may give a smaller region
FACTORS = (1.4, 1.1, 1.02, 1.005, 1.001)  # by which single widths change
GAIN = 1.002  # of the volume that is worth another width, or another sweep
SHARE = 0.2  # of a small factor, in powers, by which the volume has to grow
CLOSE = 0.01  # of the mean of V: how near to the smallest one it comes, and so what room is left inside
PARALLEL = 1 - 1e-9  # the cosine between rows of one direction
NARROW = 0.05  # first widths, in units of the functions
Widths = tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Sublevel:
    """The set V <= 1 of a candidate, in directions from the operating point."""

    candidate: Candidate
    points: Float[ndarray, "N n"]  # where V = 1, or a strip ends
    volume: float

    @classmethod
    def of(cls, candidate: Candidate, within: Float[ndarray, "g n"]) -> "Sublevel":
        """Look at the set; `within` are rows r/h that stay below 1 in it."""
        levels, n = Levels(candidate), candidate.frame.order
        d = np.random.default_rng(0).normal(size=(DIRECTIONS, n))
        d = np.vstack([d, -d]) / np.linalg.norm(np.vstack([d, d]), axis=1, keepdims=True)
        d = sla.solve_triangular(np.linalg.cholesky(levels.Pt).T, d.T).T  # a sphere, if V were x'Pt x
        low, high = np.zeros(len(d)), 1 / np.maximum(np.abs(d @ within.T).max(axis=1), 1e-300)
        for _ in range(RADII):
            middle = (low + high) / 2
            inside = levels.V(d * middle[:, None]) <= 1
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
        ball = np.pi ** (n / 2) / math.gamma(n / 2 + 1) / np.sqrt(np.linalg.det(levels.Pt))
        return cls(candidate, d * low[:, None], float(ball * np.mean(low**n)))


@dataclass(frozen=True, eq=False)
class Levels:
    """V of a candidate in floating point."""

    candidate: Candidate

    @cached_property
    def y(self) -> Float[ndarray, " J"]:
        """The unknowns in the user's units."""
        return np.asarray((self.candidate.N @ self.candidate.w) * self.candidate.matrices.sizes)

    @cached_property
    def Pt(self) -> Float[ndarray, "n n"]:
        """The matrix of the quadratic lower bound of V."""
        n, units = self.candidate.frame.order, self.candidate.matrices.units
        return np.asarray(self.candidate.Pt(self.candidate.w) / np.outer(units[:n], units[:n]))

    def V(self, x: Float[ndarray, "N n"]) -> Float[ndarray, " N"]:
        """Return V at points."""
        return np.asarray(parts_of_V(self.candidate, x) @ self.y)


def parts_of_V(candidate: Candidate, x: Float[ndarray, "N n"]) -> Float[ndarray, "N J"]:
    """Return what each unknown multiplies in V at points: products of states, and twice the integrals of densities."""
    parts = np.zeros((len(x), len(candidate.solvable.unknowns)))
    for k, unknown in enumerate(candidate.solvable.unknowns):
        match unknown.label:
            case ("P", i, j):
                parts[:, k] = (1 + (i != j)) * x[:, i] * x[:, j]
            case ("mu", p, form):
                point = candidate.frame.points[p]
                y, integral = _integrals(point.curve)
                line = x[:, list(point.row)] @ np.array([float(v) for v in point.row.values()])
                parts[:, k] = 2 * np.interp(line, y, integral @ np.array(point.forms[form].form))
    return parts


@lru_cache(maxsize=64)
def _integrals(curve: Curve) -> tuple[Float[ndarray, " K"], Float[ndarray, "K d"]]:
    """Return arguments in order and the integrals of the functions up to them."""
    y, _, integral = _sampled(curve)
    order = np.argsort(y)
    return y[order], integral[order]


def on_box(frame: Frame, box: Sequence[tuple[Fraction, Fraction]]) -> Frame:
    """Return a frame on a box about the operating point, of the first variables or of all, lo < z_i < hi.

    Functions are looked at where the box lets their arguments go, on all of R where these read more than it has. Sides
    that are no domain of a function are strips of their own.
    """
    points = tuple(
        point.on(_interval(point.row, box)) if all(i < len(box) for i in point.row) else point for point in frame.points
    )
    standing = [(point.row, point.curve.domain) for point in points]
    sides = [({i: Fraction(1)}, ends) for i, ends in enumerate(box)]
    return replace(
        frame, points=points, strips=tuple((row, *ends) for row, ends in sides if (row, ends) not in standing)
    )


def _interval(row: Row, box: Sequence[tuple[Fraction, Fraction]]) -> tuple[Fraction, Fraction]:
    """Return the ends of r'z on a box."""
    ends = [sorted(r * end for end in box[i]) for i, r in row.items()]
    return sum((low for low, _ in ends), Fraction(0)), sum((high for _, high in ends), Fraction(0))


def in_strips(frame: Frame, following: Float[ndarray, "k n"] | None) -> Float[ndarray, "g n"]:
    """Return rows r/h of all strips of a frame over the states, which algebraic variables follow."""
    rows = np.zeros((len(frame.sides), frame.n))
    for line, (row, lo, hi) in zip(rows, frame.sides, strict=True):
        line[list(row)] = [float(v / min(-lo, hi)) for v in row.values()]
    return over_states(rows, frame.order, following)


def over_states(rows: Float[ndarray, "g N"], n: int, following: Float[ndarray, "k n"] | None) -> Float[ndarray, "g n"]:
    """Return rows over all variables as rows over the n states."""
    return rows if following is None else rows[:, :n] + rows[:, n:] @ following


@dataclass
class Search:
    """Widths of strips for a frame, and the largest region that was found with them.

    Of a model with algebraic variables these follow the states, as its linearisation tells.
    """

    frame: Frame
    kappa: Fraction
    shape: Float[ndarray, "n n"]  # P of the linearisation
    left: Left
    following: Float[ndarray, "k n"] | None = None  # derivatives of algebraic variables by the states
    best: Sublevel | None = None
    widths: Widths = ()

    @cached_property
    def rows(self) -> Float[ndarray, "g n"]:
        """The rows of the points, over the states."""
        rows = np.zeros((len(self.frame.points), self.frame.n))
        for line, point in zip(rows, self.frame.points, strict=True):
            line[list(point.row)] = [float(v) for v in point.row.values()]
        return over_states(rows, self.frame.order, self.following)

    def run(self) -> Sublevel | None:
        """Widen all strips together, then single ones, while the region grows."""
        reach = np.sqrt(np.einsum("gi,ij,gj->g", self.rows, np.linalg.inv(self.shape), self.rows))
        scale, failures = NARROW / float(reach.max()), 0
        while failures < PATIENCE and self.left() > 0:
            better = self.tries(tuple(scale * reach))
            failures = 0 if better else failures + 1
            scale *= GROWTH
        directions = self._directions()
        for factor in FACTORS:
            changed = True
            while changed and self.left() > 0:
                changed = any([self._changes(strips, factor) for strips in directions])
        return self.best

    def _directions(self) -> list[frozenset[int]]:
        """Return the strips of one direction each: the narrower one of two parallel strips alone would be felt."""
        unit = self.rows / np.linalg.norm(self.rows, axis=1, keepdims=True)
        return list(dict.fromkeys(frozenset(np.flatnonzero(abs(unit @ row) > PARALLEL).tolist()) for row in unit))

    def _changes(self, strips: frozenset[int], factor: float) -> bool:
        """Whether another width of strips of one direction makes the region larger."""
        for by in (factor, 1 / factor):
            widths = tuple(h * by if k in strips else h for k, h in enumerate(self.widths))
            if self.best is not None and self.left() > 0 and self.tries(widths, min(GAIN, factor**SHARE)):
                return True
        return False

    def tries(self, widths: Widths, gain: float = GAIN) -> bool:
        """Whether these widths give a region that is larger than the best so far, which it then is."""
        short = tuple(float(h) for h in rounded(np.array(widths), 12))
        found = self.region(short)
        better = found is not None and (self.best is None or found.volume > gain * self.best.volume)
        if better:
            self.best, self.widths = found, short
        return better

    def region(self, widths: Widths) -> Sublevel | None:
        """Return the largest region for given widths, none where a function ends within them."""
        points = tuple(point.on((-h, h)) for point, h in zip(self.frame.points, widths, strict=True))
        curves = {point.curve for point in points}
        if not all(prove_continuous(curve.exact, curve.domain, curve.shift) for curve in curves):
            return None
        frame = solved(replace(self.frame, points=points), self.left)
        if frame is None:
            return None
        return enlarged(frame, self.kappa, self.rows / np.array(widths)[:, None], self.left)


def enlarged(frame: Frame, kappa: Fraction, within: Float[ndarray, "g n"], left: Left) -> Sublevel | None:
    """Return the largest region of a frame on strips |r/h x| < 1; None where there is none."""
    candidate = feasible(frame, kappa, left, across=False)
    if candidate is None:
        return None
    scaled = candidate.matrices.units[: frame.order] * within
    Pt, N = candidate.matrices.Pt(), candidate.N
    held = faces(Pt, N, [-np.outer(row, row) for row in scaled])
    inverse = np.linalg.inv(candidate.Pt(candidate.w))
    candidate = replace(candidate, w=candidate.w * 1.1 * float(np.einsum("gi,ij,gj->g", scaled, inverse, scaled).max()))
    radius = ROOM * float(np.linalg.norm(candidate.w))
    region = Region([definite(candidate.matrices.M(), N), *held], candidate.signs, radius)
    found = Sublevel.of(candidate, within)
    for _ in range(SWEEPS):
        if left() <= 0 or not np.isfinite(region.value(found.candidate.w)):
            break
        mean = parts_of_V(candidate, found.points).mean(axis=0) * candidate.matrices.sizes @ N
        w = minimise(region, mean, found.candidate.w, enough=as_near_as(CLOSE), left=left).w
        following = Sublevel.of(replace(candidate, w=w), within)
        if not following.volume > found.volume:
            break
        found, small = following, following.volume < GAIN * found.volume
        if small:
            break
    return found


def of_linearisation(
    J: Float[ndarray, "n n"], scale: Float[ndarray, " n"], *, discrete: bool = False
) -> Float[ndarray, "n n"]:
    """Return P > 0 with J'P + PJ = -diag(1/scale^2), or J'PJ - P of a step, for a stable J."""
    if discrete:
        return np.asarray(sla.solve_discrete_lyapunov(J.T, np.diag(1 / scale**2)))
    return np.asarray(sla.solve_continuous_lyapunov(J.T, -np.diag(1 / scale**2)))
