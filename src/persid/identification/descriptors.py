"""DescriptorIdentifier: states by their derivatives, measured algebraic variables by what they are at every sample."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy import ndarray
from sklearn.base import BaseEstimator

from persid._files import Json
from persid.errors import DataError
from persid.identification.identifier import FUNCTIONS, PersidskiiIdentifier
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel

HELD = 0.2  # share of every run that is held out


class DescriptorIdentifier(BaseEstimator):  # type: ignore[misc]  # scikit-learn has no types
    """Identify a model with algebraic variables from runs in which all variables are measured.

    The rows of the states are those of `PersidskiiIdentifier` with all variables in their arguments. The equation of an
    algebraic variable says what it is, 0 = -w_i + (the other variables, their functions, inputs and a constant), by the
    same regression with w_i itself at the samples in place of a derivative. An equation that reads its own variable
    inside a function is written with two: a current that is a function of a voltage, a voltage that the current lowers.

    algebraic: the names of the algebraic variables among the columns of the data.
    functions: expressions in x, one list for all variables or one list a variable, in the order of the data's columns.
    ridge: the strength, relative to columns of mean square 1, of both regressions.
    x_ref, scale: of the functions' arguments, "auto" or numbers, one a column, as of PersidskiiIdentifier.
    pattern: boolean N x N over the data's columns, whether variable j may influence row i; w_i never does its own row.
    constant: whether rows have constants.  hold: "zoh" or "paper", as of PersidskiiIdentifier.
    holdout: the share at the end of every run that is left out, for `scores_`.

    After `fit`: model_, held_: what was held out, and scores_: the root mean square error of free runs over it, by
    variable, in its unit.

    Examples:
        >>> true = ps.DescriptorModel([[-1.0, -1.0], [0.0, -1.0]], [("tanh(x)", [[1.0, 0.0]], [[0.0], [1.0]])],
        ...                           [[1.0], [0.0]], algebraic=["w"])
        >>> t = np.linspace(0, 20, 401)
        >>> data = true.simulate([1.0], t, np.sin(t)[:, None])
        >>> fit = ps.DescriptorIdentifier(["w"], ["x", "tanh(x)"], x_ref=[0, 0], scale=[1, 1]).fit(data)
        >>> fit.scores_["w"] < 0.01
        True
    """

    def __init__(
        self,
        algebraic: Sequence[str],
        functions: Any = FUNCTIONS,
        *,
        ridge: float | int = 1e-8,
        x_ref: object = "auto",
        scale: object = "auto",
        pattern: object = None,
        constant: bool = False,
        hold: str = "zoh",
        holdout: float | int = HELD,
    ) -> None:
        self.algebraic = algebraic
        self.functions = functions
        self.ridge = ridge
        self.x_ref = x_ref
        self.scale = scale
        self.pattern = pattern
        self.constant = constant
        self.hold = hold
        self.holdout = holdout

    def fit(self, data: Trajectories) -> "DescriptorIdentifier":
        """Fit the model to runs with the columns of all variables.

        Raises:
            DataError: a name is no column, or no state is left; or what PersidskiiIdentifier refuses.
        """
        missing = [name for name in self.algebraic if name not in data.states]
        if missing or not 0 < len(self.algebraic) < len(data.states):
            raise DataError(f"algebraic is {list(self.algebraic)}; needed are some of {list(data.states)}, not all")
        fitted, held = beginnings_and_ends(data, float(self.holdout))
        usual: Json = {
            "functions": self.functions,
            "ridge": self.ridge,
            "constant": self.constant,
            "holdout": 0.0,
        }
        states = PersidskiiIdentifier(
            **usual, hold=self.hold, pattern=self._pattern(data, own=True), x_ref=self.x_ref, scale=self.scale
        ).fit(fitted)
        reference: Json = {"x_ref": states.model_.x_ref, "scale": states.basis_.scale}
        values = PersidskiiIdentifier(
            **usual, hold="paper", method="derivative", pattern=self._pattern(data, own=False), **reference
        ).fit(fitted, [run.x for run in fitted])
        self.model_ = _joined(states.model_, values.model_, tuple(self.algebraic))
        self.held_ = held
        self.scores_ = free_runs_of(self.model_, held).errors
        return self

    def _pattern(self, data: Trajectories, *, own: bool) -> ndarray:
        """Return what may influence what; without `own` no variable is read by its own row."""
        N = len(data.states)
        allowed = np.ones((N, N), bool) if self.pattern is None else np.array(self.pattern, bool)
        return allowed if own else allowed & ~np.eye(N, dtype=bool)


def beginnings_and_ends(data: Trajectories, share: float = HELD) -> tuple[Trajectories, Trajectories]:
    """Return the beginnings of all runs, and their ends, `share` of each.

    Raises:
        DataError: it is no share.
    """
    if not 0 <= share < 1:
        raise DataError(f"holdout is {share}; needed is a share of every run, from 0 to below 1")
    ends = [len(run) - int(share * len(run)) for run in data]
    first = tuple(run[:k] for run, k in zip(data, ends, strict=True))
    last = tuple(run[min(k, len(run) - 2) :] for run, k in zip(data, ends, strict=True))
    return Trajectories(first, data.states, data.inputs), Trajectories(last, data.states, data.inputs)


def _joined(states: PersidskiiModel, values: PersidskiiModel, algebraic: tuple[str, ...]) -> DescriptorModel:
    """Return the rows of the states of one model with those that say what algebraic variables are of another."""
    order = [*(name for name in states.states if name not in algebraic), *algebraic]
    at = [states.states.index(name) for name in order]
    n = len(order) - len(algebraic)
    which = np.repeat([0.0, 1.0], [n, len(order) - n])
    rows = []
    for model, mask in ((states, 1 - which[:, None]), (values, which[:, None])):
        channels = model.channels
        columns = channels.columns[at] * mask
        used = columns.any(axis=0)
        terms = [
            (f, channels.rows[c][None, at], columns[:, c][:, None])
            for c, f in enumerate(channels.functions) if used[c]
        ]  # fmt: skip
        rows.append((channels.A0[np.ix_(at, at)] * mask, terms, model.B[at] * mask, model.b[at] * np.ravel(mask)))
    (A0, terms, B, b), (A1, more, B1, b1) = rows
    x_ref = states.x_ref[at]
    whole = PersidskiiModel(
        A0 + A1 - np.diag(which), [*terms, *more], B + B1, b + b1 - x_ref * which, x_ref, states.u_ref,
        states=order, inputs=states.inputs, domain=None if states.domain is None else states.domain[at],
        provenance=states.provenance,
    )  # fmt: skip
    return DescriptorModel(whole, algebraic=algebraic)


@dataclass(frozen=True, eq=False)
class FreeRuns:
    """Measured runs beside free runs of a model, all variables in the model's order.

    By variable: root mean square errors in its unit, infinite where a run ends early, and R².
    """

    pairs: tuple[tuple[Trajectory, Trajectory], ...]
    errors: dict[str, float]
    r2: dict[str, float]


def free_runs_of(model: DescriptorModel, data: Trajectories) -> FreeRuns:
    """Simulate a model from the first sample of every run, the algebraic variables near where they were measured."""
    at = [data.states.index(name) for name in model.variables]
    pairs, squares, spread, count = [], np.zeros(len(at)), np.zeros(len(at)), 0
    for run in data:
        measured = Trajectory(run.t, run.x[:, at], run.u)
        z, n = measured.x, model.n
        free = model.simulate(z[0, :n], run.t, run.u, near=z[0, n:])[0]
        pairs.append((measured, free))
        squares += np.inf if len(free) < len(z) else ((free.x - z) ** 2).sum(axis=0)
        spread += ((z - z.mean(axis=0)) ** 2).sum(axis=0)
        count += len(z)
    with np.errstate(all="ignore"):
        values = np.sqrt(squares / count), 1 - squares / spread
    errors, r2 = (dict(zip(model.variables, each.tolist(), strict=True)) for each in values)
    return FreeRuns(tuple(pairs), errors, r2)
