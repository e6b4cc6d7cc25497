"""A symmetric matrix P and its entries over its upper triangle, row by row.

P = sum of p_k E_k with E_k = e_i e_j' + e_j e_i' for the k-th pair i <= j.
"""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.lyapunov.arrays import HOST, Array, Arrays

FORMED = 6  # order up to which all E are formed: products of them take one call


@dataclass(frozen=True, eq=False)
class Triangle:
    """The two forms of a symmetric matrix of an order, and what a solver needs of them."""

    order: int
    arrays: Arrays

    @cached_property
    def _ends(self) -> tuple[Array, Array]:
        """Row i and column j of each entry."""
        i, j = np.triu_indices(self.order)
        return self.arrays.put(i), self.arrays.put(j)

    @cached_property
    def _numbers(self) -> Array:
        """The number of the entry at each place of the matrix."""
        numbers = np.zeros((self.order, self.order), int)
        numbers[np.triu_indices(self.order)] = np.arange(self.order * (self.order + 1) // 2)
        return self.arrays.put((np.triu(numbers) + np.triu(numbers, 1).T).ravel())

    @cached_property
    def _doubled(self) -> Array:
        """2 on the diagonal, 1 elsewhere: E_ii holds 2."""
        return self.arrays.put(1 + np.eye(self.order))

    @cached_property
    def _formed(self) -> Float[ndarray, "f k k"] | None:
        """All E of a small matrix of the host; else None."""
        if self.arrays is not HOST or self.order > FORMED:
            return None
        shape = self.order * (self.order + 1) // 2, self.order, self.order
        return np.reshape([self.matrix(row) for row in np.eye(shape[0])], shape)

    def matrix(self, entries: Float[Array, " f"]) -> Float[Array, "k k"]:
        """Return P."""
        return self._spread(entries) * self._doubled

    def entries(self, P: Float[Array, "k k"]) -> Float[Array, " f"]:
        """Return the entries that make P."""
        return self._upper(P / self._doubled)

    def pairings(self, M: Float[Array, "k k"]) -> Float[Array, " f"]:
        """Return <E_k, M> for every entry, M symmetric."""
        return 2 * self._upper(M)

    def dual(self, values: Float[Array, " f"]) -> Float[Array, "k k"]:
        """Return the symmetric W with <E_k, W> = values for every entry."""
        return self._spread(values) / 2

    def schur(self, U: Float[Array, "k k"], V: Float[Array, "k k"]) -> Float[Array, "f f"]:
        """Return the matrix of tr(E_k U E_l V), U and V symmetric."""
        if self._formed is not None:
            left, right = (E.reshape(len(E), self.order**2) for E in (self._formed @ U, V @ self._formed))
            return left @ right.T
        take, (i, j) = self.arrays.xp.take, self._ends
        (Ui, Vi), (Uj, Vj) = ((take(U, at, axis=0), take(V, at, axis=0)) for at in (i, j))
        return (
            take(Uj, i, axis=1) * take(Vi, j, axis=1) + take(Uj, j, axis=1) * take(Vi, i, axis=1)
            + take(Ui, i, axis=1) * take(Vj, j, axis=1) + take(Ui, j, axis=1) * take(Vj, i, axis=1)
        )  # fmt: skip

    def _upper(self, M: Array) -> Array:
        xp, (i, j) = self.arrays.xp, self._ends
        return xp.take(xp.reshape(M, (-1,)), i * self.order + j)

    def _spread(self, entries: Array) -> Array:
        xp = self.arrays.xp
        return xp.reshape(xp.take(entries, self._numbers), (self.order, self.order))


@lru_cache(maxsize=64)
def triangle(order: int) -> Triangle:
    """Return the triangle of host arrays of an order."""
    return Triangle(order, HOST)
