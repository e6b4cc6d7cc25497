"""Why equations have exactly one solution: a form of the difference of two that is positive definite.

With d the difference of (w, s) at two solutions for the same x and u, s the channels that read w and act in equations,

    2 sum_i (n_i'd)(H_i d) - 2 sum tau (l_k'dPhi)(l_l'dPhi) > 0,     forms that do not fall, tau >= 0,

is linear in the rows n_i and in tau: the largest margin is sought (docs/ledger.md, section 11).
"""

from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import combinations

import numpy as np

from persid._dyadics import rounded
from persid.lyapunov.barrier import Centre, Region, definite, minimise
from persid.lyapunov.frame import Frame, Unknown, paired
from persid.lyapunov.pairs import combine
from persid.lyapunov.points import Row
from persid.lyapunov.proposals import system_of
from persid.lyapunov.system import scaling

START = 0.3  # of the ball of radius 1 in which a margin is sought
_ONE, _HALF = Fraction(1), Fraction(1, 2)
Values = dict[tuple[object, ...], Fraction]


def solved(frame: Frame, left: Callable[[], float]) -> Frame | None:
    """Return the frame with why its equations, if any, have one solution; None where that is not found."""
    if frame.order == frame.n:
        return frame
    values = solving(frame, left)
    return None if values is None else replace(frame, solving=values)


def solving(frame: Frame, left: Callable[[], float]) -> Values | None:
    """Return rows n_i by ("solving", i, entry) and tau by ("solving", p, k, l); None where none are found."""
    kept = [*range(frame.order, frame.n), *_acting(frame)]
    unknowns = [*_multipliers(frame, kept), *_products(frame, set(kept))]
    units = np.concatenate([scaling(system_of(frame)).entries, np.ones(frame.width - frame.entries)])

    def read(row: Row) -> np.ndarray:
        return np.array([float(row.get(i, 0)) * units[i] for i in kept])

    listed = [(a, b, k) for k, each in enumerate(unknowns) for a, b in each.M]
    norms = np.array([_norm(a, kept, units) * _norm(b, kept, units) for a, b, _ in listed])
    sizes = 0.5 / np.where(norms > 0, norms, 1.0)
    pairs = [(a, b, sizes[k], k) for a, b, k in listed]
    margin = [({i: _ONE}, {i: -_HALF}, 1 / units[i] ** 2, len(unknowns)) for i in kept]
    block = definite(paired([*pairs, *margin], len(unknowns) + 1, len(kept), read), np.eye(len(unknowns) + 1))
    signs = np.eye(len(unknowns) + 1)[[k for k, each in enumerate(unknowns) if each.multiplier]]
    w = np.array([1.0 if each.multiplier or each.label[2] == frame.order + each.label[1] else 0.0 for each in unknowns])
    w *= START / np.linalg.norm(w)
    low = float(np.linalg.eigvalsh(combine(paired(pairs, len(unknowns), len(kept), read), w))[0])
    t = min(low, 0.0) - 0.1
    region = Region((block,), signs, 1.0 + abs(t))
    objective = np.append(np.zeros(len(unknowns)), -1.0)
    found = minimise(region, objective, np.append(w, t), enough=Centre.knows_sign, left=left).w
    if not found[-1] > 0:
        return None
    numbers = rounded(found[:-1] * sizes)
    return {each.label: Fraction(float(v)) for each, v in zip(unknowns, numbers, strict=True) if v}


def _norm(row: Row, kept: list[int], units: np.ndarray) -> float:
    return float(np.sqrt(sum((float(row.get(i, 0)) * units[i]) ** 2 for i in kept)))


def _acting(frame: Frame) -> list[int]:
    """Return the entries of channels that read an algebraic variable and stand in an equation."""
    found = []
    for c, at in frame.places.items():
        channel = frame.model.channels[c]
        if any(i >= frame.order for i in channel.row) and any(channel.column[frame.order :]):
            found.append(at)
    return found


def _multipliers(frame: Frame, kept: list[int]) -> Iterator[Unknown]:
    for h in range(frame.order, frame.n):
        for i in kept:
            yield Unknown(("solving", h - frame.order, i), (({i: _ONE}, frame.flow[h]),), multiplier=False)


def _products(frame: Frame, kept: set[int]) -> Iterator[Unknown]:
    for p, point in enumerate(frame.points):
        if all(i < frame.order for i in point.row):
            continue
        rows = {
            k: point.reads(form.form, frame.places)
            for k, form in enumerate(point.forms)
            if form.kind == "nondecreasing"
        }
        own = {k: row for k, row in rows.items() if all(i < frame.n or i in kept for i in row)}
        for k, j in combinations(own, 2):
            yield Unknown(("solving", p, k, j), ((own[k], {i: -v for i, v in own[j].items()}),))
