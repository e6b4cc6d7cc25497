"""A model as a network: the coefficients of the functions of each node (state), for claim L1."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

from persid_check.model import Model
from persid_check.results import NotProvedError

MAX_FUNCTIONS = 8  # of a node

Functions = tuple[tuple[str, Fraction], ...]  # (text of f, alpha): the function y -> f(alpha y)
Slots = tuple[Sequence[Fraction | float], ...]  # the coefficients of every slot of a node, one for each row
Column = Mapping[int, Sequence[Fraction]]  # row i: the coefficients A_s[i, k] of the slots s of one node k


@dataclass(frozen=True)
class Nodes:
    """x_i' = sum over k and slots s of slots[k][s][i] phi_s(x_k), phi = (y, functions of kinds[kind[k]])."""

    n: int
    kinds: tuple[Functions, ...]
    kind: tuple[int, ...]
    slots: tuple[Slots, ...]

    @property
    def entries(self) -> int:
        """How many pairs (row, node) are coupled, the diagonal included."""
        return sum(sum(map(any, zip(*slots, strict=True))) for slots in self.slots)

    def column(self, k: int) -> Column:
        """Return the coefficients of one node in the rows in which they are not all zero."""
        rows = enumerate(zip(*self.slots[k], strict=True))
        return {i: tuple(map(Fraction, coefficients)) for i, coefficients in rows if any(coefficients)}


def nodes_of(model: Model) -> Nodes:
    """Return the nodes of a model.

    Raises:
        NotProvedError: an argument row is not a positive multiple of a unit vector, or a node has too many functions.
    """
    functions: list[list[tuple[str, Fraction]]] = [[] for _ in range(model.n)]
    slots: list[list[Sequence[Fraction | float]]] = [[column] for column in zip(*model.A0, strict=True)]
    for c, channel in enumerate(model.channels):
        k, alpha = next(iter(channel.row.items()), (0, Fraction(0)))
        if len(channel.row) != 1 or alpha < 0:
            raise NotProvedError("model", f"the row of channel {c} is no positive multiple of a unit vector")
        if any(channel.column):
            functions[k].append((channel.text, alpha))
            slots[k].append(channel.column)
    kinds = tuple(dict.fromkeys(tuple(found) for found in functions))
    place = {kind: t for t, kind in enumerate(kinds)}
    if any(len(kind) > MAX_FUNCTIONS for kind in kinds):
        raise NotProvedError("model", f"a node has more than {MAX_FUNCTIONS} functions")
    return Nodes(model.n, kinds, tuple(place[tuple(found)] for found in functions), tuple(map(tuple, slots)))
