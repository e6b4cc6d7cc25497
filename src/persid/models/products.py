"""Products of states as functions of one argument each: squares of sums and of differences."""

from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import ModelError


def products(
    columns: Mapping[tuple[int, int], Sequence[float] | Float[ndarray, " n"]],
) -> tuple[str, Float[ndarray, "q n"], Float[ndarray, "n q"]]:
    """Return the term of a PersidskiiModel that is the sum of columns[i, j] x_i x_j, states counted from 0.

    x_i x_j = ((x_i + x_j)^2 - (x_i - x_j)^2) / 4, where x is measured from x_ref, as in every term. A column has one
    coefficient for each equation. Quarters of binary64 are exact, so products that cancel in an energy still do: such
    models are certified for all states.

    Raises:
        ModelError: there is no product, columns have different lengths, or a state has no column.

    Examples:
        Lorenz's system, x' = 10 (y - x), y' = x/2 - y - x z, z' = x y - 2 z:

        >>> term = ps.products({(0, 2): [0, -1, 0], (0, 1): [0, 0, 1]})
        >>> model = ps.PersidskiiModel([[-10, 10, 0], [0.5, -1, 0], [0, 0, -2]], [term])
        >>> model.rhs([1.0, 2.0, 3.0]).tolist()
        [10.0, -4.5, -4.0]
        >>> ps.certify(model).certificate.scope
        'global'
    """
    n = len(next(iter(columns.values()), ()))
    found: dict[tuple[int, ...], ndarray] = {}
    for (i, j), column in ((sorted(pair), column) for pair, column in columns.items()):
        if not (min(i, j) >= 0 and max(i, j) < n == len(column)):
            raise ModelError(f"x_{i} x_{j} has {len(column)} coefficients; needed are one for each of {n} states")
        for sign in (1, -1):
            row = tuple(int(k == i) + sign * int(k == j) for k in range(n))
            if any(row):
                found[row] = found.get(row, np.zeros(n)) + sign * np.array(column, float) / 4
    if not found:
        raise ModelError("no product of states is named")
    return "x**2", np.array(list(found), float), np.array(list(found.values())).T
