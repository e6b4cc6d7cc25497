"""Claim L1 for networks: weights w with V = sum w_k |x_k| decreasing through every node, by value iteration.

For a generator v of node k's cone let d = sum_s v_s A_s[k,k] and N_i = |sum_s v_s A_s[i,k]|, i != k. The claim's
inequality, w_k d + sum_i w_i N_i + kappa w_k v_0 <= 0, reads w >= Phi(w) with

    Phi(w)_k = max over v of  sum_i N_i w_i / (-d - kappa v_0),

monotone and positively homogeneous: w > Phi(w) has a solution if and only if Phi's Perron root is below 1. Then
w <- 1 + Phi(w) increases to one; and as soon as a step adds less than 1, w > Phi(w). Where the root is above 1, a
Perron vector z of the transposed matrix of the worst generators proves that there are no weights.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.sparse import csr_array

from persid.lyapunov.sectors import Curve, axes, nondecreasing_pool, pool
from persid_check.networks.cone import generators
from persid_check.networks.nodes import Functions
from persid_check.networks.table import Table
from persid_check.results import NotProvedError
from persid_check.search.prover import prove_nondecreasing

GENERATORS = 96  # of a cone, in networks of up to SMALL coefficients
FEW_GENERATORS = 64  # in larger ones: with 16 a ring with four functions lost half its rate, with 40 a fortieth
CANDIDATES = 20  # forms that are tried, the most different ones first
SMALL = 200_000
SWEEPS = 400  # of value iteration, at most
INNER = 10  # cheap steps with the worst generators kept, between two sweeps
MARGIN = 0.5  # a step adds at most 1 - MARGIN: how strictly w > Phi(w) is asked for
RATE_SHARE = 0.9  # of the best rate found; the rest is margin
BISECTIONS = 12
FAST = 2_000_000  # generators times entries above which the best rate is sought in two steps
PART = 4000  # nodes of a large network among which a Perron vector is sought
HUGE = 1e14  # weights that spread more than this mean that there are none

Forms = tuple[tuple[float, ...], ...]


@dataclass(frozen=True)
class Cone:
    """Proved forms of one kind of node, and generators of the cone that they cut out, largest entry 1."""

    forms: Forms
    rays: tuple[tuple[int, ...], ...]

    @property
    def unit(self) -> Float[ndarray, "g s"]:
        """The generators as floats with largest entry 1."""
        return np.array([[float(Fraction(c, max(map(abs, ray)))) for c in ray] for ray in self.rays])


@dataclass(frozen=True, eq=False)
class Weights:
    """A solution in floating point: w > 0 with smallest entry 1, and the rate kappa, 1/s."""

    w: Float[ndarray, " n"]
    kappa: float


@dataclass(frozen=True, eq=False)
class Perron:
    """What excludes weights, in floating point: z >= 0 and for each node the generator that it is worst with."""

    z: Float[ndarray, " n"]
    choice: ndarray


@lru_cache(maxsize=512)
def cone(functions: Functions, every: bool, most: int) -> Cone:
    """Return the cone of one kind of node: as many proved forms as leave it at most `most` generators.

    With `every`, forms are nondecreasing: they serve about every equilibrium at once.
    """
    curve = Curve(tuple(text for text, _ in functions), tuple(alpha for _, alpha in functions))
    y = (1.0, *(0.0,) * (curve.size - 1))
    if curve.size == 1:
        return Cone((), generators((_exact(y),), 1))
    rising = nondecreasing_pool(curve)
    listed = [*axes(curve), *rising] if every else [*rising, *pool(curve), *axes(curve)]
    forms: list[tuple[float, ...]] = []
    rays = generators((_exact(y),), curve.size)
    for form in list(dict.fromkeys(listed))[:CANDIDATES]:
        if form == y or all(_dot(form, ray) >= 0 for ray in rays) or not _proves(curve, form, every):
            continue
        try:
            cut = generators([_exact(f) for f in (y, *forms, form)], curve.size)
        except NotProvedError:
            break
        if len(cut) <= max(most, len(rays)):
            forms, rays = [*forms, form], cut
    return Cone(tuple(forms), rays)


def _proves(curve: Curve, form: tuple[float, ...], every: bool) -> bool:
    return prove_nondecreasing(curve.exact, _exact(form)) if every else curve.proves(form)


def _exact(form: Sequence[float]) -> tuple[Fraction, ...]:
    return tuple(Fraction(c) for c in form)


def _dot(form: Sequence[float], ray: Sequence[int]) -> Fraction:
    return sum((Fraction(c) * r for c, r in zip(form, ray, strict=True)), Fraction(0))


@dataclass(frozen=True, eq=False)
class Network:
    """Generators laid over a table: for the r-th one of every node, N (nodes x rows, sparse), d and v_0.

    Nodes of kinds with fewer generators repeat their last one.
    """

    table: Table
    cones: tuple[Cone, ...]
    N: tuple[csr_array, ...]
    d: Float[ndarray, "g n"]
    v0: Float[ndarray, "g n"]


def network(table: Table, every: bool) -> Network:
    """Return the network of a table with the cones of its kinds; with `every`, of nondecreasing forms."""
    size = table.values.shape[1] + table.n
    most = GENERATORS if size <= SMALL else FEW_GENERATORS
    cones = tuple(cone(functions, every, most) for functions in table.kinds)
    rays = laid_out(cones, len(table.values))
    count = len(rays)
    starts = np.searchsorted(table.node, np.arange(table.n + 1))
    number = np.float64 if count * size <= 10 * FAST else np.float32  # the checker decides, in exact terms
    coupled = [s for s in range(len(table.values)) if table.values[s].any()]
    N = []
    for ray in rays:
        T = sum(
            (_spread(ray[:, s], table.kind, table.node) * table.values[s] for s in coupled), np.zeros(len(table.row))
        )
        N.append(csr_array((np.abs(T).astype(number), table.row, starts), shape=(table.n, table.n)))
    d = np.stack([sum(_spread(ray[:, s], table.kind) * D for s, D in enumerate(table.diagonal)) for ray in rays])
    v0 = np.stack([np.broadcast_to(_spread(ray[:, 0], table.kind), table.n) for ray in rays])
    return Network(table, cones, tuple(N), d, v0)


def laid_out(cones: Sequence[Cone], slots: int) -> Float[ndarray, "g kinds s"]:
    """Return the r-th generator of every kind; kinds of fewer generators repeat their last one."""
    count = max(len(found.rays) for found in cones)
    rays = np.zeros((count, len(cones), slots))
    for t, found in enumerate(cones):
        unit = found.unit
        rays[:, t, : unit.shape[1]] = unit[np.minimum(np.arange(count), len(unit) - 1)]
    return rays


def _spread(values: ndarray, kind: ndarray, node: ndarray | None = None) -> ndarray | float:
    """Return a number of each kind for each node, or for the node of each entry."""
    if len(values) == 1:
        return float(values[0])
    return np.asarray(values[kind if node is None else kind[node]])


def find_weights(net: Network) -> Weights | Perron | None:
    """Return weights with nearly the best rate, or what excludes them, or None where neither was found."""
    found = _solve(net, 0.0)
    if not isinstance(found, ndarray):
        return found
    low, best = 0.0, found
    high = min(float(np.min(-d[v0 > 0] / v0[v0 > 0], initial=np.inf)) for d, v0 in zip(net.d, net.v0, strict=True))
    if not np.isfinite(high):  # no generator has a y-part: nothing decays in proportion to |x|
        return None
    steps = BISECTIONS if len(net.N) * net.N[0].nnz <= FAST else 2
    for _ in range(steps):
        middle = (low + high) / 2
        found = _solve(net, middle)
        if isinstance(found, ndarray):
            low, best = middle, found
        else:
            high = middle
    gentle = _solve(net, RATE_SHARE * low) if low and steps == BISECTIONS else best
    return rated(net, gentle if isinstance(gentle, ndarray) else best)


def rated(net: Network, w: Float[ndarray, " n"]) -> Weights | None:
    """Return weights, their smallest 1, with the rate that they have; None if they have none."""
    w = w / w.min()
    kappa = np.inf
    for N, d, v0 in zip(net.N, net.d, net.v0, strict=True):
        decays = v0 > 0
        kappa = min(kappa, np.min(-(N @ w + d * w)[decays] / (w * v0)[decays], initial=np.inf))
    kappa = float(kappa) * (1 - 2.0**-18)
    return Weights(w, kappa) if 0 < kappa < np.inf else None


def _solve(net: Network, kappa: float) -> ndarray | Perron | None:
    """Return w > Phi(w) at a rate, by value iteration sped up by steps with the worst generators kept."""
    alone = _alone(net, kappa)
    if alone is not None:
        return None if kappa else _single(net, *alone)
    w = np.ones(net.table.n)
    for _ in range(SWEEPS // INNER):
        load, worst = _sweep(net, kappa, w)
        step = 1 + load - w
        if step.max() <= 1 - MARGIN:
            return w
        if (step >= 1).all() or not w.max() < HUGE:  # Phi(w) >= w: by Collatz and Wielandt its root is at least 1
            break
        policy, room = _policy(net, worst), _room(net, kappa, worst)
        w = w + step
        for _ in range(INNER):
            w = np.maximum(w, 1 + (policy @ w) / room)
    return None if kappa else _perron(net, worst, _policy(net, worst), _room(net, kappa, worst))


def _sweep(net: Network, kappa: float, w: ndarray) -> tuple[ndarray, ndarray]:
    """Return Phi(w) and for each node the generator where it is attained."""
    load, worst = np.zeros(len(w)), np.zeros(len(w), np.int64)
    for r, (N, d, v0) in enumerate(zip(net.N, net.d, net.v0, strict=True)):
        room = -d - kappa * v0
        room[room <= 0] = np.inf  # of a generator without any coefficient
        here = (N @ w) / room
        worse = here > load
        load[worse], worst[worse] = here[worse], r
    return load, worst


def _room(net: Network, kappa: float, worst: ndarray) -> ndarray:
    """Return -d - kappa v_0 of one generator for each node."""
    nodes = np.arange(net.table.n)
    room = -net.d[worst, nodes] - kappa * net.v0[worst, nodes]
    return np.where(room > 0, room, np.inf)


def _alone(net: Network, kappa: float) -> tuple[int, int] | None:
    """Return a generator and a node that it keeps from decaying at the rate, whatever the weights."""
    for r, (N, d, v0) in enumerate(zip(net.N, net.d, net.v0, strict=True)):
        room = -d - kappa * v0
        bad = room <= 0
        if bad.any():
            coupled = np.diff(np.concatenate([[0.0], np.cumsum(N.data, dtype=float)])[N.indptr]) > 0
            growing = np.flatnonzero(bad & ((room < 0) | (v0 > 0) | coupled))
            if len(growing):
                return r, int(growing[0])
    return None


def _policy(net: Network, worst: ndarray) -> csr_array:
    """Return the matrix of one generator for each node."""
    first = net.N[0]
    if len(net.N) == 1:
        return first
    choice = np.repeat(worst, np.diff(first.indptr))
    data = np.zeros_like(first.data)
    for r, N in enumerate(net.N):
        here = choice == r
        data[here] = N.data[here]
    return csr_array((data, first.indices, first.indptr), shape=first.shape)


def _single(net: Network, r: int, k: int) -> Perron:
    """Return the obstruction of a node that one of its generators lets grow."""
    z, choice = np.zeros(net.table.n), np.zeros(net.table.n, np.int64)
    z[k], choice[k] = 1.0, r
    return Perron(z, choice)


def _perron(net: Network, worst: ndarray, policy: csr_array, space: ndarray) -> Perron | None:
    """Return z with sum_k N_ik z_k >= -d_i z_i by power iteration, small entries cut off, on a part of a large network.

    Outside of its support z asks for nothing, since N >= 0; so a part that grows by itself is enough.
    """
    into = policy.T.tocsr()
    n = net.table.n
    z = _powers(into, space, np.ones(n), 30 if n > PART else SWEEPS)
    if n > PART:
        part = _part(policy, into, int(z.argmax()))
        z = np.zeros(n)
        z[part] = _powers(into[part][:, part], space[part], np.ones(len(part)), SWEEPS)
    z[z < 1e-9] = 0
    grows = (into @ z >= space * z)[z > 0].all()
    return Perron(z, worst) if grows else None


def _powers(into: csr_array, space: ndarray, z: ndarray, count: int) -> ndarray:
    """Return a power of (I + N / space) / 2 applied to z, with largest entry 1."""
    for _ in range(count):
        z = (z + into @ z / space) / 2
        z = z / z.max()
    return z


def _part(policy: csr_array, into: csr_array, start: int) -> ndarray:
    """Return about PART nodes nearest to one."""
    reached = np.zeros(policy.shape[0], bool)
    reached[start] = True
    count = 0
    while count < reached.sum() < PART:
        count = int(reached.sum())
        reached |= (policy @ reached + into @ reached) > 0
    return np.flatnonzero(reached)[: 2 * PART]
