"""OutputEquation: what is measured of a vector field's states, as one value."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.models.functions import ScalarFunction, layer
from persid.models.vector_field import VectorField


@dataclass(frozen=True, eq=False)
class OutputEquation:
    """y = h(C (x - x_ref) + D (u - u_ref) + d) with the names of the outputs; without a map h is the identity."""

    field: VectorField
    C: Float[ndarray, "l n"]
    D: Float[ndarray, "l m"]
    d: Float[ndarray, " l"]
    output_map: tuple[ScalarFunction, ...] | None
    outputs: tuple[str, ...]

    def values(self, x: Float[ndarray, "*N n"], u: Float[ndarray, "*N m"] | None = None) -> Float[ndarray, "*N l"]:
        """Return y for one state (n,) or many (N, n); u = None means u_ref."""
        y = (np.asarray(x, float) - self.field.x_ref) @ self.C.T + self.d
        if u is not None:
            y = y + (np.asarray(u, float) - self.field.u_ref) @ self.D.T
        return y if self.output_map is None else layer(self.output_map).apply("value", y)
