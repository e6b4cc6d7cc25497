"""Algebraic variables that equations give linearly: they leave the search, and their multipliers follow from it.

With 0 = H zeta = H_w (w - K zeta'), zeta' the other entries and H_w invertible (layers, loops 0 = -w + C x + D f(w)),
and w = K zeta' + e, the form of M is

    zeta'M~zeta' + 2 e'(M_w' + M_ww K) zeta' + e'M_ww e,       M~ that of w = K zeta',

where M_w' and M_ww are its rows of w. Equations may add 2 e'n for any row n over zeta; with
n = -(M_w' + M_ww K) zeta' + (R - M_ww) e / 2 the form is zeta'M~zeta' + e'R e. So M > 0 for some multipliers if and
only if M~ > 0, whose unknowns are V and the facts alone (Finsler).
"""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from fractions import Fraction

import numpy as np
from flint import fmpq, fmpq_mat
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import rounded
from persid.lyapunov.frame import Frame, Pair, Unknown
from persid.lyapunov.points import Row
from persid.lyapunov.unknowns import Label

_ZERO = Fraction(0)


def followed(frame: Frame) -> dict[int, Row]:
    """Return the rows of K, by the entries of w; none where H_w is not invertible."""
    equations, w = range(frame.order, frame.n), list(range(frame.order, frame.n))
    others = sorted({i for h in equations for i in frame.flow[h]} - set(w))
    H = fmpq_mat(
        len(w), len(w) + len(others), [_exact(frame.flow[h].get(i, _ZERO)) for h in equations for i in w + others]
    )
    solved, rank = H.rref()
    if not w or any(solved[k, k] != 1 for k in range(rank)) or rank < len(w):
        return {}
    return {
        i: {j: -Fraction(int(v.p), int(v.q)) for at, j in enumerate(others) if (v := solved[k, len(w) + at])}
        for k, i in enumerate(w)
    }


def _exact(v: Fraction) -> fmpq:
    return fmpq(v.numerator, v.denominator)


def without(unknowns: Iterable[Unknown], follows: Mapping[int, Row]) -> list[Unknown]:
    """Return the unknowns of M~: no equations, and rows over zeta'."""
    return [
        replace(each, M=tuple((_substituted(a, follows), _substituted(b, follows)) for a, b in each.M))
        for each in unknowns
        if each.label[0] != "equation"
    ]


def _substituted(row: Row, follows: Mapping[int, Row]) -> Row:
    if not any(i in follows for i in row):
        return row
    total: Row = {}
    for i, v in row.items():
        for j, k in (follows[i] if i in follows else {i: Fraction(1)}).items():
            total[j] = total.get(j, _ZERO) + v * k
    return {j: v for j, v in total.items() if v}


def multipliers(frame: Frame, kappa: Fraction, values: Mapping[Label, Fraction], R: ndarray) -> dict[Label, Fraction]:
    """Return the multipliers of the equations, rounded, for numbers of V and of facts with M~ > 0; R is of e."""
    follows, n = followed(frame), frame.order
    listed = (each for each in frame.unknowns(kappa, across=True) if each.label in values)
    M = _form([(values[each.label], each.M) for each in listed], frame.width)
    w, others = list(follows), [i for i in range(frame.width) if i not in follows]
    K, H = _dense([follows[i] for i in w], frame.width), _dense([frame.flow[h] for h in w], frame.width)
    half = (np.diag(R) - M[np.ix_(w, w)]) / 2  # of e = w - K zeta'
    rows = -half @ K
    rows[:, w] += half
    rows[:, others] -= (M[w] + M[np.ix_(w, w)] @ K)[:, others]
    found = rounded(-np.linalg.solve(H[:, w].T, rows))
    return {
        ("equation", h, i): Fraction(float(found[h, i])) for h in range(frame.n - n) for i in range(frame.width)
        if found[h, i]
    }  # fmt: skip


def _dense(rows: list[Row], width: int) -> Float[ndarray, "r w"]:
    found = np.zeros((len(rows), width))
    for line, row in zip(found, rows, strict=True):
        line[list(row)] = [float(v) for v in row.values()]
    return found


def _form(parts: list[tuple[Fraction, tuple[Pair, ...]]], width: int) -> Float[ndarray, "w w"]:
    pairs = [(a, {i: v * value for i, v in b.items()}) for value, part in parts for a, b in part]
    left, right = (_dense([pair[side] for pair in pairs], width) for side in (0, 1))
    return np.asarray(left.T @ right + right.T @ left)
