"""Linear starts: A and C by subspace methods, the rest by least squares on the simulation error."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray
from scipy.signal import lfilter

from persid.identification.outputs.records import Record

HORIZONS = (4, 8, 15, 30, 60)  # samples into the past and the future
STRIDES = (1, 4, 16)  # samples that are merged into one, where sampling is far faster than the system
COLUMNS = 6000  # of the Hankel matrices, at most
LARGEST, LEAK = 0.9995, 0.01  # modulus of a pole of a start, or what decays by such a share over a record
SMALLEST = 0.05  # a real pole of a start: below, no continuous-time model samples to it
GROWTH = 1e6  # of an unstable start over a record, at most
RIDGE = 1e-8


@dataclass(frozen=True, eq=False)
class Linear:
    """Hold x' = A x + B u + b, y = C x + D u + d, time in samples, its records' first states and its simulation error.

    b is 0 but where a mode outlasts the records: it is an offset of the outputs else.
    """

    A: Float[ndarray, "n n"]
    B: Float[ndarray, "n m"]
    b: Float[ndarray, " n"]
    C: Float[ndarray, "l n"]
    D: Float[ndarray, "l m"]
    d: Float[ndarray, " l"]
    x0: Float[ndarray, "records n"]
    error: float


def linear_starts(
    records: Sequence[Record], n: int, feedthrough: bool, horizons: Sequence[int] = HORIZONS
) -> list[Linear]:
    """Return linear models of order n from all methods and horizons, the smallest simulation error first."""
    found = []
    for stride in STRIDES:
        merged = [_merged(record, stride) for record in records]
        for A, C in _pairs(merged, n, horizons):
            for continuous in _continuous(A, stride, max(len(u) for u, _ in merged)):
                try:
                    found.append(_completed(continuous, C, records, feedthrough))
                except (np.linalg.LinAlgError, ValueError):
                    continue
    return sorted((start for start in found if np.isfinite(start.error)), key=lambda start: start.error)


def _merged(record: Record, stride: int) -> Record:
    """Return every stride-th sample with the mean of the inputs in between."""
    u, y = record
    whole = len(u) // stride * stride
    return u[:whole].reshape(whole // stride, stride, u.shape[1]).mean(1), y[:whole:stride]


def _pairs(records: Sequence[Record], n: int, horizons: Sequence[int]) -> Iterator[tuple[ndarray, ndarray]]:
    m, l = (part.shape[1] for part in records[0])  # noqa: E741
    for f in horizons:
        long = [record for record in records if len(record[0]) >= 4 * f]
        if not long or f * l <= n:
            continue
        for method in (_past_inputs, _past_both, _predictor):
            if m or method is not _past_inputs:
                try:
                    yield method(long, n, f)
                except np.linalg.LinAlgError:
                    continue


def _past_inputs(records: Sequence[Record], n: int, f: int) -> tuple[ndarray, ndarray]:
    """PI-MOESP: past inputs as instruments."""
    return _moesp(records, n, f, lambda u, y: u)


def _past_both(records: Sequence[Record], n: int, f: int) -> tuple[ndarray, ndarray]:
    """PO-MOESP: past inputs and outputs as instruments."""
    return _moesp(records, n, f, lambda u, y: np.concatenate([u, y], 2))


def _moesp(
    records: Sequence[Record], n: int, f: int, instrument: Callable[[ndarray, ndarray], ndarray]
) -> tuple[ndarray, ndarray]:
    """Return A and C from the range of the extended observability matrix.

    In the triangular factor of (future u, 1; instruments; future y), the block of y by instruments holds what future
    outputs owe to the past alone: its left singular vectors span the range.
    """
    rows = []
    for u, y in records:
        first = np.arange(0, len(u) - 2 * f + 1, max(1, (len(u) - 2 * f + 1) * len(records) // COLUMNS))
        past, future = first[:, None] + np.arange(f), first[:, None] + f + np.arange(f)
        known, later = instrument(u[past], y[past]), np.ones((len(first), 1))
        inputs, outputs = u[future].reshape(len(first), -1), y[future].reshape(len(first), -1)
        rows.append((np.hstack([inputs, later]), known.reshape(len(first), -1), outputs))
    U, Z, Y = (np.vstack(part) for part in zip(*rows, strict=True))
    triangle = np.linalg.qr(np.hstack([U, Z, Y]), mode="r")
    a, b = U.shape[1], U.shape[1] + Z.shape[1]
    left, size, _ = np.linalg.svd(np.asarray(triangle)[a:b, b:].T, full_matrices=False)
    l = records[0][1].shape[1]  # noqa: E741
    observability = left[:, :n] * np.sqrt(size[:n])
    return np.linalg.lstsq(observability[:-l], observability[l:])[0], observability[:l]


def _predictor(records: Sequence[Record], n: int, f: int) -> tuple[ndarray, ndarray]:
    """PBSID: states from a long predictor's Markov parameters, then A and C by least squares."""
    l = records[0][1].shape[1]  # noqa: E741
    pasts, nows = [], []
    for u, y in records:
        both = np.hstack([u, y])
        pasts.append(np.hstack([both[f - i : len(u) - i] for i in range(1, f + 1)]))
        nows.append((u[f:], y[f:]))
    Z, U, Y = np.vstack(pasts), np.vstack([u for u, _ in nows]), np.vstack([y for _, y in nows])
    Phi = np.hstack([Z, U, np.ones((len(Z), 1))])
    gram = Phi.T @ Phi
    weights = np.linalg.solve(gram + 1e-6 * np.trace(gram) / len(gram) * np.eye(len(gram)), Phi.T @ Y).T
    width = Z.shape[1] // f
    Gamma = np.zeros((f * l, Z.shape[1]))
    for i in range(f):
        Gamma[i * l : (i + 1) * l, : (f - i) * width] = weights[:, i * width : f * width]
    low = np.linalg.cholesky(_lifted(Z.T @ Z))
    right = np.linalg.svd(Gamma @ low, full_matrices=False)[2]
    basis = np.linalg.solve(low.T, right[:n].T)
    X = [past @ basis for past in pasts]
    A_C = []
    states, inputs = np.vstack(X), np.hstack([U, np.ones((len(U), 1))])
    CD = np.linalg.lstsq(np.hstack([states, inputs]), Y)[0]
    error = np.split(Y - np.hstack([states, inputs]) @ CD, np.cumsum([len(x) for x in X])[:-1])
    for x, (u, _), e in zip(X, nows, error, strict=True):
        A_C.append((np.hstack([x[:-1], u[:-1], np.ones((len(u) - 1, 1)), e[:-1]]), x[1:]))
    known, following = (np.vstack(part) for part in zip(*A_C, strict=True))
    return np.linalg.lstsq(known, following)[0][:n].T, CD[:n].T


def _lifted(gram: Float[ndarray, "p p"]) -> Float[ndarray, "p p"]:
    return np.asarray(gram + 1e-9 * np.trace(gram) / len(gram) * np.eye(len(gram)))


def _continuous(A: Float[ndarray, "n n"], stride: int, length: int) -> list[Float[ndarray, "n n"]]:
    """Return A of one sample in continuous time, from that of `stride` samples, by the logarithm of its poles.

    Poles outside the unit circle are reflected; where they let a run of so many samples grow by less than GROWTH, the
    unstable model is a start as well. Real poles that are negative or nearly zero are moved to SMALLEST.
    """
    w, V = np.linalg.eig(A)
    w = w.astype(complex)
    low = (np.abs(w.imag) < 1e-9) & (w.real < SMALLEST)
    w = np.where(low, SMALLEST + 0.01 * np.arange(len(w)), w)
    size = np.maximum(np.abs(w), 1e-300)
    largest = max(LARGEST, 1 - LEAK / length)
    poles = [np.where(size > largest, w / size * np.minimum(largest, 1 / size), w)]
    if 1 < size.max() < GROWTH ** (1 / length):
        poles.append(w)
    return [(V @ np.diag(np.log(w) / stride) @ np.linalg.inv(V)).real for w in poles]


def _completed(A: Float[ndarray, "n n"], C: Float[ndarray, "l n"], records: Sequence[Record], through: bool) -> Linear:
    """Return the model with the B, b, D, d and x0 of least simulation error, in which they are linear.

    In modal coordinates the response to an input is a first-order recursion, held from sample to sample:
    xi+ = e^lambda xi + (e^lambda - 1)/lambda beta u.
    """
    w, V = np.linalg.eig(A)
    back, (m, l), n = np.linalg.inv(V), (part.shape[1] for part in records[0]), len(A)  # noqa: E741
    forces = m + bool(w.real.max() * max(len(u) for u, _ in records) > -1)  # an offset is one more input
    sums: list[tuple[ndarray, ndarray, float, int]] = []
    for r, (u, y) in enumerate(records):
        columns = _responses(w, V, back, C, np.hstack([u, np.ones((len(u), 1))])[:, :forces])
        first = np.zeros((*y.shape, len(records), n))
        first[:, :, r] = np.einsum("lr,kr,ri->kli", C @ V, np.exp(np.outer(np.arange(len(u)), w)), back).real
        through_columns = np.einsum("km,il->kiml", u, np.eye(l)).reshape(*y.shape, -1)[:, :, : m * l * through]
        ones = np.broadcast_to(np.eye(l), (len(u), l, l))
        J = np.concatenate([columns, through_columns, ones, first.reshape(*y.shape, -1)], 2).reshape(y.size, -1)
        sums.append((J.T @ J, J.T @ y.ravel(), float((y**2).sum()), y.size))
    gram, right = np.sum([part[0] for part in sums], 0), np.sum([part[1] for part in sums], 0)
    total, count = sum(part[2] for part in sums), sum(part[3] for part in sums)
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scaled = gram * scale[:, None] * scale
    theta = scale * np.linalg.solve(scaled + RIDGE * np.eye(len(scaled)), scale * right)
    error = np.sqrt(max(total - 2 * theta @ right + theta @ gram @ theta, 0.0) / count)
    given, D, d, x0 = np.split(theta, np.cumsum([n * forces, m * l * through, l]))
    B, b = np.split(np.hstack([given.reshape(n, forces), np.zeros((n, 1))])[:, : m + 1], [m], 1)
    return Linear(
        A=A,
        B=B,
        b=b[:, 0],
        C=C,
        D=D.reshape(m, l).T if through else np.zeros((l, m)),
        d=d,
        x0=x0.reshape(len(records), n),
        error=error,
    )


def _responses(
    w: ndarray, V: ndarray, back: ndarray, C: Float[ndarray, "l n"], u: Float[ndarray, "N m"]
) -> Float[ndarray, "N l n*m"]:
    """Return the derivatives of the outputs by every entry of B."""
    pole = np.exp(w)
    if not u.shape[1]:
        return np.zeros((len(u), len(C), 0))
    filtered = [lfilter([0.0, gain], [1.0, -z], u, axis=0) for z, gain in zip(pole, (pole - 1) / w, strict=True)]
    return np.asarray(np.einsum("lr,ri,rkj->klij", C @ V, back, np.array(filtered)).real.reshape(len(u), len(C), -1))
