"""Which coefficients a fit may use, and which of them are one and the same number."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool
from numpy import ndarray

from persid.errors import DataError
from persid.identification.basis import Basis


@dataclass(frozen=True, eq=False)
class Structure:
    """Parameters of a fit: `parameter[j, i]` is the number of the parameter at theta[j, i], -1 where theta is zero."""

    parameter: ndarray
    count: int

    @classmethod
    def of(cls, parameter: ndarray) -> "Structure":
        """Number the parameters anew, without gaps, in their order; -1 stays."""
        used, numbered = np.unique(parameter, return_inverse=True)
        unused = int(used[0] == -1)
        return cls(numbered.reshape(parameter.shape) - unused, len(used) - unused)

    @property
    def is_separate(self) -> bool:
        """Whether no parameter is used by two states, so that every state has its own least-squares problem."""
        return self.count == int((self.parameter >= 0).sum())

    @property
    def most_columns(self) -> int:
        """The largest number of unknowns that a sample of all states has to determine, per state."""
        if self.is_separate:
            return int((self.parameter >= 0).sum(axis=0).max())
        return -(-self.count // self.parameter.shape[1])


def make_structure(basis: Basis, pattern: Any = None, shared: bool = False, constant: bool = True) -> Structure:
    """Return the structure of a fit: full, `pattern[i, j]` (may state j influence state i), or shared along a chain.

    `shared=True` gives the coefficients of states by the difference of their places, x_j in the equation of x_i by
    j - i: a translation-invariant chain. Inputs and constants stay free in every equation.

    Raises:
        DataError: pattern is no n x n matrix of truth values, or shared states have different functions.
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
    return Structure.of(parameter)


def _pattern(pattern: Any, n: int) -> Bool[ndarray, "n n"]:
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
