"""Obstructions: an exact dual matrix X = L L' shows that a family of Lyapunov functions holds no certificate."""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import dyadics
from persid._files import Json, json_object, write_atomically
from persid.certificates.acceptance import accepted
from persid.certificates.encoding import encode, factor, heading
from persid.errors import RejectedError, RoundingError
from persid.lyapunov.search import Outcome
from persid.lyapunov.system import System
from persid.models.model import PersidskiiModel

_STATEMENT = "No certificate exists in this family of Lyapunov functions; stability is not refuted."
BITS = 40  # of the largest entry of L


@dataclass(frozen=True, eq=False)
class Obstruction:
    """A proof, accepted by `persid_check`, that no certificate exists in a family; it does not refute stability."""

    data: bytes
    statement: str

    @classmethod
    def accept(cls, data: bytes) -> "Obstruction":
        """Return the obstruction that these bytes are.

        Raises:
            RejectedError: the checker does not accept them as one; the message gives its reason.
        """
        return cls(data, accepted(data, ("infeasible",)).statement)

    def save(self, path: str | Path) -> None:
        """Write the accepted bytes."""
        write_atomically(path, self.data)

    @cached_property
    def content(self) -> Json:
        """The file as an object."""
        return json_object(self.data)


def find_obstruction(model: PersidskiiModel, outcome: Outcome) -> Obstruction | None:
    """Return the obstruction that the dual matrix of an infeasible search is, if the checker accepts it."""
    system, full = outcome.assembly.unknowns.system, outcome.assembly.problem.symmetric > 0
    mirrored = any(factor < 0 for group in system.groups for factor in group.curve.factors)
    if mirrored or model.is_discrete or outcome.assembly.unknowns.target.kappa or len(system.states) < model.n:
        return None
    try:
        L = _factor(outcome)
        content: Json = {
            **heading(model, "infeasible", _STATEMENT),
            "family": "full" if full else "diagonal",
            "groups": [{"forms": _forms(system, g, outcome)} for g in range(len(system.groups))],
            "L": [[int(v) for v in row] for row in _all_entries(model, system, L)],
            "proof": {"P": factor(_lyapunov_product(system, L))} if full else {},
        }
        return Obstruction.accept(encode(content))
    except (RejectedError, RoundingError, np.linalg.LinAlgError):
        return None


def _factor(outcome: Outcome) -> Float[ndarray, "N r"]:
    """Return integers L with L L' close to X in the units of z."""
    w = outcome.assembly.unknowns.units.entries
    L = np.linalg.cholesky(outcome.solution.X) * w[:, None]
    return np.asarray(np.round(np.ldexp(L, BITS - int(np.ceil(np.log2(np.abs(L).max()))))))


def _all_entries(model: PersidskiiModel, system: System, L: ndarray) -> ndarray:
    """Return L with a zero row for each channel that has no place in z."""
    rows = np.zeros((model.n + len(model.channels.functions), L.shape[1]))
    rows[: model.n] = L[: model.n]
    rows[[model.n + c for c in system.channels]] = L[model.n :]
    return rows


def _lyapunov_product(system: System, L: ndarray) -> ndarray:
    GX = (system.G @ L) @ L[: system.n].T
    return np.asarray(GX + GX.T)


def _forms(system: System, g: int, outcome: Outcome) -> list[list[list[int]]]:
    """Return the forms of a group's pool over (y, every member)."""
    group, pool = system.groups[g], outcome.assembly.unknowns.families[g].forms
    forms = np.zeros((len(pool), 1 + len(group.members)))
    forms[:, [0, *(1 + group.members.index(c) for c in group.channels)]] = pool
    return [dyadics(form) for form in forms]
