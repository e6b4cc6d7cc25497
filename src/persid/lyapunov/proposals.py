"""Proposals for a ledger: unknowns with M > 0 on the rows that are not zero, the best rate, then the smallest gain.

Two problems are solved by the barrier method, in unknowns w with y = N w (`zero_rows`):
    margin: maximise t with M - tI > 0, Pt - tI > 0, |w| < 1;
    gain:   minimise gamma with Pt > I and M > 0, the inputs and gamma I in M.
What is found is rounded so that zero rows stay exactly zero.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cached_property

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import rounded
from persid.lyapunov.barrier import Centre, Region, as_near_as, definite, minimise
from persid.lyapunov.coordinates import Coordinates
from persid.lyapunov.dual_start import dual_factor
from persid.lyapunov.elimination import followed, multipliers, without
from persid.lyapunov.frame import Frame, Matrices, Unknown
from persid.lyapunov.interior_point import Status, solve
from persid.lyapunov.pairs import combine, pairings
from persid.lyapunov.rates import largest_rate
from persid.lyapunov.sectors import Group
from persid.lyapunov.system import Scaling, System, scaling
from persid.lyapunov.unknowns import Label
from persid.lyapunov.zero_rows import Solvable, reduced

ACROSS = ("difference", "one_signed", "step")  # facts of which there may be many
ROUNDS = 60
FALL = 0.1  # share to which the complementarity falls in a round
FEW = 60  # facts across channels with which a problem is small
JOINING = 8  # facts, for each state, that may join in one
START = 0.3  # of the ball of radius 1 in which a margin is sought
ROOM = 1e4  # times the size of the first point: the ball in which a gain is made small
INSIDE = 1.2  # times what Pt > I needs: a point well inside, where a gain is made small
ABOVE = 1.5  # times gamma there, of which a gain begins at twice
NEAR = 0.02  # of gamma, and so a gain to 1 %
DENSE = 1000  # unknowns up to which a gain is made small
NEGLIGIBLE = (1e-2, 1e-3, 1e-5, 1e-8)
LOSS = 1.03  # by which gamma may grow for a proof with fewer facts
Left = Callable[[], float]


@dataclass(frozen=True, eq=False)
class Proposal:
    """Numbers of a ledger: P, mu and tau by their labels, exact, with the rows of M that they make zero.

    `gamma` and `least` are what they prove in floating point in good coordinates: of the joint inputs, and of V.
    """

    frame: Frame
    kappa: Fraction
    values: dict[Label, Fraction]
    zero: tuple[int, ...]
    gamma: float
    least: float


@dataclass(frozen=True, eq=False)
class Candidate:
    """A frame with a rate, its unknowns, and a point w where the margin is positive."""

    frame: Frame
    kappa: Fraction
    solvable: Solvable
    matrices: Matrices
    w: Float[ndarray, " W"]

    @cached_property
    def N(self) -> Float[ndarray, "J W"]:
        """All unknowns as combinations of the free ones, both in their sizes."""
        sizes = self.matrices.sizes
        return np.asarray(self.solvable.N * sizes[list(self.solvable.free)] / sizes[:, None])

    @property
    def speed(self) -> float:
        """A rate of the size of the model's, in 1/s."""
        return self.matrices.rate

    @property
    def eliminated(self) -> bool:
        """Whether algebraic variables have left M, with the multipliers of their equations."""
        algebraic = self.frame.order < self.frame.n
        return algebraic and not any(each.label[0] == "equation" for each in self.solvable.unknowns)

    @property
    def signs(self) -> Float[ndarray, "M W"]:
        """The rows of N of the unknowns that are positive."""
        return self.N[[k for k, each in enumerate(self.solvable.unknowns) if each.multiplier]]

    def Pt(self, w: Float[ndarray, " W"]) -> Float[ndarray, "k k"]:
        """Return the matrix of the quadratic lower bound of V, over what P reads, in units."""
        return np.asarray(combine(self.matrices.Pt(), self.N @ w))

    def least(self, w: Float[ndarray, " W"]) -> float:
        """Return the largest p with V >= p |x|^2 by Pt, in the user's units; negative where Pt is not positive."""
        n, Pt, back = self.frame.order, self.Pt(w), self.matrices.back
        if np.linalg.eigvalsh(Pt)[0] <= 0:
            return -1.0
        states = back[:n, :n]
        return float(1 / np.linalg.eigvalsh(states @ np.linalg.inv(Pt)[:n, :n] @ states.T)[-1])

    def in_use(self) -> "Candidate":
        """Return the candidate without multipliers that are zero, where no equations tie them to others."""
        if self.solvable.pivots:
            return self
        return self.part([k for k, each in enumerate(self.solvable.unknowns) if self.w[k] > 0 or not each.multiplier])

    def part(self, kept: Sequence[int]) -> "Candidate":
        """Return the candidate with some of its unknowns, where no equations tie them to others."""
        solvable = replace(
            self.solvable, unknowns=tuple(self.solvable.unknowns[k] for k in kept), free=tuple(range(len(kept)))
        )
        return replace(self, solvable=solvable, matrices=self.matrices.part(kept), w=self.w[list(kept)])

    def proposal(self) -> Proposal:
        """Round, without the unknowns that are negligible where that does little harm."""
        w, gamma = self.w, self.gamma(self.w)
        for share in NEGLIGIBLE:
            leaner = self._without(share)
            if leaner is not None and self.gamma(leaner) <= LOSS * gamma:
                w = leaner
                break
        free = w * self.matrices.sizes[list(self.solvable.free)]
        free = free if self.frame.basis else rounded(free)  # badly scaled: every bit may count
        y = self.solvable.exact([Fraction(float(v)) for v in free])
        values = {each.label: v for each, v in zip(self.solvable.unknowns, y, strict=True) if v}
        if self.eliminated:
            sizes = self.matrices.rate / self.matrices.units[self.frame.order : self.frame.n] ** 2
            values |= multipliers(self.frame, self.kappa, values, sizes)
        values |= dict(self.frame.solving)
        gamma, least = self.gamma(w), self.least(w)
        return Proposal(self.frame, self.kappa, values, self.solvable.zero, gamma * least, least)

    def _without(self, share: float) -> ndarray | None:
        small = np.abs(self.w) < share * np.abs(self.w).max()
        small &= np.array([self.solvable.unknowns[k].multiplier for k in self.solvable.free])
        w = np.where(small, 0.0, self.w)
        return w if (self.signs @ w).min(initial=0.0) >= 0 else None

    def gamma(self, w: Float[ndarray, " W"]) -> float:
        """Return the least gamma / p of a point, in the user's units; infinity where an inequality fails."""
        frame, k = self.frame, len(self.matrices.kept)
        if not (w.any() and np.isfinite(self.N @ w).all()):
            return np.inf
        M, least = combine(self.matrices.M(inputs=True), self.N @ w), self.least(w)
        if least <= 0 or np.linalg.eigvalsh(M[:k, :k])[0] <= 1e-13 * np.abs(M[:k, :k]).max():
            return np.inf
        side = M[:k, k:] / self.matrices.units[frame.entries :]
        own = M[k:, k:] / self.matrices.units[frame.entries :] / self.matrices.units[frame.entries :, None]
        worst = np.linalg.eigvalsh(side.T @ np.linalg.solve(M[:k, :k], side) - own)[-1] if side.shape[1] else 0.0
        return float(max(worst, 0.0)) * self.matrices.rate / least


def matrices_of(frame: Frame, kappa: Fraction, across: bool) -> tuple[Solvable, Matrices] | None:
    """Return the unknowns of a frame at a rate and the matrices in good units; None where no V is left."""
    follows, listed, able = followed(frame), frame.unknowns(kappa, across=across), range(frame.order, frame.entries)
    solvable = reduced(without(listed, follows) if follows else listed, [i for i in able if i not in follows])
    if follows and solvable is not None and solvable.zero:  # rows of channels that w reads would not vanish
        follows, solvable = {}, reduced(listed, able)
    if solvable is None or (solvable.zero and frame.sloped):
        return None
    system = system_of(replace(frame, sloped=False))
    if frame.basis:
        rows = [[float(row.get(i, 0)) for i in range(frame.n)] for row in frame.basis]
        system = Coordinates(system, np.array(rows)).turned
    units = scaling(system)
    kept = np.array([i for i in range(frame.entries) if i not in solvable.zero and i not in follows], int)
    inputs, slopes = units.inputs[: frame.width - frame.entries], units.rate * units.entries[frame.z[frame.order :]]
    every = np.concatenate([units.entries, slopes, inputs])
    matrices = Matrices(frame, solvable.unknowns, every, units.rate, kept)
    return solvable, matrices


def system_of(frame: Frame) -> System:
    """Return the frame in floating point."""
    G, channels = np.zeros((frame.n, frame.width)), tuple(frame.places)
    for i, row in enumerate(frame.flow):
        for j, v in row.items():
            G[i, j] = float(v)
    found = []
    for point in frame.points:
        line = np.zeros(frame.n)
        line[list(point.row)] = [float(v) for v in point.row.values()]
        found.append(Group(line, point.channels, point.channels, point.curve))
    return System(
        G[:, : frame.entries], G[:, frame.entries :], tuple(found), tuple(range(frame.n)), channels,
        frame.model.is_discrete,
    )  # fmt: skip


def feasible(frame: Frame, kappa: Fraction, left: Left, *, across: bool) -> Candidate | None:
    """Return a candidate whose margin is positive, None where none is found."""
    built = matrices_of(frame, kappa, across)
    if built is None:
        return None
    solvable, matrices = built
    candidate = Candidate(frame, kappa, solvable, matrices, np.zeros(len(solvable.free)))
    try:
        free = frame.order < frame.n or bool(frame.identities)  # multipliers of any sign
        plain = not (solvable.zero or frame.is_regional or frame.sloped or free)
        w = _priced(matrices, left) if plain else None
        candidate = _grown(candidate, left) if w is None else replace(candidate, w=w)
        return candidate if np.isfinite(candidate.gamma(candidate.w)) else None
    except np.linalg.LinAlgError:  # numbers of a size that floating point does not bear
        return None


def _priced(matrices: Matrices, left: Left) -> Float[ndarray, " J"] | None:
    """Return unknowns of the interior-point method: facts that its dual matrix prices below zero join in rounds.

    None where it has no point to begin at, and the problem is small.
    """
    frame, all_of = matrices.frame, matrices.M()
    facts = np.array([k for k, each in enumerate(matrices.unknowns) if each.label[0] in ACROSS], int)
    chosen = [k for k in range(len(matrices.unknowns)) if k not in set(facts)]
    cost = np.array([_cost(each) for each in matrices.unknowns])
    units = Scaling(matrices.units[: frame.n], matrices.units[: frame.entries], np.ones(0), matrices.rate)
    together = np.arange(frame.entries), np.zeros((0, frame.entries))  # facts read any two functions
    C = dual_factor(system_of(frame), units, [together] * len(frame.points), frame.entries)
    start, w = None, np.zeros(len(cost))
    for _ in range(ROUNDS):
        problem = replace(matrices.part(chosen).M(sign=-1.0), cost=cost[chosen], C=C, symmetric=frame.n)
        found = solve(problem, start=start, fall=FALL, time_limit=left())
        if found.status is Status.STALLED and not found.steps and len(cost) <= DENSE:
            return None
        w[:] = 0.0
        w[chosen] = found.y
        if found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if found.status in (Status.FEASIBLE, Status.TIME):
            break
        prices = -pairings(all_of, found.X)[facts]
        joining = [int(k) for k in facts[np.argsort(prices)] if k not in set(chosen)]
        worth = dict(zip(facts.tolist(), prices.tolist(), strict=True))
        joining = [k for k in joining if worth[k] < 0][: JOINING * frame.n]
        if not joining and found.status is not Status.ROUGH:
            break
        start = found, np.array([*range(len(chosen)), *[-1] * len(joining)], int)
        chosen += joining
    return w


def _cost(unknown: Unknown) -> float:
    """Return what an unknown adds to sum mu + tr P."""
    return {"mu": 1.0, "P": 2.0 * (unknown.label[1:] == unknown.label[2:] * 2)}.get(unknown.label[0], 0.0)


def _grown(candidate: Candidate, left: Left) -> Candidate:
    """Return the candidate at a centre, positive if one is found: of many facts across channels few join in rounds.

    At a centre w, Z = M - tI, the margin rises with facts F of <Z^-1, F> > 0, the most with the largest.
    """
    unknowns = candidate.solvable.unknowns
    facts = [k for k, each in enumerate(unknowns) if each.label[0] in ACROSS]
    if candidate.solvable.pivots or len(facts) <= FEW:
        return replace(candidate, w=_centred(candidate, left)[0])
    chosen, every = sorted(set(range(len(unknowns))) - set(facts)), candidate.matrices.M()
    for _ in range(ROUNDS):
        part = candidate.part(chosen)
        w, t = _centred(part, left)
        Z = combine(part.matrices.M(), w) - t * np.eye(len(part.matrices.kept))
        worth = pairings(every, np.linalg.inv(Z))
        joining = sorted((k for k in facts if k not in set(chosen) and worth[k] > 0), key=lambda k: -worth[k])
        if t > 0 or not joining or left() <= 0:
            break
        chosen = sorted({*chosen, *joining[:FEW]})
    return replace(part, w=w)


def _centred(candidate: Candidate, left: Left) -> tuple[Float[ndarray, " W"], float]:
    """Return the point where the barrier method has decided the sign of the margin, and the margin."""
    frame, matrices, w = candidate.frame, candidate.matrices, _first(candidate)
    here = candidate.N @ w
    low = min(float(np.linalg.eigvalsh(combine(pairs, here))[0]) for pairs in (matrices.M(), matrices.Pt()))
    t = low - 0.1 * (1 + abs(low))
    size = 4 * abs(t)
    N = sla.block_diag(candidate.N, np.eye(1))
    blocks = (
        definite(matrices.M([[(int(i), -size) for i in matrices.kept]]), N),
        definite(matrices.Pt([[(i, -size) for i in frame.z]]), N),
    )
    objective = np.append(np.zeros(len(w)), -1.0)
    region = Region(blocks, np.pad(candidate.signs, ((0, 0), (0, 1))), 1.0)
    found = minimise(region, objective, np.append(w, t / size), enough=Centre.knows_sign, left=left)
    return found.w[:-1], float(found.w[-1]) * size


def _first(candidate: Candidate) -> ndarray:
    """Return a point of the ball where all multipliers are positive."""
    sizes, solvable = candidate.matrices.sizes, candidate.solvable
    if solvable.pivots:
        w = solvable.inside[list(solvable.free)] / sizes[list(solvable.free)]
    else:
        squares = [bool(each.Pt) and each.label[1] == each.label[2] for each in solvable.unknowns]
        w = np.array(
            [each.multiplier or square for each, square in zip(solvable.unknowns, squares, strict=True)], float
        )
    return np.asarray(START * w / max(float(np.linalg.norm(w)), 1e-300))


def best_rate(frame: Frame, fastest: float, left: Left) -> Candidate | None:
    """Return a candidate whose kappa is within some percent of the largest; `fastest` bounds kappa from above."""

    def ask(trial: float, _: Candidate | None) -> Candidate | None:
        return feasible(frame, Fraction(_short(trial)), left, across=True)

    return largest_rate(ask, fastest, left, first=0.5, fall=0.1, near=1.1)


def _short(number: float) -> float:
    """Round a rate to a few bits: it is a coefficient of the equations."""
    return float(rounded(np.array([number]), 8)[0])


def smallest_gain(candidate: Candidate, left: Left) -> Candidate:
    """Return the candidate of this rate whose gain is the smallest."""
    candidate = candidate.in_use()
    if len(candidate.w) > DENSE:
        return candidate
    if candidate.frame.width == candidate.frame.entries:  # without inputs no gain
        return candidate
    region, w, _ = with_gain(candidate)
    if not np.isfinite(region.value(w)):
        return candidate
    found = minimise(region, np.eye(len(w))[-1], w, enough=as_near_as(NEAR), left=left)
    smaller = replace(candidate, w=found.w[:-1])
    return smaller if np.isfinite(smaller.gamma(smaller.w)) else candidate


def with_gain(candidate: Candidate) -> tuple[Region, Float[ndarray, " W"], float]:
    """Return Pt > I and M > 0 with gamma I at the inputs, a point inside, and the unit of gamma, its last entry."""
    frame, matrices = candidate.frame, candidate.matrices
    unit = ABOVE * max(candidate.gamma(candidate.w), 1e-12)
    inputs = [(i, matrices.units[i] ** 2 / matrices.rate * unit) for i in range(frame.entries, frame.width)]
    N = sla.block_diag(candidate.N, np.eye(1))
    w = np.append(candidate.w * INSIDE / candidate.least(candidate.w), 2.0)
    blocks = (definite(matrices.M([inputs], inputs=True), N), definite(matrices.Pt([[]]), N, -matrices.identity))
    return Region(blocks, np.pad(candidate.signs, ((0, 0), (0, 1))), ROOM * float(np.linalg.norm(w))), w, unit
