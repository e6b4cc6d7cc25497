"""The right side of a model with its fixed parts prepared, for the many evaluations of a simulation."""

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray

from persid.models.functions import layer

if TYPE_CHECKING:
    from persid.models.model import PersidskiiModel


def drift(model: "PersidskiiModel") -> Callable[[ndarray], ndarray]:
    """Return A0 (x - x_ref) + sum_c a_c f_c(r_c'(x - x_ref)), x' without its forcing, as a function of states (…, n).

    Channels of one function, shifted or not, stand together, so that each function is called once.
    """
    channels = model.channels
    found = layer(channels.functions)
    order = [c for _, places in found.kinds for c in places]
    shifts, x_ref = found.shifts[order], model.x_ref
    A0, rows, columns = (
        np.ascontiguousarray(M.T) for M in (channels.A0, channels.rows[order], channels.columns[:, order])
    )
    ends = np.cumsum([0, *(len(places) for _, places in found.kinds)]).tolist()
    pieces = [(f.on_arrays, a, b) for (f, _), (a, b) in zip(found.kinds, pairwise(ends), strict=True)]

    def dot(x: ndarray) -> ndarray:
        dx = x - x_ref
        result = dx @ A0
        if pieces:
            y = dx @ rows + shifts
            for f, a, b in pieces:
                y[..., a:b] = f(y[..., a:b])
            result += y @ columns
        return result

    return dot
