"""The paper's road: lifting, EDMD, the generator as a matrix logarithm, and the coefficients of the vector field.

Rows are samples and psi_next = psi K, the paper's transposed convention [least_square_solution].
"""

import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.linalg import eig, expm, logm

from persid.errors import DataError, GeneratorError
from persid.identification.basis import Basis
from persid.identification.gram import BLOCK, ILL_CONDITIONED, Rows, Triangle, condition_number, triangle
from persid.measurements.recordings import Measurements, Part, block_sums, lengths, steps
from persid.measurements.trajectory import Trajectory
from persid.models.functions import ScalarFunction, scalar_function

Mixed = Callable[[ndarray, ndarray], object]

INACCURATE = 1e-6  # relative error of exp(log K) from which a logarithm is refused
MIXED = -2  # in place of a coordinate: a lifting function of several coordinates
EQUAL_STEPS = 1e-3  # relative spread of the steps up to which a run counts as sampled at equal steps
SAMPLING_ERROR = 10.0  # with regressed inputs an eigenvalue below this / sqrt(samples) cannot be told from 0
SURE = 0.5  # an eigenvalue above this is told from 0 by any data
ALIASING = 0.9  # of half a circle per sample
VANISHING = 1e-12  # relative to the largest eigenvalue


@dataclass(frozen=True, eq=False)
class Lifting:
    """Lifting functions psi: coordinates x - x_ref, the basis functions, further functions, inputs, 1. Paper: Sec. 2.1.

    Each function depends on one coordinate of (x, u) alone, `extra[i]` being the further ones of state i; but for the
    `width` columns of `mixed`, a function of x (N, n) and u (N, m). The first n functions are the coordinates, the last
    m + 1 the inputs and the constant.
    """

    basis: Basis
    extra: tuple[tuple[ScalarFunction, ...], ...] = ()
    mixed: Mixed | None = None
    width: int = 0

    @cached_property
    def _functions(self) -> tuple[int, ...]:
        """Columns of the basis that are functions; its linear ones are among the coordinates already."""
        return tuple(k for k, c in enumerate(self.basis.columns[: self.basis.state_columns]) if c.kind == "function")

    @cached_property
    def owner(self) -> tuple[int, ...]:
        """The coordinate of chi = (x, u) that each function depends on, -1 for the constant, -2 for several."""
        n, m = len(self.basis.states), len(self.basis.inputs)
        extra = [i for i, functions in enumerate(self.extra) for _ in functions]
        functions = (int(self.basis.owner[k]) for k in self._functions)
        return (*range(n), *functions, *extra, *[MIXED] * self.width, *range(n, n + m), -1)

    @property
    def size(self) -> int:
        """Number of lifting functions."""
        return len(self.owner)

    def values(self, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"]) -> Float[ndarray, "N l"]:
        """Return psi at every sample."""
        n, m = len(self.basis.states), len(self.basis.inputs)
        out = np.empty((len(x), self.size))
        middle = n + len(self._functions)
        if all(self.basis.linear):  # then the coordinates and functions are the columns of the basis, in its order
            self.basis.write(x, out[:, :middle])
        else:
            out[:, :n] = x - self.basis.x_ref
            out[:, n:middle] = self.basis.values(x)[:, list(self._functions)]
        if self.extra:
            y = (x - self.basis.x_ref) / self.basis.scale
            extra = [f.value(y[:, i]) for i, functions in enumerate(self.extra) for f in functions]
            out[:, middle : middle + len(extra)] = np.transpose(extra)
        out[:, self.mixed_columns] = self.mix(x, u)
        out[:, self.size - m - 1 : -1] = u - self.basis.u_ref
        out[:, -1] = 1
        return out

    @property
    def mixed_columns(self) -> slice:
        """Places of the functions of several coordinates."""
        stop = self.size - len(self.basis.inputs) - 1
        return slice(stop - self.width, stop)

    def mix(self, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"]) -> Float[ndarray, "N w"]:
        """Return the functions of several coordinates."""
        return np.zeros((len(x), 0)) if self.mixed is None else np.asarray(self.mixed(x, u), float)

    def slopes(self, x: Float[ndarray, "N n"]) -> Float[ndarray, "N l"]:
        """Return the derivative of every function by its own coordinate.

        Raises:
            DataError: there are functions of several coordinates.
        """
        if self.width:
            raise DataError('a lifting by a function of x and u has no elementary generators; use gamma="coordinates"')
        y = (x - self.basis.x_ref) / self.basis.scale
        extra = [
            f.derivative(y[:, i]) / self.basis.scale[i] for i, functions in enumerate(self.extra) for f in functions
        ]
        functions = self.basis.slopes(x)[:, list(self._functions)]
        inputs = np.ones((len(x), len(self.basis.inputs)))
        return np.column_stack([np.ones_like(x), functions, *extra, inputs, np.zeros(len(x))])

    def columns(self, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"]) -> Float[ndarray, "N p"]:
        """Return the basis functions G of the vector field, inputs and constant among them."""
        return np.column_stack([self.basis.values(x), u - self.basis.u_ref, np.ones(len(x))])


def make_lifting(basis: Basis, extra: Sequence[str] | Mixed = ()) -> Lifting:
    """Return the default lifting of a basis, enlarged.

    `extra` holds expressions, taken of every (x_i - x_ref_i)/scale_i, or is one function of x (N, n) and u (N, m) that
    returns further columns (N, w).
    """
    if callable(extra):
        probe = np.asarray(extra(basis.x_ref[None], basis.u_ref[None]))
        if probe.ndim != 2 or len(probe) != 1:
            raise DataError(f"lifting(x, u) returned shape {probe.shape} for one sample; needed is (1, w)")
        return Lifting(basis, (), extra, probe.shape[1])
    functions = tuple(scalar_function(text) for text in extra)
    return Lifting(basis, (functions,) * len(basis.states) if functions else ())


def snapshot_pairs(run: Trajectory, lifting: Lifting, hold: str) -> Iterator[tuple[ndarray, ndarray]]:
    """Yield blocks of (psi, psi_next): (x_k, u_k) goes with (x_{k+1}, u_k), or with u_{k+1} for hold="paper".

    psi_next is without its last columns that equal those of psi: the constant, and the inputs under hold="zoh".
    """
    moving = _moving(lifting, hold)
    for begin in range(0, len(run) - 1, BLOCK):
        piece = run[begin : min(begin + BLOCK, len(run) - 1) + 1]
        psi = lifting.values(piece.x, piece.u)
        after = psi[1:, :moving]
        if lifting.width and hold == "zoh":
            after = after.copy()
            after[:, lifting.mixed_columns] = lifting.mix(piece.x[1:], piece.u[:-1])
        yield psi[:-1], after


def sample_step(data: Measurements) -> float:
    """Return the step in s of equally sampled runs, or raise DataError: EDMD and delays need one."""
    found = steps(data)
    if found.high - found.low > EQUAL_STEPS * found.high:
        raise DataError(
            f'EDMD needs equal steps; these go from {found.low:.6g} to {found.high:.6g} s. Use method="weak"'
        )
    return found.mean


@dataclass(frozen=True, eq=False)
class PairSums:
    """Sums over snapshot pairs: M = sum psi psi', C = sum psi psi_next' (the columns that move), and their number."""

    M: Float[ndarray, "l l"]
    C: Float[ndarray, "l k"]
    pairs: int

    def __add__(self, other: "PairSums") -> "PairSums":
        return PairSums(self.M + other.M, self.C + other.C, self.pairs + other.pairs)


def pair_sums(run: Trajectory, count: int, lifting: Lifting, hold: str) -> PairSums:
    """Return the sums over the pairs that begin in the first `count` samples of a run."""
    size, moving = lifting.size, _moving(lifting, hold)
    M, C, pairs = np.zeros((size, size)), np.zeros((size, moving)), 0
    for psi, after in snapshot_pairs(run[: count + 1], lifting, hold):
        M += psi.T @ psi
        C += psi.T @ after
        pairs += len(psi)
    return PairSums(M, C, pairs)


def _moving(lifting: Lifting, hold: str) -> int:
    """Number of lifting functions, the first ones, whose next values are not known beforehand."""
    return lifting.size - 1 - (len(lifting.basis.inputs) if hold == "zoh" else 0)


def _whole(data: Measurements) -> list[Part]:
    return [Part(r, 0, count, 0) for r, count in enumerate(lengths(data))]


def edmd(
    data: Measurements, lifting: Lifting, hold: str = "zoh", parts: Sequence[Part] | None = None
) -> Float[ndarray, "l l"]:
    """Return the Koopman matrix K = pinv(Psi) Psi_next for psi_next = psi K, of all samples or of some parts.

    Paper: least_square_solution (Sec. 2.3). One pass over the samples; a second one by QR where the scaled Gram matrix
    is ill-conditioned.

    Raises:
        DataError: the samples do not determine K: a lifting function is a combination of the others on them.
    """
    used = _whole(data) if parts is None else _one_block(parts)
    sums = block_sums(data, used, partial(pair_sums, lifting=lifting, hold=hold), 1, within=True)[0]
    d = np.sqrt(np.maximum(np.diag(sums.M), np.finfo(float).tiny))
    scaled = sums.M / np.outer(d, d)
    if condition_number(scaled) < ILL_CONDITIONED:
        moving = np.linalg.solve(scaled, sums.C / d[:, None]) / d[:, None]
    else:
        work = partial(_pair_triangle, lifting=lifting, hold=hold, d=d)
        moving = _from_triangle(block_sums(data, used, work, 1, within=True)[0], d)
    return np.hstack([moving, np.eye(lifting.size)[:, moving.shape[1] :]])


def _one_block(parts: Sequence[Part]) -> list[Part]:
    return [replace(part, block=0) for part in parts]


def _pair_triangle(run: Trajectory, count: int, lifting: Lifting, hold: str, d: ndarray) -> Triangle:
    return triangle(_scaled_pairs(run[: count + 1], lifting, hold, d))


def _scaled_pairs(run: Trajectory, lifting: Lifting, hold: str, d: ndarray) -> Iterator[Rows]:
    empty = np.zeros((0, lifting.size)), np.zeros((0, _moving(lifting, hold)))
    yield empty  # a part of one sample has no pairs
    for psi, after in snapshot_pairs(run, lifting, hold):
        yield psi / d, after


def _from_triangle(root: Triangle, d: ndarray) -> ndarray:
    size = len(d)
    U, s, Vt = np.linalg.svd(root.R[:, :size], full_matrices=False)
    floor = np.finfo(float).eps * size * s[0]
    if len(s) < size or s[-1] < floor:
        raise DataError(
            f"the samples determine only {int((s > floor).sum())} of {size} lifting functions; "
            "an input that never varies, or too few samples, does that: leave functions or inputs out, or add data"
        )
    return np.asarray((Vt.T / s @ U.T @ root.R[:, size:]) / d[:, None])


@dataclass(frozen=True, eq=False)
class _Residuals:
    """Sums over snapshot pairs: psi psi' and |psi_next v - k psi v|^2 for some eigenpairs (k, v), and their number."""

    M: ndarray
    squares: ndarray
    pairs: int

    def __add__(self, other: "_Residuals") -> "_Residuals":
        return _Residuals(self.M + other.M, self.squares + other.squares, self.pairs + other.pairs)


def _residuals(run: Trajectory, count: int, lifting: Lifting, hold: str, k: ndarray, v: ndarray) -> _Residuals:
    M, squares, pairs, moving = np.zeros((lifting.size,) * 2), np.zeros(len(k)), 0, _moving(lifting, hold)
    for psi, after in snapshot_pairs(run[: count + 1], lifting, hold):
        r = after @ v[:moving] + psi[:, moving:] @ v[moving:] - (psi @ v) * k
        M += psi.T @ psi
        squares += (np.abs(r) ** 2).sum(axis=0)
        pairs += len(psi)
    return _Residuals(M, squares, pairs)


def doubtful_eigenvalues(
    data: Measurements,
    lifting: Lifting,
    K: Float[ndarray, "l l"],
    hold: str = "zoh",
    parts: Sequence[Part] | None = None,
) -> tuple[complex, ...]:
    """Return the eigenvalues of K that their sampling error does not tell from 0 (3 standard deviations).

    With K v = k v, w'K = k w' and the residual r = psi_next v - k psi v, first-order perturbation of
    K = pinv(Psi) Psi_next gives var k = (w' (Psi'Psi)^-1 w) mean|r|^2 / |w'v|^2.
    """
    values, left, right = eig(K, left=True)
    small = np.flatnonzero(np.abs(values) < SURE)
    if not len(small):
        return ()
    w, v = left[:, small], right[:, small]
    used = _whole(data) if parts is None else _one_block(parts)
    work = partial(_residuals, lifting=lifting, hold=hold, k=values[small], v=v)
    sums = block_sums(data, used, work, 1, within=True)[0]
    d = np.sqrt(np.diag(sums.M))
    spread = np.linalg.solve(sums.M / np.outer(d, d), w / d[:, None])
    variance = (w.conj() / d[:, None] * spread).sum(axis=0).real * sums.squares / sums.pairs
    error = np.sqrt(np.maximum(variance, 0)) / np.abs((w.conj() * v).sum(axis=0))
    return tuple(complex(values[k]) for k, e in zip(small, error, strict=True) if np.abs(values[k]) < 3 * e)


def koopman_generator(
    K: Float[ndarray, "l l"],
    dt: float,
    *,
    samples: int | None = None,
    hold: str = "zoh",
    doubtful: tuple[complex, ...] = (),
) -> Float[ndarray, "l l"]:
    """Return L = log(K)/dt in 1/s, or refuse where K has no trustworthy real logarithm.

    Paper: eq:log_K (Sec. 2.2). `samples` is the number of pairs behind K; with hold="paper" the rows of the inputs are
    regressed, and an eigenvalue below 10/sqrt(samples) cannot be told from 0; neither can those that are `doubtful`.

    Raises:
        GeneratorError: an eigenvalue is zero, negative, not to be told from that, or turns near half a circle a sample.
    """
    values = np.linalg.eigvals(K).astype(complex)
    limit = SAMPLING_ERROR / np.sqrt(samples) if hold == "paper" and samples else 0.0
    if doubtful:
        worst = min(doubtful, key=abs)
        raise GeneratorError(_refusal(f"the eigenvalue {_show(worst)} cannot be told from 0 by these data", values, dt))
    _diagnose(values, max(limit, VANISHING * float(np.abs(values).max())), dt)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # of an estimate; the error itself is judged below
        L = logm(K)
    if np.iscomplexobj(L):
        if np.abs(L.imag).max() > 1e-8 * (1 + np.abs(L.real).max()):
            raise GeneratorError(_refusal("the logarithm is complex", values, dt))
        L = L.real
    error = np.linalg.norm(expm(L) - K) / np.linalg.norm(K)
    if not error < INACCURATE:
        raise GeneratorError(_refusal(f"its exponential misses K by {error:.1g} of its norm", values, dt))
    return L / dt


def _diagnose(values: ndarray, limit: float, dt: float) -> None:
    small = values[np.abs(values) <= limit]
    if len(small):
        worst = small[np.argmin(np.abs(small))]
        why = f"the eigenvalue {_show(worst)} cannot be told from 0 (limit {limit:.2g})"
        raise GeneratorError(_refusal(why, values, dt))
    angles = np.abs(np.angle(values))
    k = int(angles.argmax())
    if angles[k] >= np.pi - 1e-9:
        raise GeneratorError(_refusal(f"the eigenvalue {_show(values[k])} is real and negative", values, dt))
    if angles[k] > ALIASING * np.pi:
        turn = f"turns {angles[k] / np.pi:.2f} of half a circle per sample: aliasing"
        raise GeneratorError(_refusal(f"the eigenvalue {_show(values[k])} {turn}", values, dt))


def _refusal(why: str, values: ndarray, dt: float) -> str:
    return (
        f"the Koopman matrix has no trustworthy logarithm: {why}. Spectrum: {spectrum_in_words(values, dt)}. "
        'Try hold="zoh" where inputs are held, fewer functions (functions=["x"]), a shorter sampling step, or '
        'method="weak" or time="discrete", which need no logarithm'
    )


def _show(eigenvalue: complex) -> str:
    value = complex(eigenvalue)
    return f"{value.real:.3g}" if abs(value.imag) < 1e-12 else f"{value.real:.3g}{value.imag:+.3g}i"


def spectrum_in_words(values: ndarray, dt: float) -> str:
    """Describe eigenvalues of a Koopman matrix: how many of each kind, and the slowest and fastest decay."""
    size, angle = np.abs(values), np.abs(np.angle(values))
    negative = int((angle >= np.pi - 1e-9).sum())
    turning = int(((angle > 1e-9) & (angle < np.pi - 1e-9)).sum())
    text = f"{len(values)} eigenvalues, {negative} negative, {turning} complex"
    text += f", moduli from {size.min():.3g} to {size.max():.3g}"
    outside = int((size > 1 + 1e-9).sum())
    fastest = f"the fastest decays in {-dt / np.log(size.min()):.3g} s" if 0 < size.min() < 1 else "none decays"
    return f"{text} ({outside} above 1), {fastest}"


def elementary_generators(
    lifting: Lifting, x: Float[ndarray, "N n"], u: Float[ndarray, "N m"]
) -> Float[ndarray, "c p l l"]:
    """Return L_ij,rep for coordinate i of chi and basis function j: G_j d/dchi_i projected on span(psi) on samples.

    Paper: L_rep_sum (Sec. 2.2). For small cases: the array holds (n+m) p l^2 numbers.
    """
    psi, columns = lifting.values(x, u), lifting.columns(x, u)
    slopes, inverse = lifting.slopes(x), np.linalg.pinv(psi)
    c = len(lifting.basis.states) + len(lifting.basis.inputs)
    out = np.zeros((c, columns.shape[1], lifting.size, lifting.size))
    for k, i in enumerate(lifting.owner):
        if i >= 0:
            out[i, :, :, k] = (inverse @ (columns * slopes[:, k : k + 1])).T
    return out


def gamma(
    L: Float[ndarray, "l l"],
    lifting: Lifting,
    x: Float[ndarray, "N n"],
    u: Float[ndarray, "N m"],
    reading: str = "coordinates",
) -> Float[ndarray, "n p"]:
    """Return the coefficients lambda_ij of F_i = sum_j lambda_ij G_j for the states (rows of u' are dropped).

    Paper: eq:Gamma_cal (Sec. 2.2). "coordinates" uses the columns of L that belong to x_i, F_i = L x_i, projected on
    the G_j; "literal" is the pseudoinverse over all columns of vec(L). Each lifting function depends on one coordinate,
    so that the literal problem falls apart into one small problem a state, without l^2 (n+m) p numbers.
    """
    n = len(lifting.basis.states)
    psi, columns = lifting.values(x, u), lifting.columns(x, u)
    if reading == "coordinates":
        return np.asarray(np.linalg.lstsq(columns, psi @ L[:, :n], rcond=None)[0].T)
    if reading != "literal":
        raise DataError(f'gamma={reading!r}; choose "coordinates" or "literal"')
    slopes, inverse = lifting.slopes(x), np.linalg.pinv(psi)
    rows = []
    for i in range(n):
        mine = [k for k, owner in enumerate(lifting.owner) if owner == i]
        stacked = np.vstack([inverse @ (columns * slopes[:, k : k + 1]) for k in mine])
        rows.append(np.linalg.pinv(stacked) @ np.concatenate([L[:, k] for k in mine]))
    return np.array(rows)


def extract(coefficients: Float[ndarray, " g"], n: int, m: int, M: int) -> tuple[list[ndarray], ndarray]:
    """Return Gamma_1 ... Gamma_M (n x n) and B (n x m) of the vector Gamma of all lambda_ij.

    Paper: eq:compute_parameters_B_Gamma (Sec. 4.1); the index matrices E_j' and B~ are this reshape.
    """
    table = np.asarray(coefficients, float).reshape(n + m, n * M + m)[:n]
    return [table[:, j * n : (j + 1) * n] for j in range(M)], table[:, n * M :]


def index_matrices(n: int, m: int, M: int) -> tuple[list[Float[ndarray, "a b"]], Float[ndarray, "c b"]]:
    """Return the paper's E_1 ... E_M and B~, entry by entry as printed. Paper: eq:compute_parameters_B_Gamma."""
    width = n * M + m
    total = (n + m) * width
    E = [np.zeros((n * n, total)) for _ in range(M)]
    for j in range(1, M + 1):
        for a in range(1, n * n + 1):
            b = a // n * width + (j - 1) * n + a % n if a % n else (a // n - 1) * width + j * n
            E[j - 1][a - 1, b - 1] = 1
    Bt = np.zeros((m * n, total))
    for c in range(1, m * n + 1):
        d = c // m * width + n * M + c % m if c % m else c // m * width
        Bt[c - 1, d - 1] = 1
    return E, Bt
