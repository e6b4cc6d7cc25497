"""What a network file claims: L1 with its weights, or that no weights exist."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import TYPE_CHECKING

from persid_check.companion import Arrays, binary64
from persid_check.json_text import Stated
from persid_check.model import Model
from persid_check.networks.members import Members
from persid_check.networks.nodes import Functions, Nodes
from persid_check.networks.table import Table
from persid_check.sparse import SparseModel

if TYPE_CHECKING:
    from numpy import ndarray

Forms = tuple[tuple[Fraction, ...], ...]


@dataclass(frozen=True)
class Kind:
    """The forms of the nodes with one list of functions; with an infeasible claim, the rays that they choose from."""

    functions: Functions
    forms: Forms
    rays: Forms = ()


@dataclass(frozen=True)
class NetworkSubject:
    """What the file is about: its claim, the model's canonical form and its nodes."""

    claim: str
    sha256: str
    form: Stated
    model: Model | SparseModel
    nodes: Nodes | Table
    arrays: Arrays


@dataclass(frozen=True)
class NetworkClaim:
    """Claim L1: weights w and rate kappa, about x_ref or (`every`) about the equilibrium of every constant input.

    With `members` it is one about every model with coefficients within their ellipsoids.
    """

    subject: NetworkSubject
    every: bool
    kinds: tuple[Kind, ...]
    weights: "Sequence[Fraction] | ndarray"
    kappa: Fraction
    members: Members | None = None

    @cached_property
    def spread(self) -> tuple[Fraction, Fraction]:
        """The smallest and the largest weight."""
        if isinstance(self.weights, tuple):
            return min(self.weights), max(self.weights)
        floats = binary64(self.weights)
        return Fraction(float(floats.min())), Fraction(float(floats.max()))


@dataclass(frozen=True)
class NetworkObstruction:
    """Claim "L1-infeasible": z >= 0 and a ray for each node with M z >= 0."""

    subject: NetworkSubject
    kinds: tuple[Kind, ...]
    z: "Sequence[Fraction] | ndarray"
    choice: "Sequence[int] | ndarray"
