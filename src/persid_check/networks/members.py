"""Members of a network: rows of coefficients that may differ from the model's, each within an ellipsoid.

A row d of the ellipsoid of C has |d'zeta| <= |C zeta| for every zeta = (x, channels, u); docs/network-format.md.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from math import isqrt

from persid_check.entry import Entry
from persid_check.model import Model
from persid_check.work import spend

DIGITS = 64  # bits of a root, at least

Row = Mapping[int, Fraction]


@dataclass(frozen=True)
class Ellipsoid:
    """What the coefficients of x_i' may differ by: the rows of C over (x, channels, u)."""

    state: int
    C: tuple[Row, ...]


@dataclass(frozen=True)
class Members:
    """The ellipsoids of a model's rows; its channels stand at the slots of its nodes."""

    model: Model
    ellipsoids: tuple[Ellipsoid, ...]

    @cached_property
    def places(self) -> Mapping[int, tuple[int, int]]:
        """The node and the slot of every state and of every channel that has one."""
        found, counts = {k: (k, 0) for k in range(self.model.n)}, [1] * self.model.n
        for c, channel in enumerate(self.model.channels):
            if any(channel.column):
                (k,) = channel.row
                found[self.model.n + c] = (k, counts[k])
                counts[k] += 1
        return found

    @cached_property
    def at_nodes(self) -> Mapping[int, Sequence[tuple[int, Sequence[Row]]]]:
        """For each node, the ellipsoids that read it: the state, and the rows of C over the node's slots."""
        found: dict[int, list[tuple[int, list[dict[int, Fraction]]]]] = {}
        for ellipsoid in self.ellipsoids:
            mine: dict[int, list[dict[int, Fraction]]] = {}
            for row in ellipsoid.C:
                lines: dict[int, dict[int, Fraction]] = {}
                for entry, value in row.items():
                    if entry in self.places:
                        k, slot = self.places[entry]
                        lines.setdefault(k, {})[slot] = value
                for k, line in lines.items():
                    mine.setdefault(k, []).append(line)
            for k, rows in mine.items():
                found.setdefault(k, []).append((ellipsoid.state, rows))
        return found

    def sizes(self, k: int, ray: Sequence[Fraction | int]) -> list[tuple[int, Fraction]]:
        """Return (i, a bound of |C_i E_k v|) for every ellipsoid that reads node k."""
        return [(i, _norm([_at(row, ray) for row in rows])) for i, rows in self.at_nodes.get(k, ())]

    @cached_property
    def at_inputs(self) -> Mapping[int, Mapping[int, Sequence[Fraction]]]:
        """For each input, the entries that rows of C have at it, by the state of their ellipsoid."""
        first, found = self.model.n + len(self.model.channels), dict[int, dict[int, list[Fraction]]]()
        for ellipsoid in self.ellipsoids:
            for row in ellipsoid.C:
                spend(len(row))
                for entry, value in row.items():
                    if entry >= first:
                        found.setdefault(entry - first, {}).setdefault(ellipsoid.state, []).append(value)
        return found

    def of_input(self, j: int) -> list[tuple[int, Fraction]]:
        """Return (i, a bound of |C_i e_j|) for every ellipsoid that reads input j."""
        return [(i, _norm(values)) for i, values in self.at_inputs.get(j, {}).items()]


def read_members(entry: Entry, model: Model) -> Members:
    """Return the ellipsoids that a file lists.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    idle = {model.n + c for c, channel in enumerate(model.channels) if not any(channel.column)}
    size = model.n + len(model.channels) + model.m
    found: list[Ellipsoid] = []
    for each in entry.items():
        given = each.fields(("state", "C"))
        state = given["state"].index(model.n)
        if found and state <= found[-1].state:
            given["state"].refuse("states rise")
        C = tuple(row.row(size) for row in given["C"].items())
        if any(place in idle for row in C for place in row):
            given["C"].refuse("it reads a channel whose column is zero")
        found.append(Ellipsoid(state, C))
    return Members(model, tuple(found))


def _at(row: Row, ray: Sequence[Fraction | int]) -> Fraction:
    spend(len(row))
    return sum((value * ray[slot] for slot, value in row.items()), Fraction(0))


def _norm(values: Sequence[Fraction]) -> Fraction:
    """Return a number that is at least the Euclidean norm, by less than 2^-60 of itself."""
    square = sum((value * value for value in values), Fraction(0))
    if not square:
        return square
    n, d = square.numerator, square.denominator
    k = max(0, DIGITS + (d.bit_length() - n.bit_length()) // 2 + 1)
    scaled, rest = divmod(n << 2 * k, d)
    root = isqrt(scaled)
    return Fraction(root + bool(rest or root * root < scaled), 1 << k)
