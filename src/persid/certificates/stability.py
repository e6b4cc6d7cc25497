"""The certificate of a Lyapunov function.

It is a ledger; version 1 is written where a lemma has no partition that is found, and no outputs are bounded.
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import _floor, dyadic, dyadics, rounded
from persid._files import Json, json_object
from persid.certificates.bounds import above, largest_eigenvalue
from persid.certificates.certificate import Certificate
from persid.certificates.encoding import encode, factor, heading
from persid.certificates.ledger import as_ledger
from persid.certificates.outputs import described, with_constants
from persid.errors import RejectedError, RoundingError
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.multipliers import Chosen, Lyapunov
from persid.lyapunov.operating_points import OperatingPoint
from persid.lyapunov.sectors import Group, nondecreasing_pool
from persid.lyapunov.system import System
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel


def prove(
    model: PersidskiiModel,
    lyapunov: Lyapunov,
    point: OperatingPoint | None = None,
    box: Float[ndarray, "n 2"] | None = None,
    outputs: OutputModel | None = None,
) -> Certificate:
    """Return the certificate that the checker accepts: of a region with a box, with the rate if there is one.

    With a rate it bounds the outputs, if there are any. Where V allows for deviations it speaks of every plant within
    them. Version 1 has no place for either.

    Raises:
        RejectedError: the checker accepts it in neither format, or not with the outputs.
        RoundingError: a matrix is not positive definite in floating point.
    """
    content = version_1(model, lyapunov, point, box)
    if outputs is not None and "kappa" in content:  # of the model itself: deviations only make its inequality harder
        return Certificate.of(with_constants(as_ledger(content, outputs=described(outputs))))
    deviations = [_deviation(*pair) for pair in zip(lyapunov.deviations, lyapunov.s, strict=True)]
    try:
        return Certificate.of(as_ledger(content, deviations))
    except (RejectedError, RoundingError):
        if deviations or model.is_discrete:  # version 1 knows neither
            raise
        return Certificate.accept(encode(content))


def with_constant(certificate: Certificate, epsilon: float) -> Certificate:
    """Return the certificate of plants with another constant part of their one deviation; the proof is the same.

    Raises:
        RejectedError: the constant part drives the state out of the region.
    """
    content, claim = json_object(certificate.data), certificate.stated
    (deviation,) = content["deviations"]
    changed = content | {"deviations": [deviation | {"epsilon": dyadic(epsilon)}]}
    if claim.level:
        room = float(claim.kappa * claim.level) - float(claim.deviations[0].s) * epsilon**2
        if room <= 0:
            raise RejectedError("the constant part of the deviations drives the state out of the region")
        most = np.sqrt(room / above(largest_eigenvalue(claim.gamma)))
        changed["input_bound"] = dyadic(min(_floor(most), float(claim.input_bound)))
    return Certificate.accept(encode(changed), certificate.arrays)


def version_1(
    model: PersidskiiModel,
    lyapunov: Lyapunov,
    point: OperatingPoint | None = None,
    box: Float[ndarray, "n 2"] | None = None,
) -> Json:
    """Return the content of version 1: claim R with a box, claim E with a rate, else G (all states kept) or M."""
    system, states = lyapunov.system, list(lyapunov.system.states)
    rate, regional = lyapunov.kappa > 0, box is not None
    claim = "R" if regional else "E" if rate else "G" if len(states) == model.n else "M"
    side, push, Gamma, gamma = _inputs(lyapunov)
    block = np.block([[lyapunov.decrease, -side], [-side.T, Gamma - push]])
    below = lyapunov.below[np.ix_(states, states)]
    p = _floor(np.linalg.eigvalsh(below)[0]) if rate else 0.0
    content: Json = {
        **heading(
            model,
            claim,
            f"The model is input-to-state stable ({'in a region' if regional else 'for all initial states'}).",
        ),
        "operating_point": None if point is None else point.to_dict(),
        "P": _stored(lyapunov.P),
        "groups": [_group(group, part, claim) for group, part in zip(system.groups, lyapunov.chosen, strict=True)],
        "dropped": [i for i in range(model.n) if i not in states] + _absent(model, system),
        "gamma": gamma,
    }
    if rate:
        content |= {"kappa": dyadic(lyapunov.kappa), "p": dyadic(p)}
    if claim == "E" and _is_incremental(lyapunov):
        content["incremental"] = True
    if box is not None:
        here = OperatingPoint(model.x_ref, 0.0, model.u_ref) if point is None else point
        level = _floor(float((here.reach(box) ** 2 / np.diag(np.linalg.inv(below))).min()))
        room = lyapunov.kappa * level - float(lyapunov.s @ [d.epsilon**2 for d in lyapunov.deviations])
        if room <= 0:
            raise RoundingError("the constant part of the deviations drives the state out of the region")
        bound = _floor(np.sqrt(room / largest(Gamma)))
        content |= {"box": [dyadics(side) for side in box], "level": dyadic(level), "input_bound": dyadic(bound)}
    content["proof"] = {"P": factor(below - p * np.eye(len(below))), "Q": factor(block)}
    return content


def _deviation(deviation: Deviation, s: float) -> Json:
    """Write a deviation; a number of its bound is meant exactly."""
    rows = {"columns": deviation.L.T, "C": deviation.C}
    lists = {name: [[[int(i), dyadic(row[i])] for i in np.flatnonzero(row)] for row in M] for name, M in rows.items()}
    return {**lists, "s": dyadic(float(s)), "epsilon": dyadic(deviation.epsilon)}


def _is_incremental(lyapunov: Lyapunov) -> bool:
    """Whether V has no integrals and uses forms that were made to be nondecreasing: it holds for any two solutions."""
    parts = zip(lyapunov.system.groups, lyapunov.chosen, strict=True)
    return all(
        not part.mu.any() and all(tuple(form.tolist()) in nondecreasing_pool(group.curve) for form in part.forms)
        for group, part in parts
    )


def _inputs(lyapunov: Lyapunov) -> tuple[ndarray, ndarray, ndarray, object]:
    """Return crossing, push and Gamma in the user's units, and Gamma as the file has it: gamma I, or a matrix."""
    side, push, units = lyapunov.crossing, lyapunov.push, lyapunov.units
    if units is None:
        return side, push, lyapunov.gamma * np.eye(side.shape[1]), dyadic(lyapunov.gamma)
    Gamma = rounded(lyapunov.coupling / units / units[:, None])
    stored = {"lower": [dyadics(row[: i + 1]) for i, row in enumerate(Gamma)]}
    return side / units, push / units / units[:, None], Gamma, stored


def largest(Gamma: ndarray) -> float:
    """Return what the checker takes for the largest eigenvalue: (tr Gamma^16)^(1/16); exact for gamma I."""
    if not Gamma.size or np.array_equal(Gamma, Gamma[0, 0] * np.eye(len(Gamma))):
        return float(Gamma[0, 0]) if Gamma.size else 1.0
    return float((np.linalg.eigvalsh(Gamma) ** 16).sum() ** (1 / 16))


def _stored(P: ndarray) -> Json:
    if np.array_equal(P, np.diag(np.diag(P))):
        return {"diagonal": dyadics(np.diag(P))}
    return {"lower": [dyadics(row[: i + 1]) for i, row in enumerate(P)]}


def _absent(model: PersidskiiModel, system: System) -> list[int]:
    present = set(system.channels)
    return [model.n + c for c in range(len(model.channels.functions)) if c not in present]


def _group(group: Group, part: Chosen, claim: str) -> Json:
    """Write a group: its forms over (y, every member), zero at members without effect."""
    forms = np.zeros((len(part.forms), 1 + len(group.members)))
    forms[:, [0, *(1 + group.members.index(c) for c in group.channels)]] = part.forms
    stored: Json = {
        "forms": [dyadics(form) for form in forms],
        "mu": dyadics(part.mu),
        "products": [[k, j, dyadic(tau)] for k, j, tau in part.products],
    }
    if claim in ("E", "R"):
        stored["integral"] = [dyadic(c) if mu else None for c, mu in zip(part.upper, part.mu, strict=True)]
    if claim == "R":
        stored["quadratic"] = [dyadic(d) if mu else None for d, mu in zip(part.lower, part.mu, strict=True)]
    return stored
