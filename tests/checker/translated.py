"""Files of version 1 as ledgers with the same claim: good ledgers for the tests of the checker."""

from collections.abc import Iterator
from fractions import Fraction
from typing import Any

from persid._dyadics import dyadic, exact
from persid.certificates.curves import Curve, Curves, Use, written_point
from persid.certificates.ledger import with_proof
from persid_check.ledger import FORMAT
from persid_check.model import Model, model_of
from persid_check.subject import Group, groups_of
from persid_check.version_1.format import WORDS

Json = dict[str, Any]
ZERO = Fraction(0)


def as_ledger(content: Json) -> Json:
    """The content of format 2 that claims what a content of format 1 claims; the factors of its rows are dyadic."""
    model, claim = model_of(content["model"]), content["claim"]
    curves, points, facts = Curves(), [], []
    for g, (group, stored) in enumerate(zip(groups_of(model), content["groups"], strict=True)):
        place, at = curves.place(_curve(content, model, group), list(_uses(claim, stored)))
        densities = [[at[k], mu] for k, mu in enumerate(stored["mu"]) if mu[0]]
        points.append(written_point(place, group.row, [c for c, _ in group.members], densities))
        facts += [[g, at[k], at[j], tau] for k, j, tau in stored["products"]]
    rated, regional, written = claim in ("E", "R"), claim == "R", curves.written()
    numbers = {
        name: content[name] if asked else [0, 0]
        for name, asked in (("kappa", rated), ("p", rated), ("level", regional), ("input_bound", regional))
    }
    same = ("statement", "model_sha256", "model", "operating_point", "P", "gamma", "dropped")
    draft = (
        {name: content[name] for name in same}
        | numbers
        | {
            "format": FORMAT,
            "claim": WORDS[claim],
            "curves": written,
            "points": points,
            "facts": {"value": facts, "one_signed": [], "difference": [], "constant": []},
            "deviations": [],
            "spanning": _spanning(content, model, points, written),
            "strips": _strips(content, model, points, written) if regional else [],
            "outputs": [],
            "proof": {"P": [], "M": [], "V": None},
        }
    )
    return with_proof(draft)


def _curve(content: Json, model: Model, group: Group) -> Curve:
    shift, domain, point = None, None, content["operating_point"]
    if point is not None:
        center = sum((r * (exact(point["x"][i]) - model.x_ref[i]) for i, r in group.row.items()), ZERO)
        shift = (center, sum((abs(r) for r in group.row.values()), ZERO) * exact(point["radius"]))
    if content["claim"] == "R":
        box = _relative_box(content, model)
        sides = [sorted((r * box[i][0], r * box[i][1])) for i, r in group.row.items()]
        domain = (sum((s[0] for s in sides), ZERO), sum((s[1] for s in sides), ZERO))
        domain = domain if sides else (Fraction(-1), Fraction(1))
    return Curve(tuple((model.channels[c].text, alpha) for c, alpha in group.members), shift, domain)


def _uses(claim: str, stored: Json) -> Iterator[Use]:
    none = [None] * len(stored["forms"])
    bounds = zip(stored.get("integral", none), stored.get("quadratic", none), strict=True)
    for pairs, mu, (c, d) in zip(stored["forms"], stored["mu"], bounds, strict=True):
        form = tuple(exact(v) for v in pairs)
        yield Use(form, c and exact(c), exact(d) if d else ZERO, claim == "M") if mu[0] else Use(form)


def _relative_box(content: Json, model: Model) -> list[tuple[Fraction, Fraction]]:
    point = content["operating_point"]
    center = model.x_ref if point is None else [exact(v) for v in point["x"]]
    radius = ZERO if point is None else exact(point["radius"])
    return [
        (exact(lo) - x + radius, exact(hi) - x - radius) for (lo, hi), x in zip(content["box"], center, strict=True)
    ]


def _strips(content: Json, model: Model, points: list[Json], curves: list[Json]) -> list[object]:
    sides = [([[i, [1, 0]]], [dyadic(lo), dyadic(hi)]) for i, (lo, hi) in enumerate(_relative_box(content, model))]
    standing = [(point["row"], curves[point["curve"]]["domain"]) for point in points]
    return [[row, *ends] for row, ends in sides if (row, ends) not in standing]


def _spanning(content: Json, model: Model, points: list[Json], curves: list[Json]) -> list[list[int]]:
    dropped, found = set(content["dropped"]), []
    if not any(i < model.n for i in dropped):
        return []
    for p, point in enumerate(points):
        for k, _ in point["densities"]:
            form = curves[point["curve"]]["forms"][k]["l"]
            reads = {model.n + c for c, v in zip(point["channels"], form[1:], strict=True) if v[0]}
            reads |= {i for i, _ in point["row"]} if form[0][0] else set()
            if not reads & dropped:
                found.append([p, k])
                break
    return found
