"""The matrix inequality of the claims: from sector forms to a problem for the interior-point method, and back.

With z = (x, channel values), x' = G z + B u and half the gradient of V equal to E'z (theory: claims G and M),

    Q = E G + G'E' + S,   E = [P; 0] + sum_g N_g'lambda_g r_g',  S = sum_g sum_kl tau_gkl N_g'(l_k l_l' + l_l l_k')N_g

with N_g z = phi_g. Every unknown is a pair of rows: P_ij: e_i, G_j; mu_gk: N_g'l_k, G'r_g; tau_gkl: N_g'l_k, N_g'l_l.
Deviations L w of a plant (`deviations`) are further entries: z grows by w, G by L; s_j adds s_j (C_j'C_j - I) to Q.
In discrete time there is no mu, and P_ij is two signed pairs: G_i, G_j and, less 1 - kappa times, e_i, e_j.
Paper: thm:main_ISS and cor:extension_basis_function are the special cases with the forms e_0, …, e_J only.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse

from persid.lyapunov.arrays import Array
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.dual_start import dual_factor
from persid.lyapunov.iterate import Iterate
from persid.lyapunov.own_functions import depths_in
from persid.lyapunov.pairs import Problem, pairings
from persid.lyapunov.sectors import Group
from persid.lyapunov.system import Family, Scaling, System, Target, is_broad, scaling
from persid.lyapunov.unknowns import Label, Unknowns, labels

Prices = list[tuple[Float[ndarray, "K K"], Float[ndarray, " K"]]]  # of a group's products, and of its densities


@dataclass(frozen=True, eq=False)
class Assembly:
    """A Problem together with what its unknowns are."""

    unknowns: Unknowns
    problem: Problem


@dataclass(frozen=True, eq=False)
class Terms:
    """Unknowns as sums of pairs of rows of [S; H], pair k (p[k], q[k]) of unknown owner[k] with a weight.

    Row h of H belongs to a gradient: it is rho_h (F + kappa upper_h I_x) for the flow x' = F (z, u) in scaled units, or
    a multiple of that. `cost` is what the unknowns add to c'y, `sizes` what they are times their multipliers.
    """

    S: sparse.csr_array
    H: Float[ndarray, "h W"]
    rho: Float[ndarray, "h n"]
    upper: Float[ndarray, " h"]
    p: Int[ndarray, " K"]
    q: Int[ndarray, " K"]
    owner: Int[ndarray, " K"]
    weight: Float[ndarray, " K"]
    cost: Float[ndarray, " J"]
    sizes: Float[ndarray, " J"]

    @property
    def tie(self) -> sparse.csr_array | None:
        """The weight of each pair (row) in its unknown (column); None where each unknown is one pair."""
        if len(self.p) == len(self.cost):
            return None
        shape = (len(self.p), len(self.cost))
        return sparse.csr_array((self.weight, self.owner, np.arange(len(self.p) + 1)), shape=shape)


def assemble(
    system: System, families: Sequence[Family], *, full_P: bool = False, target: Target | None = None
) -> Assembly:
    """Make the interior-point problem of a claim: maximise the margin t of its matrix inequality over P, mu and tau."""
    return Catalogue(system, families, full_P=full_P, target=target).assembly(families)


_Pairs = tuple[tuple[int, ...], tuple[int, ...], tuple[float, ...]]


class _Unknown(NamedTuple):
    """A weighted sum of pairs of rows p (of S) and q (of S, or -1 - i for row i of H)."""

    p: tuple[int, ...]
    q: tuple[int, ...]
    weight: tuple[float, ...]
    size: float
    cost: float


class Catalogue:
    """All rows of D = [S; H] and all unknowns that families of forms allow, from which problems are put together.

    The densities are those of the families; products may be any. `units` are given where the flow of the system is
    unknown, as it is in a fit: the gradients, not their products with the flow, are then made unit vectors.
    """

    def __init__(
        self, system: System, families: Sequence[Family], *, full_P: bool = False, target: Target | None = None,
        units: Scaling | None = None,
    ) -> None:  # fmt: skip
        self.system, self.families, self.full_P, self.target = system, families, full_P, target or Target()
        self.is_flow_known = units is None
        self.units = units = scaling(system) if units is None else units
        inputs = system.B.shape[1] if self.target.ratio is not None else 0
        self.inside = system.entries + inputs
        known = np.concatenate([units.entries, units.inputs[:inputs]])
        self._bounds = [(d, self._bound(d) * known) for d in self.target.deviations]
        sizes = [np.full(d.L.shape[1], _unit(d, C, units)) for d, C in self._bounds]
        self.weights = np.concatenate([known, *sizes])
        self.width = len(self.weights)
        flow = np.hstack([system.G, system.B[:, :inputs], *(d.L for d in self.target.deviations)])
        self.flow = flow * self.weights / units.rate
        self._S = [sparse.csr_array(sparse.eye_array(self.width))]
        self._height = self.width
        self._gradients: list[tuple[ndarray, float, ndarray]] = []  # rho, upper and the row of H
        self._codes: dict[tuple[int, float], int] = {}
        self._unknowns: dict[Label, _Unknown] = {}
        if system.discrete:
            self._stepped()
        else:
            self._quadratic()
        self._forms = [self._rows(group, family.forms) for group, family in zip(system.groups, families, strict=True)]
        for g, family in enumerate(families):
            self._densities(g, family)
        self._deviations()
        if self.target.ratio is not None:
            (self._smallest_eigenvalue_of_steps if system.discrete else self._smallest_eigenvalue)()

    def size(self, *label: object) -> float:
        """Return what an unknown is times its multiplier."""
        return self._unknowns[label].size

    def assembly(self, families: Sequence[Family]) -> Assembly:
        """Return the problem of some of the densities and of products, in families of the same forms."""
        terms = self.terms(families)
        return Assembly(self.unknowns(families, terms), self._problem(terms))

    def terms(self, families: Sequence[Family], kept: Sequence[int] = ()) -> Terms:
        """Return the unknowns of a problem as pairs of the rows that they use, and of rows that are `kept` anyway."""
        names = labels(len(self.system.states), self.full_P, families, self.target)
        return self._terms(
            [self._product(*name[1:]) if name[0] == "tau" else self._unknowns[name] for name in names], kept
        )

    def unknowns(self, families: Sequence[Family], terms: Terms) -> Unknowns:
        """Return what the unknowns are, with the way back to multipliers."""
        return Unknowns(self.system, tuple(families), self.target, self.units, terms.sizes, self._order_of_P)

    def prices(self, X: Float[Array, "w w"]) -> Prices:
        """Return <F, X> of every product and of every density of each group, as unknowns of a problem would have it.

        A product, or a density after adding the dual bound m, may help only where its price is negative; forms that
        are no densities get NaN.
        """
        names, problem = self._all_densities
        worth = [np.full(len(family.forms), np.nan) for family in self.families]
        if not names:
            return list(zip(self._product_prices(X), worth, strict=True))
        for (_, g, k), price in zip(names, problem.arrays.get(pairings(problem, X)), strict=True):
            worth[g][k] = price
        return list(zip(self._product_prices(X), worth, strict=True))

    def shares(self, state: Iterate) -> Float[ndarray, " g"]:
        """Return the part of <N, X> = 1 on the entries that each group reads: where margins are small it is large."""
        of = state.problem.arrays
        diagonal = of.get(of.xp.linalg.diagonal(state.X))  # blocks of entries keep their places in z = C w
        return np.array([diagonal[at].sum() for _, _, _, at in self._forms])

    def _product_prices(self, X: Array) -> list[ndarray]:
        of, (places, ends) = self.system.arrays, self._blocks
        blocks = np.split(of.get(of.xp.take(of.xp.reshape(X, (-1,)), places)), ends)[:-1]
        parts = zip(self._forms, blocks, strict=True)
        return [2 * rows @ block.reshape(len(at), len(at)) @ rows.T for (_, _, rows, at), block in parts]

    @cached_property
    def _blocks(self) -> tuple[Array, Int[ndarray, " e"]]:
        """Where the entries of X that groups read stand, where the arrays live, and where those of each group end."""
        places = [(at[:, None] * self.width + at).ravel() for _, _, _, at in self._forms]
        ends = np.cumsum([len(each) for each in places], dtype=int)
        return self.system.arrays.put(np.concatenate([np.zeros(0, int), *places])), ends

    @cached_property
    def _all_densities(self) -> tuple[list[Label], Problem]:
        names = [name for name in self._unknowns if name[0] == "mu"]
        return names, self._problem(self._terms([self._unknowns[name] for name in names]))

    @property
    def _order_of_P(self) -> int:
        return len(self.system.states) if self.full_P else 0

    def _rows(self, group: Group, forms: ndarray) -> tuple[ndarray, ndarray, ndarray, ndarray]:
        """Add the rows l'N_g, in the units of z and made unit vectors; return places in S, norms, entries and where."""
        at, rows = self.system.lines(group, forms)
        rows = rows * self.units.entries[at]
        norms = np.linalg.norm(rows, axis=1)
        rows = rows / norms[:, None]
        places = self._height + np.arange(len(rows))
        line, entry = np.nonzero(rows)
        self._S.append(sparse.csr_array((rows[line, entry], (line, at[entry])), shape=(len(rows), self.width)))
        self._height += len(rows)
        return places, norms, rows, at

    def _product(self, g: int, k: int, j: int) -> _Unknown:
        places, norms, _, _ = self._forms[g]
        return _Unknown((int(places[k]),), (int(places[j]),), (1.0,), float(norms[k] * norms[j]), 0.0)

    def _densities(self, g: int, family: Family) -> None:
        """Add mu of each form: its own pair, and on a domain -d r r' in P, which its integral makes up for."""
        group, (places, norms, _, _) = self.system.groups[g], self._forms[g]
        upper = self.target.upper.get(group.curve, np.ones(len(family.forms)))
        lower = self.target.lower.get(group.curve, np.zeros(len(family.forms)))
        gradients = {c: self._gradient(group.row, c) for c in {float(upper[k]) for k in family.densities}}
        if any(lower[k] for k in family.densities):
            (y, *_), (y_norm, *_), _, _ = self._rows(group, np.eye(1, group.curve.size))
            half, half_size = self._gradient(group.row, 0.5)
        for k in family.densities:
            code, size = gradients[float(upper[k])]
            size *= float(norms[k])
            pairs: _Pairs = ((int(places[k]),), (code,), (1.0,))
            if lower[k]:
                weight = -float(lower[k]) * float(y_norm) * half_size / size
                pairs = ((int(places[k]), int(y)), (code, half), (1.0, weight))
            self._unknowns["mu", g, k] = _Unknown(*pairs, size, 1.0)

    def _gradient(self, row: ndarray, upper: float) -> tuple[int, float]:
        """Return the code and the size of r'(G + kappa c I_x): W adds kappa c y l'phi to what V' has to outweigh."""
        upper = upper if self.target.kappa else 0.0
        support = np.flatnonzero(row)
        if len(support) == 1 and row[support[0]] * self.units.states[support[0]] > 0:  # else mu would be negative
            i = int(support[0])
            if (i, upper) not in self._codes:
                unit = np.zeros(self.system.n)
                unit[i] = 1.0
                self._codes[i, upper] = self._append(unit, upper, self._decaying(unit, upper), self.units.states[i])
            return self._codes[i, upper], float(row[i] * self.units.states[i] * self.units.rate)
        product = self._decaying(row, upper)
        size = float(np.linalg.norm(product if self.is_flow_known else row * self.units.states)) or 1.0
        return self._append(row, upper, product, size), size * self.units.rate

    def _decaying(self, row: ndarray, upper: float) -> ndarray:
        reads = np.flatnonzero(row)
        product: ndarray = row[reads] @ self.flow[reads]
        if upper:
            k = len(self.system.states)
            product[:k] += (
                self.target.kappa * upper * row[list(self.system.states)] * self.weights[:k] / self.units.rate
            )
        return product

    def _append(self, row: ndarray, upper: float, product: ndarray, size: float) -> int:
        self._gradients.append((row * self.units.states / size, upper, product / size))
        return -len(self._gradients)

    def _quadratic(self) -> None:
        """Add the entries of P: half of x'Px is its own constant c = 1/2."""
        states, k = self.system.states, len(self.system.states)
        units = np.eye(self.system.n)
        codes = [self._gradient(units[i], 0.5)[0] for i in states]
        if self.full_P:
            for number, (i, j) in enumerate(combinations_with_replacement(range(k), 2)):
                cost = 2.0 if i == j else 0.0
                self._unknowns["P", number] = _Unknown((i, j), (codes[j], codes[i]), (1.0, 1.0), 1.0, cost)
        else:
            for i in range(k):
                size = float(self.units.states[states[i]] ** 2 * self.units.rate)
                self._unknowns["P", i] = _Unknown((i,), (codes[i],), (1.0,), size, 1.0)

    def _bound(self, deviation: Deviation) -> ndarray:
        """Return C at the entries of the inequality, without w; inputs that it leaves out have some gain anyway."""
        system = self.system
        return deviation.columns(system.states, system.channels, system.B.shape[1])[:, : self.inside]

    def _deviations(self) -> None:
        """Add s of each deviation: s (C'C - I), with the rows of C made unit vectors."""
        first = self.inside
        for j, (deviation, C) in enumerate(self._bounds):
            w = range(first, first + deviation.L.shape[1])
            first = w.stop
            norms = np.linalg.norm(C, axis=1)
            rows = self._height + np.arange(len(C))
            unit = C / np.where(norms > 0, norms, 1.0)[:, None]
            self._S.append(sparse.csr_array(np.pad(unit, ((0, 0), (0, self.width - self.inside)))))
            self._height += len(C)
            own = self.weights[list(w)] ** 2
            size = float(own.max(initial=1e-300))
            weight = (*(0.5 * norms**2 / size).tolist(), *(-0.5 * own / size).tolist())
            self._unknowns["s", j] = _Unknown((*rows.tolist(), *w), (*rows.tolist(), *w), weight, size, 0.0)

    def _smallest_eigenvalue(self) -> None:
        """Add p: P - p diag(shape) is what the entries of P stand for, and gamma = ratio p bounds the inputs."""
        k, rate = len(self.system.states), self.units.rate
        codes = [self._gradient(unit, 0.5)[0] for unit in np.eye(self.system.n)]
        shape = self.target.shape_of(self.system) * self.units.states**2 * rate
        inputs = range(self.system.entries, self.inside)
        ratio = -0.5 * float(self.target.ratio or 0.0) * self.weights[self.system.entries : self.inside] ** 2
        size = float(shape.max())
        pairs = ((*range(k), *inputs), (*codes, *inputs), (*(shape / size).tolist(), *(ratio / size).tolist()))
        self._unknowns[("p",)] = _Unknown(*pairs, size, float(shape.sum() / size))

    def _stepped(self) -> None:
        """Add the entries of P: what x+'P x+ - (1 - kappa) x'P x holds of each, with the rows of x+ in S."""
        k, left = self.system.n, 1 - self.target.kappa
        self._S.append(sparse.csr_array(self.flow / self.units.states[:, None]))
        after, self._height = self._height, self._height + k
        if self.full_P:
            for number, (i, j) in enumerate(combinations_with_replacement(range(k), 2)):
                pairs = (after + i, i), (after + j, j), (1.0, -left)
                self._unknowns["P", number] = _Unknown(*pairs, 1.0, 2.0 if i == j else 0.0)
        else:
            for i in range(k):
                pairs = (after + i, i), (after + i, i), (0.5, -0.5 * left)
                self._unknowns["P", i] = _Unknown(*pairs, float(self.units.states[i] ** 2), 1.0)

    def _smallest_eigenvalue_of_steps(self) -> None:
        """Add p, as `_smallest_eigenvalue` does: V has p x'diag(shape)x more, at both ends of a step."""
        k, left = self.system.n, 1 - self.target.kappa
        shape = self.target.shape_of(self.system) * self.units.states**2
        inputs = range(self.system.entries, self.inside)
        ratio = -0.5 * float(self.target.ratio or 0.0) * self.weights[self.system.entries : self.inside] ** 2
        size, half = float(shape.max()), 0.5 * shape
        rows = (*range(self.width, self.width + k), *range(k), *inputs)
        weights = np.concatenate([half, -left * half, ratio]) / size
        self._unknowns[("p",)] = _Unknown(rows, rows, tuple(weights.tolist()), size, float(shape.sum() / size))

    @cached_property
    def _factor(self) -> sparse.csr_array:
        """C, with which C C' is the first dual matrix."""
        forms = [(at, rows) for _, _, rows, at in self._forms]
        weighted = self.is_flow_known and is_broad(self.system, self.target)
        depth = depths_in(self.system, self.families) if weighted else None
        return dual_factor(self.system, self.units, forms, self.width, depth)

    @cached_property
    def _all_rows(self) -> tuple[sparse.csr_array, ndarray, ndarray, ndarray]:
        """S, H, and the gradients rho with their constants `upper`."""
        rho, upper, H = zip(*self._gradients, strict=True) if self._gradients else ((), (), ())
        return (
            sparse.csr_array(sparse.vstack(self._S)), np.array(H).reshape(-1, self.width),
            np.array(rho).reshape(-1, self.system.n), np.array(upper, float),
        )  # fmt: skip

    def _terms(self, unknowns: Sequence[_Unknown], kept: Sequence[int] = ()) -> Terms:
        """Return unknowns as pairs of the rows that they use."""
        S, H, rho, upper = self._all_rows
        p, q = _flat(u.p for u in unknowns), _flat(u.q for u in unknowns)
        rows, places = np.unique(np.concatenate([np.array(kept, int), p, q[q >= 0]]), return_inverse=True)
        lines, codes = np.unique(-1 - q[q < 0], return_inverse=True)
        p, inside = places[len(kept) : len(kept) + len(q)], places[len(kept) + len(q) :]
        dense = q < 0
        q[~dense], q[dense] = inside, len(rows) + codes
        owner = np.repeat(np.arange(len(unknowns)), [len(u.p) for u in unknowns])
        weight = np.array([w for u in unknowns for w in u.weight], float)
        cost, sizes = np.array([u.cost for u in unknowns], float), np.array([u.size for u in unknowns], float)
        return Terms(
            S=S[rows],
            H=H[lines],
            rho=rho[lines],
            upper=upper[lines],
            p=p,
            q=q,
            owner=owner,
            weight=weight,
            cost=cost,
            sizes=sizes,
        )

    def _problem(self, terms: Terms) -> Problem:
        return Problem(
            S=terms.S,
            H=terms.H,
            p=terms.p,
            q=terms.q,
            cost=terms.cost,
            C=self._factor,
            symmetric=self._order_of_P,
            tie=terms.tie,
            arrays=self.system.arrays,
        )


def _unit(deviation: Deviation, C: ndarray, units: Scaling) -> float:
    """Return the unit of w: what C allows it, or else what moves the states as much as they move themselves."""
    size = float(np.linalg.norm(C))
    strength = float(np.linalg.norm(deviation.L / units.states[:, None])) / units.rate
    return 0.5 * size / np.sqrt(max(deviation.L.shape[1], 1)) if size else 1 / (strength or 1.0)


def _flat(places: Iterable[tuple[int, ...]]) -> Int[ndarray, " K"]:
    return np.array([i for each in places for i in each], int)


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
    return np.asarray(E @ G + G.T @ E.T + S)


def corollary_1(system: System) -> tuple[Family, ...]:
    """Return the families of Corollary 1, corrected: y and every f_j in V, every product of two of them in one group.

    The printed term R_s'R_s Upsilon R_r'R_r has the wrong shape unless all k_s = n, and is then no multiplier: products
    of functions of different rows have no sign. With R_j = I and x among the f_j this is Theorem 1's content too.
    Paper: cor:extension_basis_function (Sec. 4.3).
    """
    return tuple(Family.full(np.eye(group.curve.size)[: None if group.channels else 0]) for group in system.groups)
