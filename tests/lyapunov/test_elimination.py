"""Algebraic variables that equations give linearly: rows of K, and multipliers that leave M~ and squares alone."""

from dataclasses import replace
from fractions import Fraction

import numpy as np

import persid as ps
from persid.lyapunov.elimination import followed, multipliers, without
from persid.lyapunov.frame import Frame
from persid.lyapunov.points import points_of
from persid.lyapunov.unknowns import Label
from persid_check.model import model_of


def frame_of(D: float = 0.5) -> Frame:
    """x' = -x + f(w1) - w2 + u, w1 = x + D f(w1), w2 = 2 w1 - x + u: a loop and what follows it."""
    A0 = [[-1.0, 0.0, -1.0], [1.0, -1.0, 0.0], [-1.0, 2.0, -1.0]]
    model = ps.DescriptorModel(A0, [("tanh(x)", [[0.0, 1, 0]], [[1.0], [D], [0]])], [[1.0], [0], [1]],
                               algebraic=["w1", "w2"])  # fmt: skip
    return Frame(model_of(model.canonical, algebraic=True), points_of(model.rows, None), lone=False)


def form(frame: Frame, values: dict[Label, Fraction], kappa: Fraction) -> np.ndarray:
    """The matrix of the unknowns with values, all of zeta."""
    M = np.zeros((frame.width, frame.width))
    for each in frame.unknowns(kappa, across=True):
        for a, b in each.M if each.label in values else ():
            for i, u in a.items():
                for j, v in b.items():
                    M[i, j] += float(values[each.label] * u * v)
    return M + M.T


def test_variables_follow_the_other_entries() -> None:
    """w1 = x + s/2 and w2 = 2 w1 - x + u = x + s + u, in fractions; zeta is (x, w1, w2, s, u)."""
    half = Fraction(1, 2)
    assert followed(frame_of()) == {1: {0: 1, 3: half}, 2: {0: 1, 3: 1, 4: 1}}


def test_nothing_follows_where_an_equation_has_no_linear_part() -> None:
    """Without -w1 on its right the first equation tells f(w1) and not w1: the general search has to do."""
    frame = frame_of()
    flow = list(frame.flow)
    flow[1] = {i: v for i, v in flow[1].items() if i != 1}
    found = replace(frame)
    found.__dict__["flow"] = tuple(flow)
    assert followed(found) == {}


def test_multipliers_leave_the_smaller_form_and_squares() -> None:
    """For any numbers of V and facts, M with the multipliers is M~ plus R (w - K zeta')^2."""
    frame, kappa, rng = frame_of(), Fraction(1, 8), np.random.default_rng(0)
    known = [each for each in frame.unknowns(kappa, across=True) if each.label[0] != "equation"]
    values = {each.label: Fraction(float(v)) for each, v in zip(known, rng.uniform(0.5, 2, len(known)), strict=True)}
    follows, R = followed(frame), np.array([2.0, 3.0])
    whole = form(frame, values | multipliers(frame, kappa, values, R), kappa)
    smaller = np.zeros_like(whole)
    for each in without(known, follows):
        for a, b in each.M:
            for i, u in a.items():
                for j, v in b.items():
                    smaller[i, j] += float(values[each.label] * u * v)
                    smaller[j, i] += float(values[each.label] * u * v)
    assert not smaller[[1, 2]].any()
    e = np.zeros((2, frame.width))
    for line, (w, row) in zip(e, follows.items(), strict=True):
        line[w] = 1.0
        line[list(row)] = [-float(v) for v in row.values()]
    np.testing.assert_allclose(whole, smaller + e.T @ np.diag(R) @ e, atol=1e-13)
