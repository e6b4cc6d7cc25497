"""Matrices that are sums of pairs of rows, F = sum of d_p d_q' + d_q d_p', and what a solver needs of them.

No F is ever formed: <F, M> for all of them comes from the rows of D M, sum_k y_k F_k from two sparse matrices, and the
matrix of tr(F_k X F_l V) from products of blocks of D X D' and D V D'.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray
from scipy import sparse

BLOCK = 32  # rows of the Schur complement made at once: what they gather from stays in the cache


@dataclass(frozen=True, eq=False)
class Problem:
    """Data of the problem (D) of `interior_point`: unknowns that are sums of pairs of rows of D = [S; H].

    S is sparse, H dense; pair k is (p[k], q[k]) with p[k] always a row of S. Unknown j sums the pairs of column j of
    `tie` (None: one pair each). The first `symmetric`(`symmetric` + 1)/2 unknowns are the upper triangle of a
    symmetric matrix P, entry (i, j) standing for e_i e_j' + e_j e_i'; 0 without P. `cost` is c; X0 = C C' is positive
    definite with <F_k, X0> > 0 for every multiplier of zero cost, and C has no entries but between those that rows of
    S, and products of two rows of S, hold together: it leaves S sparse.
    """

    S: sparse.csr_array
    H: Float[ndarray, "h N"]
    p: Int[ndarray, " K"]
    q: Int[ndarray, " K"]
    cost: Float[ndarray, " J"]
    C: sparse.csr_array
    symmetric: int = 0
    tie: sparse.csr_array | None = None

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
        return replace(self, S=sparse.csr_array(self.S @ self.C), H=H, C=sparse.csr_array(sparse.eye_array(self.order)))

    @cached_property
    def _entries(self) -> tuple[ndarray, ndarray, ndarray]:
        """The nonzeros of the rows p: their pair, their value, and their place in the matrix D M, row q."""
        rows = self.S[self.p]
        pair = np.repeat(np.arange(len(self.p)), np.diff(rows.indptr))
        return pair, rows.data, self.q[pair] * self.order + rows.indices

    @cached_property
    def _square(self) -> ndarray:
        """Room for the Schur complement: new pages for every step would cost a tenth of the time."""
        return np.empty((len(self.p), len(self.p)))

    @cached_property
    def _inside(self) -> tuple[ndarray, sparse.csc_array]:
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
        return pairs, sparse.csc_array((value, place, starts), shape=(N * N, len(pairs)))

    @cached_property
    def _outside(self) -> tuple[ndarray, sparse.csc_array]:
        """The pairs with a row of H, and the matrix from their weights to the entries of a matrix L: L'H is the sum."""
        rows, N = self.S.shape[0], self.order
        pairs = np.flatnonzero(self.q >= rows)
        left = self.S[self.p[pairs]]
        place = np.repeat((self.q[pairs] - rows) * N, np.diff(left.indptr)) + left.indices
        return pairs, sparse.csc_array((left.data, place, left.indptr), shape=(len(self.H) * N, len(pairs)))


def combine(problem: Problem, y: Float[ndarray, " J"]) -> Float[ndarray, "N N"]:
    """Return sum_k y_k F_k."""
    weights, N = y if problem.tie is None else problem.tie @ y, problem.order
    (inside, products), (outside, lines) = problem._inside, problem._outside
    half = (products @ weights[inside]).reshape(N, N)
    if len(outside):
        half += (lines @ weights[outside]).reshape(len(problem.H), N).T @ problem.H
    return np.asarray(half + half.T)


def _product(problem: Problem, M: ndarray) -> ndarray:
    """Return D M."""
    rows = problem.S.shape[0]
    product = np.empty((rows + len(problem.H), M.shape[1]))
    product[:rows] = problem.S @ M
    np.matmul(problem.H, M, out=product[rows:])
    return product


def sandwich(problem: Problem, M: Float[ndarray, "N N"]) -> Float[ndarray, "r r"]:
    """Return D M D' for a symmetric M."""
    return _product(problem, np.ascontiguousarray(_product(problem, M).T))


def pairings(problem: Problem, M: Float[ndarray, "N N"]) -> Float[ndarray, " J"]:
    """Return <F_k, M> for every unknown, M symmetric."""
    pair, value, place = problem._entries
    terms = value * _product(problem, M).ravel()[place]
    products = 2 * np.bincount(pair, terms, minlength=len(problem.p)).astype(float)  # without pairs it counts integers
    return products if problem.tie is None else problem.tie.T @ products


def lengths(problem: Problem, M: Float[ndarray, "N N"]) -> Float[ndarray, " J"]:
    """Return 2 |d_p| |d_q|, summed over the pairs of every unknown, in the norm of M > 0: at least |<F_k, M>|."""
    squares = np.concatenate([problem.S.multiply(problem.S @ M).sum(axis=1), ((problem.H @ M) * problem.H).sum(axis=1)])
    norms = np.sqrt(np.maximum(squares, 0))
    products = 2 * norms[problem.p] * norms[problem.q]
    return np.asarray(products if problem.tie is None else abs(problem.tie).T @ products)


def schur(problem: Problem, Y: Float[ndarray, "r r"], V: Float[ndarray, "r r"]) -> Float[ndarray, "J J"]:
    """Return the matrix of tr(F_k X F_l Z^-1), Y = D X D', V = D Z^-1 D'; its lower triangle, all that is read.

    The next call for the same problem overwrites it.
    """
    M = pair_products(problem.p, problem.q, Y, V, problem._square)
    return M if problem.tie is None else tied(M, problem.tie)


def pair_products(
    p: Int[ndarray, " K"], q: Int[ndarray, " K"], Y: Float[ndarray, "r r"], V: Float[ndarray, "r r"],
    M: Float[ndarray, "K K"],
) -> Float[ndarray, "K K"]:  # fmt: skip
    """Write tr(F_k X F_l Z^-1) of single pairs (p_k, q_k) to the lower triangle of M, and return M."""
    for start in range(0, len(p), BLOCK):
        rows, stop = slice(start, start + BLOCK), min(start + BLOCK, len(p))
        r, s = p[:stop], q[:stop]
        Yp, Yq, Vp, Vq = Y[p[rows]], Y[q[rows]], V[p[rows]], V[q[rows]]
        block = Yq.take(r, 1) * Vp.take(s, 1)
        block += Yq.take(s, 1) * Vp.take(r, 1)
        block += Yp.take(r, 1) * Vq.take(s, 1)
        block += Yp.take(s, 1) * Vq.take(r, 1)
        M[rows, :stop] = block
    return M


def tied(M: Float[ndarray, "K K"], tie: sparse.csr_array) -> Float[ndarray, "J J"]:
    """Return tie' M tie for a symmetric M of which the lower triangle is given."""
    M = np.tril(M) + np.tril(M, -1).T
    return np.asarray(tie.T @ np.ascontiguousarray((tie.T @ M).T))


def unpack(problem: Problem, y: Float[ndarray, " J"]) -> Float[ndarray, "k k"]:
    """Return the matrix P(y)."""
    return symmetric_matrix(problem.symmetric, y[: problem.free])


def symmetric_matrix(order: int, entries: Float[ndarray, " f"]) -> Float[ndarray, "k k"]:
    """Return P, the sum of its entries times E_k = e_i e_j' + e_j e_i' over its upper triangle."""
    P = np.zeros((order, order))
    P[np.triu_indices(order)] = entries
    return P + P.T


def symmetric_entries(P: Float[ndarray, "k k"]) -> Float[ndarray, " f"]:
    """Return the entries of which `symmetric_matrix` makes P."""
    return (P / (1 + np.eye(len(P))))[np.triu_indices(len(P))]


def pack(M: Float[ndarray, "k k"]) -> Float[ndarray, " f"]:
    """Return <E_k, M> for the entries of P, M symmetric."""
    return 2 * M[np.triu_indices(len(M))]


def dual_of_P(problem: Problem, values: Float[ndarray, " f"]) -> Float[ndarray, "k k"]:
    """Return the symmetric W with <E_k, W> = values for every entry of P."""
    W = np.zeros((problem.symmetric, problem.symmetric))
    W[np.triu_indices(problem.symmetric)] = values / 2
    return W + np.triu(W, 1).T


def schur_of_P(U: Float[ndarray, "k k"], V: Float[ndarray, "k k"]) -> Float[ndarray, "f f"]:
    """Return the matrix of tr(E_k U E_l V) for the entries of P, U and V symmetric."""
    i, j = np.triu_indices(len(U))

    def products(a: ndarray, b: ndarray, c: ndarray, d: ndarray) -> ndarray:
        return np.asarray(U[np.ix_(a, b)] * V[np.ix_(c, d)])

    return np.asarray(products(j, i, i, j) + products(j, j, i, i) + products(i, i, j, j) + products(i, j, j, i))
