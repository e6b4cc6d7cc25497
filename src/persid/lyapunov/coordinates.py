"""Coordinates in which a badly scaled model is well scaled, for a search whose steps floating point does not bear.

A plant in companion form, of poles from 1 to 100, has coefficients of many sizes that no units of the states even out.
In x^ = S x with S of the real Schur form of its linear part, balanced before and after, they are of the size of the
poles. Forms and multipliers do not depend on coordinates of the states; V = x^'P^ x^ + … has P = S'P^ S, and what is
proved is about the model itself.
"""

from dataclasses import dataclass, replace

import numpy as np
import scipy.linalg as sla
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import rounded
from persid.errors import RoundingError
from persid.lyapunov.multipliers import Lyapunov
from persid.lyapunov.system import System


@dataclass(frozen=True, eq=False)
class Coordinates:
    """x^ = S x for the states of a system that has dropped none."""

    system: System
    S: Float[ndarray, "n n"]

    @classmethod
    def of(cls, system: System, J: Float[ndarray, "n n"]) -> "Coordinates | None":
        """Return coordinates of A0 where that is stable, else of the linearisation J; None where there are none."""
        n = system.n
        A0 = system.G[:, :n]
        linear = A0 if np.linalg.eigvals(A0).real.max() < 0 else J
        if len(system.states) < n or system.discrete or not np.isfinite(linear).all():
            return None
        units = _balance(linear)
        T, Z = sla.schur(linear / units[:, None] * units)
        return cls(system, np.linalg.inv(Z * _balance(T)) / units)

    @property
    def turned(self) -> System:
        """The system in these coordinates."""
        n, back = self.system.n, np.linalg.inv(self.S)
        G = self.S @ self.system.G
        groups = tuple(replace(group, row=group.row @ back) for group in self.system.groups)
        return replace(self.system, G=np.hstack([G[:, :n] @ back, G[:, n:]]), B=self.S @ self.system.B, groups=groups)

    def back(self, found: Lyapunov) -> Lyapunov:
        """Return a Lyapunov function of the turned system as one of the system.

        Raises:
            RoundingError: in the user's coordinates its margin is lost.
        """
        P = self.S.T @ found.P @ self.S
        same = replace(found, system=self.system, P=rounded((P + P.T) / 2))
        if not same.is_sound:
            raise RoundingError("rounding the multipliers loses the margin of the matrix inequality")
        return same


def _balance(M: Float[ndarray, "n n"]) -> Float[ndarray, " n"]:
    return np.asarray(sla.matrix_balance(M, permute=False, separate=True)[1][0])
