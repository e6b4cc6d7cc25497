"""Algebraic variables solved for: Newton's method with shorter steps, inside the integration of the states."""

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.measurements.trajectory import Trajectory
from persid.models.integration import (
    STATE_CAP,
    End,
    constant,
    has_left,
    jumps,
    lsoda_steps,
    moving_force,
    passed,
    quiet,
)
from persid.models.vector_field import VectorField

STEPS = 60  # of Newton's method
HALVINGS = 40  # of one of them
ENOUGH = 1e-12  # size of what is left, times that of the terms
STANDSTILL = 1000  # steps of the integration in a row that are too short to be added to t


class _NoSolutionError(Exception):
    """The equations have no solution that Newton's method finds."""


@dataclass(frozen=True, eq=False)
class Equations:
    """The right side of all variables, of which the first n have derivatives."""

    field: VectorField
    n: int
    drift: Callable[[ndarray], ndarray]

    @classmethod
    def of(cls, right: VectorField, n: int) -> "Equations":
        """Prepare a right side for many evaluations."""
        return cls(right, n, right.drift())

    def values(self, x: ndarray, w: ndarray, force: ndarray) -> Float[ndarray, " N"]:
        """Return the right side of all variables."""
        return np.asarray(self.drift(np.concatenate([x, w])) + force)

    def solved(
        self, x: Float[ndarray, " n"], u: Float[ndarray, " m"], near: Float[ndarray, " k"]
    ) -> Float[ndarray, " k"] | None:
        """Return w near some values with 0 = h(x, w, u), None where none is found."""
        with quiet():
            return self._newton(x, np.array(near, float), self.field.forcing(u))

    def _newton(self, x: ndarray, w: ndarray, force: ndarray) -> ndarray | None:
        h = self.values(x, w, force)[self.n :]
        for _ in range(STEPS):
            J = self.field.jacobian(np.concatenate([x, w]))[self.n :]
            if not (np.isfinite(J).all() and np.isfinite(h).all()):
                return None
            size = np.abs(J) @ np.abs(np.concatenate([x, w]) - self.field.x_ref) + np.abs(force[self.n :])
            if (np.abs(h) <= ENOUGH * (size + np.finfo(float).tiny)).all():
                return w
            step = np.linalg.lstsq(J[:, self.n :], -h, rcond=None)[0]
            for _ in range(HALVINGS):
                following = self.values(x, w + step, force)[self.n :]
                if np.linalg.norm(following) < np.linalg.norm(h):
                    break
                step = step / 2
            else:
                return w if (np.abs(h) <= 1e3 * ENOUGH * (1 + size)).all() else None
            w, h = w + step, following
        return None


@dataclass(eq=False)
class _Run:
    """x' with the algebraic variables solved for, from where they were found last."""

    equations: Equations
    force: Callable[[float], ndarray]
    w: ndarray
    found: list[ndarray] = field(default_factory=list)

    def at(self, s: float, x: ndarray) -> ndarray:
        """Return the algebraic variables at a time (s) and a state."""
        w = self.equations._newton(x, self.w, self.force(s))
        if w is None:
            raise _NoSolutionError
        self.w = w
        return w

    def rate(self, s: float, x: ndarray) -> ndarray:
        """Return x'."""
        return self.equations.values(x, self.at(s, x), self.force(s))[: self.equations.n]


def integrate(
    equations: Equations, start: Float[ndarray, " N"], t: Float[ndarray, " T"], u: Any, tolerances: tuple[float, float]
) -> Trajectory:
    """Return the run of all variables sampled at t; see `DescriptorModel.simulate`."""
    right, n = equations.field, equations.n
    x0, w0 = start[:n], start[n:]
    held = right.sampled(t, u)
    cap = STATE_CAP * (1 + float(np.abs(x0).max() + np.abs(right.x_ref[:n]).max()))
    moving = moving_force(right, u) if callable(u) else None
    ends = [0, len(t) - 1] if moving else jumps(held)
    states, run, end = [start[None]], _Run(equations, partial(constant, x0), w0), End()
    with quiet():
        for a, b in pairwise(ends):
            run.force = moving or partial(constant, right.forcing(held[a]))
            found, end = _span(run, states[-1][-1][:n], t[a : b + 1], tolerances, cap)
            states.append(found)
            if end.early:
                break
            if b < len(t) - 1 and (after := _after(run, found[-1], n, right.forcing(held[b]))) is None:
                end = End(stopped_at=float(t[b]))
                break
            if b < len(t) - 1:
                found[-1] = after
    rows = np.concatenate(states)
    return Trajectory(t[: len(rows)], rows, held[: len(rows)], **asdict(end))


def _after(run: _Run, z: ndarray, n: int, force: ndarray) -> ndarray | None:
    """Return the variables after a jump of the input, where the states stay."""
    w = run.equations._newton(z[:n], z[n:], force)
    return None if w is None else np.concatenate([z[:n], w])


def _span(
    run: _Run, x: ndarray, t: ndarray, tolerances: tuple[float, float], cap: float
) -> tuple[Float[ndarray, "K N"], End]:
    """Integrate over t, where the input does not jump; return the variables at t[1:] up to an early end, and that."""
    rows, k, still, now = list[ndarray](), 1, 0, float(t[0])
    try:
        for solver in lsoda_steps(run.rate, x, (t[0], t[-1]), rtol=tolerances[0], atol=tolerances[1]):
            still, now = still + 1 if solver.t == solver.t_old else 0, float(solver.t)
            if has_left(solver, cap):
                return _stacked(rows, run), End(diverged_at=now)
            if solver.status == "failed" or still >= STANDSTILL:
                return _stacked(rows, run), End(stopped_at=now)
            for y, s in zip(passed(solver, t, k), t[k:], strict=False):
                rows.append(np.concatenate([y, run.at(float(s), y)]))
            k = len(rows) + 1
    except _NoSolutionError:
        return _stacked(rows, run), End(stopped_at=now)
    return _stacked(rows, run), End()


def _stacked(rows: list[ndarray], run: _Run) -> Float[ndarray, "K N"]:
    return np.array(rows, float).reshape(len(rows), run.equations.field.n)
