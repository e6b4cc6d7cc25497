"""Boxes: where the states of measurements lie, how wide that is, and how far a run may go beside it."""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.measurements.recordings import Measurements

REACH = 10.0  # a free run is stopped this many widths of the data outside their box
LEAST = 1e-12  # width of a state that stands still, as far as the reach goes


def box_of(data: Measurements) -> Float[ndarray, "n 2"]:
    """Return the smallest box that holds all states."""
    return data.moments.of(slice(len(data.states))).box


def widths(box: Float[ndarray, "n 2"]) -> Float[ndarray, " n"]:
    """Return the unit in which each state's errors are measured: its width, 1 where it stands still."""
    width = box[:, 1] - box[:, 0]
    return np.where(width > 0, width, 1.0)


def reach(box: Float[ndarray, "n 2"]) -> tuple[Float[ndarray, " n"], Float[ndarray, " n"]]:
    """Return the bounds at which a free run is stopped."""
    width = np.maximum(box[:, 1] - box[:, 0], LEAST)
    return box[:, 0] - REACH * width, box[:, 1] + REACH * width
