"""The certificate of a proposal: facts of every kind, rows that are exactly zero, strips of a region."""

from dataclasses import dataclass, replace
from fractions import Fraction
from functools import lru_cache
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import SLACK, _floor, dyadic, dyadics, rounded
from persid._files import Json
from persid.certificates.certificate import Certificate
from persid.certificates.curves import (
    INTEGRABLE,
    SECTOR,
    Curve,
    Curves,
    Use,
    curve_of,
    idle_points,
    written_point,
)  # fmt: skip
from persid.certificates.ledger import draft, floats, with_proof
from persid.certificates.outputs import described, with_constants
from persid.certificates.partitions import cuts_of, cuts_of_product
from persid.certificates.stability import largest
from persid.lyapunov.frame import Frame
from persid.lyapunov.operating_points import OperatingPoint
from persid.lyapunov.points import Known, Point, steepness
from persid.lyapunov.practical import Rough
from persid.lyapunov.proposals import Proposal
from persid.lyapunov.reaching import bounded
from persid.lyapunov.shifted_model import place
from persid.lyapunov.unknowns import Label
from persid.models.descriptor import DescriptorModel
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid_check.ledger.assembly import assemble
from persid_check.ledger.file import read_ledger

RISING = ("nondecreasing",)
SHORT = 20  # bits of a bound of slopes


def prove_facts(
    model: PersidskiiModel | DescriptorModel, proposal: Proposal, point: OperatingPoint | None, *, each: bool = False,
    outputs: OutputModel | None = None,
) -> Certificate:  # fmt: skip
    """Return the certificate that the checker accepts: of a region where there are strips, else global.

    With `each` every input has a gain of its own. With a rate it bounds the outputs, if there are any.

    Raises:
        RejectedError: the checker does not accept it.
        RoundingError: a lemma is not proved, or a matrix is not positive definite in floating point.
    """
    content = _content(model, proposal, point, each)
    if outputs is not None and proposal.kappa:
        content = with_constants(with_proof(content | {"outputs": described(outputs)}))
    return Certificate.of(content)


def _content(
    model: PersidskiiModel | DescriptorModel, proposal: Proposal, point: OperatingPoint | None, each: bool
) -> Json:
    frame, n = proposal.frame, proposal.frame.n
    claim = "region" if frame.is_regional else "rate-and-gain" if proposal.kappa else "iss"
    claim = "practical" if isinstance(frame, Rough) else claim
    curves, points, facts, algebraic = _written(proposal)
    absent = [c for c in range(len(frame.model.channels)) if c not in frame.places]
    rows = model.rows if isinstance(model, DescriptorModel) else model
    points += idle_points(curves, rows, absent, place(rows, point, None))
    zero = [i for i in range(n) if i in proposal.zero]
    zero += [n + c for c, at in frame.places.items() if at in proposal.zero]
    content = draft(model, claim, point, curves, points, facts) | {
        "P": _quadratic(proposal),
        "dropped": sorted([*zero, *(n + c for c in absent)]),
        "kappa": dyadic(proposal.kappa),
        "strips": [[[[i, dyadic(r)] for i, r in row.items()], dyadic(lo), dyadic(hi)] for row, lo, hi in frame.strips],
    }
    if frame.order < n:
        content["algebraic"] = algebraic
    if frame.basis and not each:  # in the user's coordinates floating point may not find them
        gamma = dyadic(-_floor(-max(proposal.gamma, 1e-30)))
        p = dyadic(_floor(proposal.least)) if proposal.kappa else [0, 0]
        return with_proof(content | {"gamma": gamma, "p": p})
    return with_proof(content | _numbers(content, frame.is_regional, each))


def _quadratic(proposal: Proposal) -> Json:
    """Return P, with the channels whose values it reads, if there are any."""
    frame = proposal.frame
    rows = [[dyadic(v) for v in line] for line in _entries(proposal)]
    return {"lower": rows, "channels": list(frame.slopes)} if frame.slopes else {"lower": rows}


def _entries(proposal: Proposal) -> list[list[Fraction]]:
    """Return the lower rows of P: a sum of products of rows of the basis."""
    z, frame = proposal.frame.z, proposal.frame
    total: dict[tuple[int, int], Fraction] = {}
    for at, i in enumerate(z):
        for j in z[: at + 1]:
            value = proposal.values.get(("P", j, i), Fraction(0))
            for (a, u), (b, v) in product(frame.unit(i).items(), frame.unit(j).items()):
                for entry in {(a, b), (b, a)} if i != j else {(a, b)}:
                    total[entry] = total.get(entry, Fraction(0)) + value * u * v * (1 + (i != j and a == b))
    return [[total.get((i, j), Fraction(0)) for j in z[: at + 1]] for at, i in enumerate(z)]


def _numbers(draft: Json, regional: bool, each: bool) -> Json:
    """Return gamma, p, and for a region the level and the bound of the inputs, that the matrices just allow."""
    ledger = read_ledger(draft)
    matrices, n = assemble(ledger), ledger.model.order
    inputs = range(ledger.entries, ledger.entries + ledger.inputs)
    M, Pt = floats(matrices.M), floats(matrices.Pt)
    kept = [i for i in range(len(M)) if i not in inputs and i not in set(ledger.dropped)]
    side, inner = M[np.ix_(kept, inputs)], M[np.ix_(kept, kept)]
    scale = 1 / np.sqrt(np.maximum(np.diag(inner), 1e-300))
    scaled = scale[:, None] * side
    own = floats(matrices.M.kept(inputs, inputs) + -matrices.gamma)  # what steps and slopes have of the inputs alone
    stored, largest = _gamma(scaled.T @ np.linalg.solve(scale[:, None] * inner * scale, scaled) - own, each)
    found = {"gamma": stored, "p": dyadic(_floor(_least(Pt, n)))}
    if not regional:
        return found if ledger.kappa else {"gamma": stored}
    inverse, level = np.linalg.inv(Pt), np.inf
    reaches = iter(ledger.algebraic.bounds if ledger.algebraic is not None else ())
    for row, lo, hi in ledger.sides:
        if ledger.is_of_states(row):
            r = np.zeros(n)
            r[list(row)] = [float(v) for v in row.values()]
            share = float(r @ inverse @ r)
        else:
            reach = next(reaches)
            share = float(reach.alpha) + float(reach.beta) * float(ledger.kappa) / largest
        level = min(level, float(min(-lo, hi)) ** 2 / share)
    level *= 1 - SLACK / 64
    bound = _floor(float(np.sqrt(float(ledger.kappa) * level / largest)))
    return found | {"level": dyadic(level, 40), "input_bound": dyadic(bound)}


def _least(Pt: Float[ndarray, "k k"], n: int) -> float:
    """Return the largest p with z'Pt z >= p |x|^2."""
    scale = 1 / np.sqrt(np.maximum(np.diag(Pt), 1e-300))
    inverse = scale[:, None] * np.linalg.inv(scale[:, None] * Pt * scale) * scale
    return float(1 / np.linalg.eigvalsh(inverse[:n, :n])[-1])


def _gamma(least: Float[ndarray, "m m"], each: bool) -> tuple[object, float]:
    """Return Gamma a little above the least one, gamma I or a matrix, as a file has it, and its largest eigenvalue."""
    if each and len(least):
        sizes = np.diag(least)
        above = least + np.diag(SLACK * np.maximum(sizes, 1e-18 * sizes.max(initial=0.0) or 1e-18))
        Gamma = rounded((above + above.T) / 2)
        return {"lower": [dyadics(row[: i + 1]) for i, row in enumerate(Gamma)]}, largest(Gamma)
    gamma = -_floor(-max(float(np.linalg.eigvalsh(least)[-1]), 1e-30)) if len(least) else 1.0
    return dyadic(gamma), gamma


def _value(proposal: Proposal, label: tuple[object, ...]) -> list[int]:
    return dyadic(proposal.values.get(label, Fraction(0)))


@dataclass
class _Used:
    """How each point uses its forms: kinds that will do, and whether as a density."""

    kinds: dict[int, tuple[str, ...]]
    densities: set[int]


def _written(proposal: Proposal) -> tuple[Curves, list[Json], dict[str, list[object]], Json]:
    """Return the curves, the points, the facts of a file, and what it says of equations."""
    frame = proposal.frame
    used = [_Used({}, set()) for _ in frame.points]
    for label in proposal.values:
        for p, k, kinds in _uses(label):
            if used[p].kinds.get(k) != RISING:
                used[p].kinds[k] = kinds
            if label[0] == "mu":
                used[p].densities.add(k)
    curves, points = Curves(), list[Json]()
    at: list[dict[int, int]] = []
    for p, point in enumerate(frame.points):
        forms = sorted(used[p].kinds)
        uses = [_use(point, k, used[p].kinds[k], k in used[p].densities, frame.sloped) for k in forms]
        place, numbers = curves.place(curve_of(point.curve), uses)
        at.append(dict(zip(forms, numbers, strict=True)))
        densities = [[at[p][k], _value(proposal, ("mu", p, k))] for k in sorted(used[p].densities)]
        points.append(written_point(place, point.row, point.channels, densities))
    facts: dict[str, list[object]] = {"value": [], "one_signed": [], "difference": [], "constant": []}
    for label, value in proposal.values.items():
        match label:
            case ("value" | "slope" as kind, p, k, j):
                facts.setdefault(kind, []).append([p, at[p][k], at[p][j], dyadic(value)])
            case ("one_signed", p, k, q, j):
                facts["one_signed"].append([p, at[p][k], q, at[q][j], dyadic(value)])
            case ("constant", p, k, j):
                c = Fraction(frame.constants[p, k, j]) if isinstance(frame, Rough) else Fraction(0)
                listed = curves.add(points[p]["curve"], (at[p][k], at[p][j], c))
                facts["constant"].append([p, listed, dyadic(value)])
            case ("difference" | "step" as kind, p, q, sign, k, j):
                facts.setdefault(kind, []).append([p, q, sign, at[p][k], at[p][j], dyadic(value)])
    if identity := _identity(proposal):
        facts["identity"] = identity
    return curves, points, facts, _equations(proposal, at)


def _identity(proposal: Proposal) -> list[object]:
    """Return the sum of all identities with their multipliers, [i, j, sigma] with i >= j, over all channels."""
    frame = proposal.frame
    channels = {at: frame.n + c for c, at in frame.places.items()}
    total: dict[tuple[int, int], Fraction] = {}
    for k, identity in enumerate(frame.identities):
        tau = proposal.values.get(("identity", k), Fraction(0))
        for i, j, sigma in identity if tau else ():
            a, b = sorted((channels.get(i, i), channels.get(j, j)))
            total[b, a] = total.get((b, a), Fraction(0)) + tau * sigma
    return [[*place, dyadic(value)] for place, value in sorted(total.items()) if value]


def _equations(proposal: Proposal, at: list[dict[int, int]]) -> Json:
    """Return what a file says of equations, of a region with how far points go on their strips."""
    frame = proposal.frame
    count = frame.n - frame.order
    products = [
        [label[1], at[label[1]][label[2]], at[label[1]][label[3]], dyadic(value)]
        for label, value in proposal.values.items()
        if label[0] == "solving" and len(label) == 4
    ]
    solvable = {"multipliers": _rows(proposal, ("solving",), count), "products": products, "proof": []}
    found = {"solvable": solvable, "equations": _rows(proposal, ("equation",), count)}
    return found | (
        {"bounds": [_reach(proposal, k, at) for k in range(len(bounded(frame)))]} if frame.is_regional else {}
    )


def _reach(proposal: Proposal, place: int, at: list[dict[int, int]]) -> Json:
    """Return how far the row at a place among those that are bounded goes, and why."""
    facts = [
        [label[2], at[label[2]][label[3]], at[label[2]][label[4]], dyadic(value)]
        for label, value in proposal.values.items()
        if label[:2] == ("reaching", place) and len(label) == 5
    ]
    rows = _rows(proposal, ("reaching", place), proposal.frame.n - proposal.frame.order)
    alpha, beta = (_value(proposal, (name, place)) for name in ("alpha", "beta"))
    return {"equations": rows, "value": facts, "alpha": alpha, "beta": beta, "proof": []}


def _rows(proposal: Proposal, name: Label, count: int) -> list[list[list[Any]]]:
    """Return the rows of multipliers of so many equations, by labels (*name, equation, entry)."""
    frame, rows = proposal.frame, [list[Any]() for _ in range(count)]
    channels = {at: frame.n + c for c, at in frame.places.items()}
    ahead = frame.n + len(frame.model.channels) - frame.entries
    for label, value in proposal.values.items():
        if label[: len(name)] == name and len(label) == len(name) + 2:
            *_, h, i = label
            place = i if i < frame.n else channels.get(i, i + ahead)
            rows[h].append([place, dyadic(value)])
    return [sorted(row) for row in rows]


def _uses(label: Label) -> list[tuple[int, int, tuple[str, ...]]]:
    """Return the points and forms that an unknown reads, with the kinds that will do."""
    match label:
        case ("mu", p, k):
            return [(p, k, SECTOR)]
        case ("value" | "constant", p, k, j):
            return [(p, k, SECTOR), (p, j, SECTOR)]
        case ("reaching", _, q, k, j):
            return [(q, k, SECTOR), (q, j, SECTOR)]
        case ("one_signed", p, k, q, j):
            return [(p, k, ("one-signed",)), (q, j, ("one-signed",))]
        case ("slope", p, k, j) | ("solving", p, k, j):
            return [(p, k, RISING), (p, j, RISING)]
        case ("difference" | "step", p, q, _, k, j):
            return [(p, k, RISING), (p, j, RISING), (q, k, RISING), (q, j, RISING)]
    return []


def _use(point: Point, k: int, kinds: tuple[str, ...], density: bool, sloped: bool) -> Use:
    known = point.forms[k]
    form = tuple(Fraction(v) for v in known.form)
    square = Fraction(known.square) if sloped else Fraction(0)
    if known.kind == "offset":
        c = Fraction(known.c) if density else None
        return Use(form, c, kinds=("offset",), offset=Fraction(known.offset), e=Fraction(known.e))
    return Use(form, Fraction(known.c), Fraction(known.d), False, kinds, square) if density else Use(form, kinds=kinds)


def proved(point: Point, order: int | None = None) -> Point:
    """Return the point with what is proved of its forms: others leave it, constants that are not proved weaken.

    Where its row reads more than the first `order` variables no form is a density: no bound of an integral is proved.
    """
    curve, loose = curve_of(point.curve), order is not None and any(i >= order for i in point.row)
    forms = (replace(form, c=np.nan) if loose else form for form in point.forms)
    return replace(point, forms=tuple(found for form in forms if (found := _proved(curve, form)) is not None))


def with_proved(frame: Frame) -> Frame:
    """Return the frame with what is proved of the forms of its points."""
    return replace(frame, points=tuple(proved(point, frame.order) for point in frame.points))


def proved_far(frame: Rough) -> Rough:
    """Return a frame with the forms that are proved to have their offsets; what is no density then is none."""
    points = []
    for point in frame.points:
        curve = curve_of(point.curve)
        forms = (form if form.kind != "offset" else _proved_far(curve, form) for form in point.forms)
        points.append(replace(point, forms=tuple(form for form in forms if form is not None)))
    found = replace(frame, points=tuple(points))
    return replace(found, constants={place: c for place, c in found.constants_seen.items() if _holds(found, place, c)})


@lru_cache(maxsize=8192)
def _proved_far(curve: Curve, known: Known) -> Known | None:
    form = tuple(Fraction(v) for v in known.form)
    if cuts_of(curve.lemma(form, "offset", allowance=Fraction(known.offset)), None) is None:
        return None
    if not np.isfinite(known.c):
        return known
    upper = curve.lemma(form, "upper", c=Fraction(known.c), allowance=Fraction(known.e))
    return known if cuts_of(upper, None) is not None else replace(known, c=np.nan, e=0.0)


def _holds(frame: Rough, place: tuple[int, int, int], c: float) -> bool:
    p, k, j = place
    point = frame.points[p]
    first, second = (tuple(Fraction(v) for v in point.forms[i].form) for i in (k, j))
    return cuts_of_product(curve_of(point.curve).product(first, second, Fraction(c))) is not None


def with_squares(point: Point) -> Point:
    """Return the point with bounds of integrals by squares of their own forms, where such are proved."""
    curve = curve_of(point.curve)
    forms = [replace(form, square=_square(curve, point, k)) for k, form in enumerate(point.forms)]
    return replace(point, forms=tuple(forms))


def _square(curve: Curve, point: Point, k: int) -> float:
    """Return d with e_0 - d l nondecreasing: 1 over the largest slope, as far as it is proved; else 0."""
    known = point.forms[k]
    reads = {c for c, v in zip(point.channels, known.form[1:], strict=True) if v}
    if known.kind not in RISING or not np.isfinite(known.c) or not reads <= set(point.restricted):
        return 0.0
    steepest = steepness(point.curve, known.form)
    for share in (1.0, 1.0 - SLACK) if np.isfinite(steepest) and steepest > 0 else ():
        use = Use(tuple(Fraction(v) for v in known.form), square=Fraction(_floor_to(share / steepest)))
        if use.below is not None and cuts_of(curve.lemma(use.below[1], "nondecreasing"), curve.domain) is not None:
            return float(use.square)
    return 0.0


def _floor_to(number: float) -> float:
    """Round down to some bits."""
    unit = np.exp2(np.floor(np.log2(number)) - SHORT)
    return float(np.floor(number / unit) * unit)


@lru_cache(maxsize=8192)
def _proved(curve: Curve, known: Known) -> Known | None:
    form = tuple(Fraction(v) for v in known.form)
    kinds = (known.kind,) if known.kind == "one-signed" else SECTOR[SECTOR.index(known.kind) :]
    kind = next((kind for kind in kinds if cuts_of(curve.lemma(form, kind), curve.domain) is not None), None)
    if kind is None:
        return None
    free = 1.0 if kind == "nondecreasing" else np.nan
    c = known.c if known.c == 0.5 and not any(form[1:]) else _upper(curve, form, known.c, free)
    d = known.d if known.d and _lower(curve, form, Fraction(known.d)) else 0.0
    return Known(known.form, kind, c, d)


def _upper(curve: Curve, form: tuple[Fraction, ...], c: float, free: float) -> float:
    """Return c if it is proved, else what needs no proof."""
    if not np.isfinite(c) or c >= free:
        return free
    return c if cuts_of(curve.lemma(form, "upper", c=Fraction(c)), curve.domain) is not None else free


def _lower(curve: Curve, form: tuple[Fraction, ...], d: Fraction) -> bool:
    below = (form[0] - d, *form[1:])
    return any(cuts_of(curve.lemma(below, kind), curve.domain) is not None for kind in INTEGRABLE)
