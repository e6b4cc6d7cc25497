"""Rows of M that can only be zero: which ones, what that says of the unknowns, and unknowns for which it holds exactly.

The diagonal entry of M at a channel that no fact and no density raises can only be zero; then its whole row is, if
M >= 0. Each entry of that row is a linear equation among the unknowns, with rational coefficients:

    P a_c + A0'r lambda + tau r + … = 0.

Unknowns that lower such a diagonal entry vanish, and so do multipliers that the equations force to zero; without them
further rows may be zero. The equations are solved by rational elimination: free unknowns may be rounded, those at the
pivots are then combinations of them. All is homogeneous, so one factor clears the denominators.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import lcm
from typing import Any

import numpy as np
from flint import fmpq, fmpq_mat
from jaxtyping import Float
from numpy import ndarray
from scipy import sparse

from persid.lyapunov.frame import Unknown

_ZERO = Fraction(0)


@dataclass(frozen=True, eq=False)
class Solvable:
    """The unknowns that are left, the rows that are zero, and pivots = N free, exactly."""

    unknowns: tuple[Unknown, ...]
    zero: tuple[int, ...]
    free: tuple[int, ...]
    pivots: dict[int, dict[int, Fraction]]  # of unknown j: its combination of free ones, by place in `free`
    inside: Float[ndarray, " J"]  # unknowns that solve the equations, all multipliers positive

    @property
    def N(self) -> Float[ndarray, "J W"]:
        """All unknowns as combinations of the free ones."""
        N = np.zeros((len(self.unknowns), len(self.free)))
        N[list(self.free), range(len(self.free))] = 1.0
        for j, combination in self.pivots.items():
            for k, v in combination.items():
                N[j, k] = float(v)
        return N

    def exact(self, free: Sequence[Fraction]) -> list[Fraction]:
        """Return all unknowns for values of the free ones, times a number that makes them dyadic."""
        y = [_ZERO] * len(self.unknowns)
        for j, v in zip(self.free, free, strict=True):
            y[j] = v
        for j, combination in self.pivots.items():
            y[j] = sum((v * free[k] for k, v in combination.items()), _ZERO)
        scale = lcm(*(_odd(v.denominator) for v in y))
        return [v * scale / (1 << (scale.bit_length() - 1)) for v in y]


def _odd(number: int) -> int:
    return number // (number & -number)


def reduced(unknowns: Sequence[Unknown], able: Collection[int]) -> Solvable | None:
    """Return the unknowns that may be positive together where rows of M vanish; None where no V is left.

    Entries that are `able` to may have a zero row: no states, since V has to bound them.
    """
    left = list(unknowns)
    while True:
        diagonals = [_diagonal(each, able) for each in left]
        risen = {
            i for unknown, each in zip(left, diagonals, strict=True) for i, v in each.items()
            if v > 0 or not unknown.multiplier
        }  # fmt: skip
        zero = tuple(i for i in able if i not in risen)
        lowering = [any(v < 0 and i in zero for i, v in each.items()) for each in diagonals]
        left = [each for each, out in zip(left, lowering, strict=True) if not out]
        if any(lowering):
            continue
        equations = _equations(left, zero)
        y = _largest_support(left, equations)
        supported = [not each.multiplier or v > 0 for each, v in zip(left, y, strict=True)]
        if all(supported):
            break
        left = [each for each, keeps in zip(left, supported, strict=True) if keeps]
    return _eliminated(tuple(left), zero, equations, y) if left else None


def _diagonal(unknown: Unknown, able: Collection[int]) -> dict[int, Fraction]:
    found: dict[int, Fraction] = {}
    for a, b in unknown.M:
        for i, v in a.items():
            if i in able and i in b:
                found[i] = found.get(i, _ZERO) + 2 * v * b[i]
    return found


def _equations(unknowns: Sequence[Unknown], zero: Sequence[int]) -> list[dict[int, Fraction]]:
    """Return, for each entry of a zero row, the coefficients of the unknowns in it."""
    rows: dict[tuple[int, int], dict[int, Fraction]] = {}
    for k, unknown in enumerate(unknowns):
        for a, b in unknown.M:
            for x, y in ((a, b), (b, a)):
                for r in zero:
                    for j, v in y.items() if r in x else ():
                        row = rows.setdefault((r, j), {})
                        row[k] = row.get(k, _ZERO) + x[r] * v
    found = ({k: v for k, v in row.items() if v} for row in rows.values())
    return [row for row in found if row]


def _largest_support(unknowns: Sequence[Unknown], equations: Sequence[dict[int, Fraction]]) -> Float[ndarray, " J"]:
    """Return a solution of the equations with the most positive multipliers: maximise sum min(y_k, 1)."""
    J, signed = len(unknowns), np.array([each.multiplier for each in unknowns])
    everything = np.ones(J)
    if not equations:
        return everything
    if not signed.any():
        return np.zeros(J)
    from scipy.optimize import linprog

    sizes = [max(map(abs, each.values())) for each in equations]
    lines = [(i, k, float(v / sizes[i])) for i, each in enumerate(equations) for k, v in each.items()]
    rows, columns, values = zip(*lines, strict=True)
    A: Any = sparse.csr_array((values, (rows, columns)), shape=(len(equations), 2 * J))
    least: Any = sparse.csr_array(sparse.hstack([-sparse.eye_array(J), sparse.eye_array(J)]))[np.flatnonzero(signed)]
    bounds: Any = np.array([(0 if s else -np.inf, np.inf) for s in signed] + [(0, float(s)) for s in signed])
    cost = np.concatenate([np.zeros(J), -signed.astype(float)])
    x = linprog(cost, A_ub=least, b_ub=np.zeros(least.shape[0]), A_eq=A, b_eq=np.zeros(len(equations)), bounds=bounds).x
    return np.where(signed & (x[J:] < 0.5), 0.0, x[:J]) if x is not None else np.where(signed, 0.0, everything)


def _eliminated(
    unknowns: tuple[Unknown, ...], zero: tuple[int, ...], equations: Sequence[dict[int, Fraction]], y: ndarray
) -> Solvable:
    """Solve the equations for unknowns whose signs are free as far as can be: identities first, then P."""
    J, pivots = len(unknowns), dict[int, dict[int, Fraction]]()
    if equations:
        order = sorted(range(J), key=lambda k: (unknowns[k].label[0] != "identity", unknowns[k].multiplier, -y[k]))
        place = {k: at for at, k in enumerate(order)}
        A = fmpq_mat(len(equations), J)
        for i, equation in enumerate(equations):
            for k, v in equation.items():
                A[i, place[k]] = fmpq(v.numerator, v.denominator)
        R, rank = A.rref()
        for i in range(rank):
            row = [(order[at], Fraction(int(R[i, at].p), int(R[i, at].q))) for at in range(J) if R[i, at]]
            pivots[row[0][0]] = {k: -v for k, v in row[1:]}
    free = tuple(k for k in range(J) if k not in pivots)
    at = {k: i for i, k in enumerate(free)}
    return Solvable(unknowns, zero, free, {j: {at[k]: v for k, v in row.items()} for j, row in pivots.items()}, y)
