"""The unknowns of a matrix inequality, and the way between them and the multipliers in the user's units."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numpy import ndarray

from persid.lyapunov.system import Family, Multipliers, Scaling, System, Target
from persid.lyapunov.triangle import triangle

Label = tuple[Any, ...]  # of an unknown: ("P", i), ("mu", g, k), ("tau", g, k, l), ("s", j), ("p",)


@dataclass(frozen=True, eq=False)
class Unknowns:
    """The unknowns y of an inequality: P, then mu and tau group by group, s of deviations, p last with a ratio.

    Unknown j is the multiplier times `sizes[j]`. A full P of order `symmetric` is its upper triangle, in scaled units;
    `symmetric` = 0 is a diagonal P.
    """

    system: System
    families: tuple[Family, ...]
    target: Target
    units: Scaling
    sizes: Float[ndarray, " J"]
    symmetric: int

    @cached_property
    def labels(self) -> list[Label]:
        """What the unknowns are, in order."""
        return labels(len(self.system.states), self.symmetric > 0, self.families, self.target)

    def places_in(self, other: "Unknowns") -> Int[ndarray, " J"]:
        """Return the place in another problem of every unknown of this one; -1 where it is not there."""
        place = {label: j for j, label in enumerate(other.labels)}
        return np.array([place.get(label, -1) for label in self.labels], int)

    @cached_property
    def _parts(self) -> list[slice]:
        """Where P stands, then mu and tau of every group."""
        k = len(self.system.states)
        counts = [k * (k + 1) // 2 if self.symmetric else k]
        for family in self.families:
            counts += [len(family.densities), len(family.products)]
        ends = np.cumsum([0, *counts]).tolist()
        return [slice(*pair) for pair in pairwise(ends)]

    def multipliers(self, y: Float[ndarray, " J"]) -> Multipliers:
        """Return the multipliers that unknowns stand for, in the user's units."""
        values, (first, *parts) = y / self.sizes, self._parts
        P = np.zeros((self.system.n, self.system.n))
        own = triangle(self.symmetric).matrix(y[first]) / self._P_units if self.symmetric else np.diag(values[first])
        P[self._kept] = own
        p = 0.0 if self.target.ratio is None else float(values[-1])
        s = values[parts[-1].stop if parts else first.stop :][: len(self.target.deviations)]
        mu = [_spread(values[part], family) for part, family in zip(parts[::2], self.families, strict=True)]
        return Multipliers(P + self._beside(mu, p), tuple(mu), tuple(values[part] for part in parts[1::2]), s, p)

    def values(self, numbers: Multipliers) -> Float[ndarray, " J"]:
        """Return the unknowns that stand for multipliers."""
        P = (numbers.P - self._beside(numbers.mu, numbers.p))[self._kept]
        groups = zip(self.families, numbers.mu, numbers.tau, strict=True)
        rest = [part for family, mu, tau in groups for part in (mu[list(family.densities)], tau)]
        last = [] if self.target.ratio is None else [np.array([numbers.p])]
        head = triangle(self.symmetric).entries(P * self._P_units) if self.symmetric else np.diag(P)
        return np.asarray(np.concatenate([head, *rest, numbers.s, *last]) * self.sizes)

    @property
    def _kept(self) -> tuple[ndarray, ...]:
        return np.ix_(self.system.states, self.system.states)

    @property
    def _P_units(self) -> Float[ndarray, "k k"]:
        states = self.units.states[list(self.system.states)]
        return np.asarray(states[:, None] * states * self.units.rate)

    def _beside(self, mu: Sequence[ndarray], p: float) -> Float[ndarray, "n n"]:
        """Return what P holds beside its own unknowns: p diag(shape), less d r r' for every mu (claim R)."""
        found = p * np.diag(self.target.shape_of(self.system))
        for group, each in zip(self.system.groups, mu, strict=True):
            if group.curve in self.target.lower:
                r = group.row[reads := np.flatnonzero(group.row)]
                found[np.ix_(reads, reads)] -= float(each @ self.target.lower[group.curve]) * np.outer(r, r)
        return found


def labels(states: int, full_P: bool, families: Sequence[Family], target: Target) -> list[Label]:
    """Return what the unknowns of an inequality are, in order."""
    names: list[Label] = [("P", i) for i in range(states * (states + 1) // 2 if full_P else states)]
    for g, family in enumerate(families):
        names += [("mu", g, k) for k in family.densities]
        names += [("tau", g, *pair) for pair in family.products]
    names += [("s", j) for j in range(len(target.deviations))]
    return names if target.ratio is None else [*names, ("p",)]


def _spread(values: Float[ndarray, " D"], family: Family) -> Float[ndarray, " K"]:
    """Return a number for each form: those of the densities, 0 for the others."""
    full = np.zeros(len(family.forms))
    full[list(family.densities)] = values
    return full
