"""The right side of a model with its fixed parts prepared, for the many evaluations of a simulation."""

from collections.abc import Callable
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from numpy import ndarray

if TYPE_CHECKING:
    from persid.models.model import PersidskiiModel


def drift(model: "PersidskiiModel") -> Callable[[ndarray], ndarray]:
    """Return A0 (x - x_ref) + sum_c a_c f_c(r_c'(x - x_ref)), x' without its forcing, as a function of one state (n,).

    Channels of one function stand together, so that each function is called once.
    """
    channels = model.channels
    kinds = {f: [c for c, g in enumerate(channels.functions) if g == f] for f in channels.functions}
    order = [c for places in kinds.values() for c in places]
    rows, columns, A0, x_ref = channels.rows[order], channels.columns[:, order], channels.A0, model.x_ref
    ends = np.cumsum([0, *map(len, kinds.values())]).tolist()
    pieces = [(f.on_arrays, a, b) for f, (a, b) in zip(kinds, pairwise(ends), strict=True)]

    def dot(x: ndarray) -> ndarray:
        dx = x - x_ref
        result = A0 @ dx
        if pieces:
            y = rows @ dx
            for f, a, b in pieces:
                y[a:b] = f(y[a:b])
            result += columns @ y
        return result

    return dot
