"""From a solution in floating point to the bytes of a certificate: choose what is used, round, factor, write."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certificate import FORMAT, RoundingError, dyadic, dyadics, encode, factor, rounded
from persid.equilibrium import OperatingPoint
from persid.lmi import Assembly
from persid.model import PersidskiiModel
from persid.sector import Group
from persid.system import System
from persid_check import canonical_model

NEGLIGIBLE = (1e-2, 1e-3, 1e-5, 1e-8)  # unknowns below such a share of the largest are tried as zeros
LOSS = 1.05  # by which gamma may grow, and the lower bound of V shrink, for a proof with fewer forms
SLACK = 1 / 64  # relative distance that gamma, p and the level keep from what the rounded multipliers just allow


@dataclass(frozen=True, eq=False)
class Chosen:
    """The part of a group's family that a certificate uses: forms with mu, c and d, and products (k, l, tau)."""

    forms: Float[ndarray, "K d"]
    mu: Float[ndarray, " K"]
    upper: Float[ndarray, " K"]
    lower: Float[ndarray, " K"]
    products: tuple[tuple[int, int, float], ...]


@dataclass(frozen=True, eq=False)
class Lyapunov:
    """V and the multipliers of its proof, in numbers that a certificate can write exactly."""

    system: System
    P: Float[ndarray, "n n"]
    chosen: tuple[Chosen, ...]
    kappa: float
    units: Float[ndarray, " m"] | None = None  # of the inputs of `system`, where each has its own gain: u = units v

    @cached_property
    def E(self) -> Float[ndarray, "N n"]:
        """Half the gradient of V is E'z."""
        E = np.zeros((self.system.entries, self.system.n))
        E[: len(self.system.states)] = self.P[list(self.system.states)]
        for group, part in zip(self.system.groups, self.chosen, strict=True):
            E += np.outer(part.mu @ self.system.lift(group, part.forms), group.row)
        return E

    @cached_property
    def decrease(self) -> Float[ndarray, "N N"]:
        """The matrix -Q - kappa W."""
        EG = self.E @ self.system.G
        total = -EG - EG.T
        if self.kappa:
            k = len(self.system.states)
            total[:k, :k] -= self.kappa * self.P[np.ix_(self.system.states, self.system.states)]
        for group, part in zip(self.system.groups, self.chosen, strict=True):
            rows = self.system.lift(group, part.forms)
            T = np.zeros((len(rows), len(rows)))
            for k, j, tau in part.products:
                T[k, j] = T[j, k] = tau
            total -= rows.T @ T @ rows
            if self.kappa:
                y = self.system.lift(group, np.eye(1, group.curve.size))[0]
                weight = (part.mu * np.nan_to_num(part.upper)) @ rows
                total -= self.kappa * (np.outer(y, weight) + np.outer(weight, y))
        return total

    @cached_property
    def below(self) -> Float[ndarray, "n n"]:
        """A matrix with V >= x'below x on the domain: P and, on a domain, what the integrals add."""
        rows = np.array([group.row for group in self.system.groups]).reshape(-1, self.system.n)
        return self.P + (rows.T * [float(part.mu @ part.lower) for part in self.chosen]) @ rows

    @cached_property
    def gamma(self) -> float:
        """A gamma for which the block with the inputs is positive definite: above (EB)'(-Q - kappa W)^-1 EB."""
        EB = self.E @ self.system.B
        if not EB.shape[1]:
            return 1.0
        scale = 1 / np.sqrt(np.diag(self.decrease))
        solved = np.linalg.solve(scale[:, None] * self.decrease * scale, scale[:, None] * EB)
        return -_floor(-max(float(np.linalg.eigvalsh((scale[:, None] * EB).T @ solved)[-1]), 1e-300))

    @property
    def coupling(self) -> Float[ndarray, "m m"]:
        """A symmetric Gamma for which that block is positive definite: (EB)'(-Q - kappa W)^-1 EB and a little more.

        Its diagonal holds the gains of single inputs, squared; one that does nothing is given a tiny gain.
        """
        scale = 1 / np.sqrt(np.diag(self.decrease))
        EB = scale[:, None] * self.E @ self.system.B
        least = EB.T @ np.linalg.solve(scale[:, None] * self.decrease * scale, EB)
        sizes = np.diag(least)
        floor = 1e-18 * (sizes.max(initial=0.0) or 1.0)
        return (least + least.T) / 2 + np.diag(SLACK * np.maximum(sizes, floor))

    @property
    def depth(self) -> float:
        """The smallest eigenvalue of `below` on the kept states."""
        states = list(self.system.states)
        return float(np.linalg.eigvalsh(self.below[np.ix_(states, states)])[0]) if states else 0.0

    @property
    def is_sound(self) -> bool:
        """Whether the inequalities hold in floating point."""
        states = list(self.system.states)
        return _is_positive(self.decrease) and _is_positive(self.below[np.ix_(states, states)])


def choose(
    assembly: Assembly,
    y: Float[ndarray, " J"],
    lower: Sequence[Float[ndarray, " _"]] | None = None,
    units: Float[ndarray, " m"] | None = None,
) -> Lyapunov:
    """Return the rounded Lyapunov function of a solution; negligible unknowns go where the margin allows it.

    `lower` gives the constants d of each group's forms (claim R), `units` those of the inputs (a gain for each).

    Raises:
        RoundingError: the rounded numbers do not satisfy the inequalities.
    """
    complete = _lyapunov(assembly, y, lower)
    if not complete.is_sound:
        raise RoundingError("rounding the multipliers loses the margin of the matrix inequality")
    for share in NEGLIGIBLE:
        sparse = np.where(np.abs(y) < share * np.abs(y).max(), 0.0, y)
        sparse[: assembly.problem.free] = y[: assembly.problem.free]
        leaner = _lyapunov(assembly, sparse, lower)
        if leaner.is_sound and leaner.gamma <= LOSS * complete.gamma and leaner.depth >= complete.depth / LOSS:
            return replace(leaner, units=units)
    return replace(complete, units=units)


def _lyapunov(assembly: Assembly, y: ndarray, lower: Sequence[ndarray] | None) -> Lyapunov:
    numbers = assembly.multipliers(y)
    chosen = _chosen(assembly, numbers.mu, numbers.tau, lower)
    return Lyapunov(assembly.system, rounded(numbers.P), chosen, assembly.target.kappa)


def _is_positive(M: ndarray) -> bool:
    diagonal = np.diag(M)
    if not (diagonal > 0).all():
        return False
    scale = 1 / np.sqrt(diagonal)
    return not len(M) or bool(np.linalg.eigvalsh(scale[:, None] * M * scale)[0] > 1e-13)


def _chosen(
    assembly: Assembly, mus: Sequence[ndarray], taus: Sequence[ndarray], lower: Sequence[ndarray] | None
) -> tuple[Chosen, ...]:
    found = []
    parts = zip(assembly.system.groups, assembly.families, mus, taus, strict=True)
    for g, (group, family, mu, tau) in enumerate(parts):
        products = [(k, j, float(t)) for (k, j), t in zip(family.products, rounded(tau), strict=True) if t > 0]
        used = sorted({k for k in range(len(mu)) if mu[k] > 0} | {k for pair in products for k in pair[:2]})
        place = {k: new for new, k in enumerate(used)}
        pairs = tuple((min(place[k], place[j]), max(place[k], place[j]), t) for k, j, t in products)
        upper = assembly.target.upper.get(group.curve, np.full(len(mu), np.nan))
        below = np.zeros(len(mu)) if lower is None else lower[g]
        found.append(Chosen(family.forms[used], rounded(mu[used]), upper[used], below[used], pairs))
    return tuple(found)


def write(
    model: PersidskiiModel,
    lyapunov: Lyapunov,
    point: OperatingPoint | None = None,
    box: Float[ndarray, "n 2"] | None = None,
    *,
    reach: Float[ndarray, " n"] | None = None,
) -> bytes:
    """Return the bytes of a certificate: claim R with a box, claim E with a rate, else G (all states kept) or M.

    `reach` is the distance h of x* from the box, per state, for claim R.
    """
    system, states = lyapunov.system, list(lyapunov.system.states)
    rate, regional = lyapunov.kappa > 0, box is not None
    claim = "R" if regional else "E" if rate else "G" if len(states) == model.n else "M"
    side, Gamma, gamma = _inputs(lyapunov)
    block = np.block([[lyapunov.decrease, side], [side.T, Gamma]])
    below = lyapunov.below[np.ix_(states, states)]
    p = _floor(np.linalg.eigvalsh(below)[0]) if rate else 0.0
    content: dict[str, Any] = {
        "format": FORMAT,
        "claim": claim,
        "statement": f"The model is input-to-state stable ({'in a region' if regional else 'for all initial states'}).",
        "model_sha256": model.sha256,
        "model": canonical_model(model.to_dict()),
        "operating_point": None if point is None else point.to_dict(),
        "P": _stored(lyapunov.P),
        "groups": [_group(group, part, claim) for group, part in zip(system.groups, lyapunov.chosen, strict=True)],
        "dropped": [i for i in range(model.n) if i not in states] + _absent(model, system),
        "gamma": gamma,
    }
    if rate:
        content |= {"kappa": dyadic(lyapunov.kappa), "p": dyadic(p)}
    if box is not None and reach is not None:
        level = _floor(float((reach**2 / np.diag(np.linalg.inv(below))).min()))
        bound = _floor(np.sqrt(lyapunov.kappa * level / _largest(Gamma)))
        content |= {"box": [dyadics(side) for side in box], "level": dyadic(level), "input_bound": dyadic(bound)}
    content["proof"] = {"P": factor(below - p * np.eye(len(below))), "Q": factor(block)}
    return encode(content)


def _inputs(lyapunov: Lyapunov) -> tuple[ndarray, ndarray, Any]:
    """Return -E B and Gamma in the user's units, and Gamma as the file has it: gamma I, or a matrix."""
    side = -lyapunov.E @ lyapunov.system.B
    if lyapunov.units is None:
        return side, lyapunov.gamma * np.eye(side.shape[1]), dyadic(lyapunov.gamma)
    Gamma = rounded(lyapunov.coupling / lyapunov.units / lyapunov.units[:, None])
    return side / lyapunov.units, Gamma, {"lower": [dyadics(row[: i + 1]) for i, row in enumerate(Gamma)]}


def _largest(Gamma: ndarray) -> float:
    """Return what the checker takes for the largest eigenvalue: (tr Gamma^16)^(1/16); exact for gamma I."""
    if not Gamma.size or np.array_equal(Gamma, Gamma[0, 0] * np.eye(len(Gamma))):
        return float(Gamma[0, 0]) if Gamma.size else 1.0
    return float((np.linalg.eigvalsh(Gamma) ** 16).sum() ** (1 / 16))


def _floor(number: float) -> float:
    """Return a dyadic of few bits a little below a number (above, in size, a negative one)."""
    fraction, exponent = np.frexp(number * (1 - SLACK) if number > 0 else number * (1 + SLACK))
    return float(np.ldexp(np.floor(np.ldexp(fraction, 20)), int(exponent) - 20))


def _stored(P: ndarray) -> dict[str, Any]:
    if np.array_equal(P, np.diag(np.diag(P))):
        return {"diagonal": dyadics(np.diag(P))}
    return {"lower": [dyadics(row[: i + 1]) for i, row in enumerate(P)]}


def _absent(model: PersidskiiModel, system: System) -> list[int]:
    present = set(system.channels)
    return [model.n + c for c in range(len(model.channels.functions)) if c not in present]


def _group(group: Group, part: Chosen, claim: str) -> dict[str, Any]:
    """Write a group: its forms over (y, every member), zero at members without effect."""
    forms = np.zeros((len(part.forms), 1 + len(group.members)))
    forms[:, [0, *(1 + group.members.index(c) for c in group.channels)]] = part.forms
    stored: dict[str, Any] = {
        "forms": [dyadics(form) for form in forms],
        "mu": dyadics(part.mu),
        "products": [[k, j, dyadic(tau)] for k, j, tau in part.products],
    }
    if claim in ("E", "R"):
        stored["integral"] = [dyadic(c) if mu else None for c, mu in zip(part.upper, part.mu, strict=True)]
    if claim == "R":
        stored["quadratic"] = [dyadic(d) if mu else None for d, mu in zip(part.lower, part.mu, strict=True)]
    return stored
