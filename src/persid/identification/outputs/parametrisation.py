"""Latent models that are stable by construction: every parameter gives a model with a proof, with P = I."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

KEPT = 1 - 1e-3  # of S, for Delta'Delta: what is left is the margin that survives rounding
TINY, NEAR = 1e-12, 1 - 1e-6  # least density M, of the largest; norm of U at most
REGULAR = 1e-6  # least eigenvalue of S with unit diagonal: a share 1 - KEPT of it still survives rounding
ROOM, SHRUNK = 0.7, 200  # norm of U at which neurons without effect begin; how often their multipliers shrink, at most
BESIDE = 0.1  # of the others' T, for one neuron more, at most
SLACK = 1e-4  # of |A|: the multiple of the unit matrix that A gives away


@dataclass(frozen=True)
class Shape:
    """Say how many states and neurons there are, which decay rate kappa is asked for, and the slack eps of A.

    A parameter vector is (J below its diagonal, L, R, log M, log T, X).
    """

    n: int
    q: int
    kappa: float = 0.0
    eps: float = 1e-6

    @property
    def sizes(self) -> tuple[int, ...]:
        """Numbers of entries of the six parts."""
        n, q = self.n, self.q
        return n * (n - 1) // 2, n * n, q * n, q, q, n * q

    @property
    def size(self) -> int:
        """Number of parameters."""
        return sum(self.sizes)


@dataclass(frozen=True, eq=False)
class Proved:
    """Hold K models with their multipliers; `valid` is False where the parameters give none (S is not positive)."""

    A: Float[ndarray, "K n n"]
    A1: Float[ndarray, "K n q"]
    R: Float[ndarray, "K q n"]
    M: Float[ndarray, "K q"]
    T: Float[ndarray, "K q"]
    valid: ndarray


@np.errstate(all="ignore")  # what overflows is not valid, and costs infinitely much
def proved(shape: Shape, v: Float[ndarray, "K p"]) -> tuple[Proved, Float[ndarray, "K p d"]]:
    """Return the models of the parameters and the derivative of (A, A1, R) by every parameter.

    With G = R R', J skew, M and T positive and diagonal,

        S = 2 T + M G T + T G M + kappa M G M         Delta = X (1 + X'X)^(-1/2) chol(S)'   so that Delta'Delta < S
        At = J - L L'/2 - eps      A = At - kappa/2      A1 = At R'M - R'T - L Delta - kappa/2 R'M

    and the inequality of `StableFit` is, with K = L'R'M + Delta,

        Z = (L, K')'(L, K')' + diag(0, S - Delta'Delta) + 2 eps (1, R'M)'(1, R'M) > 0.

    Each line is followed by its differential, for all parameters at once (axis 1).
    """
    n, q, kappa, eye = shape.n, shape.q, shape.kappa, np.eye(shape.n)
    (J, dJ), (L, dL), (R, dR), (logM, dlogM), (logT, dlogT), (X, dX) = _parts(shape, v)
    M, T = np.exp(logM), np.exp(logT)
    dM, dT = M[:, None] * dlogM, T[:, None] * dlogT
    At = J - L @ _t(L) / 2 - shape.eps * eye
    dAt = dJ - _twice_symmetric(dL @ _t(L)[:, None]) / 2
    A, dA = At - kappa / 2 * eye, dAt
    if not q:
        empty = np.zeros((len(v), n, 0))
        return Proved(A, empty, _t(empty), M, T, np.ones(len(v), bool)), dA.reshape(*v.shape, -1)

    G, dG = R @ _t(R), _twice_symmetric(dR @ _t(R)[:, None])
    # S = 2 T + Y + Y', Y = M G (T + kappa M / 2)
    N, dN = T + kappa / 2 * M, dT + kappa / 2 * dM
    S = 2 * _diagonal(T) + _twice_symmetric(M[..., None] * G * N[:, None])
    dY = dM[..., None] * (G * N[:, None])[:, None] + M[:, None, :, None] * (
        dG * N[:, None, None] + G[:, None] * dN[:, :, None]
    )
    dS = 2 * _diagonal(dT) + _twice_symmetric(dY)
    valid = np.isfinite(S).all((1, 2)) & np.isfinite(dS).all((1, 2, 3))
    S = np.where(valid[:, None, None], S, np.eye(q))
    unit = 1 / np.sqrt(np.maximum(np.einsum("kii->ki", S), 1e-300))
    valid &= np.linalg.eigvalsh(unit[:, :, None] * S * unit[:, None])[:, 0] > REGULAR
    S = np.where(valid[:, None, None], S, np.eye(q))

    # chol: d(low) = low Phi(low^-1 dS low^-T), Phi the lower triangle with half of the diagonal
    low = np.sqrt(KEPT) * np.linalg.cholesky(S)
    inverse = np.linalg.inv(low)[:, None]
    dlow = low[:, None] @ ((np.tril(np.ones((q, q))) - np.eye(q) / 2) * (inverse @ (KEPT * dS) @ _t(inverse)))
    # Y^(-1/2) = V w^(-1/2) V': its differential is V (F * V' dY V) V', F the divided differences of w^(-1/2)
    w, V = np.linalg.eigh(np.eye(q) + _t(X) @ X)
    root = np.sqrt(w)
    shrunk = (V / root[:, None]) @ _t(V)
    F = -1 / (root[:, :, None] * root[:, None] * (root[:, :, None] + root[:, None]))
    V4 = V[:, None]
    dshrunk = V4 @ (F[:, None] * (_t(V4) @ _twice_symmetric(_t(dX) @ X[:, None]) @ V4)) @ _t(V4)
    Delta = X @ shrunk @ _t(low)
    dDelta = dX @ (shrunk @ _t(low))[:, None] + X[:, None] @ (dshrunk @ _t(low)[:, None] + shrunk[:, None] @ _t(dlow))

    # A1 = (At - kappa/2) R'M - R'T - L Delta, for A = At - kappa/2
    RM, dRM = _t(R) * M[:, None], _t(dR) * M[:, None, None] + _t(R)[:, None] * dM[:, :, None]
    dRT = _t(dR) * T[:, None, None] + _t(R)[:, None] * dT[:, :, None]
    A1 = A @ RM - _t(R) * T[:, None] - L @ Delta
    dA1 = dA @ RM[:, None] + A[:, None] @ dRM - dRT - dL @ Delta[:, None] - L[:, None] @ dDelta
    slopes = [np.broadcast_to(part, (*v.shape, *part.shape[2:])).reshape(*v.shape, -1) for part in (dA, dA1, dR)]
    return Proved(A, A1, R, M, T, valid), np.concatenate(slopes, 2)


def parameters_of(shape: Shape, A: Float[ndarray, "n n"], R: Float[ndarray, "q n"]) -> Float[ndarray, " p"]:
    """Return parameters of the linear model A (A + A' + kappa < 0) with neurons of no effect, A1 = 0.

    T and M shrink until Delta = L^-1 (A R'M - R'T) fits below S, which it does in the end: Delta'Delta falls as T^2.

    Raises:
        ValueError: A + A' + kappa is not negative.
    """
    L, fast = _root(shape, A), np.abs(np.linalg.eigvals(A)).max()
    for k in range(SHRUNK):
        T = np.full(len(R), 0.7**k)
        one = Multiplied(A, np.zeros(R.T.shape), R, 0.1 * T / fast, T)
        U = _share(shape, L, one)
        if not len(R) or np.linalg.norm(U, 2) < ROOM:
            break
    return _flat(L, one, U)


def parameters_beside(
    shape: Shape, given: "Multiplied", idle: Bool[ndarray, " q"], most: float = NEAR
) -> Float[ndarray, " p"]:
    """Return parameters of a model that its M and T prove, with neurons beside those that have no effect yet: `idle`.

    A fit ends near the edge of what is proved, where there is little room for more: so U of what is there is shrunk to
    `most`, the model giving way a little. T and M of the idle, at first a share of the others', shrink until half of
    the room is left.

    Raises:
        ValueError: A + A' + kappa is not negative.
    """
    A, A1, R, M, T = given
    L, fast = _root(shape, A), np.abs(np.linalg.eigvals(A)).max()
    own = given.of(~idle)
    U = _shrunk(_share(shape, L, own), most)
    A1 = A1.copy()
    A1[:, ~idle] = A @ (own.R.T * own.M) - own.R.T * own.T - L @ U @ _root_of_S(shape, own).T
    for k in range(SHRUNK):
        tau = BESIDE * np.median(own.T) * 0.7**k
        one = Multiplied(A, A1, R, np.where(idle, 0.1 * tau / fast, M), np.where(idle, tau, T))
        if _is_positive(shape, one) and np.linalg.norm(_share(shape, L, one), 2) < (1 + np.linalg.norm(U, 2)) / 2:
            break
    return parameters_under(shape, one)


def parameters_under(shape: Shape, given: "Multiplied") -> Float[ndarray, " p"]:
    """Return parameters of a model with multipliers M >= 0 and T that prove it; where its margin is less than what is
    kept here, those of a model beside it.

    Raises:
        ValueError: A + A' + kappa is not negative.
    """
    L, M = _root(shape, given.A), np.maximum(given.M, TINY * given.M.max(initial=TINY))
    one = given._replace(M=M)
    return _flat(L, one, _shrunk(_share(shape, L, one), NEAR))


def _shrunk(U: Float[ndarray, "n q"], most: float) -> Float[ndarray, "n q"]:
    left, size, right = np.linalg.svd(U, full_matrices=False)
    return np.asarray((left * np.minimum(size, most)) @ right)


def _root(shape: Shape, A: Float[ndarray, "n n"]) -> Float[ndarray, "n n"]:
    w, V = np.linalg.eigh(-(A + A.T) - (shape.kappa + 2 * shape.eps) * np.eye(shape.n))
    if w[0] <= 0:
        raise ValueError("A + A' + kappa is not negative in these coordinates")
    return np.asarray((V * np.sqrt(w)) @ V.T)


class Multiplied(NamedTuple):
    """A model x' = A x + A1 f(R x) with its multipliers."""

    A: Float[ndarray, "n n"]
    A1: Float[ndarray, "n q"]
    R: Float[ndarray, "q n"]
    M: Float[ndarray, " q"]
    T: Float[ndarray, " q"]

    def of(self, chosen: Bool[ndarray, " q"]) -> "Multiplied":
        """Return the model with some of its neurons."""
        return Multiplied(self.A, self.A1[:, chosen], self.R[chosen], self.M[chosen], self.T[chosen])


def _share(shape: Shape, L: Float[ndarray, "n n"], one: Multiplied) -> Float[ndarray, "n q"]:
    """Return U with Delta = U chol(KEPT S)': below 1 in norm where M and T prove the model."""
    A, A1, R, M, T = one
    Delta = np.linalg.solve(L, A @ (R.T * M) - R.T * T - A1)
    return np.asarray(Delta @ np.linalg.inv(_root_of_S(shape, one).T))


def _root_of_S(shape: Shape, one: Multiplied) -> Float[ndarray, "q q"]:
    return np.asarray(np.sqrt(KEPT) * np.linalg.cholesky(_S(shape, one)))


def _is_positive(shape: Shape, one: Multiplied) -> bool:
    return bool(np.linalg.eigvalsh(_S(shape, one))[0] > 0)


def _S(shape: Shape, one: Multiplied) -> Float[ndarray, "q q"]:
    G, M, T = one.R @ one.R.T, one.M, one.T
    return np.asarray(2 * np.diag(T) + M[:, None] * G * T + T[:, None] * G * M + shape.kappa * M[:, None] * G * M)


def _flat(L: Float[ndarray, "n n"], one: Multiplied, U: Float[ndarray, "n q"]) -> Float[ndarray, " p"]:
    A, _, R, M, T = one
    w, V = np.linalg.eigh(np.eye(len(R)) - U.T @ U)
    X, J = U @ (V / np.sqrt(w)) @ V.T, (A - A.T) / 2
    low = np.tril_indices(len(A), -1)
    return np.concatenate([J[low], L.ravel(), R.ravel(), np.log(M), np.log(T), X.ravel()])


def _parts(shape: Shape, v: Float[ndarray, "K p"]) -> list[tuple[ndarray, ndarray]]:
    """Return the six parts with their derivatives by the whole vector, which are constant."""
    n, q, unit = shape.n, shape.q, np.eye(shape.size)
    forms = (None, (n, n), (q, n), (q,), (q,), (n, q))
    ends = np.cumsum(shape.sizes)[:-1]
    found = []
    for part, slopes, form in zip(np.split(v, ends, 1), np.split(unit, ends, 1), forms, strict=True):
        both = (part, slopes)
        pair = tuple(_skew(x, n) if form is None else x.reshape(len(x), *form) for x in both)
        found.append((pair[0], pair[1][None]))
    return found


def _skew(below: Float[ndarray, "K p"], n: int) -> Float[ndarray, "K n n"]:
    J = np.zeros((len(below), n, n))
    i, j = np.tril_indices(n, -1)
    J[:, i, j], J[:, j, i] = below, -below
    return J


def _t(matrix: ndarray) -> ndarray:
    return np.swapaxes(matrix, -1, -2)


def _twice_symmetric(matrix: ndarray) -> ndarray:
    return np.asarray(matrix + _t(matrix))


def _diagonal(entries: ndarray) -> ndarray:
    return entries[..., None] * np.eye(entries.shape[-1])
