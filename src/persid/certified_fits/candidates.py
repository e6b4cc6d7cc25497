"""Candidates: sets of functions, their scales and the ridge, fitted to a part of the data and scored on the rest."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from sklearn.base import clone

from persid.identification import free_runs as freerun
from persid.identification.basis import Functions
from persid.identification.identifier import PersidskiiIdentifier
from persid.identification.learned import USUAL, learns
from persid.identification.scores import parted
from persid.measurements.boxes import box_of, widths
from persid.measurements.trajectories import Trajectories
from persid.models.functions import scalar_function
from persid.models.lookup_tables import WORD
from persid.models.model import PersidskiiModel

VALIDATED = 0.2  # share of every run that candidates are scored on
SHORTEST = 16  # samples of a run, below which nothing is kept for scores
LONGEST = 3000  # samples of one scored free run
SIMILAR = 1.02  # of candidates within 2 % of the best error the smallest one is taken, and the one with the most ridge
FINALISTS = 4  # candidates that are fitted to all of the data, one after the other until one is certified
MOST_FUNCTIONS = 5  # beside x, up to which all smaller sets are tried
FACTORS = (2.0, 0.5)  # by which the argument of a function is multiplied, one function after the other

Dictionary = tuple[tuple[str, ...], ...]  # the functions of each state


@dataclass(frozen=True, eq=False)
class Candidate:
    """One choice of functions (a tuple a state) and ridge, fitted under the certificate to the first part of every run.

    `names` are the functions to be read. `feasible` says whether a fit that satisfies the matrix inequality in floating
    point was found; `certified` whether the checker accepted a proof of it, None where none was made because it was no
    better than an earlier one. `error` is the free-run RMSE on the rest, in widths of the data, `r2` the mean over
    states of its R2; `excess` the growth of the residuals over the free fit with the same functions and ridge.
    """

    functions: Dictionary
    names: tuple[str, ...]
    ridge: float
    feasible: bool
    certified: bool | None
    error: float
    r2: float
    excess: float
    seconds: float

    @property
    def size(self) -> int:
        """Number of columns that are functions of the state; a learned one has about as many as it has knots."""
        return sum(USUAL if f == WORD else 1 for row in self.functions for f in row)


@dataclass(frozen=True)
class Choice:
    """Functions (None: those of the free fit) and ridge of the final fit."""

    functions: Dictionary | None
    ridge: float


def ranked(table: Sequence[Candidate], fallback: float) -> list[Choice]:
    """Order feasible candidates by their error, the simplest one within 2 % of the best in front."""
    good = sorted((row for row in table if _eligible(row)), key=lambda row: row.error)
    if not good:
        return [Choice(None, fallback)]
    near = [row for row in good if row.error <= SIMILAR * good[0].error]
    first = min(near, key=lambda row: (row.size, -row.ridge))
    return [Choice(row.functions, row.ridge) for row in [first, *(row for row in good if row is not first)]][:FINALISTS]


def lowest_error(table: Sequence[Candidate]) -> float:
    """Return the smallest error so far."""
    return min((row.error for row in table if _eligible(row)), default=np.inf)


def _eligible(row: Candidate) -> bool:
    return row.feasible and row.certified is not False and bool(np.isfinite(row.error))


def trials(start: Dictionary, ridges: Sequence[float], table: Sequence[Candidate], select: bool) -> Iterator[Choice]:
    """Yield what is to be tried; `table`, which grows meanwhile, tells what has proved good.

    First the ridges. Then, to select functions: smaller sets, functions that are learned, other scales of each
    function, and the sets without one function in one state, each step from the best so far.
    """
    for ridge in ridges:
        yield Choice(start, ridge)
    if not select:
        return
    seen = {start}
    for step in (_smaller, _learned, _rescaled, _reduced):
        base = ranked(table, ridges[0])[0]
        for functions in step(start if step is _smaller or base.functions is None else base.functions):
            if functions not in seen:
                seen.add(functions)
                yield Choice(functions, base.ridge)


def _smaller(functions: Dictionary) -> Iterator[Dictionary]:
    """Yield the sets of functions that hold the linear part, small ones first."""
    others = [name for name in dict.fromkeys(f for row in functions for f in row) if name != "x"]
    if len(others) > MOST_FUNCTIONS:
        return
    for size in range(len(others)):
        for kept in combinations(others, size):
            found = tuple(tuple(f for f in row if f == "x" or f in kept) for row in functions)
            if all(found):
                yield found


def _learned(functions: Dictionary) -> Iterator[Dictionary]:
    """Yield the set that learns a function of each state from the data, in place of those that are given."""
    yield (("x", WORD),) * len(functions)


def _rescaled(functions: Dictionary) -> Iterator[Dictionary]:
    """Yield the sets with the argument of one function stretched or compressed."""
    for name in dict.fromkeys(f for row in functions for f in row):
        if not re.fullmatch(r"x(\*\*[\d.]+)?|pwl", name):  # a power's scale is its coefficient, pwl has those of data
            for factor in FACTORS:
                other = rescaled(name, factor)
                yield tuple(tuple(other if f == name else f for f in row) for row in functions)


def rescaled(name: str, factor: float) -> str:
    """Return the text of f(factor x): tanh(x) becomes tanh(2*x)."""
    argument = f"{factor:g}*x"
    if re.fullmatch(r"\w+\(x\)", name):
        return name.replace("(x)", f"({argument})")
    return scalar_function(re.sub(r"\bx\b", f"({argument})", name)).text


def _reduced(functions: Dictionary) -> Iterator[Dictionary]:
    """Yield the sets without one function in one state."""
    for i, row in enumerate(functions):
        for name in row:
            if len(row) > 1 and name != "x":
                rest = tuple(f for f in row if f != name)
                yield (*functions[:i], rest, *functions[i + 1 :])


def dictionary(functions: Functions, n: int) -> Dictionary:
    """Return the functions of each of n states as an estimator was given them."""
    if all(isinstance(f, str) for f in functions):
        return (tuple(map(str, functions)),) * n
    return tuple(tuple(row) for row in functions)


def shown(functions: Dictionary, states: Sequence[str]) -> tuple[str, ...]:
    """Return the functions to be read: those that not all states have with the names of their states."""
    found = []
    for name in dict.fromkeys(f for row in functions for f in row):
        owners = [state for state, row in zip(states, functions, strict=True) if name in row]
        found.append(name if len(owners) == len(states) else f"{name} in {', '.join(owners)}")
    return tuple(found)


def estimator_with(fitted: PersidskiiIdentifier, functions: Dictionary) -> PersidskiiIdentifier:
    """Return an unfitted estimator like a fitted one, with its ridge and other functions."""
    alike = len(set(functions)) == 1
    given = list(functions[0]) if alike else [list(row) for row in functions]
    one_curve = fitted.one_curve and learns(given)
    chosen = {"ridge": fitted.ridge_, "holdout": 0.0, "functions": given, "one_curve": one_curve}
    alike_but: PersidskiiIdentifier = clone(fitted).set_params(**chosen)
    return alike_but


def shortened(data: Trajectories) -> Trajectories:
    """Return the first samples of every run, as many as are scored."""
    return Trajectories(tuple(run[:LONGEST] for run in data), data.states, data.inputs)


def halves(data: Trajectories) -> tuple[Trajectories, Trajectories] | None:
    """Return the first part of every run and the rest to be scored on, or None where the runs are too short."""
    if min(len(run) for run in data) * VALIDATED < SHORTEST:
        return None
    return parted(data, [len(run) - int(VALIDATED * len(run)) for run in data], LONGEST)


def free_run_error(model: PersidskiiModel, data: Trajectories, hold: str) -> float:
    """Return the free-run RMSE in widths of the data, each state counting alike; infinite where a run ends early."""
    return scored(model, data, hold)[0]


def scored(model: PersidskiiModel, data: Trajectories, hold: str) -> tuple[float, float]:
    """Return the free-run error in widths of the data and the mean R2 of the states."""
    width = widths(box_of(data))
    guesses, means = [], []
    for run in data:
        found = model.simulate(run.x[0], run.t, freerun.input_signal(run.t, run.u, hold))[0]
        if len(found) < len(run):
            return np.inf, -np.inf
        guesses.append(found.x)
        means.append(float((((found.x - run.x) / width) ** 2).mean()))
    truth, record = np.concatenate([run.x for run in data]), data.moments.of(slice(len(data.states)))
    fit = freerun.score(truth, np.concatenate(guesses), record=record)
    return float(np.sqrt(np.mean(means))), fit.r2_mean
