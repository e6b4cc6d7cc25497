"""Basis: the columns of a regression, and the way from their coefficients to a PersidskiiModel and back."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json
from persid.errors import DataError, ModelError
from persid.measurements.moments import Moments
from persid.measurements.recordings import Measurements
from persid.models.functions import ScalarFunction, scalar_function
from persid.models.model import PersidskiiModel

Functions = Sequence[str] | Sequence[Sequence[str]]


@dataclass(frozen=True)
class Column:
    """One column: `kind` is linear, function, input or constant; places are -1 where a column has none."""

    kind: str
    name: str
    state: int = -1
    term: int = -1
    input: int = -1


def _named(text: str, argument: str) -> str:
    return re.sub(r"\bx\b", argument, text)


@dataclass(frozen=True, eq=False)
class Basis:
    """Basis functions of the vector field: x - x_ref, the functions of (x - x_ref)/scale, u - u_ref and 1.

    Paper: eq:basis_functions_selected (Sec. 4.1).

    `terms[j][i]` is the j-th nonlinear function of state i, or None; `linear[i]` says whether x_i itself is a column.
    With a step `dt` (s) coefficients are those of what x moves by in a step; of a state that is no column itself, those
    of x+ - x_ref.
    Columns stand in the order: linear, functions (term by term, state by state), inputs, constant.
    """

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    linear: tuple[bool, ...]
    terms: tuple[tuple[ScalarFunction | None, ...], ...]
    x_ref: Float[ndarray, " n"]
    u_ref: Float[ndarray, " m"]
    scale: Float[ndarray, " n"]
    dt: float | None = None

    @cached_property
    def columns(self) -> tuple[Column, ...]:
        """The columns in order; `columns[j].name` is the name of feature j."""
        linear = [Column("linear", self.states[i], i) for i in self._linear]
        functions = [
            Column(
                "function", _named(f.text, self._argument(i, re.fullmatch(r"\w+\(x(;.*)?\)", f.text) is not None)), i, j
            )
            for j, term in enumerate(self.terms)
            for i, f in enumerate(term)
            if f
        ]
        inputs = [Column("input", name, input=k) for k, name in enumerate(self.inputs)]
        return (*linear, *functions, *inputs, Column("constant", "1"))

    def _argument(self, i: int, bare: bool) -> str:
        shift = f"{self.states[i]}-{self.x_ref[i]:g}" if self.x_ref[i] else self.states[i]
        simple = self.scale[i] == 1 and not self.x_ref[i]
        divided = f"({shift})/{self.scale[i]:g}" if self.x_ref[i] else f"{shift}/{self.scale[i]:g}"
        text = shift if self.scale[i] == 1 else divided
        return text if simple or bare else f"({text})"

    @cached_property
    def _linear(self) -> list[int]:
        return [i for i, used in enumerate(self.linear) if used]

    @cached_property
    def _places(self) -> list[tuple[list[int], list[tuple[ScalarFunction, list[int]]]]]:
        """Per term: its states, and its functions each with the positions they fill."""
        result = []
        for term in self.terms:
            states = [i for i, f in enumerate(term) if f]
            kinds = {f: [k for k, i in enumerate(states) if term[i] == f] for f in term if f}
            result.append((states, list(kinds.items())))
        return result

    @property
    def size(self) -> int:
        """Number of columns."""
        return len(self.columns)

    @cached_property
    def state_columns(self) -> int:
        """Number of columns that depend on x; they stand first."""
        return self.size - len(self.inputs) - 1

    def values(self, x: Float[ndarray, "N n"]) -> Float[ndarray, "N p"]:
        """Return the columns that depend on x."""
        out = np.empty((len(x), self.state_columns))
        self.write(x, out)
        return out

    def write(self, x: Float[ndarray, "N n"], out: Float[ndarray, "N p"]) -> None:
        """Write the columns that depend on x into `out`."""
        dx = x - self.x_ref
        k, n = len(self._linear), len(self.states)
        out[:, :k] = dx if k == n else dx[:, self._linear]
        y = dx if (self.scale == 1).all() else dx / self.scale
        for states, functions in self._places:
            arguments = y if len(states) == n else y[:, states]
            for f, places in functions:
                if len(functions) == 1:
                    out[:, k : k + len(states)] = f.on_arrays(arguments)
                else:
                    out[:, [k + place for place in places]] = f.on_arrays(arguments[:, places])
            k += len(states)

    def slopes(self, x: Float[ndarray, "N n"]) -> Float[ndarray, "N p"]:
        """Return the derivatives of the columns that depend on x, each by its own state."""
        y = (x - self.x_ref) / self.scale
        out = np.ones((len(x), self.state_columns))
        k = len(self._linear)
        for states, functions in self._places:
            for f, places in functions:
                chosen = [states[place] for place in places]
                out[:, [k + place for place in places]] = f.derivative(y[:, chosen]) / self.scale[chosen]
            k += len(states)
        return out

    @cached_property
    def owner(self) -> ndarray:
        """State of each column that depends on x."""
        return np.array([column.state for column in self.columns[: self.state_columns]], dtype=int)

    @property
    def _identity(self) -> Float[ndarray, "n n"]:
        """What A0 holds beside coefficients: in discrete time the identity, for states that are columns."""
        return np.diag(np.array(self.linear, float)) * (self.dt is not None)

    def kept(self, x: Float[ndarray, "*N n"]) -> Float[ndarray, "*N n"]:
        """Return what coefficients of a step are relative to: x itself, or x_ref where it is no column."""
        return np.asarray(np.where(self.linear, x, self.x_ref))

    def model(self, theta: Float[ndarray, "p n"], **more: Any) -> PersidskiiModel:
        """Return the model with x', or x+ - x, = theta' columns; `more` goes to PersidskiiModel."""
        n, m = len(self.states), len(self.inputs)
        A0 = np.zeros((n, n))
        k = len(self._linear)
        A0[:, self._linear] = theta[:k].T
        A0 += self._identity
        terms: list[tuple[object, object, ndarray]] = []
        for states, _ in self._places:
            f = [term.text for i in states if (term := self.terms[len(terms)][i])]
            unscaled = len(states) == n and bool((self.scale == 1).all())
            R = None if unscaled else (np.eye(n) / self.scale)[states]
            terms.append((f[0] if len(set(f)) == 1 else f, R, theta[k : k + len(states)].T))
            k += len(states)
        names: Json = {"states": self.states, "inputs": self.inputs}
        if self.dt is not None:
            names |= {"time": "discrete", "dt": self.dt}
        B, b = theta[k : k + m].T, theta[k + m]
        return PersidskiiModel(A0, terms, B, b, self.x_ref, self.u_ref, **names, **more)

    def coefficients(self, model: PersidskiiModel) -> Float[ndarray, "p n"]:
        """Return theta of a model that `model` made (or one of the same terms, x_ref, scales and names)."""
        parts = [
            (model.A0 - self._identity).T[self._linear],
            *(term.A.T for term in model.terms),
            model.B.T,
            model.b[None],
        ]
        theta = np.vstack(parts)
        if theta.shape[0] != self.size:
            raise ModelError(f"the model has {theta.shape[0]} rows of coefficients; this basis has {self.size}")
        return theta


def make_basis(data: Measurements, functions: Functions, x_ref: object = "auto", scale: object = "auto") -> Basis:
    """Return the basis for data: reference points at 0 or the mean, scales powers of two, arguments of order 1.

    `x_ref="auto"` takes, for each state, 0 where the data come as near to 0 as they spread, else the mean, rounded.
    `scale="auto"` takes the power of two next to the largest |x - x_ref| / 2; 1/scale is then exact.

    Raises:
        DataError: functions, x_ref or scale do not fit the states.
    """
    n = len(data.states)
    lists = per_state(functions, n)
    found = data.moments
    x, u = found.of(slice(n)), found.of(slice(n, None))
    reference = reference_point(x) if is_auto(x_ref) else _vector("x_ref", x_ref, n)
    sizes = _powers_of_two(_reach(x, reference)) if is_auto(scale) else _vector("scale", scale, n)
    if not (sizes > 0).all():
        raise DataError(f"scale = {sizes.tolist()}; every scale must be positive")
    parsed = [[f for f in map(scalar_function, names) if not f.is_linear] for names in lists]
    linear = tuple(any(scalar_function(f).is_linear for f in names) for names in lists)
    depth = max(len(row) for row in parsed)
    terms = tuple(tuple(row[j] if j < len(row) else None for row in parsed) for j in range(depth))
    return Basis(
        states=data.states,
        inputs=data.inputs,
        linear=linear,
        terms=terms,
        x_ref=reference,
        u_ref=typical_input(u),
        scale=sizes,
    )


def per_state(functions: Functions, n: int) -> list[list[str]]:
    """Return the list of functions of each of n states."""
    if isinstance(functions, str) or not len(functions):
        raise DataError('functions needs a list such as ["x", "tanh(x)"], or one such list per state')
    if all(isinstance(f, str) for f in functions):
        return [list(dict.fromkeys(functions))] * n  # type: ignore[arg-type]
    if len(functions) != n or any(isinstance(f, str) for f in functions):
        raise DataError(
            f"functions has {len(functions)} lists but there are {n} states; give one list, or one per state"
        )
    return [list(dict.fromkeys(names)) for names in functions]


def _vector(name: str, value: object, n: int) -> ndarray:
    try:
        vector = np.broadcast_to(np.asarray(value, float), (n,)).copy()
    except (TypeError, ValueError):
        raise DataError(
            f'{name} = {value!r}; needed is "auto", a number, or one number for each of {n} states'
        ) from None
    if not np.isfinite(vector).all():
        raise DataError(f"{name} = {vector.tolist()}; every number must be finite")
    return vector


def is_auto(value: object) -> bool:
    """Whether an argument is left to the data."""
    return isinstance(value, str) and value == "auto"


def _reach(x: Moments, reference: ndarray) -> ndarray:
    return np.asarray(np.maximum(np.abs(x.low - reference), np.abs(x.high - reference)))


def reference_point(x: Moments) -> Float[ndarray, " k"]:
    """Return 0 where a column comes as near to 0 as it spreads, else its mean, rounded to what its spread resolves."""
    low, high = x.low, x.high
    digit = np.floor(np.log10(np.where(high > low, (high - low) / 2, 1.0)))
    rounded = np.array([round(value, -int(place)) for value, place in zip(x.mean, digit, strict=True)])
    near = (low - (high - low) <= 0) & (high + (high - low) >= 0)
    return np.where(near, 0.0, np.where(high > low, rounded, x.mean))


def typical_input(u: Moments) -> Float[ndarray, " m"]:
    """Return an input that occurs: 0 where it lies in the range of the data, else the mean, rounded where it can be."""
    rounded = reference_point(u)
    inside = (u.low <= rounded) & (rounded <= u.high)
    return np.where((u.low <= 0) & (u.high >= 0), 0.0, np.where(inside, rounded, u.mean))


def _powers_of_two(reach: ndarray) -> ndarray:
    """Return the power of two next to reach / 2, so that arguments reach 1.4 to 2.8; 1 where nothing moves."""
    safe = np.where(reach > 0, reach, 2.0)
    return np.exp2(np.round(np.log2(safe / 2)))
