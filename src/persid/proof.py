"""From a solution in floating point to the bytes of a certificate: choose what is used, round, factor, write."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid_check import canonical_model, model_sha256

from persid.certificate import FORMAT, RoundingError, dyadic, dyadics, encode, factor, rounded
from persid.lmi import Assembly, Multipliers, System
from persid.model import PersidskiiModel
from persid.sector import Group

NEGLIGIBLE = 1e-8  # unknowns below this share of the largest one are tried as zeros first
GAIN_SLACK = 2.0  # gamma is this factor above the smallest that the rounded multipliers allow


@dataclass(frozen=True, eq=False)
class Chosen:
    """The part of a group's family that a certificate uses: forms, their mu, and products (k, l, tau)."""

    forms: Float[ndarray, "K d"]
    mu: Float[ndarray, " K"]
    products: tuple[tuple[int, int, float], ...]


def choose(assembly: Assembly, y: Float[ndarray, " J"]) -> tuple[ndarray, tuple[Chosen, ...]]:
    """Return P and, for each group, what is used of its family; negligible unknowns go where the margin allows it."""
    sparse = np.where(np.abs(y) < NEGLIGIBLE * np.abs(y).max(), 0.0, y)
    sparse[: assembly.problem.free] = y[: assembly.problem.free]
    for candidate in (sparse, y):
        numbers = assembly.multipliers(candidate)
        P, chosen = rounded(numbers.P), _chosen(assembly, numbers)
        negative = -inequality(assembly.system, P, chosen)[1]
        if _is_positive(negative) and _is_positive(P[np.ix_(assembly.system.states, assembly.system.states)]):
            return P, chosen
    raise RoundingError("rounding the multipliers loses the margin of the matrix inequality")


def _is_positive(M: ndarray) -> bool:
    diagonal = np.diag(M)
    if not (diagonal > 0).all():
        return False
    scale = 1 / np.sqrt(diagonal)
    return bool(np.linalg.eigvalsh(scale[:, None] * M * scale)[0] > 1e-13) if len(M) else True


def _chosen(assembly: Assembly, numbers: Multipliers) -> tuple[Chosen, ...]:
    found = []
    for family, mu, tau in zip(assembly.families, numbers.mu, numbers.tau, strict=True):
        products = [(k, j, float(t)) for (k, j), t in zip(family.products, rounded(tau), strict=True) if t > 0]
        used = sorted({k for k in range(len(mu)) if mu[k] > 0} | {k for pair in products for k in pair[:2]})
        place = {k: new for new, k in enumerate(used)}
        pairs = tuple((min(place[k], place[j]), max(place[k], place[j]), t) for k, j, t in products)
        found.append(Chosen(family.forms[used], rounded(mu[used]), pairs))
    return tuple(found)


def inequality(system: System, P: Float[ndarray, "n n"], chosen: Sequence[Chosen]) -> tuple[ndarray, ndarray]:
    """Return E and Q in the entries of z that the system keeps."""
    E = np.zeros((system.G.shape[1], system.n))
    E[: len(system.states)] = P[list(system.states)]
    S = np.zeros((system.G.shape[1],) * 2)
    for group, part in zip(system.groups, chosen, strict=True):
        rows = system.lift(group, part.forms)
        E += np.outer(part.mu @ rows, group.row)
        T = np.zeros((len(rows), len(rows)))
        for k, j, tau in part.products:
            T[k, j] = T[j, k] = tau
        S += rows.T @ T @ rows
    EG = E @ system.G
    return E, EG + EG.T + S


def write(model: PersidskiiModel, system: System, P: Float[ndarray, "n n"], chosen: Sequence[Chosen]) -> bytes:
    """Return the bytes of a certificate of claim G (all states kept) or M."""
    E, Q = inequality(system, P, chosen)
    gamma = _gamma(-Q, E @ system.B)
    side = -E @ system.B
    block = np.block([[-Q, side], [side.T, gamma * np.eye(side.shape[1])]])
    states = list(system.states)
    content: dict[str, Any] = {
        "format": FORMAT,
        "claim": "G" if len(states) == model.n else "M",
        "statement": "The model is input-to-state stable for all initial states.",
        "model_sha256": model_sha256(model.to_dict()),
        "model": canonical_model(model.to_dict()),
        "operating_point": None,
        "P": _stored(P),
        "groups": [_group(group, part) for group, part in zip(system.groups, chosen, strict=True)],
        "dropped": [i for i in range(model.n) if i not in states] + _absent(model, system),
        "gamma": dyadic(gamma),
        "proof": {"P": factor(P[np.ix_(states, states)]), "Q": factor(block)},
    }
    return encode(content)


def _gamma(negative: ndarray, EB: ndarray) -> float:
    """Return a gamma for which the block with the inputs is positive definite: above (EB)'(-Q)^-1 EB, a power of two."""
    if not EB.shape[1]:
        return 1.0
    scale = 1 / np.sqrt(np.diag(negative))
    solved = np.linalg.solve(scale[:, None] * negative * scale, scale[:, None] * EB)
    smallest = float(np.linalg.eigvalsh((scale[:, None] * EB).T @ solved)[-1])
    return float(np.exp2(np.ceil(np.log2(max(GAIN_SLACK * smallest, 1e-300)))))


def _stored(P: ndarray) -> dict[str, Any]:
    if np.array_equal(P, np.diag(np.diag(P))):
        return {"diagonal": dyadics(np.diag(P))}
    return {"lower": [dyadics(row[: i + 1]) for i, row in enumerate(P)]}


def _absent(model: PersidskiiModel, system: System) -> list[int]:
    present = set(system.channels)
    return [model.n + c for c in range(len(model.channels.functions)) if c not in present]


def _group(group: Group, part: Chosen) -> dict[str, Any]:
    """Write a group: its forms over (y, every member), zero at members without effect."""
    forms = np.zeros((len(part.forms), 1 + len(group.members)))
    forms[:, [0, *(1 + group.members.index(c) for c in group.channels)]] = part.forms
    return {
        "forms": [dyadics(form) for form in forms],
        "mu": dyadics(part.mu),
        "products": [[k, j, dyadic(tau)] for k, j, tau in part.products],
    }
