"""Records of the nine-bus grid as synchrophasors give them, the model that is identified from them, and its free runs.

Frames come 60 times a second, with noise of 0.02 degrees on the angle and 1 mHz on the frequency of every machine.
Rotor angles are taken for measured; in a real grid they are estimated from the phasors at the terminals.

The right side has sines and cosines of the angle between every pair of machines, and that between machines 2 and 3 is
the difference of two states. It is measured too, so that a model with three angles is fitted row by row; what follows
from the other two is then put in for the third, and x' = 360 f for the rows of the angles, which are known.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray

import persid as ps
from persid.studies.nine_bus import (
    HERTZ,
    KINEMATICS,
    LOADS,
    MVA,
    NORMAL,
    RADIANS,
    STATES,
    TO_MACHINES,
    TO_PAIRS,
    Condition,
    Grid,
    H,
)

FRAMES = int(HERTZ)  # a second
ANGLE_NOISE, FREQUENCY_NOISE = 0.02, 1e-3  # degrees, Hz
LARGEST_STEP, HELD = 0.25, 4.0  # share of a load; s from one step to the next
NOMINAL = np.array([power.real * MVA for _, power in LOADS.values()])  # MW
MEASURED = ("d21", "d31", "d23", *STATES[2:])
FROM_STATES = np.block([[TO_PAIRS, np.zeros((3, 3))], [np.zeros((3, 2)), np.eye(3)]])  # measured ones from states
READS = {  # which measured states each row reads: pairs, its own frequencies, and no row that of the whole grid but one
    "d21": ("f21",), "d31": ("f31",), "d23": ("f21", "f31"), "f21": ("d21", "d31", "d23", "f21", "f31"),
    "f31": ("d21", "d31", "d23", "f21", "f31"), "f0": ("d21", "d31", "d23", "f0"),
}  # fmt: skip
TO_SHOWN = np.block([[TO_PAIRS, np.zeros((3, 3))], [np.zeros((3, 2)), TO_MACHINES]])
SHOWN = ("d21", "d31", "d23", "f1", "f2", "f3")  # degrees and Hz, what an operator reads


@dataclass(frozen=True, eq=False)
class Record:
    """What happened: times (s), the states without noise, and the load steps (MW) held from each frame to the next."""

    t: Float[ndarray, " N"]
    x: Float[ndarray, "N 5"]
    u: Float[ndarray, "N 3"]

    def measured(self, random: np.random.Generator) -> Float[ndarray, "N 6"]:
        """Return angles (degrees) and frequencies (Hz) of the machines with noise, as differences and means."""
        noise = random.normal(0, [ANGLE_NOISE] * 3 + [FREQUENCY_NOISE] * 3, (len(self.t), 6))
        angles = np.column_stack([np.zeros(len(self.t)), self.x[:, :2]]) + noise[:, :3]
        f = self.x[:, 2:] @ TO_MACHINES.T + noise[:, 3:]
        first, second, third = angles.T
        pairs = [second - first, third - first, second - third]
        return np.column_stack([*pairs, f[:, 1] - f[:, 0], f[:, 2] - f[:, 0], f @ H / H.sum()])


def load_steps(grid: Grid, seconds: float, random: np.random.Generator) -> Record:
    """Return a record in which, every few seconds, one load goes to a random size near its nominal one."""
    t, each = np.arange(round(seconds * FRAMES) + 1) / FRAMES, round(HELD * FRAMES)
    x, u, loads = np.tile(grid.rest, (len(t), 1)), np.zeros((len(t), len(LOADS))), np.ones(len(LOADS))
    for k in range(0, len(t) - 1, each):
        loads[random.integers(len(loads))] = 1 + random.uniform(-LARGEST_STEP, LARGEST_STEP)
        held = slice(k, min(k + each, len(t) - 1) + 1)
        x[held] = grid.simulate(x[k], t[held], Condition(tuple(loads.tolist())))
        u[held] = NOMINAL * (loads - 1)
    return Record(t, x, u)


def ring_down(grid: Grid, fault: int, cleared: float, seconds: float) -> Record:
    """Return the record after a short circuit at a bus that went away by itself, `cleared` s after it came."""
    start = grid.simulate(grid.rest, np.array([0.0, cleared]), Condition(fault=fault))[-1]
    t = np.arange(round(seconds * FRAMES) + 1) / FRAMES
    return Record(t, grid.simulate(start, t, NORMAL), np.zeros((len(t), len(LOADS))))


def identify(records: Sequence[Record], random: np.random.Generator) -> ps.PersidskiiModel:
    """Return the model of the states that measurements of these records give."""
    data = ps.Trajectories.from_arrays(
        [record.measured(random) for record in records],
        [record.u for record in records],
        t=[record.t for record in records],
        states=MEASURED,
        inputs=tuple(LOADS),
    )
    pattern = [[name in READS[row] for name in MEASURED] for row in MEASURED]
    functions = [["sin(x)", "cos(x)"]] * 3 + [["x"]] * 3
    units = [1 / RADIANS] * 3 + [1.0] * 3
    fit = ps.PersidskiiIdentifier(functions, x_ref=0.0, scale=units, pattern=pattern, ridge=0.0).fit(data)
    return of_states(fit.model_)


def of_states(measured: ps.PersidskiiModel) -> ps.PersidskiiModel:
    """Return a model of all that is measured as one of the states: d23 = d21 - d31, and x' = 360 f for the angles."""
    swings, still = slice(3, None), np.zeros((2, 3))
    A0 = np.vstack([np.hstack([np.zeros((2, 2)), KINEMATICS]), measured.A0[swings] @ FROM_STATES])
    terms = [
        (term.f[0].text, term.R @ FROM_STATES, np.vstack([still, term.A[swings]]))
        for term in measured.terms
        if term.R is not None
    ]
    B, b = np.vstack([still, measured.B[swings]]), np.concatenate([[0.0, 0.0], measured.b[swings]])
    return ps.PersidskiiModel(A0, terms, B, b, states=STATES, inputs=measured.inputs, provenance=measured.provenance)


def relative(model: ps.PersidskiiModel) -> ps.PersidskiiModel:
    """Return the model of angles and frequencies between machines alone: nothing in it reads that of the whole grid."""
    few = len(STATES) - 1
    terms = [(term.f[0].text, term.R[:, :few], term.A[:few]) for term in model.terms if term.R is not None]
    return ps.PersidskiiModel(
        model.A0[:few, :few], terms, model.B[:few], model.b[:few], states=STATES[:few], inputs=model.inputs
    )


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A run of a model from the first state of a record and its load steps alone, beside what happened."""

    record: Record
    x: Float[ndarray, "K 5"]

    @classmethod
    def of(cls, model: ps.PersidskiiModel, record: Record) -> "FreeRun":
        """Run a model."""
        return cls(record, model.simulate(record.x[0], record.t, record.u)[0].x)

    @cached_property
    def errors(self) -> Float[ndarray, "K 6"]:
        """What the run shows less what happened, in degrees and Hz."""
        return np.asarray((self.x - self.record.x[: len(self.x)]) @ TO_SHOWN.T)


def rms(errors: Float[ndarray, "K 6"]) -> tuple[float, float]:
    """Return the root mean square of the errors of angles, in degrees, and of frequencies, in mHz."""
    return float(np.sqrt(np.mean(errors[:, :3] ** 2))), 1e3 * float(np.sqrt(np.mean(errors[:, 3:] ** 2)))
