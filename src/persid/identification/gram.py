"""Gram: the sums of products that a least-squares fit needs, accumulated in blocks, and its ridge solutions."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from operator import add
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import UnderdeterminedError
from persid.identification.basis import Basis
from persid.identification.instruments import two_stages
from persid.identification.structure import Structure
from persid.measurements.moments import BLOCK as BLOCK

ILL_CONDITIONED = 1e7  # the Gram matrix squares the condition number, which leaves no more than 2 digits beyond this

ILL_PROJECTED = 1e4  # so, too, do products with instruments, of which less is kept

Rows = tuple[Float[ndarray, "N _"], ...]  # columns phi and left sides y; before them instruments, where there are some


@dataclass(frozen=True, eq=False)
class Gram:
    """What least squares knows of the data: minimise sum |y - theta' phi|^2 with y an increment or derivative of x.

    G = sum phi phi', H = sum phi y', yy = sum of y_i^2, each over `rows` rows; theta (p x n) belongs to
    `basis.columns`, the last being the constant; `basis.model(theta)` is the model and `basis.coefficients(model)`
    the way back. `weights` are the units of ridge strengths, `structure` tells which coefficients may be used.
    `root` is the triangular factor of [phi, y] where the Gram matrix alone is too ill-conditioned, else None.
    With `instruments`, Z'[Z, phi, y], all of this is of the second stage: phi stands for its projection on them.
    """

    G: Float[ndarray, "p p"]
    H: Float[ndarray, "p n"]
    yy: Float[ndarray, " n"]
    rows: int
    basis: Basis
    structure: Structure
    root: Float[ndarray, "r q"] | None = None
    instruments: Float[ndarray, "z _"] | None = None

    def __add__(self, other: "Gram") -> "Gram":
        return weighted((self, other), (1, 1))

    def __sub__(self, other: "Gram") -> "Gram":
        return weighted((self, other), (1, -1))

    @property
    def ill_conditioned(self) -> float:
        """The condition number from which on a triangular factor is needed."""
        return ILL_CONDITIONED if self.instruments is None else ILL_PROJECTED

    @cached_property
    def weights(self) -> Float[ndarray, " p"]:
        """Root mean square of every column, the unit in which ridge strengths are measured; 0 for the constant and
        for columns that do not vary."""
        total = np.diag(self.G)
        mean = self.G[-1] ** 2 / max(self.G[-1, -1], np.finfo(float).tiny)
        varies = total - mean > 1e-14 * len(total) * total
        varies[-1] = False
        return np.sqrt(np.where(varies, total, 0) / max(self.rows, 1))

    @cached_property
    def scaled(self) -> Float[ndarray, "k k"]:
        """The Gram matrix of the columns that vary and the constant, each scaled to mean square 1."""
        size = np.sqrt(np.diag(self.G) / max(self.rows, 1))
        keep = (self.weights > 0) | ((np.arange(len(size)) == len(size) - 1) & (size > 0))
        return self.G[np.ix_(keep, keep)] / self.rows / np.outer(size[keep], size[keep])

    def _centred(self, M: ndarray) -> ndarray:
        """Project the constant column out: the rows of M become those of the centred columns."""
        g = self.G[:, -1] / max(self.G[-1, -1], np.finfo(float).tiny)
        return M - np.outer(g, M[-1])

    def residual(self, theta: Float[ndarray, "p n"]) -> Float[ndarray, " n"]:
        """Return the mean squared residual of each equation."""
        value = self.yy - 2 * np.einsum("ij,ij->j", self.H, theta) + np.einsum("ij,ij->j", theta, self.G @ theta)
        return np.asarray(np.maximum(value, 0) / max(self.rows, 1))

    def solve(self, ridge: float) -> Float[ndarray, "p n"]:
        """Return theta of the ridge fit; the strength is relative to columns of mean square 1, the constant is free."""
        return np.asarray(self.path(np.array([float(ridge)]))[0])

    def path(self, ridges: Float[ndarray, " k"]) -> Float[ndarray, "k p n"]:
        """Return theta for every ridge strength, from one factorisation a state."""
        if not self.structure.is_separate:
            return np.stack([self._solve_shared(ridge) for ridge in ridges])
        out = np.zeros((len(ridges), *self.H.shape))
        used = self.structure.parameter >= 0
        for pattern in np.unique(used, axis=1).T:
            states = np.flatnonzero((used == pattern[:, None]).all(axis=0))
            solutions = self._solve_columns(pattern, states, ridges)
            out[np.ix_(np.arange(len(ridges)), np.flatnonzero(pattern), states)] = solutions
        return np.asarray(out + self.structure.given)

    def _solve_columns(self, used: ndarray, states: ndarray, ridges: ndarray) -> ndarray:
        """Solve (C + ridge) w = c in units where every column has mean square 1, then put the constant back."""
        keep = np.flatnonzero(used & (self.weights > 0))
        weights = self.weights[keep]
        constant = bool(used[-1])
        if self.root is not None:
            w = self._from_root(keep, states, constant, ridges)
        else:
            G, H = (self._centred(self.G), self._centred(self.H)) if constant else (self.G, self.H)
            C = G[np.ix_(keep, keep)] / self.rows / np.outer(weights, weights)
            c = H[np.ix_(keep, states)] / self.rows / weights[:, None]
            w = _ridge_path(C, c, ridges)
        theta = np.zeros((len(ridges), len(used), len(states)))
        theta[:, keep] = w / weights[:, None]
        if constant:
            theta[:, -1] = (self.H[-1, states] - np.einsum("p,kps->ks", self.G[-1], theta)) / self.G[-1, -1]
        return theta[:, used]

    def _from_root(self, keep: ndarray, states: ndarray, constant: bool, ridges: ndarray) -> ndarray:
        """The same solution by singular values of the triangular factor: the condition number is not squared."""
        root = self.root
        if root is None:
            raise ValueError("this Gram has no triangular factor")
        p = len(self.G)
        phi, y = root[:, keep] / self.weights[keep], root[:, p + states]
        if constant:
            q = root[:, p - 1 : p] / np.linalg.norm(root[:, p - 1])
            phi, y = phi - q @ (q.T @ phi), y - q @ (q.T @ y)
        U, s, Vt = np.linalg.svd(phi / np.sqrt(self.rows), full_matrices=False)
        projected = U.T @ y / np.sqrt(self.rows)
        good = s > np.finfo(float).eps * len(s) * s.max(initial=0)
        return np.stack([Vt[good].T @ ((s / (s**2 + r))[good, None] * projected[good]) for r in ridges])

    def _solve_shared(self, ridge: float) -> ndarray:
        """Solve one system for all states: every parameter's column is the sum of the columns it stands for."""
        number, count = self.structure.parameter, self.structure.count
        M, h, penalty = np.zeros((count, count)), np.zeros(count), np.zeros(count)
        for i in range(number.shape[1]):
            used = np.flatnonzero(
                (number[:, i] >= 0) & ((self.weights > 0) | (np.arange(len(number)) == len(number) - 1))
            )
            ids = number[used, i]
            M[np.ix_(ids, ids)] += self.G[np.ix_(used, used)] / self.rows
            h[ids] += self.H[used, i] / self.rows
            penalty[ids] += self.weights[used] ** 2
        diagonal = np.sqrt(np.where(np.diag(M) > 0, np.diag(M), 1.0))
        A = (M + ridge * np.diag(penalty)) / np.outer(diagonal, diagonal)
        parameters = _ridge_path(A, (h / diagonal)[:, None], np.zeros(1))[0, :, 0] / diagonal
        return np.where(number >= 0, parameters[number], self.structure.given)


def _ridge_path(C: ndarray, c: ndarray, ridges: ndarray) -> ndarray:
    """Return (C + r I)^-1 c for every r; directions that the data do not hold get 0."""
    e, V = np.linalg.eigh((C + C.T) / 2)
    good = e > np.finfo(float).eps * len(e) * e.max(initial=0)
    projected = V[:, good].T @ c
    return np.stack([V[:, good] @ (projected / (e[good] + r)[:, None]) for r in ridges])


def weighted(grams: Sequence[Gram], weights: Sequence[int]) -> Gram:
    """Return the Gram of all rows together, those of each Gram counted so many times."""
    counted = [(int(weight), gram) for weight, gram in zip(weights, grams, strict=True) if weight and gram.rows]
    if not counted:
        return grams[0]
    one = counted[0][1]

    def sums(name: str) -> Any:
        return sum(weight * getattr(gram, name) for weight, gram in counted)

    if one.instruments is None:
        return Gram(sums("G"), sums("H"), sums("yy"), sums("rows"), one.basis, one.structure)
    return _projected(sums("instruments"), sums("yy"), sums("rows"), one.basis, one.structure)


def _projected(products: ndarray, yy: ndarray, rows: int, basis: Basis, structure: Structure) -> Gram:
    G, H = two_stages(products, basis.size)
    return Gram(G, H, yy, rows, basis, structure, instruments=products)


def accumulate(blocks: Iterable[Rows], basis: Basis, structure: Structure) -> Gram:
    """Sum a stream of blocks ([Z,] phi, y) to a Gram: one pass, memory independent of the number of rows."""
    p, n = basis.size, len(basis.states)
    products, yy, rows = np.zeros((p, p + n)), np.zeros(n), 0
    projected = False
    for *instruments, phi, y in blocks:
        left, projected = (instruments or [phi])[0], bool(instruments)
        new = left.T @ np.hstack([*instruments, phi, y])
        products = products + new if rows else new
        yy += np.einsum("ij,ij->j", y, y)
        rows += len(y)
    if projected:
        return _projected(products, yy, rows, basis, structure)
    return Gram(products[:, :p], products[:, p:], yy, rows, basis, structure)


@dataclass(frozen=True, eq=False)
class Triangle:
    """The triangular factor R of rows, R'R = their Gram matrix; a sum is the factor of both sets of rows together."""

    R: Float[ndarray, "r q"]

    def __add__(self, other: "Triangle") -> "Triangle":
        stacked = np.vstack([R for R in (self.R, other.R) if len(R)] or [self.R])
        return Triangle(np.asarray(np.linalg.qr(stacked, mode="r")))


def triangle(blocks: Iterable[Rows]) -> Triangle:
    """Return the triangular factor of all rows [phi, y] (tall-skinny QR)."""
    return reduce(add, (Triangle(np.hstack(rows)) for rows in blocks), Triangle(np.zeros((0, 0))))


def with_root(gram: Gram, root: Triangle) -> Gram:
    """Return the Gram with the triangular factor of its rows [phi, y], from a second pass over them.

    Of the factor of [Z, phi, y] the first rows, one an instrument, are the projection of [phi, y] on them.
    """
    z = 0 if gram.instruments is None else len(gram.instruments)
    return replace(gram, root=root.R[:z, z:] if z else root.R)


def condition_number(matrix: Float[ndarray, "k k"]) -> float:
    """Return the condition number of the columns behind a Gram matrix; infinite where they are dependent."""
    if not len(matrix):
        return 1.0
    e = np.linalg.eigvalsh(matrix)
    return float(np.sqrt(e[-1] / e[0])) if e[0] > np.finfo(float).eps * e[-1] else float("inf")


def refuse_underdetermined(gram: Gram) -> None:
    """Raise UnderdeterminedError where there are fewer rows than unknowns a state."""
    unknowns = gram.structure.most_columns
    if gram.rows < unknowns:
        raise UnderdeterminedError(
            f"{gram.rows} samples for {unknowns} unknown coefficients per state: many models fit exactly. Give more "
            "data, fewer functions, pattern= or shared=True, or allow_underdetermined=True for the smallest one"
        )
