"""Records of a grid as synchrophasors give them, the model that is identified from them, and its free runs.

Frames come 60 times a second, with noise of 0.02 degrees on the angle and 1 mHz on the frequency of every machine.
Rotor angles are taken for measured; in a real grid they are estimated from the phasors at the terminals.

The right side has sines and cosines of the angle between every pair of machines, and that between machines j and k is
the difference of two states. It is measured too, so that a model with the angles of all pairs is fitted row by row;
what follows from those to the first machine is then put in for the others, and x' = 360 f for the rows of the angles,
which are known. A row reads the pairs that its own two machines stand in.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from numpy import ndarray

import persid as ps
from persid.studies.grid import HERTZ, NORMAL, RADIANS, Condition, Grid

FRAMES = int(HERTZ)  # a second
ANGLE_NOISE, FREQUENCY_NOISE = 0.02, 1e-3  # degrees, Hz
LARGEST_STEP, HELD = 0.25, 4.0  # share of a load; s from one step to the next


@dataclass(frozen=True, eq=False)
class Record:
    """What happened: times (s), the states without noise, and the load steps (MW) held from each frame to the next."""

    t: Float[ndarray, " N"]
    x: Float[ndarray, "N n"]
    u: Float[ndarray, "N m"]

    def measured(self, grid: Grid, random: np.random.Generator) -> Float[ndarray, "N k"]:
        """Return angles (degrees) and frequencies (Hz) of the machines with noise, as differences and means."""
        K, k = grid.machines, grid.machines - 1
        noise = random.normal(0, [ANGLE_NOISE] * K + [FREQUENCY_NOISE] * K, (len(self.t), 2 * K))
        angles = np.column_stack([np.zeros(len(self.t)), self.x[:, :k]]) + noise[:, :K]
        f = self.x[:, k:] @ grid.to_machines.T + noise[:, K:]
        first, second = np.array(grid.pairs).T
        pairs = angles[:, first] - angles[:, second]
        return np.column_stack([pairs, f[:, 1:] - f[:, :1], f @ grid.case.H / grid.case.H.sum()])


def load_steps(grid: Grid, seconds: float, random: np.random.Generator) -> Record:
    """Return a record in which, every few seconds, one load goes to a random size near its nominal one."""
    case, t, each = grid.case, np.arange(round(seconds * FRAMES) + 1) / FRAMES, round(HELD * FRAMES)
    x, u, loads = np.tile(grid.rest, (len(t), 1)), np.zeros((len(t), len(case.loads))), np.ones(len(case.loads))
    for k in range(0, len(t) - 1, each):
        loads[random.integers(len(loads))] = 1 + random.uniform(-LARGEST_STEP, LARGEST_STEP)
        held = slice(k, min(k + each, len(t) - 1) + 1)
        x[held] = grid.simulate(x[k], t[held], Condition(tuple(loads.tolist())))
        u[held] = case.nominal * (loads - 1)
    return Record(t, x, u)


def ring_down(grid: Grid, fault: int, cleared: float, seconds: float) -> Record:
    """Return the record after a short circuit at a bus that went away by itself, `cleared` s after it came."""
    start = grid.simulate(grid.rest, np.array([0.0, cleared]), Condition(fault=fault))[-1]
    t = np.arange(round(seconds * FRAMES) + 1) / FRAMES
    return Record(t, grid.simulate(start, t, NORMAL), np.zeros((len(t), len(grid.case.loads))))


def from_states(grid: Grid) -> Float[ndarray, "k n"]:
    """Return the measured quantities, angles of all pairs and frequencies, from the states."""
    p, K = len(grid.pairs), grid.machines
    return np.block([[grid.to_pairs, np.zeros((p, K))], [np.zeros((K, K - 1)), np.eye(K)]])


def to_shown(grid: Grid) -> Float[ndarray, "k n"]:
    """Return what an operator reads, angles of all pairs and the machines' frequencies, from the states."""
    p, K = len(grid.pairs), grid.machines
    return np.block([[grid.to_pairs, np.zeros((p, K))], [np.zeros((K, K - 1)), grid.to_machines]])


def shown(grid: Grid) -> tuple[str, ...]:
    """Return the names of what an operator reads, in degrees and Hz."""
    return (*grid.angles, *(f"f{k + 1}" for k in range(grid.machines)))


def measured(grid: Grid) -> tuple[str, ...]:
    """Return the names of what is measured."""
    return (*grid.angles, *grid.states[grid.machines - 1 :])


def _reads(grid: Grid) -> Iterator[tuple[str, ...]]:
    """Yield for each measured row those that it reads: no row reads the frequency of the whole grid but its own."""
    frequencies = grid.states[grid.machines - 1 : -1]  # of machines 2, 3, ...
    for i, j in grid.pairs:
        yield tuple(frequencies[k - 1] for k in (i, j) if k)
    for k in range(1, grid.machines):
        paired = zip(grid.angles, grid.pairs, strict=True)
        own = (angle for angle, pair in paired if 0 in pair or k in pair)
        yield (*own, *frequencies)
    yield (*grid.angles, "f0")


def identify(grid: Grid, records: Sequence[Record], random: np.random.Generator) -> ps.PersidskiiModel:
    """Return the model of the states that measurements of these records give."""
    names, angles = measured(grid), len(grid.pairs)
    data = ps.Trajectories.from_arrays(
        [record.measured(grid, random) for record in records],
        [record.u for record in records],
        t=[record.t for record in records],
        states=names,
        inputs=tuple(grid.case.loads),
    )
    pattern = [[name in reads for name in names] for reads in _reads(grid)]
    functions = [["sin(x)", "cos(x)"]] * angles + [["x"]] * grid.machines
    units = [1 / RADIANS] * angles + [1.0] * grid.machines
    fit = ps.PersidskiiIdentifier(functions, x_ref=0.0, scale=units, pattern=pattern, ridge=0.0).fit(data)
    return of_states(grid, fit.model_)


def of_states(grid: Grid, found: ps.PersidskiiModel) -> ps.PersidskiiModel:
    """Return a model of all that is measured as one of the states: d_jk = d_j1 - d_k1, and x' = 360 f for angles."""
    swings, K, still = slice(len(grid.pairs), None), grid.machines, np.zeros(grid.machines - 1)
    known = np.hstack([np.zeros((K - 1, K - 1)), grid.kinematics])
    A0 = np.vstack([known, found.A0[swings] @ from_states(grid)])
    terms = [
        (term.f[0].text, term.R @ from_states(grid), grid.below(term.A[swings]))
        for term in found.terms
        if term.R is not None
    ]
    B, b = grid.below(found.B[swings]), np.concatenate([still, found.b[swings]])
    return ps.PersidskiiModel(A0, terms, B, b, states=grid.states, inputs=found.inputs, provenance=found.provenance)


def relative(model: ps.PersidskiiModel) -> ps.PersidskiiModel:
    """Return the model of angles and frequencies between machines alone: nothing in it reads that of the whole grid."""
    few = model.n - 1
    terms = [(term.f[0].text, term.R[:, :few], term.A[:few]) for term in model.terms if term.R is not None]
    return ps.PersidskiiModel(
        model.A0[:few, :few], terms, model.B[:few], model.b[:few], states=model.states[:few], inputs=model.inputs
    )


@dataclass(frozen=True, eq=False)
class FreeRun:
    """A run of a model from the first state of a record and its load steps alone, beside what happened."""

    grid: Grid
    record: Record
    x: Float[ndarray, "K n"]

    @classmethod
    def of(cls, grid: Grid, model: ps.PersidskiiModel, record: Record) -> "FreeRun":
        """Run a model."""
        return cls(grid, record, model.simulate(record.x[0], record.t, record.u)[0].x)

    @cached_property
    def errors(self) -> Float[ndarray, "K k"]:
        """What the run shows less what happened, in degrees and Hz."""
        return np.asarray((self.x - self.record.x[: len(self.x)]) @ to_shown(self.grid).T)


def rms(grid: Grid, errors: Float[ndarray, "K k"]) -> tuple[float, float]:
    """Return the root mean square of the errors of angles, in degrees, and of frequencies, in mHz."""
    angles, frequencies = np.split(errors, [len(grid.pairs)], axis=1)
    return float(np.sqrt(np.mean(angles**2))), 1e3 * float(np.sqrt(np.mean(frequencies**2)))
