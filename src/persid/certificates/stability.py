"""The certificate of a Lyapunov function with integrals: facts are products of two forms of one point."""

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import _floor, dyadic, dyadics, rounded
from persid._files import Json, json_object
from persid.certificates.bounds import above, largest_eigenvalue
from persid.certificates.certificate import Certificate
from persid.certificates.curves import Curves, Use, curve_of, idle_points, written_point
from persid.certificates.encoding import encode
from persid.certificates.ledger import draft, with_proof
from persid.certificates.outputs import described, with_constants
from persid.errors import RejectedError, RoundingError
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.multipliers import Chosen, Lyapunov
from persid.lyapunov.operating_points import OperatingPoint
from persid.lyapunov.points import written
from persid.lyapunov.sectors import Place
from persid.lyapunov.shifted_model import place
from persid.lyapunov.system import System
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel

_ZERO = Fraction(0)


def prove(
    model: PersidskiiModel,
    lyapunov: Lyapunov,
    point: OperatingPoint | None = None,
    box: Float[ndarray, "n 2"] | None = None,
    outputs: OutputModel | None = None,
) -> Certificate:
    """Return the certificate that the checker accepts: of a region with a box, with the rate if there is one.

    With a rate it bounds the outputs, if there are any. Where V allows for deviations it speaks of every plant within
    them.

    Raises:
        RejectedError: the checker does not accept it.
        RoundingError: a lemma is not proved, or a matrix is not positive definite in floating point.
    """
    content = _content(model, lyapunov, point, box)
    if outputs is not None and lyapunov.kappa > 0:  # of the model itself: deviations only make its inequality harder
        return Certificate.of(with_constants(with_proof(content | {"outputs": described(outputs)})))
    deviations = [_deviation(*pair) for pair in zip(lyapunov.deviations, lyapunov.s, strict=True)]
    return Certificate.of(with_proof(content | {"deviations": deviations}))


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


def _content(
    model: PersidskiiModel, lyapunov: Lyapunov, point: OperatingPoint | None, box: Float[ndarray, "n 2"] | None
) -> Json:
    """Return what is claimed: a region with a box, a rate and a gain with a rate, else stability without numbers."""
    rate, regional = lyapunov.kappa > 0, box is not None
    below = lyapunov.below[np.ix_(lyapunov.system.states, lyapunov.system.states)]
    Gamma, gamma = _gamma(lyapunov)
    curves = Curves()
    points, products = _points(model, lyapunov, place(model, point, box), curves)
    content = draft(
        model, "region" if regional else "rate-and-gain" if rate else "iss", point, curves, points, {"value": products}
    )
    content |= {"P": _stored(lyapunov.P), "gamma": gamma, "dropped": _dropped(model, lyapunov.system)}
    content["spanning"] = _spanning(model, content)
    if rate:
        content |= {"kappa": dyadic(lyapunov.kappa), "p": dyadic(_floor(np.linalg.eigvalsh(below)[0]))}
    if box is None:
        return content
    here = OperatingPoint(model.x_ref, 0.0, model.u_ref) if point is None else point
    level = _floor(float((here.reach(box) ** 2 / np.diag(np.linalg.inv(below))).min()))
    room = lyapunov.kappa * level - float(lyapunov.s @ [d.epsilon**2 for d in lyapunov.deviations])
    if room <= 0:
        raise RoundingError("the constant part of the deviations drives the state out of the region")
    bound = _floor(np.sqrt(room / largest(Gamma)))
    return content | {
        "strips": _strips(content, Place.about(here.x, model.x_ref, here.radius, box)),
        "level": dyadic(level),
        "input_bound": dyadic(bound),
    }


def _points(
    model: PersidskiiModel, lyapunov: Lyapunov, at: Place | None, curves: Curves
) -> tuple[list[Json], list[object]]:
    """Return the points of the groups, with their shares of V, and the products of their forms."""
    points, products, system = list[Json](), list[object](), lyapunov.system
    for group, part in zip(system.groups, lyapunov.chosen, strict=True):
        if not group.channels:
            continue
        k, row, stretched = written(group)
        place, numbers = curves.place(curve_of(stretched), list(uses(part, k, lyapunov)))
        shares = [[at, dyadic(Fraction(mu) * k)] for at, mu in zip(numbers, part.mu.tolist(), strict=True) if mu]
        products += [[len(points), numbers[i], numbers[j], dyadic(tau)] for i, j, tau in part.products]
        points.append(written_point(place, row, group.channels, shares))
    return points + idle_points(curves, model, _absent(model, system), at), products


def uses(part: Chosen, k: Fraction, lyapunov: Lyapunov) -> Iterator[Use]:
    """Return how a Lyapunov function uses the forms of a group, over y/k; those in V have their constants."""
    rate = lyapunov.kappa > 0
    spans = not rate and len(lyapunov.system.states) < lyapunov.system.n
    bounds = zip(part.upper.tolist(), part.lower.tolist(), strict=True)
    for form, mu, (c, d) in zip(part.forms.tolist(), part.mu.tolist(), bounds, strict=True):
        over = (Fraction(form[0]) * k, *map(Fraction, form[1:]))
        yield Use(over, Fraction(c) if rate else None, Fraction(d) * k if rate else _ZERO, spans) if mu else Use(over)


def _dropped(model: PersidskiiModel, system: System) -> list[int]:
    states = [i for i in range(model.n) if i not in system.states]
    return states + [model.n + c for c in _absent(model, system)]


def _spanning(model: PersidskiiModel, content: Json) -> list[list[int]]:
    """Return forms in V that grow without bound and read nothing that is dropped, one of each point."""
    dropped, found = set(content["dropped"]), []
    if not any(i < model.n for i in dropped):
        return []
    for p, point in enumerate(content["points"]):
        for k, _ in point["densities"]:
            form = content["curves"][point["curve"]]["forms"][k]
            reads = {model.n + c for c, v in zip(point["channels"], form["l"][1:], strict=True) if v[0]}
            reads |= {i for i, _ in point["row"]} if form["l"][0][0] else set()
            if form["is"] in ("rising", "growing") and not reads & dropped:
                found.append([p, k])
                break
    return found


def _strips(content: Json, at: Place) -> list[object]:
    """Return the sides of the box, but for those that stand as the domain of a point."""
    sides = [([[i, [1, 0]]], [dyadic(lo), dyadic(hi)]) for i, (lo, hi) in enumerate(at.box or ())]
    standing = [(point["row"], content["curves"][point["curve"]]["domain"]) for point in content["points"]]
    return [[row, *ends] for row, ends in sides if (row, ends) not in standing]


def _deviation(deviation: Deviation, s: float) -> Json:
    """Write a deviation; a number of its bound is meant exactly."""
    rows = {"columns": deviation.L.T, "C": deviation.C}
    lists = {name: [[[int(i), dyadic(row[i])] for i in np.flatnonzero(row)] for row in M] for name, M in rows.items()}
    return {**lists, "s": dyadic(float(s)), "epsilon": dyadic(deviation.epsilon)}


def _gamma(lyapunov: Lyapunov) -> tuple[ndarray, object]:
    """Return Gamma in the user's units, and as the file has it: gamma I, or a matrix."""
    units = lyapunov.units
    if units is None:
        return lyapunov.gamma * np.eye(lyapunov.crossing.shape[1]), dyadic(lyapunov.gamma)
    Gamma = rounded(lyapunov.coupling / units / units[:, None])
    return Gamma, {"lower": [dyadics(row[: i + 1]) for i, row in enumerate(Gamma)]}


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
    return [c for c in range(len(model.channels.functions)) if c not in present]
