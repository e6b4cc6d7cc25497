"""Figures of characteristics: what one state does to the derivative of another, as tables have it."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from numpy import ndarray

from persid.models.model import PersidskiiModel
from persid.plots.style import FIELD, MEASURED, MODEL, short, tidy

BINS = 60
DENSITY = 0.22  # of the height is for the data's density


def tabulated(model: PersidskiiModel) -> list[tuple[int, int]]:
    """Return (equation, state) of all tables of one state that an equation has."""
    channels = model.channels
    found = set()
    for c, f in enumerate(channels.functions):
        support = np.flatnonzero(channels.rows[c])
        if f.table is not None and len(support) == 1:
            found |= {(int(i), int(support[0])) for i in np.flatnonzero(channels.columns[:, c])}
    return sorted(found)


def effect(
    model: PersidskiiModel, equation: int, state: int, x: Float[ndarray, " N"]
) -> tuple[Float[ndarray, " N"], Float[ndarray, " k"]]:
    """Return what a state adds to the derivative of another, linear part and functions of it alone, and all knots."""
    channels, dx = model.channels, x - model.x_ref[state]
    total, knots = channels.A0[equation, state] * dx, list[float]()
    for c, f in enumerate(channels.functions):
        a, row = float(channels.columns[equation, c]), channels.rows[c]
        if a and np.flatnonzero(row).tolist() == [state]:
            total = total + a * f.value(row[state] * dx)
            if f.table is not None:
                knots += [float(model.x_ref[state] + t / row[state]) for t in f.table.knots[1:-1]]
    return np.asarray(total), np.unique(knots)


def characteristic(
    ax: Axes, model: PersidskiiModel, equation: int, state: int, x: Float[ndarray, " N"],
    span: tuple[float, float] | None = None,
) -> Axes:  # fmt: skip
    """Draw what a state adds to the derivative of another over the range of its samples x, knots as dots.

    The blue area below is the density of the samples: where there are few, little is known. The curve is 0 at x_ref.
    `span` are the least and the largest value that there is to be room for; without it, those of the curve.
    """
    low, high = float(x.min()), float(x.max())
    shown = np.linspace(low, high, 400)
    curve, knots = effect(model, equation, state, shown)
    inside = knots[(knots >= low) & (knots <= high)]
    ax.plot(shown, curve, color=MODEL, lw=1.6)
    ax.plot(inside, effect(model, equation, state, inside)[0], "o", ms=4, color=MODEL)
    counts, edges = np.histogram(x, bins=BINS)
    bottom, top = (float(curve.min()), float(curve.max())) if span is None else span
    height = max(top - bottom, 1e-12)
    floor = bottom - (DENSITY + 0.06) * height
    level = floor + DENSITY * height * counts / max(counts.max(), 1)
    ax.fill_between(np.repeat(edges, 2)[1:-1], floor, np.repeat(level, 2), color=MEASURED, alpha=0.25, lw=0)
    ax.axhline(0, color=FIELD, lw=0.8)
    ax.set_ylim(floor, top + 0.06 * height)
    ax.set_xlabel(short(model.states[state], 15))
    ax.set_ylabel(f"in d({short(model.states[equation], 12)})/dt")
    ax.locator_params(axis="x", nbins=6)
    return tidy(ax)
