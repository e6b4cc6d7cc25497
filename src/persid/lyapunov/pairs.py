"""Matrices that are sums of pairs of rows, F = sum of d_p d_q' + d_q d_p', and what a solver needs of them.

No F is formed where they are large: <F, M> for all of them comes from the rows of D M, sum_k y_k F_k from two sparse
matrices, and the matrix of tr(F_k X F_l V) from products of blocks of D X D' and D V D'. Where they are small a handful
of entries costs less than a call does: all F are formed once, as the lines of one matrix. A problem is data of the
host; what is computed with lives where its `arrays` say.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
from array_api_compat import array_namespace
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse

from persid.lyapunov.arrays import HOST, Array, Arrays
from persid.lyapunov.triangle import Triangle, triangle

FORMED = 2**16  # entries of all F together up to which they are formed, on the host


@dataclass(frozen=True, eq=False)
class Problem:
    """Data of the problem (D) of `interior_point`: unknowns that are sums of pairs of rows of D = [S; H].

    S is sparse, H dense; pair k is (p[k], q[k]) with p[k] always a row of S. Unknown j sums the pairs of column j of
    `tie` (None: one pair each). The first `symmetric`(`symmetric` + 1)/2 unknowns are the upper triangle of a
    symmetric matrix P, entry (i, j) standing for e_i e_j' + e_j e_i'; 0 without P. `cost` is c; X0 = C C' is positive
    definite with <F_k, X0> > 0 for every multiplier of zero cost, and C has no entries but between those that rows of
    S, and products of two rows of S, hold together: it leaves S sparse. N is that of (D), None for the inverse of X0.
    """

    S: sparse.csr_array
    H: Float[ndarray, "h N"]
    p: Int[ndarray, " K"]
    q: Int[ndarray, " K"]
    cost: Float[ndarray, " J"]
    C: sparse.csr_array
    symmetric: int = 0
    tie: sparse.csr_array | None = None
    N: Float[ndarray, "N N"] | None = None
    arrays: Arrays = field(default=HOST, repr=False)

    @property
    def order(self) -> int:
        """Order of the matrix inequality."""
        return int(self.H.shape[1])

    @property
    def free(self) -> int:
        """Number of unknowns that are entries of P."""
        return self.symmetric * (self.symmetric + 1) // 2

    @property
    def X(self) -> Float[ndarray, "N N"]:
        """The first dual matrix, X0."""
        return np.asarray((self.C @ self.C.T).toarray())

    def whitened(self) -> "Problem":
        """Return the problem for z = C w: there the dual matrix X0 is I."""
        H = np.ascontiguousarray((self.C.T @ self.H.T).T)
        N = None if self.N is None else np.asarray(self.C.T @ (self.C.T @ self.N.T).T)
        return replace(self, S=self.S @ self.C, H=H, C=_identity(self.order), N=N)

    @cached_property
    def _rows(self) -> tuple[Array, Array, Array, Array]:
        """S, H, p and q where the arrays live."""
        put = self.arrays.put
        return self.arrays.sparse(self.S), put(self.H), put(self.p), put(self.q)

    @cached_property
    def _ties(self) -> tuple[Array, Array, Array]:
        """The weights of pairs in unknowns, the transposed matrix, and that of their sizes."""
        assert self.tie is not None, "asked for only where unknowns are sums of pairs"
        tie, of = self.tie, self.arrays.sparse
        weights = of(tie)
        if isinstance(weights, ndarray):
            return weights, weights.T, abs(weights).T
        return weights, of(sparse.csr_array(tie.T)), of(sparse.csr_array(abs(tie).T))

    @cached_property
    def costs(self) -> Array:
        """The cost c where the arrays live."""
        return self.arrays.put(self.cost)

    @cached_property
    def along(self) -> Array | None:
        """N where the arrays live; None for the identity."""
        return None if self.N is None else self.arrays.put(self.N)

    @cached_property
    def triangle(self) -> Triangle:
        """The matrix P and its entries, where the arrays live."""
        return triangle(self.symmetric) if self.arrays is HOST else Triangle(self.symmetric, self.arrays)

    @cached_property
    def _dense(self) -> Float[ndarray, "r N"] | None:
        """D = [S; H] of a small problem of the host; else None."""
        small = self.arrays is HOST and len(self.cost) * self.order**2 <= FORMED
        return np.concatenate([self.S.toarray(), self.H]) if small else None

    @cached_property
    def _sides(self) -> tuple[Float[ndarray, "K N"], Float[ndarray, "K N"]] | None:
        """The rows d_p and d_q of all pairs of a small problem of the host; else None.

        A price is small where M d_q is, and the rounding of a formed F would be larger.
        """
        return None if self._dense is None else (self._dense[self.p], self._dense[self.q])

    @cached_property
    def _formed(self) -> Float[ndarray, "J NN"] | None:
        """All F of a small problem of the host, a line each; else None."""
        N, J = self.order, len(self.cost)
        if self._sides is None:
            return None
        left, right = self._sides
        half = (left[:, :, None] * right[:, None, :]).reshape(len(left), N * N)
        half = half if self.tie is None else self.tie.T @ half
        F = half.reshape(J, N, N)
        return np.ascontiguousarray(F + F.transpose(0, 2, 1)).reshape(J, N * N)

    @cached_property
    def _entries(self) -> tuple[Array, Array]:
        """Where the nonzeros of the rows p meet D M, row q, and the matrix that sums them to the pairs."""
        rows = self.S[self.p]
        pair = np.repeat(np.arange(len(self.p)), np.diff(rows.indptr))
        return self._summed(rows, self.q[pair] * self.order + rows.indices)

    @cached_property
    def _own(self) -> tuple[Array, Array]:
        """The same for the rows of S, each with its own row of S M."""
        row = np.repeat(np.arange(self.S.shape[0]), np.diff(self.S.indptr))
        return self._summed(self.S, row * self.order + self.S.indices)

    def _summed(self, rows: sparse.csr_array, place: ndarray) -> tuple[Array, Array]:
        sums = sparse.csr_array((rows.data, np.arange(rows.nnz), rows.indptr), shape=(rows.shape[0], rows.nnz))
        return self.arrays.put(place), self.arrays.sparse(sums)

    @cached_property
    def _square(self) -> Array:
        """Room for the Schur complement: new pages for every step would cost a tenth of the time."""
        room = self.arrays.empty(len(self.cost), len(self.cost))
        if self._one_each.runs:  # what is above the diagonal is added to as well, though never read
            room[:, :] = 0.0
        return room

    @cached_property
    def _one_each(self) -> "OneEach":
        """The pairs with one of each unknown first."""
        return OneEach.of(self)

    def release(self) -> None:
        """Give that room back; the next Schur complement takes it anew."""
        self.__dict__.pop("_square", None)

    @cached_property
    def _inside(self) -> tuple[Array, Array]:
        """The pairs of two rows of S, and the matrix from their weights to all entries of sum w_k s_p s_q'."""
        rows, N = self.S.shape[0], self.order
        pairs = np.flatnonzero(self.q < rows)
        left, right = self.S[self.p[pairs]], self.S[self.q[pairs]]
        width = np.diff(right.indptr)
        pair = np.repeat(np.arange(len(pairs)), np.diff(left.indptr))
        entry = np.repeat(np.arange(left.nnz), width[pair])  # of the left row; every one meets all of the right row
        first = np.cumsum(width[pair]) - width[pair]
        other = right.indptr[pair][entry] + np.arange(len(entry)) - first[entry]
        place, value = left.indices[entry] * N + right.indices[other], left.data[entry] * right.data[other]
        starts = np.concatenate([[0], np.cumsum(np.diff(left.indptr) * width)])
        weights = sparse.csc_array((value, place, starts), shape=(N * N, len(pairs)))
        return self.arrays.put(pairs), self.arrays.sparse(weights)

    @cached_property
    def _outside(self) -> tuple[Array, Array] | None:
        """The pairs with a row of H, and the matrix from their weights to the entries of L: L'H is the sum; or None."""
        rows, N = self.S.shape[0], self.order
        pairs = np.flatnonzero(self.q >= rows)
        left = self.S[self.p[pairs]]
        place = np.repeat((self.q[pairs] - rows) * N, np.diff(left.indptr)) + left.indices
        weights = sparse.csc_array((left.data, place, left.indptr), shape=(len(self.H) * N, len(pairs)))
        return (self.arrays.put(pairs), self.arrays.sparse(weights)) if len(pairs) else None


def congruent(of: Arrays, C: sparse.csr_array, X: Float[Array, "N N"]) -> Float[Array, "N N"]:
    """Return C X C' for a symmetric X, where it lives."""
    factor = of.sparse(C)
    return factor @ of.xp.asarray((factor @ X).T, copy=True)


@lru_cache(maxsize=64)
def _identity(order: int) -> sparse.csr_array:
    return sparse.csr_array(sparse.eye_array(order))


def combine(problem: Problem, y: Float[Array, " J"]) -> Float[Array, "N N"]:
    """Return sum_k y_k F_k."""
    if problem._formed is not None:
        return (y @ problem._formed).reshape(problem.order, problem.order)
    xp, N = problem.arrays.xp, problem.order
    weights = y if problem.tie is None else problem._ties[0] @ y
    pairs, products = problem._inside
    half = xp.reshape(products @ xp.take(weights, pairs), (N, N))
    if problem._outside is not None:
        pairs, lines = problem._outside
        half += xp.reshape(lines @ xp.take(weights, pairs), (len(problem.H), N)).T @ problem._rows[1]
    return half + half.T


def _product(problem: Problem, M: Array) -> Array:
    """Return D M."""
    S, H, *_ = problem._rows
    return problem.arrays.xp.concat([S @ M, H @ M])


def sandwich(problem: Problem, M: Float[Array, "N N"]) -> Float[Array, "r r"]:
    """Return D M D' for a symmetric M: its rows of H are columns of those of S, but where H meets H."""
    xp, (S, H, *_) = problem.arrays.xp, problem._rows
    lines = xp.asarray(_product(problem, M).T, copy=True)
    upper, height = S @ lines, S.shape[0]
    corner = H @ lines[:, height:]
    del lines  # here a step holds the most
    return xp.concat([upper, xp.concat([upper[:, height:].T, corner], axis=1)])


def pairings(problem: Problem, M: Float[Array, "N N"]) -> Float[Array, " J"]:
    """Return <F_k, M> for every unknown, M symmetric."""
    if problem._sides is not None:
        left, right = problem._sides
        products = 2 * ((left @ M) * right).sum(axis=1)
    else:
        place, sums = problem._entries
        products = 2 * (sums @ _taken(problem, _product(problem, M), place))
    return products if problem.tie is None else problem._ties[1] @ products


def _taken(problem: Problem, M: Array, place: Array) -> Array:
    xp = problem.arrays.xp
    return xp.take(xp.reshape(M, (-1,)), place)


def lengths(problem: Problem, M: Float[Array, "N N"]) -> Float[Array, " J"]:
    """Return 2 |d_p| |d_q|, summed over the pairs of every unknown, in the norm of M > 0: at least |<F_k, M>|."""
    xp, (_, _, p, q) = problem.arrays.xp, problem._rows
    squares = _squares(problem, M)
    norms = xp.sqrt(xp.where(squares > 0, squares, xp.zeros_like(squares)))
    products = 2 * xp.take(norms, p) * xp.take(norms, q)
    return products if problem.tie is None else problem._ties[2] @ products


def _squares(problem: Problem, M: Array) -> Array:
    """Return d'M d for every row d of D."""
    if problem._dense is not None:
        return ((problem._dense @ M) * problem._dense).sum(axis=1)
    xp, (S, H, _, _), (place, sums) = problem.arrays.xp, problem._rows, problem._own
    return xp.concat([sums @ _taken(problem, S @ M, place), xp.sum((H @ M) * H, axis=1)])


def schur(problem: Problem, X: Float[Array, "N N"], V: Float[Array, "N N"]) -> Float[Array, "J J"]:
    """Return the matrix of tr(F_k X F_l V), X and V symmetric; its lower triangle, all that is read.

    The next call for the same problem overwrites it.
    """
    if problem._formed is not None:
        shape, lines = (len(problem.cost), -1), problem._formed.reshape(-1, problem.order)
        transposed = (lines @ V).reshape(-1, problem.order, problem.order).transpose(0, 2, 1)
        return (lines @ X).reshape(shape) @ transposed.reshape(shape).T
    Y, V = sandwich(problem, X), sandwich(problem, V)
    return problem._one_each.schur(Y, V, problem._square, problem.arrays)


@dataclass(frozen=True, eq=False)
class OneEach:
    """Pairs (p, q): one of each of J unknowns first, with the weight 1, and then R others that some unknowns have.

    Those are m unknowns, in runs of which each stands at a slice of all and at one of the m. Mostly m is small, and the
    Schur complement is that of single pairs, J by J, and little more.
    """

    p: Int[Array, " K"]
    q: Int[Array, " K"]
    weights: Any  # of the others in all unknowns, (J, R),
    few: Any  # and in those that have others, (m, R)
    runs: tuple[tuple[slice, slice], ...]

    @classmethod
    def of(cls, problem: Problem) -> "OneEach":
        """Put the pairs of a problem in order; one whose weight is not 1 is another pair, too, with what is left."""
        of, count = problem.arrays, len(problem.cost)
        tie = sparse.csr_array(sparse.eye_array(count) if problem.tie is None else problem.tie)
        first = np.unique(tie.indices, return_index=True)[1]
        weight = tie.data.copy()
        weight[first] -= 1
        others = np.flatnonzero(weight)
        order, unknown = np.concatenate([first, others]), tie.indices[others]
        entries = weight[others], (unknown, np.arange(len(others)))
        weights, several = sparse.csr_array(entries, shape=(count, len(others))), np.unique(unknown)
        runs = _runs(several)
        few = of.sparse(weights[several])
        return cls(of.put(problem.p[order]), of.put(problem.q[order]), of.sparse(weights), few, runs)

    def schur(self, Y: Float[Array, "r r"], V: Float[Array, "r r"], M: Float[Array, "J J"], of: Arrays) -> Array:
        """Write tr(F_k X F_l Z^-1) to the lower triangle of M, from D X D' and D Z^-1 D'."""
        count, size, tril = M.shape[0], self.p.shape[0], of.xp.tril
        pair_products(self.p[:count], self.q[:count], Y, V, M, of.block)
        if self.runs:
            lines = pair_products(self.p, self.q, Y, V, of.empty(size - count, size), of.block)
            own = 0.5 * (tril(lines[:, count:]) + tril(lines[:, count:], k=-1))
            half = self.few @ (lines[:, :count] + (self.weights @ own.T).T)
            for at, those in self.runs:
                M[at, : at.stop] += half[those, : at.stop]
                M[at.start :, at] += half[those, at.start :].T
        return M


def _runs(places: Int[ndarray, " m"]) -> tuple[tuple[slice, slice], ...]:
    """Return where runs of consecutive numbers stand, among all numbers and among the ones given."""
    ends = np.flatnonzero(np.diff(places, prepend=-2, append=np.iinfo(int).max) > 1).tolist()
    return tuple((slice(int(places[a]), int(places[a]) + b - a), slice(a, b)) for a, b in pairwise(ends))


def pair_products(
    p: Int[Array, " K"], q: Int[Array, " K"], Y: Float[Array, "r r"], V: Float[Array, "r r"],
    M: Float[Array, "k K"], block: int,
) -> Float[Array, "k K"]:  # fmt: skip
    """Write tr(F_k X F_l Z^-1) of single pairs (p_k, q_k) to the lower triangle of M, a `block` of rows at a time.

    M has the last lines, all or some.
    """
    take, before = array_namespace(M).take, M.shape[1] - M.shape[0]
    for start in range(before, p.shape[0], block):
        stop = min(start + block, p.shape[0])
        rows = slice(start, stop)
        r, s = p[:stop], q[:stop]
        (Yp, Vp), (Yq, Vq) = ((take(Y, at[rows], axis=0), take(V, at[rows], axis=0)) for at in (p, q))
        products = take(Yq, r, axis=1) * take(Vp, s, axis=1)
        products += take(Yq, s, axis=1) * take(Vp, r, axis=1)
        products += take(Yp, r, axis=1) * take(Vq, s, axis=1)
        products += take(Yp, s, axis=1) * take(Vq, r, axis=1)
        M[start - before : stop - before, :stop] = products
    return M


def tied(M: Float[Array, "K K"], tie: Array) -> Float[Array, "J J"]:
    """Return tie M tie' for a symmetric M of which the lower triangle is given."""
    xp = array_namespace(M)
    M = xp.tril(M) + xp.tril(M, k=-1).T
    return tie @ xp.asarray((tie @ M).T, copy=True)
