# ruff: noqa: E741 (l is the letter of the mathematics)
"""A maker of ledgers for the tests: curves with partitions, a program by cvxpy, rounded; nothing is trusted."""

import copy
import json
import warnings
from dataclasses import dataclass, field
from fractions import Fraction
from typing import Any

import numpy as np

from checker.maker import model as model_object
from persid._dyadics import dyadic
from persid.certificates.curves import written_cuts
from persid.certificates.ledger import floats, with_proof
from persid.certificates.outputs import steepness, with_constants
from persid.certificates.partitions import cuts_of, cuts_of_continuity
from persid_check import canonical_model, model_sha256
from persid_check.expression import parse
from persid_check.ledger.assembly import assemble
from persid_check.ledger.file import read_ledger
from persid_check.ledger.lemmas import Lemma, Product
from persid_check.model import sha256_of
from persid_check.outputs import FIELDS
from persid_check.outputs import FORMAT as OUTPUT_FORMAT

GRID = 2**24
ZERO = [0, 0]


def number(value: Any) -> list[int]:
    """A dyadic of a float or a fraction."""
    return dyadic(Fraction(value))


@dataclass
class Sketch:
    """Curves, points and facts without multipliers: each fact and each density gets its own."""

    model: dict[str, Any]
    curves: list[dict[str, Any]]
    points: list[dict[str, Any]]
    facts: list[tuple[Any, ...]]
    claim: str = "iss"
    kappa: Any = 0
    full: bool = True
    more: dict[str, Any] = field(default_factory=dict)
    inside: tuple[int, ...] = ()


def form(functions: list[tuple[str, Any]], l: Any, kind: str, **numbers: Any) -> dict[str, Any]:
    """A form with its partition; a false one gets the cuts -1, 0, 1."""
    shift, domain = numbers.pop("shift", None), numbers.pop("domain", None)
    programs = tuple((parse(text), Fraction(a)) for text, a in functions)
    centre = None
    if isinstance(shift, tuple):
        centre = (Fraction(shift[0]) - Fraction(shift[1]), Fraction(shift[0]) + Fraction(shift[1]))
    ends = None if domain is None else (Fraction(domain[0]), Fraction(domain[1]))
    row = tuple(Fraction(v) for v in l)

    def cuts(what: str, **values: Fraction) -> list[Any]:
        found = cuts_of(Lemma(programs, row, what, centre, **values), ends)
        return [0, [-1, 0, 1]] if found is None else written_cuts(found)

    offset, upper, lower = Fraction(numbers.get("offset", 0)), numbers.get("upper"), numbers.get("lower")
    entry: dict[str, Any] = {"l": [number(v) for v in row], "is": kind, "cuts": cuts(kind, allowance=offset)}
    entry["offset"] = number(offset)
    entry["upper"] = None
    if upper is not None:
        c, e = (Fraction(v) for v in upper)
        free = (kind in ("nondecreasing", "rising") and c >= 1) or (not any(row[1:]) and c >= Fraction(1, 2))
        entry["upper"] = [number(c), number(e), None if free and not e else cuts("upper", c=c, allowance=e)]
    entry["lower"] = None if lower is None else [number(lower[0]), lower[1]]
    return entry


def curve(functions: list[tuple[str, Any]], *forms: tuple[Any, ...], **about: Any) -> dict[str, Any]:
    """A curve of texts with factors; a form is (l, kind) or (l, kind, numbers)."""
    shift, domain = about.get("shift"), about.get("domain")
    programs = tuple((parse(text), Fraction(a)) for text, a in functions)
    middle, radius = (Fraction(v) for v in shift) if isinstance(shift, tuple) else (Fraction(0), Fraction(0))
    ends = None if domain is None else (middle - radius + Fraction(domain[0]), middle + radius + Fraction(domain[1]))
    continuous = cuts_of_continuity(programs, ends)
    made = [
        form(functions, l, kind, shift=shift, domain=domain, **(numbers[0] if numbers else {}))
        for l, kind, *numbers in forms
    ]
    return {
        "functions": [[text, number(a)] for text, a in functions],
        "shift": [number(v) for v in shift] if isinstance(shift, tuple) else shift,
        "domain": None if domain is None else [number(v) for v in domain],
        "continuous": [0, [-1, 1]] if continuous is None else written_cuts(continuous),
        "forms": made,
        "products": [
            [k, q, number(c), product_cuts(programs, forms[k][0], forms[q][0], c)]
            for k, q, c in about.get("products", ())
        ],
    }


def product_cuts(programs: Any, k: Any, q: Any, c: Any) -> list[Any]:
    """Equal pieces on which a product with a constant is proved, or -1, 1."""
    rows = tuple(Fraction(v) for v in k), tuple(Fraction(v) for v in q)
    product = Product(programs, rows, Fraction(c))
    for reach in (2, 4, 8):
        for count in (16, 64, 256, 1024):
            cuts = tuple(Fraction(-reach) + Fraction(2 * reach * i, count) for i in range(count + 1))
            if product.unproved(cuts) is None:
                return written_cuts(cuts)
    return [0, [-1, 1]]


def point(curve: int, row: dict[int, Any], channels: list[int], densities: list[int]) -> dict[str, Any]:
    """A point with densities of multiplier 0."""
    return {"curve": curve, "row": [[i, number(v)] for i, v in row.items()], "channels": channels,
            "densities": [[k, ZERO] for k in densities]}  # fmt: skip


def draft(sketch: Sketch) -> dict[str, Any]:
    """The content with all multipliers 0."""
    facts: dict[str, list[Any]] = {"value": [], "one_signed": [], "difference": [], "constant": []}
    for kind, *places in sketch.facts:
        facts.setdefault(kind, []).append([*places, ZERO])
    n = len(sketch.model["states"]) + len(sketch.inside)
    P: dict[str, Any] = {"lower": [[ZERO] * (i + 1) for i in range(n)]} if sketch.full else {"diagonal": [ZERO] * n}
    return {
        "format": "persid-certificate-2", "claim": sketch.claim, "statement": "for people",
        "model_sha256": model_sha256(sketch.model), "model": canonical_model(sketch.model), "operating_point": None,
        "curves": copy.deepcopy(sketch.curves), "points": copy.deepcopy(sketch.points), "facts": facts,
        "P": P | ({"channels": list(sketch.inside)} if sketch.inside else {}),
        "gamma": ZERO, "deviations": [], "dropped": [],
        "spanning": [], "kappa": number(sketch.kappa), "p": ZERO, "strips": [], "level": ZERO, "input_bound": ZERO,
        "outputs": [], "proof": {"P": [], "M": [], "V": None},
    } | copy.deepcopy(sketch.more)  # fmt: skip


def _places(content: dict[str, Any], sketch: Sketch) -> list[tuple[Any, ...]]:
    """The places of the unknowns: entries of P, densities, facts."""
    found: list[tuple[Any, ...]] = []
    for i, row in enumerate(next(iter(content["P"].values()))):
        found += [("P", "lower", i, j) for j in range(len(row))] if sketch.full else [("P", "diagonal", i)]
    for p, each in enumerate(content["points"]):
        found += [("points", p, "densities", i, 1) for i in range(len(each["densities"]))]
    for kind, listed in content["facts"].items():
        found += [("facts", kind, i, len(entry) - 1) for i, entry in enumerate(listed)]
    return [*found, *(("deviations", j, "s") for j in range(len(content["deviations"])))]


def setting(content: dict[str, Any], place: tuple[Any, ...], value: Any) -> None:
    """Set one place of a content."""
    at: Any = content
    for key in place[:-1]:
        at = at[key]
    at[place[-1]] = value


def solved(sketch: Sketch, ratio: float = 1e4) -> dict[str, Any]:
    """A ledger whose multipliers make the margin large with gamma <= ratio; accepted or not, the checker says."""
    import cvxpy as cp

    base = draft(sketch)
    places = _places(base, sketch)
    basis = []
    for place in places:
        content = copy.deepcopy(base)
        setting(content, place, [1, 0])
        basis.append([floats(part) for part in (assemble(read_ledger(content)).M, assemble(read_ledger(content)).Pt)])
    content = copy.deepcopy(base)
    content["gamma"] = [1, 0]
    corner = floats(assemble(read_ledger(content)).M)
    y, t, gamma = cp.Variable(len(places)), cp.Variable(), cp.Variable()
    M = sum(y[k] * part[0] for k, part in enumerate(basis)) + gamma * corner
    Pt = sum(y[k] * part[1] for k, part in enumerate(basis))
    kept = [i for i in range(len(corner)) if i not in base["dropped"]]
    constraints = [gamma <= ratio, cp.norm_inf(y) <= 100]
    constraints.append(M[kept, :][:, kept] - t * np.eye(len(kept)) >> 0)
    constraints.append(Pt - t * np.eye(Pt.shape[0]) >> 0)
    signed = [k for k, place in enumerate(places) if place[0] != "P"]
    constraints += [y[signed] >= 0] if signed else []
    scale = [k for k, place in enumerate(places) if place[0] == "P" and (not sketch.full or place[2] == place[3])]
    scale += [k for k, place in enumerate(places) if place[0] == "points"]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # an inaccurate solution is as good as any: the checker decides
        cp.Problem(cp.Maximize(t), [*constraints, cp.sum(y[scale]) <= 1]).solve(solver=cp.CLARABEL)
    for place, value in zip(places, y.value, strict=True):
        value = value if place[0] == "P" else max(value, 0.0)
        setting(content, place, number(Fraction(round(value * GRID), GRID)))
    content["gamma"] = number(Fraction(round(float(gamma.value) * GRID) + 1, GRID))
    if sketch.claim != "iss":
        Pt = floats(assemble(read_ledger(content)).Pt)
        content["p"] = number(Fraction(round(0.9 * np.linalg.eigvalsh(Pt)[0] * GRID), GRID))
    return with_proof(content)


def seeing(content: dict[str, Any], **outputs: tuple[Any, ...]) -> dict[str, Any]:
    """A ledger that bounds outputs, by name: (row of C, row of D, map) or (row of C, row of D)."""
    rows = [[[float(v).hex() for v in row] for row in (each[0], each[1])] for each in outputs.values()]
    maps = [each[2] for each in outputs.values() if len(each) > 2]
    block = {
        "outputs": list(outputs), "C": [C for C, _ in rows], "D": [D for _, D in rows],
        "d": [(0.5).hex()] * len(rows), "output_map": maps or None, "constants": [ZERO] * len(rows),
        "lipschitz": [steepness(text) for text in maps] or None,
    }  # fmt: skip
    return with_constants(with_proof(rehashed(content | {"outputs": block})))


def rehashed(content: dict[str, Any]) -> dict[str, Any]:
    """The same with the hash of what the outputs have become."""
    form = {name: content["outputs"][name] for name in FIELDS}
    stated = sha256_of({"format": OUTPUT_FORMAT, "dynamics": content["model"], **form})
    return content | {"outputs": content["outputs"] | {"sha256": stated}}


def data(content: dict[str, Any]) -> bytes:
    """The bytes of a ledger."""
    return json.dumps(content).encode()


__all__ = ["Sketch", "curve", "data", "draft", "model_object", "number", "point", "setting", "solved"]
