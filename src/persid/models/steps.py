"""Long runs with sampled inputs, in plain NumPy: classical Runge-Kutta steps, the pieces of a record side by side.

A long record is cut into about sqrt(N) pieces, all stepped at once. The states s_i at which they start are found as in
multiple shooting: with e_i the end of piece i from s_i, and Phi_i the derivative of that end, the next starts are

    s_{i+1} <- e_i + Phi_i (s_i_new - s_i_old)                  until every piece starts where the one before it ends.

After k sweeps the first k pieces are right whatever Phi is, and mostly a few sweeps do. The error of a step of length h
is of fourth order, so that of a run with r times as many steps is what they changed, divided by r^4 - 1: steps are
shortened as this foretells, until nothing that matters is left, and the rest is taken off.
"""

from collections.abc import Callable
from math import ceil
from typing import TypeVar

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid.models.vector_field import VectorField

D = TypeVar("D")

STEP = 0.4  # of the fastest time constant at x_ref, to begin with
SHORTER, SHORTEST = 2.0, 8.0  # by how much steps are shortened at a time, at least and at most
TRIALS = 8
TOLERANCE = 2e-7  # error of a run, in units of its largest |x - x_ref|
SAFE = 1.2  # for what the fourth order does not foretell
TINY = 1e-300  # a run that rests has no size
PIECES = 4  # times the root of the number of intervals: a Python step is for many pieces at once
DIFFERENCE = 1e-6  # of the size of the states, for derivatives
JOINT = 1e-10  # by which the ends of pieces may still move, in the same units

STAGES = (
    (0.0, 1 / 6),
    (0.5, 1 / 3),
    (0.5, 1 / 3),
    (1.0, 1 / 6),
)  # places and weights of the classical method

Forcing = tuple[ndarray, ndarray]  # B (u - u_ref) + b at the start and at the end of every interval, (L, …, n)


def runge_kutta(
    rate: Callable[[ndarray, D], ndarray], x: ndarray, h: float | ndarray, drives: tuple[D, D, D]
) -> ndarray:
    """Return the states x after one step of length h (one, or one a state) of the classical Runge-Kutta method.

    `drives` are what the rate takes beside the state at the start, in the middle and at the end of the step.
    """
    start, middle, end = drives
    k, total = np.zeros(()), np.zeros(())
    for (place, weight), drive in zip(STAGES, (start, middle, middle, end), strict=True):
        k = rate(x + place * h * k if place else x, drive)
        total = total + weight * k
    return np.asarray(x + h * total)


def forcing(field: VectorField, u: Float[ndarray, "N m"] | None, hold: str, count: int) -> Forcing:
    """Return B (u - u_ref) + b at both ends of each of `count` - 1 intervals: held, or in straight lines ("foh")."""
    force = np.zeros((count, field.n)) + field.b
    force = force if u is None else force + (u[:count] - field.u_ref) @ field.B.T
    return force[:-1], force[:-1] if hold == "zoh" else force[1:]


def substeps(field: VectorField, dt: float) -> int:
    """Return how many steps an interval of dt (s) takes to begin with."""
    fastest = float(np.abs(np.linalg.eigvals(field.jacobian(field.x_ref))).max())
    return ceil(1e-9 + fastest * dt / STEP)


def swept(
    dot: Callable[[ndarray], ndarray],
    X: Float[ndarray, "S n"],
    dt: Float[ndarray, "L #S 1"],
    force: Forcing,
    steps: int,
) -> Float[ndarray, "L+1 S n"]:
    """Return the runs of many states side by side, over L intervals of `steps` Runge-Kutta steps each."""
    found = np.empty((len(dt) + 1, *X.shape))
    found[0] = X

    def rate(x: ndarray, drive: ndarray) -> ndarray:
        return np.asarray(dot(x) + drive)

    for k, (length, first, last) in enumerate(zip(dt, *force, strict=True)):
        h, slope = length / steps, (last - first) / (2 * steps)
        for j in range(steps):
            begin = first + 2 * j * slope
            X = runge_kutta(rate, X, h, (begin, begin + slope, begin + 2 * slope))
        found[k + 1] = X
    return found


def corrections(
    gap: Float[ndarray, "*K S n"], flow: Float[ndarray, "*K S n n"], follows: Bool[ndarray, " S"]
) -> Float[ndarray, "*K S n"]:
    """Return Newton's changes of the states at which pieces start: each is its gap and what the one before flows into.

    `gap` is the end of the piece before less the start, `flow` the derivative Phi of a piece's end by its start.
    """
    change = gap.copy()
    for s in np.flatnonzero(follows[1:]) + 1:
        change[..., s, :] += (flow[..., s - 1, :, :] @ change[..., s - 1, :, None])[..., 0]
    return change


def run(
    field: VectorField,
    x0: Float[ndarray, " n"],
    t: Float[ndarray, " N"],
    u: Float[ndarray, "N m"] | None,
    hold: str,
) -> Float[ndarray, "N n"] | None:
    """Return the states at the times t, or None where the run leaves all bounds or no step is short enough for it."""
    dt, steps = np.diff(t), substeps(field, float(np.diff(t).max()))
    force, dot = forcing(field, u, hold, len(t)), field.drift()
    record = _Record(dot, x0, dt, force)
    with np.errstate(all="ignore"):
        record.linearise(steps)
        before, ratio = record.swept(steps), SHORTER
        record.linearise(steps)  # again, where the run passes
        for _ in range(TRIALS):
            finer = ceil(ratio * steps)
            after = record.swept(finer)
            if not np.isfinite(after).all():
                return None
            rest = (after - before) / ((finer / steps) ** 4 - 1)
            error = float(np.abs(rest).max()) / (TOLERANCE * float(np.abs(after - field.x_ref).max()) + TINY)
            if error <= 1:
                return np.asarray(after + rest)
            before, steps = after, finer
            ratio = float(np.clip(SAFE * error**0.25, SHORTER, SHORTEST)) if np.isfinite(error) else SHORTER
    return None


class _Record:
    """A record in pieces, the states at which they start as found so far, and the derivatives Phi of their ends."""

    def __init__(self, dot: Callable[[ndarray], ndarray], x0: ndarray, dt: ndarray, force: Forcing) -> None:
        self.dot, self.count = dot, len(dt)
        self.pieces = min(self.count, ceil(PIECES * np.sqrt(self.count)))
        self.length = -(-self.count // self.pieces)
        self.dt, self.force = self._cut(dt[:, None]), (self._cut(force[0]), self._cut(force[1]))
        self.starts = np.tile(x0, (self.pieces, 1))
        self.Phi = np.zeros((self.pieces, len(x0), len(x0)))

    def _cut(self, values: ndarray) -> Float[ndarray, "L S k"]:
        """Cut values of intervals into pieces; intervals of no length fill the last one up."""
        rest = self.pieces * self.length - self.count
        filled = np.concatenate([values, np.zeros((rest, *values.shape[1:]))])
        return np.ascontiguousarray(filled.reshape(self.pieces, self.length, -1).swapaxes(0, 1))

    def swept(self, steps: int) -> Float[ndarray, "N n"]:
        """Return the run, with so many steps an interval."""
        n = self.starts.shape[1]
        found = np.empty((self.length + 1, *self.starts.shape))
        moved = np.ones(self.pieces, bool)
        for _ in range(self.pieces + 1):
            force = self.force[0][:, moved], self.force[1][:, moved]
            found[:, moved] = swept(self.dot, self.starts[moved], self.dt[:, moved], force, steps)
            corrected = self._corrected(found[-1])
            moved = ~(np.abs(corrected - self.starts) <= JOINT * np.abs(corrected).max()).all(axis=1)
            self.starts = corrected
            if not moved.any():
                break
        return np.vstack([self.starts[0], found[1:].swapaxes(0, 1).reshape(-1, n)[: self.count]])

    def linearise(self, steps: int) -> None:
        """Compute the derivatives of the ends by the starts, by differences."""
        ends = swept(self.dot, self.starts, self.dt, self.force, steps)[-1]
        delta = DIFFERENCE * (1 + np.abs(ends).max())
        columns = [
            (swept(self.dot, self.starts + delta * e, self.dt, self.force, steps)[-1] - ends) / delta
            for e in np.eye(len(self.starts.T))
        ]
        self.Phi = np.nan_to_num(np.stack(columns, axis=-1), posinf=0.0, neginf=0.0)

    def _corrected(self, ends: ndarray) -> Float[ndarray, "S n"]:
        gap = np.zeros_like(ends)
        gap[1:] = ends[:-1] - self.starts[1:]
        return np.asarray(self.starts + corrections(gap, self.Phi, np.ones(self.pieces, bool)))
