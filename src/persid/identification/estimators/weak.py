"""The weak form: increments of the state over windows against integrals of the basis functions.

x(t_{k+q}) - x(t_k) = A0 ∫x + sum_j A_j ∫f_j + B ∫u + b (t_{k+q} - t_k)
"""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import UnderdeterminedError
from persid.identification.basis import Basis
from persid.identification.gram import BLOCK, Rows
from persid.identification.instruments import earlier, lag
from persid.identification.regressions import Estimator, Options, Regression
from persid.identification.windows import NOISE_RATIO, WITH_INSTRUMENTS, choose_window
from persid.measurements.recordings import Measurements, Part, lengths
from persid.measurements.trajectory import Trajectory

EQUAL = 1e-9  # relative spread of steps that counts as none
FEW_TERMS = 4  # up to so many are added one by one, more by differences of running sums


def weak_form(data: Measurements, basis: Basis, parts: Sequence[Part], options: Options) -> Regression:
    """Return the regression of the weak form over windows of the given length, or of the shortest that is useful."""
    ratio = WITH_INSTRUMENTS if options.instruments else NOISE_RATIO
    window = choose_window(data, ratio) if options.window == "auto" else int(options.window)
    longest = max(lengths(data))
    reach = window + 2 * lag(window) * options.instruments
    if longest <= reach:
        before = " and the two before it for instruments" if options.instruments else ""
        raise UnderdeterminedError(
            f"the longest run has {longest} samples; a window of {window}{before} needs {reach + 1}"
        )
    rows = instrumented_rows if options.instruments else window_rows
    return Regression(data, partial(rows, basis=basis, window=window, hold=options.hold), reach, window=window)


ESTIMATOR = Estimator(weak_form, rival="edmd", instruments=True)


def window_rows(run: Trajectory, count: int | None, basis: Basis, window: int, hold: str) -> Iterator[Rows]:
    """Yield blocks of rows (integrals of the columns, increments of x) over the windows that begin in the first
    `count` samples (None: in any).

    States are integrated by Simpson's rule (any spacing; the window is even); inputs held from sample to sample are
    summed exactly (hold="zoh") or integrated like the states (hold="paper": they vary between samples).
    """
    last = len(run) - window if count is None else min(count, len(run) - window)
    for begin in range(0, last, BLOCK):
        piece = run[begin : min(begin + BLOCK, last) + window]
        yield _integrals(piece, basis, window, hold), piece.x[window:] - piece.x[:-window]


def instrumented_rows(run: Trajectory, count: int | None, basis: Basis, window: int, hold: str) -> Iterator[Rows]:
    """Yield the same with instruments before them: a row begins at the first of the three windows that it reads."""
    reach = 2 * lag(window)
    linear = [k for k, column in enumerate(basis.columns) if column.kind == "linear"]
    last = len(run) - window - reach if count is None else min(count, len(run) - window - reach)
    for begin in range(0, last, BLOCK):
        piece = run[begin : min(begin + BLOCK, last) + window + reach]
        Z, X = earlier(_integrals(piece, basis, window, hold), linear, len(basis.inputs), window)
        yield Z, X, piece.x[reach + window :] - piece.x[reach:-window]


def _integrals(piece: Trajectory, basis: Basis, window: int, hold: str) -> ndarray:
    out = np.empty((len(piece) - window, basis.size))
    integrate(piece.t, basis.values(piece.x), piece.u - basis.u_ref, window, hold, out[:, :-1])
    out[:, -1] = piece.t[window:] - piece.t[:-window]
    return out


def integrate(
    t: Float[ndarray, " N"], values: Float[ndarray, "N p"], du: Float[ndarray, "N m"], window: int, hold: str,
    out: Float[ndarray, "K c"],
) -> None:  # fmt: skip
    """Write the integrals of functions of the state and of inputs over every window of so many steps to `out`."""
    h, p = np.diff(t), values.shape[1]
    _simpson(h, values, window, out[:, :p])
    if hold == "zoh":
        _window_sums(du[:-1] * h[:, None], window, 1, out[:, p:])
    else:
        _simpson(h, du, window, out[:, p:])


def _simpson(h: ndarray, values: ndarray, window: int, out: ndarray) -> None:
    """Integrate over every window of samples with steps h by Simpson's rule for unequal steps on pairs of steps."""
    a, b = h[:-1, None], h[1:, None]
    if np.ptp(h) <= EQUAL * h[0]:
        pairs = values[1:-1] * 4
        pairs += values[:-2]
        pairs += values[2:]
        pairs *= h[0] / 3
    else:
        # The parabola through three points: weights (a+b)/6 * (2 - b/a, (a+b)^2/(ab), 2 - a/b).
        total = (a + b) / 6
        pairs = values[1:-1] * (total * (a + b) ** 2 / (a * b))
        pairs += values[:-2] * (total * (2 - b / a))
        pairs += values[2:] * (total * (2 - a / b))
    _window_sums(pairs, window // 2, 2, out)


def _window_sums(pieces: ndarray, terms: int, stride: int, out: ndarray) -> None:
    """Write pieces[k] + pieces[k + stride] + ... (`terms` of them) to out[k]."""
    count = len(out)
    if terms <= FEW_TERMS:
        out[:] = pieces[:count]
        for j in range(1, terms):
            out += pieces[j * stride : j * stride + count]
        return
    for first in range(stride):
        sums = np.cumsum(pieces[first::stride], axis=0)
        rows = len(out[first::stride])
        out[first::stride] = sums[terms - 1 : terms - 1 + rows]
        out[first + stride :: stride] -= sums[: max(rows - 1, 0)]
