"""The matrix inequality of the claims: from sector forms to a problem for the interior-point method, and back.

With z = (x, channel values), x' = G z + B u and half the gradient of V equal to E'z (theory: claims G and M),

    Q = E G + G'E' + S,    E = [P; 0] + sum_g N_g'lambda_g r_g',    S = sum_g sum_{k<l} tau_gkl N_g'(l_k l_l' + l_l l_k')N_g,

where N_g z = phi_g. Every unknown is a pair of rows: P_ij (e_i, G_j), mu_gk (N_g'l_k, G'r_g), tau_gkl (N_g'l_k, N_g'l_l).
Paper: thm:main_ISS and cor:extension_basis_function are the special cases with the forms e_0, …, e_J only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import sparse

from persid.interior_point import Problem, unpack
from persid.model import PersidskiiModel
from persid.sector import Curve, Group, groups, sizes

SAMPLES = 6  # points of the sector cone per entry of z from which the first dual matrix is averaged


@dataclass(frozen=True, eq=False)
class System:
    """x' = G z + B u about its operating point, z = (x_i for i in `states`, values of `channels`), with its groups.

    Entries of z with a zero column of G that no form touches are left out: channels without effect, and in claim M
    states that enter through radially unbounded functions alone.
    """

    G: Float[ndarray, "n N"]
    B: Float[ndarray, "n m"]
    groups: tuple[Group, ...]
    states: tuple[int, ...]
    channels: tuple[int, ...]

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.G)

    @cached_property
    def places(self) -> dict[int, int]:
        """The entry of z of each channel that has one."""
        return {c: len(self.states) + k for k, c in enumerate(self.channels)}

    def lift(self, group: Group, forms: Float[ndarray, "K d"]) -> Float[ndarray, "K N"]:
        """Return the rows l'N_g of forms of a group."""
        rows = np.zeros((len(forms), self.G.shape[1]))
        rows[:, : len(self.states)] = forms[:, :1] * group.row[list(self.states)]
        rows[:, [self.places[c] for c in group.channels]] = forms[:, 1:]
        return rows


def system(model: PersidskiiModel, pools: Mapping[Curve, Float[ndarray, "K d"]]) -> System:
    """Return the system of a model about (x_ref, u_ref), the constant b as one more input.

    A state is dropped only where its column is zero and no group that reads it has forms of both signs in y: then
    -Q can have nothing but zero there (claim M).
    """
    channels = model.channels
    found = groups(channels)
    active = tuple(int(c) for c in np.flatnonzero(channels.columns.any(axis=0)))
    kept = tuple(i for i in range(model.n) if channels.A0[:, i].any() or _needs_state(i, found, pools))
    G = np.hstack([channels.A0[:, list(kept)], channels.columns[:, list(active)]])
    B = np.hstack([model.B, model.b[:, None]]) if model.b.any() else model.B
    return System(G, B, found, kept, active)


def _needs_state(i: int, found: Sequence[Group], pools: Mapping[Curve, ndarray]) -> bool:
    """Whether state i must stay an entry of z: a group has forms of both signs in y, or nothing else reads the state."""
    reading = [group for group in found if group.row[i] and group.channels]
    return not reading or any((pools[g.curve][:, 0] > 0).any() and (pools[g.curve][:, 0] < 0).any() for g in reading)


@dataclass(frozen=True, eq=False)
class Family:
    """The forms of one group, those allowed in V (`densities`) and the pairs (k, l) whose product may be a multiplier."""

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
class Multipliers:
    """Numbers of a Lyapunov function: P, and per group mu (one per form) and tau (one per product of the family)."""

    P: Float[ndarray, "n n"]
    mu: tuple[ndarray, ...]
    tau: tuple[ndarray, ...]


@dataclass(frozen=True, eq=False)
class Scaling:
    """z = diag(entries) z^, x = diag(states) x^, t = t^ / rate: the units in which the inequality is solved."""

    states: Float[ndarray, " n"]
    entries: Float[ndarray, " N"]
    rate: float


def scaling(system: System) -> Scaling:
    """Choose units: a state by the rows that read it alone, a channel by its function at y = 1, time by the largest rate."""
    states = np.ones(system.n)
    for group in system.groups:
        support = np.flatnonzero(group.row)
        if len(support) == 1:
            states[support[0]] = 1 / abs(group.row[support[0]])
    entries = np.concatenate([states[list(system.states)], np.ones(len(system.channels))])
    for group in system.groups:
        units = sizes(group.curve) * np.abs(group.row @ states if np.count_nonzero(group.row) > 1 else 1.0)
        entries[[system.places[c] for c in group.channels]] = np.where(units[1:] > 0, units[1:], 1.0)
    G = system.G / states[:, None] * entries
    rate = np.linalg.norm(G) / np.sqrt(system.n)
    return Scaling(states, entries, float(rate) or 1.0)


@dataclass(frozen=True, eq=False)
class Assembly:
    """A Problem together with what is needed to read multipliers back in the user's units.

    Unknown j is the multiplier times `sizes[j]`; the unknowns of group g begin at `offsets[g]`.
    """

    system: System
    families: tuple[Family, ...]
    units: Scaling
    problem: Problem
    sizes: Float[ndarray, " J"]
    offsets: tuple[int, ...] = field(repr=False)

    def multipliers(self, y: Float[ndarray, " J"]) -> Multipliers:
        """Return the multipliers of a solution in the user's units."""
        kept = list(self.system.states)
        scaled = unpack(self.problem, y) if self.problem.symmetric else np.diag(y[: len(kept)])
        states = self.units.states[kept]
        P = np.zeros((self.system.n, self.system.n))
        P[np.ix_(kept, kept)] = scaled / (states[:, None] * states * self.units.rate)
        values = y / self.sizes
        mu, tau = [], []
        for family, start in zip(self.families, self.offsets, strict=True):
            middle = start + len(family.densities)
            full = np.zeros(len(family.forms))
            full[list(family.densities)] = values[start:middle]
            mu.append(full)
            tau.append(values[middle : middle + len(family.products)])
        return Multipliers(P, tuple(mu), tuple(tau))


def assemble(system: System, families: Sequence[Family], *, full_P: bool = False) -> Assembly:
    """Make the interior-point problem of claims G and M: maximise the margin t of -Q >= t I over P, mu and tau."""
    units, k = scaling(system), len(system.states)
    builder = _Builder(system, units)
    if full_P:
        builder.add(np.repeat(range(k), k), builder.outer(np.tile(system.states, k)), np.ones(k * k), 1.0)
    else:
        builder.add(np.arange(k), builder.outer(np.array(system.states, int)), np.ones(k), 1.0)
    offsets = []
    for group, family in zip(system.groups, families, strict=True):
        offsets.append(builder.count - (k * (k - 1) // 2 if full_P else 0))
        rows, norms = builder.forms(system.lift(group, family.forms), family.used)
        chosen = list(family.densities)
        gradient, size = builder.gradient(group.row)
        builder.add(rows[chosen], np.full(len(chosen), gradient), norms[chosen] * size, 1.0)
        first, second = np.array(family.products, int).reshape(-1, 2).T
        builder.add(rows[first], rows[second], norms[first] * norms[second], 0.0)
    problem, sizes = builder.problem(k if full_P else 0)
    return Assembly(system, tuple(families), units, problem, sizes, tuple(offsets))


class _Builder:
    """Collects the rows of D = [S; H] and the pairs; rows of H are counted from -1 downwards until S is complete."""

    def __init__(self, system: System, units: Scaling) -> None:
        self.system, self.units = system, units
        self.H = [system.G / units.states[:, None] * units.entries / units.rate]
        self.heights = system.n
        self.S = [sparse.csr_array(sparse.eye_array(len(system.states), system.G.shape[1]))]
        self.height = len(system.states)
        self.p: list[ndarray] = []
        self.q: list[ndarray] = []
        self.sizes: list[ndarray] = []
        self.costs: list[ndarray] = []
        self.count = 0

    def outer(self, i: ndarray) -> ndarray:
        """Return the code of row i of H."""
        return -1 - i

    def add(self, p: ndarray, q: ndarray, sizes: ndarray, cost: float) -> None:
        """Add pairs of rows p (of S) and q (of S, or of H in code)."""
        self.p.append(p)
        self.q.append(q)
        self.sizes.append(sizes)
        self.costs.append(np.full(len(p), cost))
        self.count += len(p)

    def forms(self, lifted: ndarray, used: list[int]) -> tuple[ndarray, ndarray]:
        """Add the rows l'N_g in use, in the units of z and made unit vectors; return places in S and norms of all."""
        rows = lifted * self.units.entries
        norms = np.linalg.norm(rows, axis=1)
        places = np.full(len(rows), -1)
        places[used] = np.arange(self.height, self.height + len(used))
        self.S.append(sparse.csr_array(rows[used] / norms[used, None]))
        self.height += len(used)
        return places, norms

    def gradient(self, row: ndarray) -> tuple[int, float]:
        """Return the code and the size of r'G: a row of H where r reads one state, a new one otherwise."""
        support = np.flatnonzero(row)
        if len(support) == 1:
            i = int(support[0])
            return -1 - i, float(row[i] * self.units.states[i] * self.units.rate)
        product = row @ self.system.G * self.units.entries
        size = float(np.linalg.norm(product)) or 1.0
        self.H.append(product[None] / size)
        self.heights += 1
        return -self.heights, size

    def problem(self, symmetric: int) -> tuple[Problem, ndarray]:
        """Return the finished problem and the sizes of its unknowns."""
        S, H = sparse.csr_array(sparse.vstack(self.S)), np.vstack(self.H)
        p, q = np.concatenate(self.p).astype(int), np.concatenate(self.q).astype(int)
        q = np.where(q < 0, S.shape[0] - 1 - q, q)
        cost, sizes, tie = np.concatenate(self.costs), np.concatenate(self.sizes), None
        if symmetric:
            tie = _tie(symmetric, len(p) - symmetric**2)
            head = np.eye(symmetric)[np.triu_indices(symmetric)] * 2
            cost = np.concatenate([head, cost[symmetric**2 :]])
            sizes = np.concatenate([np.ones(len(head)), sizes[symmetric**2 :]])
        X = _interior(self.system, self.units)
        return Problem(S, H, p, q, cost, X, symmetric, tie), sizes


def _tie(k: int, others: int) -> sparse.csr_array:
    """Sum the k^2 pairs (e_i, G_j) into the upper triangle of a symmetric matrix; leave the other pairs alone."""
    place = np.zeros((k, k), int)
    i, j = np.triu_indices(k)
    place[i, j] = place[j, i] = np.arange(len(i))
    columns = np.concatenate([place.ravel(), len(i) + np.arange(others)])
    weights = np.concatenate([(1 + np.eye(k)).ravel(), np.ones(others)])
    return sparse.csr_array((weights, (np.arange(len(columns)), columns)))


def _interior(system: System, units: Scaling) -> ndarray:
    """Return a matrix in the interior of the sector cone: the mean of z z' over points z of the model, plus a little I.

    Every product of two forms is positive there, since it is nonnegative on each point.
    """
    rng = np.random.default_rng(0)
    count = SAMPLES * system.G.shape[1] + 20
    magnitude = np.exp(rng.uniform(np.log(0.1), np.log(5.0), (count, system.n)))
    x = magnitude * rng.choice([-1.0, 1.0], magnitude.shape) * units.states
    z = np.zeros((count, system.G.shape[1]))
    z[:, : len(system.states)] = x[:, list(system.states)]
    for group in system.groups:
        y = x @ group.row
        if group.curve.domain is not None:
            low, high = (float(end) for end in group.curve.domain)
            y = np.clip(y, 0.95 * low, 0.95 * high)
        with np.errstate(over="ignore"):
            z[:, [system.places[c] for c in group.channels]] = np.clip(group.curve.values(y)[:, 1:], -1e6, 1e6)
    z /= units.entries
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    X = z.T @ z / count
    return X + 1e-4 * np.eye(len(X)) * np.trace(X) / len(X)


def theorem_1(
    Gamma: Sequence[Float[ndarray, "n n"]],
    P: Float[ndarray, "n n"],
    Lambda: Sequence[Float[ndarray, " n"]],
    Xi: Sequence[Float[ndarray, " n"]],
    Upsilon: Mapping[tuple[int, int], Float[ndarray, " n"]],
    Phi: Float[ndarray, "n n"],
) -> Float[ndarray, "k k"]:
    """Return the matrix Q of the paper's Theorem 1 exactly as printed, for x' = sum_j Gamma_j f_j(x) + B u.

    Q_11 = 0, so Q <= 0 forces its first block row to vanish: P = 0 and Upsilon_0j = 0. What is left is claim M without
    any x, `reduced_theorem_1`. Diagonal matrices are given by their diagonals; Upsilon by pairs (s, z), 0 <= s < z <= M.
    Paper: thm:main_ISS, eq:main_thm_LMIs (Sec. 4.2).
    """
    n, M = len(P), len(Gamma)
    Q = np.zeros((n * (M + 2), n * (M + 2)))
    view = Q.reshape(M + 2, n, M + 2, n)
    for j in range(1, M + 1):
        view[0, :, j] = P @ Gamma[j - 1] + np.diag(Upsilon.get((0, j), np.zeros(n)))
        view[j, :, M + 1] = np.diag(Lambda[j - 1])
        for z in range(j, M + 1):
            view[j, :, z] = Gamma[j - 1].T * Lambda[z - 1] + Lambda[j - 1][:, None] * Gamma[z - 1]
            view[j, :, z] += np.diag(Xi[j - 1] if z == j else Upsilon.get((j, z), np.zeros(n)))
    view[0, :, M + 1], view[M + 1, :, M + 1] = P, -Phi
    return np.triu(Q) + np.triu(Q, 1).T


def reduced_theorem_1(
    Gamma: Sequence[Float[ndarray, "n n"]],
    Lambda: Sequence[Float[ndarray, " n"]],
    Xi: Sequence[Float[ndarray, " n"]],
    Upsilon: Mapping[tuple[int, int], Float[ndarray, " n"]],
) -> Float[ndarray, "k k"]:
    """Return what Theorem 1 comes to: the blocks of Q between f_1, …, f_M, for P = 0 and Upsilon_0j = 0.

    Paper: thm:main_ISS (Sec. 4.2), reduced.
    """
    G = np.hstack(list(Gamma))
    E = np.vstack([np.diag(line) for line in Lambda])
    n, S = len(E[0]), np.diag(np.concatenate(list(Xi)))
    for (s, z), line in Upsilon.items():
        if s > 0:
            S[(s - 1) * n : s * n, (z - 1) * n : z * n] += np.diag(line)
            S[(z - 1) * n : z * n, (s - 1) * n : s * n] += np.diag(line)
    return E @ G + G.T @ E.T + S


def corollary_1(system: System) -> tuple[Family, ...]:
    """Return the families of Corollary 1, corrected: every f_j and y itself in V, every product of two of them in one group.

    The printed term R_s'R_s Upsilon R_r'R_r has the wrong shape unless all k_s = n, and is then no multiplier: products
    of functions of different rows have no sign. With R_j = I and x among the f_j this is Theorem 1's content too.
    Paper: cor:extension_basis_function (Sec. 4.3).
    """
    return tuple(Family.full(np.eye(group.curve.size)[: None if group.channels else 0]) for group in system.groups)
