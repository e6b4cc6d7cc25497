"""Integration of a model between samples: quiet, restarted where a held input jumps, stopped at a divergence.

Two ends are told apart. A run *diverges* when its state leaves all bounds, or moves infinitely fast for what times can
resolve. It is *stopped* when it has used up its budget with the state still bounded: the model is too fast or too stiff
to be followed, which says nothing about its stability.
"""

import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.measurements.trajectory import Trajectory
from persid.models.vector_field import VectorField

if TYPE_CHECKING:
    from scipy.integrate import LSODA, RK45

STATE_CAP = 1e6  # a state beyond this many times the size of its start has diverged
HUGE = 1e140  # right sides are cut off here: LSODA squares them, and overflows would end in NaN
STIFF = 40  # explicit steps in one sample interval after which an implicit method takes over
BUDGET = 500_000  # evaluations of the right side that every run may take: some 7 s
BUDGET_PER_SAMPLE = 500  # and these for every sample; stiff models with white inputs take about 150
STANDSTILL = 10_000  # steps in a row, each too short to be added to t, after which a run is stopped


@dataclass(frozen=True)
class End:
    """Why and when, in s, a run ended before its last sample; both None where it did not."""

    diverged_at: float | None = None
    stopped_at: float | None = None

    @property
    def early(self) -> bool:
        """Whether the run ended before its last sample."""
        return self != End()


@contextmanager
def quiet() -> Iterator[None]:
    """Keep solvers from complaining: where a run goes wrong, its end says so."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def lsoda_steps(
    rate: Callable[[float, ndarray], ndarray],
    x: Float[ndarray, " n"],
    span: tuple[float, float],
    rtol: float,
    atol: float,
    band: int | None = None,
) -> Iterator["LSODA"]:
    """Yield LSODA's solver after each of its steps over a span of time, in s; right sides are cut off at `HUGE`.

    `band`: how far from its diagonal the derivative of the right side has entries; None is everywhere.
    """
    from scipy.integrate import LSODA

    def guarded(s: float, y: ndarray) -> ndarray:
        return np.asarray(np.clip(rate(s, y), -HUGE, HUGE))

    solver = LSODA(guarded, span[0], x, span[1], rtol=rtol, atol=atol, lband=band, uband=band)
    while solver.status == "running":
        solver.step()
        yield solver


def passed(solver: "LSODA", t: Float[ndarray, " N"], k: int) -> Float[ndarray, "k n"]:
    """Return the states at those of the times t[k:] that the solver's last step has passed."""
    reached = int(np.searchsorted(t, solver.t, side="right"))
    states: ndarray = solver.dense_output()(t[k:reached]).T if reached > k else np.empty((0, len(solver.y)))
    return states


def has_left(solver: "LSODA | RK45", cap: float) -> bool:
    """Whether a solver's state has left all bounds, NaN included."""
    return not np.abs(solver.y).max() < cap


def integrate(
    field: VectorField,
    x0: Float[ndarray, " n"],
    t: Float[ndarray, " N"],
    u: Callable[[float], object] | ndarray | None,
    rtol: float,
    atol: float,
) -> Trajectory:
    """Return the run from x0 sampled at t; see `PersidskiiModel.simulate`."""
    size = 1 + float(np.abs(x0).max() + np.abs(field.x_ref).max())
    solver = _Solver(field, size, rtol, atol, BUDGET + BUDGET_PER_SAMPLE * len(t))
    with quiet():
        if u is None or callable(u):
            held = field.sampled(t, u)
            force = field.forcing(field.u_ref)
            states, end = solver.span(x0, t, moving_force(field, u) if callable(u) else partial(constant, force))
        else:
            held = u
            states, end = _held(solver, x0, t, u)
    return Trajectory(t[: len(states)], states, held[: len(states)], **asdict(end))


def _held(solver: "_Solver", x0: ndarray, t: ndarray, u: ndarray) -> tuple[ndarray, End]:
    """Go from jump to jump of the input; an input that stays is integrated in one go."""
    states, end = [x0[None]], End()
    for a, b in pairwise(jumps(u)):
        force = solver.field.forcing(u[a])
        if b - a > 1:
            found, end = solver.span(states[-1][-1], t[a : b + 1], partial(constant, force))
        else:
            found, end = solver.step(states[-1][-1], float(t[a]), float(t[b]), force)
        states.append(found[1:])
        if end.early:
            break
    return np.concatenate(states), end


def jumps(held: Float[ndarray, "N m"]) -> list[int]:
    """Return the samples between which a held input stays, the first and the last among them."""
    inner = np.flatnonzero((np.diff(held[:-1], axis=0) != 0).any(axis=1)) + 1
    return [0, *inner.tolist(), len(held) - 1]


def constant(force: ndarray, _: float) -> ndarray:
    """Return a force that stays."""
    return force


def moving_force(field: VectorField, u: Callable[[float], object]) -> Callable[[float], ndarray]:
    """Return the force of an input that is a function of time."""
    return lambda s: field.forcing(np.reshape(np.asarray(u(s), float), field.m))


class _Solver:
    """The model's right side with its fixed parts prepared, what is left of the budget, and the step size carried over
    restarts."""

    def __init__(self, field: VectorField, size: float, rtol: float, atol: float, budget: int) -> None:
        self.field, self.rtol, self.atol = field, rtol, atol
        self.cap, self.budget = STATE_CAP * size, budget
        self.explicit: RK45 | None = None
        self.force: ndarray | None = None
        self.stiff = False
        self.dot = field.drift()

    def drift(self, x: ndarray) -> ndarray:
        """Return x' without the forcing, and charge the budget for it."""
        self.budget -= 1
        return self.dot(x)

    def step(self, x: ndarray, start: float, stop: float, force: ndarray) -> tuple[ndarray, End]:
        """Cross one sample interval by Dormand-Prince steps; hand over to an implicit method where it is stiff."""
        if not self.stiff:
            solver = self._restarted(x, start, stop, force)
            for _ in range(STIFF):
                solver.step()
                if has_left(solver, self.cap):
                    return x[None], End(diverged_at=float(solver.t))
                if solver.status == "finished":
                    return np.array([x, solver.y]), End()
                if solver.status == "failed":  # steps shorter than times resolve: stiff, or a divergence
                    break
            self.stiff = True
        return self.span(x, np.array([start, stop]), partial(constant, force))

    def _restarted(self, x: ndarray, start: float, stop: float, force: ndarray) -> "RK45":
        """Return the explicit solver at the start of an interval; the step size found before it is kept."""
        self.force = force
        if self.explicit is None:
            from scipy.integrate import RK45

            self.explicit = RK45(
                lambda _, y: self.drift(y) + self.force, start, x, stop, rtol=self.rtol, atol=self.atol
            )
            return self.explicit
        solver = self.explicit
        solver.t, solver.t_old, solver.t_bound, solver.status = start, start, stop, "running"
        solver.y, solver.f = x, solver.fun(start, x)
        return solver

    def span(self, x: ndarray, t: ndarray, force: Callable[[float], ndarray]) -> tuple[ndarray, End]:
        """Integrate over t, where the input does not jump; return the states at t up to an early end, and that end."""

        def rate(s: float, y: ndarray) -> ndarray:
            return np.asarray(self.drift(y) + force(s))

        states, k, still = [x[None]], 1, 0
        for solver in lsoda_steps(rate, x, (t[0], t[-1]), rtol=self.rtol, atol=self.atol):
            still = still + 1 if solver.t == solver.t_old else 0
            if has_left(solver, self.cap) or (still and np.abs(solver.fun(solver.t, solver.y)).max() >= HUGE):
                return np.concatenate(states), End(diverged_at=float(solver.t))
            if solver.status == "failed" or still >= STANDSTILL or self.budget <= 0:
                return np.concatenate(states), End(stopped_at=float(solver.t))
            states.append(passed(solver, t, k))
            k += len(states[-1])
        return np.concatenate(states), End()
