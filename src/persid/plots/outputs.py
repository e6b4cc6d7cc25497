"""Figures of an output model: how it foretells what was measured, and what is proved about it."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from numpy import ndarray

from persid.measurements.trajectory import Trajectory
from persid.plots.style import DASHES, LEVEL, MEASURED, MODEL, limits, thin, tidy

VIEW = 3.0  # widths of the data beyond which a bound would make the picture small


def output_run(
    ax: Axes,
    measured: Trajectory,
    simulated: Trajectory,
    output: int,
    bound: tuple[float, Float[ndarray, " N"]] | None = None,
    *,
    starts: int = 0,
) -> Axes:
    """Draw one output as measured and as the model runs freely, and how far from rest it can be by proof.

    `bound` is y* and the bound of |y - y*| at the times of `simulated`; where it lies far outside it is left out. The
    first `starts` samples gave the start.
    """
    ax.plot(*thin(measured.t, measured.x[:, output]), color=MEASURED, lw=1.1, label="measured")
    ax.plot(*thin(simulated.t, simulated.x[:, output]), color=MODEL, lw=1.1, ls=DASHES, label="model, free run")
    low, high = limits(measured.x[:, output], simulated.x[:, output])
    if bound is not None:
        rest, most = bound
        nearest = np.array([rest - most.min(), rest + most.min()])
        if np.abs(nearest - [low, high]).max() < VIEW * (high - low):  # else it lies far outside
            low, high = min(low, float(nearest[0])), max(high, float(nearest[1]))
            for sign, label in ((1.0, "proved bound"), (-1.0, None)):
                ax.plot(*thin(simulated.t, rest + sign * most), color=LEVEL, lw=1.0, label=label)
    if starts:
        ax.axvspan(measured.t[0], measured.t[min(starts, len(measured)) - 1], color=MEASURED, alpha=0.12, lw=0)
    pad = 0.04 * (high - low)
    ax.set_ylim(low - pad, high + pad)
    ax.set_xlabel("t in s")
    ax.legend(loc="upper right", fontsize="small", ncols=3)
    return tidy(ax)
