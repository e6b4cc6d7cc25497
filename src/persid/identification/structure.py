"""Which coefficients a fit may use, which of them are one and the same number, and which are known."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from numpy import ndarray

from persid.errors import DataError
from persid.identification.basis import Basis


@dataclass(frozen=True, eq=False)
class Structure:
    """Parameters of a fit: `parameter[j, i]` is the number of the parameter at theta[j, i], -1 where theta is known.

    What is known is `given`, zeros but for equations that are known as a whole.
    """

    parameter: ndarray
    count: int
    given: Float[ndarray, "p n"]

    @classmethod
    def of(cls, parameter: ndarray, given: Float[ndarray, "p n"] | None = None) -> "Structure":
        """Number the parameters anew, without gaps, in their order; -1 stays."""
        used, numbered = np.unique(parameter, return_inverse=True)
        unused = int(used[0] == -1)
        known = np.zeros(parameter.shape) if given is None else given
        return cls(numbered.reshape(parameter.shape) - unused, len(used) - unused, known)

    @property
    def known(self) -> Bool[ndarray, " n"]:
        """Which equations are known as a whole."""
        return np.asarray(self.given.any(axis=0))

    @property
    def is_separate(self) -> bool:
        """Whether no parameter is used by two states, so that every state has its own least-squares problem."""
        return self.count == int((self.parameter >= 0).sum())

    @property
    def most_columns(self) -> int:
        """The largest number of unknowns that a sample of all states has to determine, per state."""
        if self.is_separate:
            return int((self.parameter >= 0).sum(axis=0).max())
        return int(-(-self.count // self.parameter.shape[1]))


def make_structure(
    basis: Basis,
    pattern: object = None,
    shared: bool = False,
    constant: bool = True,
    velocities: Mapping[str, str] | None = None,
) -> Structure:
    """Return the structure of a fit: full, `pattern[i, j]` (may state j influence state i), or shared along a chain.

    `shared=True` gives the coefficients of states by the difference of their places, x_j in the equation of x_i by
    j - i: a translation-invariant chain. Inputs and constants stay free in every equation.

    `velocities` gives states that are the derivatives of others, such as {"theta": "theta_dot"}: the equation
    theta' = theta_dot is known, and nothing of it is fitted.

    Raises:
        DataError: pattern is no n x n matrix of truth values, shared states have different functions, or a velocity is
            no state, or has no linear column.
    """
    n = len(basis.states)
    allowed = np.ones((n, n), bool) if pattern is None else _pattern(pattern, n)
    parameter = np.arange(basis.size * n).reshape(basis.size, n)
    owner = basis.owner
    parameter[: len(owner)][~allowed[:, owner].T] = -1
    if shared:
        _share(basis, parameter)
    if not constant:
        parameter[-1] = -1
    given = np.zeros(parameter.shape)
    for name, velocity in (velocities or {}).items():
        _fix(basis, name, velocity, parameter, given)
    return Structure.of(parameter, given)


def _fix(basis: Basis, name: str, velocity: str, parameter: ndarray, given: ndarray) -> None:
    """Write x_i' = x_j = (x_j - x_ref_j) + x_ref_j into the coefficients that are known."""
    if missing := [one for one in (name, velocity) if one not in basis.states]:
        raise DataError(f"velocities: {', '.join(missing)} is no state; the states are {', '.join(basis.states)}")
    i, j = basis.states.index(name), basis.states.index(velocity)
    place = next((k for k, c in enumerate(basis.columns) if c.kind == "linear" and c.state == j), None)
    if place is None:
        raise DataError(
            f"{name}' = {velocity} is known, which needs the function x of {velocity}: add x to functions=, or give "
            "velocities=None to fit that equation, too"
        )
    parameter[:, i] = -1
    given[place, i], given[-1, i] = 1.0, basis.x_ref[j]


def _pattern(pattern: object, n: int) -> Bool[ndarray, "n n"]:
    matrix = np.asarray(pattern.toarray() if hasattr(pattern, "toarray") else pattern)
    if matrix.shape != (n, n) or matrix.dtype != bool:
        raise DataError(f"pattern has shape {matrix.shape} of {matrix.dtype}; needed is a boolean ({n}, {n}) matrix")
    return matrix


def _share(basis: Basis, parameter: ndarray) -> None:
    """Give equal numbers to the columns of one term whose states lie equally far from the equation's state."""
    for term in basis.terms:
        if len(set(term)) != 1:
            raise DataError("shared=True needs the same functions for every state")
    n = len(basis.states)
    columns = basis.columns[: basis.state_columns]
    kind = np.array([column.term for column in columns]) + 1
    distance = basis.owner[:, None] - np.arange(n)[None, :] + n
    ids = basis.size * n + kind[:, None] * 2 * n + distance
    block = parameter[: len(columns)]
    block[block >= 0] = ids[block >= 0]
