"""The residual margin: how far a plant may be from its model, relative to the distance from the operating point.

Meant is every plant x' = F(x, u) + g with |g / width| <= delta |(x - x*) / width|, g = 0 in equations that are known
exactly, such as x1' = x2. The largest delta is that of one inequality, in which its square is linear. Two numbers
bound it from above: with J the Jacobian at x*, in units of width and L the columns of the equations that are not known,

* the complex stability radius 1 / max_w |(jw - J)^-1 L|: for a larger delta the linear plants are not all stable,
* min |F(x, u*)| / |x - x*| over the x at which the known equations rest: there such a plant may rest, g = -F.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray
from scipy.linalg import eigvalsh, null_space

from persid.lyapunov.deviations import Deviation
from persid.lyapunov.extremes import largest
from persid.lyapunov.multipliers import lyapunov_function
from persid.lyapunov.rates import Question
from persid.lyapunov.search import catalogue
from persid.lyapunov.system import Target
from persid.models.model import PersidskiiModel

TOLERANCE = 1e-6  # relative, of the complex stability radius
NEAREST = 1e-3  # widths from x*: nearer by, the ratio is that of the Jacobian, which the radius bounds
RADII = 24  # distances from x* at which a search for another place of rest begins
DIRECTIONS = 16
DESCENTS = 12  # local searches from the best of these
NEARER = 60  # rounds of these: to the best of the points around, or nearer by where none is better
FARTHEST = 10.0  # widths from x* of the farthest start
REACH = 0.3  # of its distance from x*: how far around a start the first round looks
SHORTER = 0.6  # share to which that falls after a round without a better point
LEVELS = 50  # of the norm, which converge quadratically: a handful are needed
ON_AXIS = 1e-8  # of the largest eigenvalue: a real part below is one of rounding


@dataclass(frozen=True, eq=False)
class Residuals:
    """In which units residuals g are measured, `width` (n,), and in which equations they are: those `free`."""

    width: Float[ndarray, " n"]
    free: Bool[ndarray, " n"]
    size: int  # of zeta

    @classmethod
    def of(cls, model: PersidskiiModel, inputs: int) -> "Residuals":
        """Measure them by half the width of the data, or in the states' units; x_i' = x_j, exactly, is no fit.

        `inputs` are those of the inequality: where nothing is shifted, b counts as one more.
        """
        width = np.ones(model.n)
        if model.domain is not None:
            half = (model.domain[:, 1] - model.domain[:, 0]) / 2
            width = np.where(half > 0, half, 1.0)
        size = model.n + len(model.channels.functions) + inputs
        return cls(width, ~known_equations(model), size)

    def within(self, delta: float, epsilon: float = 0.0) -> Deviation:
        """Return |g / width|^2 <= delta^2 |(x - x*) / width|^2 + epsilon^2 as a deviation."""
        return Deviation.of_residual(self.width, self.free, delta, self.size, epsilon)


def known_equations(model: PersidskiiModel) -> Bool[ndarray, " n"]:
    """Return which equations are x_i' = x_j, j != i, with the coefficient 1 and nothing else: a definition, no fit."""
    channels = model.channels
    alone = ~(channels.columns.any(axis=1) | model.B.any(axis=1))
    A0 = channels.A0
    single = (np.count_nonzero(A0, axis=1) == 1) & (A0.max(axis=1, initial=0.0) == 1.0) & (np.diag(A0) == 0)
    # b stands for x_ref_j there, up to the rounding with which it was written
    shift = np.abs(model.b - A0 @ model.x_ref) <= 1e-12 * (np.abs(model.b) + 1)
    return np.asarray(alone & single & shift)


def complex_radius(J: Float[ndarray, "n n"], residuals: Residuals) -> float:
    """Return the complex stability radius of J for such residuals, in 1/s; 0 where J is not stable.

    The norm max_w |(jw - J)^-1 L| exceeds h exactly where [[J, L L'/h], [-I/h, -J']] has eigenvalues on the imaginary
    axis; each pair of these names an interval in which it does (Bruinsma and Steinbuch 1990).
    """
    n, width = len(J), residuals.width
    J = J / width[:, None] * width
    if not np.isfinite(J).all() or np.linalg.eigvals(J).real.max() >= 0:
        return 0.0
    L = np.eye(n)[:, np.flatnonzero(residuals.free)]
    if not L.shape[1]:
        return np.inf

    def norm(w: float) -> float:
        return float(np.linalg.norm(np.linalg.solve(1j * w * np.eye(n) - J, L), 2))

    eigenvalues = np.linalg.eigvals(J)
    best = max(norm(w) for w in (0.0, *np.abs(eigenvalues.imag), *np.abs(eigenvalues)))
    for _ in range(LEVELS):
        h = best * (1 + TOLERANCE)
        values = np.linalg.eigvals(np.block([[J, L @ L.T / h], [-np.eye(n) / h, -J.T]]))
        on_axis = np.sort(values.imag[np.abs(values.real) < ON_AXIS * np.abs(values).max()])
        middles = (on_axis[1:] + on_axis[:-1]) / 2
        larger = max((norm(float(w)) for w in middles), default=0.0)
        if larger <= h:
            return 1 / best
        best = larger
    return 1 / best


def resting_bound(
    model: PersidskiiModel,
    x_star: Float[ndarray, " n"],
    u: Float[ndarray, " m"],
    residuals: Residuals,
    box: Float[ndarray, "n 2"] | None = None,
) -> float:
    """Return the smallest |F(x, u) / width| / |(x - x*) / width| that is found, in 1/s: a bound from above.

    Looked at are x (of a box) from near x* to ten widths away, and a few of them improved by a local search.
    """
    width, known = residuals.width, ~residuals.free
    # the known equations x_i' = x_j rest where their right side is 0, as it is at x*
    basis = null_space(model.channels.A0[known] * width) if known.any() else np.eye(model.n)
    if not basis.shape[1]:
        return np.inf

    def ratios(s: Float[ndarray, "N d"]) -> Float[ndarray, " N"]:
        size, x = np.linalg.norm(s, axis=-1), x_star + width * (s @ basis.T)
        meant = size >= NEAREST
        if box is not None:
            meant &= ((box[:, 0] <= x) & (x <= box[:, 1])).all(axis=-1)
        with np.errstate(all="ignore"):
            value = np.linalg.norm((model.rhs(x, u) / width)[..., residuals.free], axis=-1) / size
        return np.where(meant & np.isfinite(value), value, np.inf)

    starts, directions = _starts(basis.shape[1])
    return _descended(ratios, starts, directions)


def _starts(d: int) -> tuple[Float[ndarray, "N d"], Float[ndarray, "K d"]]:
    """Return points in random directions and their opposites, at distances that grow geometrically; the directions."""
    directions = np.random.default_rng(0).normal(size=(DIRECTIONS * d, d))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    directions = np.vstack([directions, -directions])
    return (np.geomspace(10 * NEAREST, FARTHEST, RADII)[:, None, None] * directions).reshape(-1, d), directions


def _descended(
    f: Callable[[ndarray], ndarray], starts: Float[ndarray, "N d"], directions: Float[ndarray, "K d"]
) -> float:
    """Return the least value found from the best starts: to the best point around, nearer by where none is better."""
    values = f(starts)
    order = np.argsort(values)[:DESCENTS]
    best, values = starts[order], values[order]
    reach = REACH * np.linalg.norm(best, axis=1)
    for _ in range(NEARER):
        around = best[:, None, :] + reach[:, None, None] * directions
        tried = f(around.reshape(-1, best.shape[1])).reshape(len(best), -1)
        at, least = tried.argmin(axis=1), tried.min(axis=1)
        better = least < values
        best = np.where(better[:, None], around[np.arange(len(best)), at], best)
        values, reach = np.minimum(values, least), np.where(better, reach, SHORTER * reach)
    return float(values.min())


def largest_margin(question: Question, residuals: Residuals, kappa: float, left: Callable[[], float]) -> float:
    """Return the largest delta, to 1 %, for which an inequality of this rate is met; 0 where none is found.

    With half the gradient E'z, V' <= -kappa V without deviations leaves room R = -Q - kappa W > 0. A large s turns it
    into R - E L L'E'/s > 0, and the rest bounds a small delta: there the way to the largest one begins.
    """
    start = question.ask(kappa, None, None, left)
    if start is None:
        return 0.0
    unknowns, none, unit = start.assembly.unknowns, residuals.within(0.0), residuals.within(1.0)
    target = Target(kappa, None, question.shape, question.upper if kappa else {}, question.lower, (none,))
    whole = catalogue(question.system, unknowns.families, question.full, target)
    lower = [question.lower[group.curve] for group in question.system.groups]
    lyapunov = lyapunov_function(unknowns, start.solution.y, unknowns.system, lower)
    if not lyapunov.is_sound:
        return 0.0
    EL = lyapunov.E @ unit.L
    s = 2 * float(np.linalg.eigvalsh(EL.T @ np.linalg.solve(lyapunov.decrease, EL))[-1])
    system = question.system
    C = unit.columns(system.states, system.channels, system.B.shape[1])[:, : system.entries]
    room = replace(lyapunov, deviations=(none,), s=np.array([s])).robust
    delta2 = 0.5 / float(eigvalsh(s * C.T @ C, room)[-1])
    N = np.zeros((whole.width, whole.width))
    scaled = C * whole.weights[: system.entries]
    N[: system.entries, : system.entries] = scaled.T @ scaled / whole.size("s", 0)
    numbers = replace(unknowns.multipliers(start.solution.y), s=np.array([s]))
    found = largest(whole, unknowns.families, fixed=("s", 0), N=N, numbers=numbers, t=delta2, left=left)
    return 0.0 if found is None else float(np.sqrt(found.t))
