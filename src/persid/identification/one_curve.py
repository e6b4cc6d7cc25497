"""One learned curve for all places: the same piecewise linear function of every argument, with a factor for each place.

With ramps r_k and slopes s_k, f(y) = sum_k s_k r_k(y), the equations are

    y_i = sum_j F_ij f(x_j) + (linear parts, other functions, inputs, a constant)

so the coefficients of the ramps, F_ij s_k, are of rank one. What misses the increments is made small by turns: in the
factors and the rest for given slopes, then in the slopes and the rest for given factors, each a linear problem.
"""

from collections.abc import Sequence, Set
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.identification.basis import Basis
from persid.identification.gram import Gram
from persid.identification.regressions import Problem
from persid.identification.validation import total
from persid.models.functions import ScalarFunction, scalar_function
from persid.models.lookup_tables import WORD, lookup_table

TURNS = 200
CLOSE = 1e-9  # share of what is missed by which a turn must lower it
RIDGE = 1e-8  # relative to columns of mean square 1: what the data leave open is kept small


def with_curve(functions: Sequence[Sequence[str]], problem: Problem) -> list[list[str]]:
    """Return lists of functions with the curve in place of the word, from the ramps of a problem without its tails."""
    grams = problem.grams()
    seen = [grams[part.block] for part in problem.blocks if part.fold >= 0 and part.block in grams]
    given = {scalar_function(f).text for names in functions for f in names if f != WORD}
    ramps = _Ramps(total(seen or list(grams.values())), given)
    curve = ramps.table(ramps.slopes())
    return [[curve if f == WORD else f for f in names] for names in functions]


@dataclass(frozen=True, eq=False)
class _Ramps:
    """The sums of a fit whose tables are the ramps of one curve."""

    gram: Gram
    given: Set[str]  # functions that are no ramps

    @property
    def basis(self) -> Basis:
        return self.gram.basis

    @cached_property
    def listed(self) -> list[ScalarFunction]:
        """The ramps, in the order of their pieces."""
        every = dict.fromkeys(f for term in self.basis.terms for f in term if f)
        return [f for f in every if f.text not in self.given]

    @cached_property
    def places(self) -> dict[int, list[int]]:
        """Columns of the ramps, by the state that they read."""
        found: dict[int, dict[str, int]] = {}
        for at, column in enumerate(self.basis.columns):
            f = self.basis.terms[column.term][column.state] if column.kind == "function" else None
            if f in self.listed:
                found.setdefault(column.state, {})[f.text] = at
        return {state: [columns[f.text] for f in self.listed] for state, columns in found.items()}

    @cached_property
    def rest(self) -> Float[ndarray, "p r"]:
        """The columns that are no ramps, as a selection."""
        ramps = {at for columns in self.places.values() for at in columns}
        return np.eye(self.basis.size)[:, [at for at in range(self.basis.size) if at not in ramps]]

    @cached_property
    def used(self) -> ndarray:
        """Which columns each equation may use."""
        varies = self.gram.weights > 0
        varies[-1] = True
        return np.asarray((self.gram.structure.parameter >= 0) & varies[:, None])

    def slopes(self) -> Float[ndarray, " k"]:
        """Return the slopes of the curve, the largest 1, such that a positive one weighs more than negative ones."""
        s, before = self._first(), np.inf
        for _ in range(TURNS):
            F, missed = self._factors(s)
            if not missed < (1 - CLOSE) * before:
                break
            s, before = self._slopes(F), missed
        return np.asarray(s * (np.sign(s @ self._sizes()) or 1.0))

    @cached_property
    def _weights(self) -> Float[ndarray, " n"]:
        """One over what the ramps without a condition miss in each equation, 0 of equations that are known."""
        left = self.gram.residual(self.gram.solve(RIDGE))
        floor = 1e-12 * self.gram.yy / self.gram.rows
        return np.where(self.gram.structure.known, 0.0, 1 / np.maximum(np.maximum(left, floor), 1e-300))

    def _sizes(self) -> Float[ndarray, " k"]:
        """The root mean square of every ramp over all places."""
        return np.asarray(np.sqrt(np.mean([self.gram.weights[at] ** 2 for at in self.places.values()], axis=0)))

    def _first(self) -> Float[ndarray, " k"]:
        """Slopes near to those of all places without a condition: the first singular vector, in units of the ramps."""
        theta, sizes = self.gram.solve(RIDGE), self._sizes()
        found = np.vstack([theta[at].T for at in self.places.values()]) * sizes
        s = np.linalg.svd(found)[2][0] / np.where(sizes > 0, sizes, 1.0)
        return np.asarray(s / np.abs(s).max())

    def _along(self, s: Float[ndarray, " k"]) -> Float[ndarray, "p j"]:
        """The curve's columns, one a state that it reads."""
        found = np.zeros((self.basis.size, len(self.places)))
        for j, at in enumerate(self.places.values()):
            found[at, j] = s
        return found

    def _factors(self, s: Float[ndarray, " k"]) -> tuple[Float[ndarray, "j n"], float]:
        """Return the factors of each place in each equation, and what is missed, in units of what is missed anyway."""
        T, count = np.hstack([self.rest, self._along(s)]), len(self.places)
        F, missed = np.zeros((count, len(self._weights))), 0.0
        for i, weight in enumerate(self._weights):
            kept = (T != 0).T @ self.used[:, i]
            theta = _solved(self.gram, T[:, kept], i)
            along = np.zeros(T.shape[1])
            along[kept] = theta
            F[:, i] = along[-count:]
            missed += weight * float(self.gram.residual(np.outer(T @ along, np.eye(len(F[0]))[i]))[i])
        return F, missed

    def _slopes(self, F: Float[ndarray, "j n"]) -> Float[ndarray, " k"]:
        """Return the best slopes for given factors, the rest of each equation solved for."""
        count = len(self.listed)
        M, h = np.zeros((count, count)), np.zeros(count)
        for i, weight in enumerate(self._weights):
            ramps = np.zeros((self.basis.size, count))
            for factor, at in zip(F[:, i], self.places.values(), strict=True):
                ramps[at] += factor * np.diag(self.used[at, i])
            rest = self.rest[:, (self.rest != 0).T @ self.used[:, i]]
            C, c = _normal(self.gram, np.hstack([rest, ramps]), i)
            r = rest.shape[1]
            through = np.linalg.lstsq(C[:r, :r], np.column_stack([C[:r, r:], c[:r]]), rcond=None)[0]
            M += weight * (C[r:, r:] - C[r:, :r] @ through[:, :-1])
            h += weight * (c[r:] - C[r:, :r] @ through[:, -1])
        s = np.linalg.lstsq(M, h, rcond=1e-12)[0]
        return np.asarray(s / (np.abs(s).max() or 1.0))

    def table(self, s: Float[ndarray, " k"]) -> str:
        """Return the curve as a table; half a unit beside its ends says how it goes on."""
        tables = [f.table for f in self.listed if f.table]
        inner = np.unique([t for table in tables for t in table.knots[1:-1]])
        y = np.unique([inner[0] - 0.5, *inner, 0.0, inner[-1] + 0.5])
        return lookup_table(y, sum(slope * f.value(y) for slope, f in zip(s, self.listed, strict=True)))


def _normal(gram: Gram, T: Float[ndarray, "p c"], i: int) -> tuple[Float[ndarray, "c c"], Float[ndarray, " c"]]:
    """Return the normal equations of one equation in columns T, a ridge along."""
    ridge = RIDGE * gram.weights**2
    return T.T @ (gram.G / gram.rows + np.diag(ridge)) @ T, T.T @ gram.H[:, i] / gram.rows


def _solved(gram: Gram, T: Float[ndarray, "p c"], i: int) -> Float[ndarray, " c"]:
    C, c = _normal(gram, T, i)
    scale = 1 / np.sqrt(np.maximum(np.diag(C), 1e-300))
    return np.asarray(scale * np.linalg.lstsq(scale[:, None] * C * scale, scale * c, rcond=1e-14)[0])
