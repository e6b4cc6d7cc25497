"""A model about its operating point as the matrix inequality sees it: x' = G z + B u, its groups, and its units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import scipy.linalg as sla
from jaxtyping import Bool, Float, Int
from numpy import ndarray

from persid.lyapunov.arrays import HOST, Arrays
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.sectors import Curve, Group, sizes
from persid.models.model import PersidskiiModel

MANY = 20  # groups: from more on a system is broad


@dataclass(frozen=True, eq=False)
class System:
    """x' = G z + B u about an operating point, z = (x_i for i in `states`, values of `channels`), with its groups.

    Entries of z with a zero column of G that no form touches are left out: channels without effect, and where it helps
    states that enter through radially unbounded functions alone. Without an operating point the functions are not
    shifted and a constant b is the last column of B. In discrete time x+ stands for x', and every state is kept.
    """

    G: Float[ndarray, "n N"]
    B: Float[ndarray, "n m"]
    groups: tuple[Group, ...]
    states: tuple[int, ...]
    channels: tuple[int, ...]
    discrete: bool = False
    arrays: Arrays = field(default=HOST, repr=False)  # where its inequality is solved

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.G)

    @property
    def entries(self) -> int:
        """Number of entries of z."""
        return int(self.G.shape[1])

    @cached_property
    def places(self) -> dict[int, int]:
        """The entry of z of each channel that has one."""
        return {c: len(self.states) + k for k, c in enumerate(self.channels)}

    def lines(self, group: Group, forms: Float[ndarray, "K d"]) -> tuple[Int[ndarray, " e"], Float[ndarray, "K e"]]:
        """Return the entries of z that forms of a group read, in order, and the rows l'N_g there."""
        row = group.row[list(self.states)]
        reads = np.flatnonzero(row)
        at = np.concatenate([reads, np.array([self.places[c] for c in group.channels], int)])
        return at, np.hstack([forms[:, :1] * row[reads], forms[:, 1:]])


def system(
    model: PersidskiiModel, found: tuple[Group, ...], pools: Mapping[Curve, Float[ndarray, "K d"]], *, shifted: bool
) -> System:
    """Return the system of a model with the groups found about its operating point.

    A state is dropped only where its column is zero and no group that reads it has forms of both signs in y: then
    -Q can have nothing but zero there (a state dropped).
    """
    channels = model.channels
    active = tuple(int(c) for c in np.flatnonzero(channels.columns.any(axis=0)))
    reads = np.flatnonzero(channels.A0.any(axis=0)).tolist()
    kept = tuple(i for i in range(model.n) if model.is_discrete or i in reads or _needs_state(i, found, pools))
    G = np.hstack([channels.A0[:, list(kept)], channels.columns[:, list(active)]])
    B = model.B if shifted or not model.b.any() else np.hstack([model.B, model.b[:, None]])
    return System(G, B, found, kept, active, model.is_discrete)


def _needs_state(i: int, found: Sequence[Group], pools: Mapping[Curve, ndarray]) -> bool:
    """Whether state i must stay in z: a group has forms of both signs in y, or nothing else reads the state."""
    reading = [group for group in found if group.row[i] and group.channels]
    return not reading or any((pools[g.curve][:, 0] > 0).any() and (pools[g.curve][:, 0] < 0).any() for g in reading)


@dataclass(frozen=True, eq=False)
class Family:
    """The forms of one group, those allowed in V (`densities`), and the pairs (k, l) that may be multipliers."""

    forms: Float[ndarray, "K d"]
    densities: tuple[int, ...]
    products: tuple[tuple[int, int], ...]

    @classmethod
    def full(cls, forms: Float[ndarray, "K d"]) -> "Family":
        """Every form in V, every product of two different forms a multiplier."""
        K = len(forms)
        return cls(forms, tuple(range(K)), tuple((k, j) for k in range(K) for j in range(k + 1, K)))

    @property
    def used(self) -> list[int]:
        """The forms that take part, in order."""
        return sorted({*self.densities, *(k for pair in self.products for k in pair)})

    def within(self, pool: Float[ndarray, "L d"]) -> "Family":
        """Return the same choice in a pool that begins with these forms."""
        return Family(pool, self.densities, self.products)


@dataclass(frozen=True, eq=False)
class Target:
    """What an inequality asks for: V' <= -kappa V + gamma |u|^2 and P >= p diag(shape), with gamma = ratio * p.

    In discrete time V(x+) - V(x) stands for V', and kappa is the share that V loses in a step.

    kappa = 0 asks for V' < 0 alone; ratio = None leaves the inputs out (some gamma always exists then). `upper` gives
    the constants c of rates for each curve, one per form of its pool, NaN for forms that have none; `lower` the
    constants d of regions, with which P + sum mu d r r' takes the place of P, and P may be indefinite.
    With `deviations` the same is asked of every plant that they allow.
    """

    kappa: float = 0.0
    ratio: float | None = None
    shape: Float[ndarray, " n"] | None = None
    upper: Mapping[Curve, Float[ndarray, " K"]] = field(default_factory=dict)
    lower: Mapping[Curve, Float[ndarray, " K"]] = field(default_factory=dict)
    deviations: tuple[Deviation, ...] = ()

    def shape_of(self, system: System) -> Float[ndarray, " n"]:
        """Return the diagonal of the matrix that P is at least p times."""
        return np.ones(system.n) if self.shape is None else self.shape


def is_broad(system: System, target: Target) -> bool:
    """Whether one hard group among many decides the way to a proof, as it does where no rate is asked for."""
    return len(system.groups) > MANY and not target.kappa


@dataclass(frozen=True, eq=False)
class Multipliers:
    """Numbers of a Lyapunov function: P, and per group mu (one per form) and tau (one per product of the family).

    `s` has one for each deviation; `p` is the part p diag(shape) of P, 0 without a ratio.
    """

    P: Float[ndarray, "n n"]
    mu: tuple[ndarray, ...]
    tau: tuple[ndarray, ...]
    s: Float[ndarray, " d"]
    p: float = 0.0


@dataclass(frozen=True, eq=False)
class Scaling:
    """z = diag(entries) z^, x = diag(states) x^, u = diag(inputs) u^, t = t^ / rate: the units of the inequality.

    The rate is 1 in discrete time, where a step is the unit of time.
    """

    states: Float[ndarray, " n"]
    entries: Float[ndarray, " N"]
    inputs: Float[ndarray, " m"]
    rate: float


def scaling(system: System) -> Scaling:
    """Choose units: of states by rows that read one alone, of channels by f(1), of time by the largest rate.

    States that no row reads alone get units, powers of two, in which the couplings are balanced.
    """
    states, free = np.ones(system.n), np.ones(system.n, bool)
    for group in system.groups:
        support = np.flatnonzero(group.row)
        if len(support) == 1:
            states[support[0]] = 1 / abs(group.row[support[0]])
            free[support[0]] = False
    if free.any():
        states[free] = _balance(_couplings(system) / np.abs(states)[:, None] * np.abs(states), free)
    entries = np.concatenate([states[list(system.states)], np.ones(len(system.channels))])
    for group in system.groups:
        entries[[system.places[c] for c in group.channels]] = sizes(group.curve)[1:]
    squares = np.einsum("ij,ij,j->i", system.G, system.G, entries**2) / states**2  # no second matrix of its size
    rate = 1.0 if system.discrete else float(np.sqrt(squares.sum() / system.n)) or 1.0
    strength = np.linalg.norm(system.B / states[:, None], axis=0) / rate
    return Scaling(states, entries, 1 / np.where(strength > 0, strength, 1.0), rate)


def _couplings(system: System) -> Float[ndarray, "n n"]:
    """Return the sizes of the slopes of x' by the states."""
    slopes = np.zeros((system.n, system.n))
    slopes[:, list(system.states)] = np.abs(system.G[:, : len(system.states)])
    for group in system.groups:
        columns = np.abs(system.G[:, [system.places[c] for c in group.channels]])
        slopes += np.outer((columns * sizes(group.curve)[1:]).sum(axis=1), np.abs(group.row))
    return slopes


def _balance(M: Float[ndarray, "n n"], free: Bool[ndarray, " n"]) -> Float[ndarray, " _"]:
    """Return d for the free states, powers of two, so that rows and columns of M diag(d) / d have like norms.

    It is relative to the others' units, whose mean stays, or to a mean of 1.
    """
    d = sla.matrix_balance(M, permute=False, separate=True)[1][0]
    known = free if free.all() else ~free
    return np.asarray((d / np.exp2(np.round(np.log2(d[known]).mean())))[free])
