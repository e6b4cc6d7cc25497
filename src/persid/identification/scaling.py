"""Scaling: whether functions stand in the model as they were written, or with arguments of order 1.

A function of order 1 in its argument makes well-conditioned columns: sin((x - x_ref)/scale) with a scale from the data.
Where somebody wrote the law of the plant, that scale is wrong: sin(2 x) is no multiple of sin(x). So both are fitted to
the same windows of the data, and what was written is taken where it leaves a hundredth of the residual.
"""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from persid.identification.basis import Basis, Functions, is_auto, make_basis, per_state
from persid.identification.increments import increments, left_over
from persid.identification.learned import USUAL, learns, with_ramps, without
from persid.identification.recursion import moves
from persid.identification.windows import choose_window
from persid.measurements.recordings import Measurements, beginnings
from persid.models.lookup_tables import WORD

EXACT = 0.01  # of the squared residual is left where what was written is the law
MOST_COLUMNS = 100  # a larger basis is not tried twice
LONGEST = 2000  # samples of a run, of at most 20, that are looked at


@dataclass(frozen=True)
class Wanted:
    """The functions of a basis, and what is said of their arguments; learned ones have so many knots, and with `alike`
    the same ones for all states; with `one_curve` their arguments have one reference and one scale, too."""

    functions: Functions
    x_ref: object = "auto"
    scale: object = "auto"
    knots: int = USUAL
    alike: bool = False
    one_curve: bool = False


def choose_basis(data: Measurements, wanted: Wanted, dt: float | None = None) -> Basis:
    """Return the basis with the automatic scales, or with scale 1 where that is exact; of a step where dt is given.

    Raises:
        DataError: functions, x_ref or scale do not fit the states.
    """
    functions, x_ref, scale = wanted.functions, wanted.x_ref, wanted.scale
    if learns(functions):
        return replace(_learned(data, wanted), dt=dt)
    scaled = replace(make_basis(data, functions, x_ref, scale), dt=dt)
    if not is_auto(scale) or (scaled.scale == 1).all() or not scaled.terms or scaled.size > MOST_COLUMNS:
        return scaled
    looked_at = beginnings(data, LONGEST)
    seen = moves if dt is not None else partial(increments, window=choose_window(looked_at))
    best, left = scaled, EXACT * left_over(*seen(looked_at, scaled))
    for reference in ["auto", 0.0] if is_auto(x_ref) and scaled.x_ref.any() else [x_ref]:
        written = replace(make_basis(data, functions, reference, 1.0), dt=dt)
        with np.errstate(all="ignore"):
            residual = left_over(*seen(looked_at, written))
        if residual < left:
            best, left = written, EXACT * residual
    return best


def _learned(data: Measurements, wanted: Wanted) -> Basis:
    """Return the basis with ramps, in arguments of order 1 whatever else stands beside them."""
    lists = per_state(wanted.functions, len(data.states))
    plain = make_basis(data, [without(names) for names in lists], wanted.x_ref, wanted.scale)
    learning = [i for i, names in enumerate(lists) if WORD in names]
    if wanted.one_curve:
        plain = _alike(plain, learning, wanted)
    y = (np.concatenate([run.x for run in beginnings(data, LONGEST)]) - plain.x_ref) / plain.scale
    alike = wanted.alike or wanted.one_curve
    seen = [y[:, learning].ravel() if alike else y[:, i] for i in range(len(lists))]
    beside = [any("x" in lists[i] for i in learning) if wanted.one_curve else "x" in names for names in lists]
    found = [
        with_ramps(names, column, wanted.knots, beside_x=x)
        for names, column, x in zip(lists, seen, beside, strict=True)
    ]
    return make_basis(data, found, plain.x_ref, plain.scale)


def _alike(basis: Basis, states: list[int], wanted: Wanted) -> Basis:
    """Return a basis whose arguments of some states have one reference and one scale, but for what is given."""
    x_ref, scale = basis.x_ref.copy(), basis.scale.copy()
    if is_auto(wanted.x_ref) and np.ptp(x_ref[states]):
        x_ref[states] = np.round(x_ref[states].mean(), 3)
    if is_auto(wanted.scale):
        scale[states] = scale[states].max()
    return replace(basis, x_ref=x_ref, scale=scale)
