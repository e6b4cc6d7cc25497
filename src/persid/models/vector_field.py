"""VectorField: the right side of a model as one value, which integration, exports and equations take."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.models.channels import Channels
from persid.models.functions import layer


@dataclass(frozen=True, eq=False)
class VectorField:
    """x' = A0 (x - x_ref) + sum_c a_c f_c(r_c'(x - x_ref)) + B (u - u_ref) + b, with the names of states and inputs.

    With a step `dt` (s) the same right side is the state after one step.
    Paper: eq:main_system_Per.
    """

    channels: Channels
    B: Float[ndarray, "n m"]
    b: Float[ndarray, " n"]
    x_ref: Float[ndarray, " n"]
    u_ref: Float[ndarray, " m"]
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    dt: float | None = None

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.inputs)

    def forcing(self, u: Float[ndarray, " m"]) -> Float[ndarray, " n"]:
        """Return B (u - u_ref) + b."""
        return np.asarray(self.B @ (u - self.u_ref) + self.b)

    def sampled(self, t: Float[ndarray, " N"], u: Callable[[float], object] | ndarray | None) -> Float[ndarray, "N m"]:
        """Return the inputs at the times t (s): u is None for u_ref, a function of a time, or these inputs already."""
        if u is None:
            return np.tile(self.u_ref, (len(t), 1))
        if callable(u):
            return np.array([np.reshape(np.asarray(u(s), float), self.m) for s in t]).reshape(len(t), self.m)
        return np.asarray(u, float)

    def jacobian(self, x: Float[ndarray, " n"]) -> Float[ndarray, "n n"]:
        """Return the derivatives of x' by x at one state, in 1/s."""
        A0, rows, columns, functions = (getattr(self.channels, name) for name in ("A0", "rows", "columns", "functions"))
        slopes = layer(functions).apply("derivative", rows @ (x - self.x_ref)) if functions else np.zeros(0)
        return np.asarray(A0 + (columns * slopes) @ rows)

    def drift(self) -> Callable[[ndarray], ndarray]:
        """Return x' without its forcing as a function of states (…, n), its fixed parts prepared for many evaluations.

        Channels of one function, shifted or not, stand together, so that each function is called once.
        """
        channels = self.channels
        found = layer(channels.functions)
        order = [c for _, places in found.kinds for c in places]
        shifts, x_ref = found.shifts[order], self.x_ref
        A0, rows, columns = (
            np.ascontiguousarray(M.T) for M in (channels.A0, channels.rows[order], channels.columns[:, order])
        )
        ends = np.cumsum([0, *(len(places) for _, places in found.kinds)]).tolist()
        pieces = [(f.on_arrays, a, b) for (f, _), (a, b) in zip(found.kinds, pairwise(ends), strict=True)]

        def dot(x: ndarray) -> ndarray:
            dx = x - x_ref
            result: ndarray = dx @ A0
            if pieces:
                y = dx @ rows + shifts
                for f, a, b in pieces:
                    y[..., a:b] = f(y[..., a:b])
                result += y @ columns
            return result

        return dot
