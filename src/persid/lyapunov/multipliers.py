"""From a solution in floating point to the bytes of a certificate: choose what is used, round, factor, write."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import sparse

from persid._dyadics import SLACK, _floor, rounded
from persid.errors import RoundingError
from persid.lyapunov.arrays import HOST, SMALL
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.inequality import Assembly
from persid.lyapunov.sectors import Curve
from persid.lyapunov.system import Family, System
from persid.lyapunov.unknowns import Unknowns

NEGLIGIBLE = (1e-2, 1e-3, 1e-5, 1e-8)  # unknowns below such a share of the largest are tried as zeros
SMALLEST = 1e-13  # eigenvalue, in units in which the diagonal is 1, from which a matrix is taken for positive definite
LOSS = 1.005  # by which gamma may grow, and the lower bound of V shrink, for a proof with fewer forms


Used = tuple[int, Curve, frozenset[tuple[float, ...]]]  # a form of a group and its curve, or the product of two


@dataclass(frozen=True, eq=False)
class Chosen:
    """The part of a group's family that a certificate uses: forms with mu, c and d, and products (k, l, tau)."""

    forms: Float[ndarray, "K d"]
    mu: Float[ndarray, " K"]
    upper: Float[ndarray, " K"]
    lower: Float[ndarray, " K"]
    products: tuple[tuple[int, int, float], ...]

    @classmethod
    def of(
        cls, family: Family, mu: Float[ndarray, " K"], tau: Float[ndarray, " T"],
        upper: Float[ndarray, " K"], lower: Float[ndarray, " K"],
    ) -> "Chosen":  # fmt: skip
        """Return the forms of a family that are in use, with their multipliers, rounded."""
        products = [(k, j, float(t)) for (k, j), t in zip(family.products, rounded(tau), strict=True) if t > 0]
        used = sorted({int(k) for k in np.flatnonzero(mu > 0)} | {k for pair in products for k in pair[:2]})
        place = {k: new for new, k in enumerate(used)}
        pairs = tuple((min(place[k], place[j]), max(place[k], place[j]), t) for k, j, t in products)
        return cls(family.forms[used], rounded(mu[used]), upper[used], lower[used], pairs)


@dataclass(frozen=True, eq=False)
class Lyapunov:
    """V and the multipliers of its proof, in numbers that a certificate can write exactly."""

    system: System
    P: Float[ndarray, "n n"]
    chosen: tuple[Chosen, ...]
    kappa: float
    units: Float[ndarray, " m"] | None = None  # of the inputs of `system`, where each has its own gain: u = units v
    deviations: tuple[Deviation, ...] = ()
    s: Float[ndarray, " d"] = field(default_factory=lambda: np.zeros(0))

    @property
    def used(self) -> set[Used]:
        """The forms and the products in use, each with its group and curve."""
        found = set[Used]()
        for g, (group, part) in enumerate(zip(self.system.groups, self.chosen, strict=True)):
            forms = [tuple(form) for form in part.forms.tolist()]
            found |= {(g, group.curve, frozenset([form])) for form in forms}
            found |= {(g, group.curve, frozenset([forms[k], forms[j]])) for k, j, _ in part.products}
        return found

    @cached_property
    def E(self) -> Float[ndarray, "N n"]:
        """Half the gradient of V is E'z."""
        E = np.zeros((self.system.entries, self.system.n))
        E[: len(self.system.states)] = self.P[list(self.system.states)]
        for group, part in zip(self.system.groups, self.chosen, strict=True):
            at, rows = self.system.lines(group, part.forms)
            reads = np.flatnonzero(group.row)
            E[np.ix_(at, reads)] += np.outer(part.mu @ rows, group.row[reads])
        return E

    @cached_property
    def rise(self) -> Float[ndarray, "N N"]:
        """The form V' = 2 z'E G z without inputs, or V(x+) - V(x) = z'G'P G z - x'P x in discrete time."""
        E = self.E if self.E.size <= SMALL else sparse.csr_array(self.E)  # a handful of entries in a row
        EG = E @ self.system.G
        if not self.system.discrete:
            return np.asarray(EG + EG.T)
        step = self.system.G.T @ self.P @ self.system.G
        step[: self.system.n, : self.system.n] -= self.P
        return np.asarray(step)

    @cached_property
    def crossing(self) -> Float[ndarray, "N m"]:
        """What V rises by z times inputs, E B; G'P B in discrete time."""
        G, B = self.system.G, self.system.B
        return np.asarray(G.T @ self.P @ B if self.system.discrete else self.E @ B)

    @cached_property
    def push(self) -> Float[ndarray, "m m"]:
        """What V rises by inputs alone, B'P B in a step; nothing in continuous time."""
        B = self.system.B
        return np.asarray(B.T @ self.P @ B if self.system.discrete else np.zeros((B.shape[1], B.shape[1])))

    @cached_property
    def decrease(self) -> Float[ndarray, "N N"]:
        """The matrix -Q - kappa W."""
        total: ndarray = -self.rise
        if self.kappa:
            k = len(self.system.states)
            total[:k, :k] -= self.kappa * self.P[np.ix_(self.system.states, self.system.states)]
        for group, part in zip(self.system.groups, self.chosen, strict=True):
            at, rows = self.system.lines(group, part.forms)
            T = np.zeros((len(rows), len(rows)))
            for k, j, tau in part.products:
                T[k, j] = T[j, k] = tau
            own = rows.T @ T @ rows
            if self.kappa:
                (y,) = self.system.lines(group, np.eye(1, group.curve.size))[1]
                weight = (part.mu * np.nan_to_num(part.upper)) @ rows
                own += self.kappa * (np.outer(y, weight) + np.outer(weight, y))
            total[np.ix_(at, at)] -= own
        return total

    @cached_property
    def _spread(self) -> tuple[Float[ndarray, "M M"], Float[ndarray, "N N"]]:
        """What deviations take: sum s C'C over (z, u), and sum (E L)(E L)'/s over z."""
        inputs, N = self.system.B.shape[1], self.system.entries
        known, moved = np.zeros((N + inputs, N + inputs)), np.zeros((N, N))
        for deviation, s in zip(self.deviations, self.s, strict=True):
            C, EL = deviation.columns(self.system.states, self.system.channels, inputs), self.E @ deviation.L
            known, moved = known + s * C.T @ C, moved + EL @ EL.T / s
        return known, moved

    @cached_property
    def robust(self) -> Float[ndarray, "N N"]:
        """The matrix -Q - kappa W less what deviations take, as the Schur complement of their own entries."""
        N = self.system.entries
        known, moved = self._spread
        return self.decrease - known[:N, :N] - moved if self.deviations else self.decrease

    @cached_property
    def _driven(self) -> tuple[Float[ndarray, "N m"], Float[ndarray, "m m"]]:
        """How inputs enter: crossing and push, and what deviations that read them add to it and to Gamma."""
        N, known = self.system.entries, self._spread[0]
        return self.crossing + known[:N, N:], self.push + known[N:, N:]

    @cached_property
    def below(self) -> Float[ndarray, "n n"]:
        """A matrix with V >= x'below x on the domain: P and, on a domain, what the integrals add."""
        rows = np.array([group.row for group in self.system.groups]).reshape(-1, self.system.n)
        return np.asarray(self.P + (rows.T * [float(part.mu @ part.lower) for part in self.chosen]) @ rows)

    @cached_property
    def gamma(self) -> float:
        """A gamma for which the block with the inputs is positive definite: above (EB)'(-Q - kappa W)^-1 EB."""
        least = self._least
        return -_floor(-max(float(np.linalg.eigvalsh(least)[-1]), 1e-300)) if len(least) else 1.0

    @property
    def _least(self) -> Float[ndarray, "m m"]:
        """The least Gamma, (EB)'(-Q - kappa W)^-1 EB where there are no deviations; B'P B more in discrete time."""
        scale = 1 / np.sqrt(np.diag(self.robust))
        EB, own = self._driven
        scaled = scale[:, None] * EB
        least = scaled.T @ np.linalg.solve(scale[:, None] * self.robust * scale, scaled)
        return np.asarray((least + least.T) / 2 + own)

    @property
    def coupling(self) -> Float[ndarray, "m m"]:
        """A symmetric Gamma for which that block is positive definite: (EB)'(-Q - kappa W)^-1 EB and a little more.

        Its diagonal holds the gains of single inputs, squared; one that does nothing is given a tiny gain.
        """
        least = self._least
        sizes = np.diag(least)
        floor = 1e-18 * (sizes.max(initial=0.0) or 1.0)
        return np.asarray(least + np.diag(SLACK * np.maximum(sizes, floor)))

    @property
    def depth(self) -> float:
        """The smallest eigenvalue of `below` on the kept states."""
        states = list(self.system.states)
        return float(np.linalg.eigvalsh(self.below[np.ix_(states, states)])[0]) if states else 0.0

    @property
    def is_sound(self) -> bool:
        """Whether the inequalities hold in floating point."""
        states = list(self.system.states)
        signs = bool((self.s > 0).all())
        return signs and _is_positive(self.robust) and _is_positive(self.below[np.ix_(states, states)])


def choose(
    assembly: Assembly,
    y: Float[ndarray, " J"],
    lower: Sequence[Float[ndarray, " _"]] | None = None,
    units: Float[ndarray, " m"] | None = None,
) -> Lyapunov:
    """Return the rounded Lyapunov function of a solution; negligible unknowns go where the margin allows it.

    `lower` gives the constants d of each group's forms (a region), `units` those of the inputs (a gain for each).

    Raises:
        RoundingError: the rounded numbers do not satisfy the inequalities.
    """
    complete = _lyapunov(assembly, y, lower)
    if not complete.is_sound:
        raise RoundingError("rounding the multipliers loses the margin of the matrix inequality")
    for share in NEGLIGIBLE:
        sparse = np.where(np.abs(y) < share * np.abs(y).max(), 0.0, y)
        sparse[: assembly.problem.free] = y[: assembly.problem.free]
        leaner = _lyapunov(assembly, sparse, lower)
        if leaner.is_sound and leaner.gamma <= LOSS * complete.gamma and leaner.depth >= complete.depth / LOSS:
            return replace(leaner, units=units)
    return replace(complete, units=units)


def _lyapunov(assembly: Assembly, y: ndarray, lower: Sequence[ndarray] | None) -> Lyapunov:
    return lyapunov_function(assembly.unknowns, y, assembly.unknowns.system, lower)


def lyapunov_function(
    unknowns: Unknowns,
    y: Float[ndarray, " J"],
    system: System,
    lower: Sequence[Float[ndarray, " _"]] | None = None,
) -> Lyapunov:
    """Return the rounded Lyapunov function that unknowns stand for, of a system with groups of the same forms."""
    numbers, target = unknowns.multipliers(y), unknowns.target
    chosen = []
    parts = zip(unknowns.system.groups, unknowns.families, numbers.mu, numbers.tau, strict=True)
    for g, (group, family, mu, tau) in enumerate(parts):
        upper = target.upper.get(group.curve, np.full(len(mu), np.nan))
        below = np.zeros(len(mu)) if lower is None else lower[g]
        chosen.append(Chosen.of(family, mu, tau, upper, below))
    found = Lyapunov(system, rounded(numbers.P), tuple(chosen), target.kappa)
    return replace(found, deviations=target.deviations, s=rounded(numbers.s))


def _is_positive(M: ndarray) -> bool:
    diagonal = np.diag(M)
    if not (diagonal > 0).all():
        return False
    scale = 1 / np.sqrt(diagonal)
    return not len(M) or HOST.is_positive(HOST.add_to_diagonal(scale[:, None] * M * scale, -SMALLEST))
