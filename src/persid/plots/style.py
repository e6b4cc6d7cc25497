"""The look of all figures: colours, and what keeps curves, names and limits readable."""

import re
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import AutoLocator, FuncFormatter
from numpy import ndarray

from persid._text import SECONDS

MEASURED, MODEL, LEVEL, FIELD, FORM, INK = "#0072b2", "#d55e00", "#009e73", "#888888", "#cc79a7", "#111111"
POINTS = 400  # a longer curve is drawn by its extremes in so many intervals
DASHES = (0, (4, 2))


def plain(name: str) -> str:
    """Return a user's name so that matplotlib does not read it as mathematics."""
    return name.replace("$", r"\$")


def short(name: str, most: int = 24) -> str:
    """Return a name, its middle left out where it is longer than `most` characters, ready to be drawn."""
    half = (most - 1) // 2
    return plain(name if len(name) <= most else f"{name[:half]}…{name[-half:]}")


def tidy(ax: Axes) -> Axes:
    """Take away two sides of the frame, add a faint grid, and return the Axes."""
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.grid(True, color=FIELD, alpha=0.22, lw=0.6)
    ax.set_axisbelow(True)
    return ax


def thin(t: Float[ndarray, " N"], x: Float[ndarray, " N"], points: int = POINTS) -> tuple[ndarray, ndarray]:
    """Keep the smallest and the largest value of each of `points` intervals: the eye sees no difference."""
    if len(t) <= 2 * points:
        return t, x
    edges = np.linspace(0, len(t), points + 1).astype(int)
    picks = [a + np.sort([x[a:b].argmin(), x[a:b].argmax()]) for a, b in pairwise(edges.tolist())]
    keep = np.unique(np.concatenate([[0], *picks, [len(t) - 1]]))
    return t[keep], x[keep]


def thin_path(x: Float[ndarray, " N"], y: Float[ndarray, " N"]) -> tuple[ndarray, ndarray]:
    """Keep so many points of a path in the plane that it still looks the same."""
    keep = np.unique(np.linspace(0, len(x) - 1, min(len(x), 2 * POINTS)).astype(int))
    return x[keep], y[keep]


def span(x: Float[ndarray, " N"], extra: float) -> tuple[float, float]:
    """Return the range of values, widened by a share of itself on both sides."""
    width = max(float(x.max() - x.min()), 1e-9 * max(1.0, float(np.abs(x).max())))
    return float(x.min()) - extra * width, float(x.max()) + extra * width


def limits(shown: Float[ndarray, " N"], other: Float[ndarray, " M"] | None = None) -> tuple[float, float]:
    """Return limits that hold the data, and of the model as much as half a width of the data beyond them."""
    low, high = span(shown, 0.06)
    if other is not None and len(other):
        wide = span(shown, 0.5)
        low, high = max(wide[0], min(low, float(other.min()))), min(wide[1], max(high, float(other.max())))
    return low, high


class _UnitLocator(AutoLocator):
    """Ticks that are round numbers in a unit of so many s."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.seconds = seconds

    def tick_values(self, vmin: float, vmax: float) -> list[float]:
        return [tick * self.seconds for tick in super().tick_values(vmin / self.seconds, vmax / self.seconds)]


def timed_in(figure: Figure, unit: str) -> None:
    """Let the axes of a figure that say "t in s" count in another unit of time."""
    seconds = SECONDS[unit]
    axes = [ax for ax in figure.axes if ax.get_xlabel().startswith("t in s")] if unit != "s" else []
    for ax in (one for labelled in axes for one in labelled.get_shared_x_axes().get_siblings(labelled)):
        ax.xaxis.set_major_locator(_UnitLocator(seconds))
        ax.xaxis.set_major_formatter(FuncFormatter(lambda value, _: f"{value / seconds:g}"))
        ax.set_xlabel(re.sub(r"^t in s", f"t in {unit}", ax.get_xlabel()))
