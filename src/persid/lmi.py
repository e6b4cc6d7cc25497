"""The matrix inequality of the claims: from sector forms to a problem for the interior-point method, and back.

With z = (x, channel values), x' = G z + B u and half the gradient of V equal to E'z (theory: claims G and M),

    Q = E G + G'E' + S,   E = [P; 0] + sum_g N_g'lambda_g r_g',  S = sum_g sum_kl tau_gkl N_g'(l_k l_l' + l_l l_k')N_g

with N_g z = phi_g. Every unknown is a pair of rows: P_ij: e_i, G_j; mu_gk: N_g'l_k, G'r_g; tau_gkl: N_g'l_k, N_g'l_l.
Paper: thm:main_ISS and cor:extension_basis_function are the special cases with the forms e_0, …, e_J only.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy import sparse

from persid.interior_point import Problem, pairings, unpack
from persid.sector import Group
from persid.system import Family, Multipliers, Scaling, System, Target, scaling

SAMPLES = 6  # points of the sector cone per entry of z from which the first dual matrix is averaged


@dataclass(frozen=True, eq=False)
class Assembly:
    """A Problem together with what is needed to read multipliers back in the user's units.

    Unknown j is the multiplier times `sizes[j]`; the unknowns of group g begin at `offsets[g]`; a last unknown is p
    where the target has a ratio.
    """

    system: System
    families: tuple[Family, ...]
    target: Target
    units: Scaling
    problem: Problem
    sizes: Float[ndarray, " J"]
    offsets: tuple[int, ...] = field(repr=False)

    def multipliers(self, y: Float[ndarray, " J"]) -> Multipliers:
        """Return the multipliers of a solution in the user's units."""
        kept = list(self.system.states)
        values = y / self.sizes
        states = self.units.states[kept]
        P = np.zeros((self.system.n, self.system.n))
        if self.problem.symmetric:
            scaled = unpack(self.problem, y)
            P[np.ix_(kept, kept)] = scaled / (states[:, None] * states * self.units.rate)
        else:
            P[kept, kept] = values[: len(kept)]
        if self.target.ratio is not None:
            P += values[-1] * np.diag(_shape(self.target, self.system))
        mu, tau = [], []
        for group, family, start in zip(self.system.groups, self.families, self.offsets, strict=True):
            middle = start + len(family.densities)
            full = np.zeros(len(family.forms))
            full[list(family.densities)] = values[start:middle]
            P -= float(full @ self.target.lower.get(group.curve, np.zeros(len(full)))) * np.outer(group.row, group.row)
            mu.append(full)
            tau.append(values[middle : middle + len(family.products)])
        return Multipliers(P, tuple(mu), tuple(tau))

    def prices(self, g: int, X: Float[ndarray, "w w"]) -> tuple[Float[ndarray, "K K"], Float[ndarray, " K"]]:
        """Return <F, X> of every product and of every density of group g, as unknowns of this problem would have it.

        A product, or a density after adding the dual bound m, may help only where its price is negative; densities
        without a constant c get NaN where the target has a rate.
        """
        group, family = self.system.groups[g], self.families[g]
        builder = _Builder(self.system, self.units, self.target)
        places, norms = builder.forms(self.system.lift(group, family.forms), list(range(len(family.forms))))
        upper = self.target.upper.get(group.curve, np.ones(len(places)))
        rated = np.flatnonzero(np.isfinite(upper) | (self.target.kappa == 0))
        for k in rated:
            builder.density(group, int(k), int(places[k]), float(norms[k]))
        problem = builder.problem(0, X)
        worth = np.full(len(places), np.nan)
        worth[rated] = pairings(problem, X)
        rows = problem.S[places]
        return 2 * (rows @ (rows @ X).T), worth


def _shape(target: Target, system: System) -> ndarray:
    return np.ones(system.n) if target.shape is None else target.shape


def assemble(
    system: System, families: Sequence[Family], *, full_P: bool = False, target: Target | None = None
) -> Assembly:
    """Make the interior-point problem of a claim: maximise the margin t of its matrix inequality over P, mu and tau."""
    target = target or Target()
    builder = _Builder(system, scaling(system), target)
    k = len(system.states)
    builder.quadratic(full_P)
    offsets = []
    for group, family in zip(system.groups, families, strict=True):
        offsets.append(len(builder.cost))
        places, norms = builder.forms(system.lift(group, family.forms), family.used)
        for form in family.densities:
            builder.density(group, form, int(places[form]), float(norms[form]))
        for first, second in family.products:
            size = float(norms[first] * norms[second])
            builder.unknown([int(places[first])], [int(places[second])], [1.0], size, 0.0)
    if target.ratio is not None:
        builder.smallest_eigenvalue()
    problem = builder.problem(k if full_P else 0, builder.interior())
    return Assembly(system, tuple(families), target, builder.units, problem, np.array(builder.sizes), tuple(offsets))


class _Builder:
    """Collects rows of D = [S; H] and pairs; row i of H has the code -1 - i until the number of rows of S is known."""

    def __init__(self, system: System, units: Scaling, target: Target) -> None:
        self.system, self.units, self.target = system, units, target
        inputs = system.B.shape[1] if target.ratio is not None else 0
        self.width = system.entries + inputs
        self.weights = np.concatenate([units.entries, units.inputs[:inputs]])
        self.flow = np.hstack([system.G, system.B[:, :inputs]]) * self.weights / units.rate
        k = len(system.states)
        unit_rows = np.concatenate([np.arange(k), np.arange(system.entries, self.width)])
        self.S = [sparse.csr_array((np.ones(len(unit_rows)), (np.arange(len(unit_rows)), unit_rows)),
                                   shape=(len(unit_rows), self.width))]  # fmt: skip
        self.height = len(unit_rows)
        self.H: list[ndarray] = []
        self.codes: dict[tuple[int, float], int] = {}
        self.p: list[int] = []
        self.q: list[int] = []
        self.owner: list[int] = []
        self.weight: list[float] = []
        self.sizes: list[float] = []
        self.cost: list[float] = []

    def unknown(self, p: Sequence[int], q: Sequence[int], weight: Sequence[float], size: float, cost: float) -> None:
        """Add an unknown that is the weighted sum of pairs of rows p (of S) and q (of S, or of H in code)."""
        self.p += p
        self.q += q
        self.weight += weight
        self.owner += [len(self.cost)] * len(p)
        self.sizes.append(size)
        self.cost.append(cost)

    def forms(self, lifted: ndarray, used: list[int]) -> tuple[ndarray, ndarray]:
        """Add the rows l'N_g in use, in the units of z and made unit vectors; return places in S and norms of all."""
        rows = np.zeros((len(lifted), self.width))
        rows[:, : self.system.entries] = lifted * self.units.entries
        norms = np.linalg.norm(rows, axis=1)
        places = np.full(len(rows), -1)
        places[used] = np.arange(self.height, self.height + len(used))
        self.S.append(sparse.csr_array(rows[used] / norms[used, None]))
        self.height += len(used)
        return places, norms

    def density(self, group: Group, k: int, place: int, norm: float) -> None:
        """Add mu of form k: its own pair, and on a domain -d r r' in P, which its integral makes up for."""
        c = self.target.upper[group.curve][k] if group.curve in self.target.upper else 1.0
        d = self.target.lower[group.curve][k] if group.curve in self.target.lower else 0.0
        code, size = self.gradient(group.row, float(c))
        size *= norm
        if not d:
            return self.unknown([place], [code], [1.0], size, 1.0)
        places, norms = self.forms(self.system.lift(group, np.eye(1, group.curve.size)), [0])
        half, half_size = self.gradient(group.row, 0.5)
        weight = -float(d) * float(norms[0]) * half_size / size
        return self.unknown([place, int(places[0])], [code, half], [1.0, weight], size, 1.0)

    def gradient(self, row: ndarray, upper: float) -> tuple[int, float]:
        """Return the code and the size of r'(G + kappa c I_x): W adds kappa c y l'phi to what V' has to outweigh."""
        upper = upper if self.target.kappa else 0.0
        support = np.flatnonzero(row)
        if len(support) == 1 and row[support[0]] * self.units.states[support[0]] > 0:  # else mu would be negative
            i = int(support[0])
            if (i, upper) not in self.codes:
                unit = np.zeros(self.system.n)
                unit[i] = 1.0
                self.codes[i, upper] = self._append(self._decaying(unit, upper) / self.units.states[i])
            return self.codes[i, upper], float(row[i] * self.units.states[i] * self.units.rate)
        product = self._decaying(row, upper)
        size = float(np.linalg.norm(product)) or 1.0
        return self._append(product / size), size * self.units.rate

    def _decaying(self, row: ndarray, upper: float) -> ndarray:
        product = row @ self.flow
        if upper:
            k = len(self.system.states)
            product[:k] += (
                self.target.kappa * upper * row[list(self.system.states)] * self.weights[:k] / self.units.rate
            )
        return product

    def _append(self, row: ndarray) -> int:
        self.H.append(row)
        return -len(self.H)

    def quadratic(self, full_P: bool) -> None:
        """Add the entries of P: half of x'Px is its own constant c = 1/2."""
        states, k = self.system.states, len(self.system.states)
        units = np.eye(self.system.n)
        codes = [self.gradient(units[i], 0.5)[0] for i in states]
        for i in range(k):
            if not full_P:
                self.unknown([i], [codes[i]], [1.0], self.units.states[states[i]] ** 2 * self.units.rate, 1.0)
            for j in range(i, k if full_P else i):
                self.unknown([i, j], [codes[j], codes[i]], [1.0, 1.0], 1.0, 2.0 if i == j else 0.0)

    def smallest_eigenvalue(self) -> None:
        """Add p: P - p diag(shape) is what the entries of P stand for, and gamma = ratio p bounds the inputs."""
        k, rate = len(self.system.states), self.units.rate
        codes = [self.gradient(unit, 0.5)[0] for unit in np.eye(self.system.n)]
        shape = _shape(self.target, self.system) * self.units.states**2 * rate
        inputs = range(k, k + self.width - self.system.entries)
        ratio = -0.5 * float(self.target.ratio or 0.0) * self.weights[self.system.entries :] ** 2
        size = float(shape.max())
        weights = [*(shape / size), *(ratio / size)]
        self.unknown([*range(k), *inputs], [*codes, *inputs], weights, size, float(shape.sum() / size))

    def interior(self) -> ndarray:
        """Return a first dual matrix: in the interior of the sector cone, a multiple of I for the inputs."""
        X = np.eye(self.width) / self.width
        X[: self.system.entries, : self.system.entries] = _interior(self.system, self.units)
        return X

    def problem(self, symmetric: int, X: ndarray) -> Problem:
        """Return the finished problem."""
        S, p, q = sparse.csr_array(sparse.vstack(self.S)), np.array(self.p, int), np.array(self.q, int)
        H = np.array(self.H).reshape(-1, self.width)
        q = np.where(q < 0, S.shape[0] - 1 - q, q)
        tie = None
        if len(p) > len(self.cost):
            tie = sparse.csr_array((self.weight, (np.arange(len(p)), self.owner)), shape=(len(p), len(self.cost)))
        return Problem(S, H, p, q, np.array(self.cost), X, symmetric, tie)


def _interior(system: System, units: Scaling) -> ndarray:
    """Return a matrix in the interior of the sector cone: the mean of z z' over points z of the model, plus a little I.

    Every product of two forms is positive there, since it is nonnegative on each point.
    """
    rng = np.random.default_rng(0)
    count = SAMPLES * system.entries + 20
    magnitude = np.exp(rng.uniform(np.log(0.1), np.log(5.0), (count, system.n)))
    x = magnitude * rng.choice([-1.0, 1.0], magnitude.shape) * units.states
    x *= np.min([np.ones(count), *(_share_inside(group, x) for group in system.groups)], axis=0)[:, None]
    z = np.zeros((count, system.entries))
    z[:, : len(system.states)] = x[:, list(system.states)]
    for group in system.groups:
        with np.errstate(over="ignore"):
            values = group.curve.values(x @ group.row)[:, 1:]
        z[:, [system.places[c] for c in group.channels]] = values
    z = np.clip(np.nan_to_num(z / units.entries), -1e6, 1e6)
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    X = z.T @ z / count
    return X + 1e-4 * np.eye(len(X)) * np.trace(X) / len(X)


def _share_inside(group: Group, x: ndarray) -> ndarray:
    """Return the factors by which points x must shrink so that r'x lies well inside the domain of a group."""
    if group.curve.domain is None:
        return np.ones(len(x))
    y = x @ group.row
    limit = np.where(y < 0, -float(group.curve.domain[0]), float(group.curve.domain[1]))
    return np.minimum(1.0, 0.98 * limit / np.maximum(np.abs(y), 1e-300))


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
    any x, `reduced_theorem_1`. Diagonal matrices are given by their diagonals, Upsilon by pairs (s, z), s < z.
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
    """Return the families of Corollary 1, corrected: y and every f_j in V, every product of two of them in one group.

    The printed term R_s'R_s Upsilon R_r'R_r has the wrong shape unless all k_s = n, and is then no multiplier: products
    of functions of different rows have no sign. With R_j = I and x among the f_j this is Theorem 1's content too.
    Paper: cor:extension_basis_function (Sec. 4.3).
    """
    return tuple(Family.full(np.eye(group.curve.size)[: None if group.channels else 0]) for group in system.groups)
