"""certificate.json, format 2, as values: every field is read here, and what is not specified is refused.

Section 8 of the specification (docs/ledger.md). Nothing is expanded: what is read is as long as the file.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from persid_check.definite import Root
from persid_check.entry import MAX_BITS, Entry, Factor, Row, dyadic
from persid_check.expression import MAX_LENGTH_WITH_TABLES, Program
from persid_check.ledger import COMPANION, FORMAT
from persid_check.ledger.lemmas import Cuts
from persid_check.ledger.values import (
    Algebraic,
    Curve,
    Deviation,
    Fact,
    Form,
    Ledger,
    Map,
    Output,
    Outputs,
    Point,
    ProductForm,
    Reach,
    Upper,
)
from persid_check.model import ALGEBRAIC, Model, read_model
from persid_check.outputs import FIELDS as OUTPUT_FIELDS
from persid_check.outputs import read_outputs, require_stated
from persid_check.reading import MAX_FORMS, read_ball, read_gamma, read_P

if TYPE_CHECKING:
    from persid_check.companion import Arrays
    from persid_check.exact import Matrix

CLAIMS = ("iss", "rate-and-gain", "region", "practical")
KINDS = ("sector", "growing", "nondecreasing", "rising", "one-signed", "offset")
ENTRIES_OF_A_FACT = {"value": 4, "one_signed": 5, "difference": 6, "constant": 3}
MORE_FACTS = {"slope": 4, "step": 6}  # lists that a file may lack
MAX_FUNCTIONS, MAX_CURVES, MAX_POINTS = 3000, 3000, 10000

FIELDS = (
    "format", "claim", "statement", "model_sha256", "model", "operating_point", "curves", "points", "facts", "P",
    "gamma", "deviations", "dropped", "spanning", "kappa", "p", "strips", "level", "input_bound", "outputs", "proof",
)  # fmt: skip


def read_ledger(data: Mapping[str, object], arrays: "Arrays | None" = None) -> Ledger:
    """Return the value of a certificate's JSON object; what its companion holds is in the arrays.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    stated = data.get("model")
    equations = isinstance(stated, dict) and ALGEBRAIC in stated
    given = Entry(data).fields((*FIELDS, *[ALGEBRAIC] * equations), [COMPANION] * (not equations))
    given["format"].require(given["format"].value == FORMAT, f'"{FORMAT}" is needed')
    if equations:
        none = given["outputs"].value == given["deviations"].value == []
        given[ALGEBRAIC].require(none, "a model with algebraic variables has no outputs and no deviations here")
    claim = given["claim"].one_of(CLAIMS)
    given["statement"].text(5000)
    form: Any = _filled(stated, arrays) if arrays else stated
    model = read_model(Entry(form, "model"), discrete=True, algebraic=True)
    point = given["operating_point"]
    ball = None if point.value is None else read_ball(point, model)
    v, entries = model.m + (ball is None and any(model.b)), model.n + len(model.channels)
    curves = tuple(map(_curve, given["curves"].items(longest=MAX_CURVES)))
    points = tuple(_point(each, curves, model) for each in given["points"].items(longest=MAX_POINTS))
    P, inside = _inside(given["P"], len(model.channels))
    diagonal, P_rows = read_P(P, model.order + len(inside))
    facts = given["facts"].fields(tuple(ENTRIES_OF_A_FACT), (*MORE_FACTS, "identity"))
    return Ledger(
        claim=claim,
        sha256=given["model_sha256"].text(64),
        form=form,
        model=model,
        ball=ball,
        curves=curves,
        points=points,
        facts=_facts(facts, curves, points),
        identity=_identity(facts["identity"], entries) if "identity" in facts else (),
        diagonal=diagonal,
        P=P_rows,
        inside=inside,
        gamma=read_gamma(given["gamma"], v),
        deviations=tuple(_deviation(each, model.n, entries + v) for each in given["deviations"].items()),
        dropped=given["dropped"].indices(entries),
        spanning=tuple(_spanning(each, curves, points) for each in given["spanning"].items()),
        kappa=given["kappa"].dyadic(),
        p=given["p"].dyadic(),
        strips=tuple(_strip(each, model.n) for each in given["strips"].items()),
        level=given["level"].dyadic(),
        input_bound=given["input_bound"].dyadic(),
        outputs=_outputs(given["outputs"], form, model) if given["outputs"].value != [] else None,
        proof=_proof(given["proof"], arrays or {}),
        algebraic=_algebraic(given[ALGEBRAIC], curves, points, model, v, claim) if equations else None,
    )


def _inside(P: Entry, count: int) -> tuple[Entry, tuple[int, ...]]:
    """Return P without its channels, and these."""
    if not isinstance(P.value, dict) or "channels" not in P.value:
        return P, ()
    channels = P.fields(("lower", "channels"))["channels"]
    inside = tuple(each.index(count) for each in channels.items())
    rise = inside and all(a < b for a, b in pairwise(inside))
    channels.require(rise, "channels rise, and there is one at least")
    return Entry({"lower": P.value["lower"]}, "P"), inside


def _cuts(entry: Entry) -> Cuts:
    exponent, listed = entry.items(2)
    cuts = [m.integer(MAX_BITS) for m in listed.items()]
    entry.require(cuts and all(a < b for a, b in pairwise(cuts)), "cuts rise, and there is one at least")
    e = exponent.exponent()
    return tuple(dyadic(m, e) for m in cuts)


def _curve(entry: Entry) -> Curve:
    given = entry.fields(("functions", "shift", "domain", "continuous", "forms", "products"))
    functions = tuple(map(_function, given["functions"].items(longest=MAX_FUNCTIONS)))
    rows = given["forms"].items(longest=MAX_FORMS)
    forms = tuple(_form(row, 1 + len(functions), len(rows)) for row in rows)
    products = tuple(_product(row, len(forms)) for row in given["products"].items(longest=MAX_FORMS))
    domain = None if given["domain"].value is None else _pair(given["domain"])
    return Curve(functions, _shift(given["shift"]), domain, _cuts(given["continuous"]), forms, products)


def _function(entry: Entry) -> tuple[Program, Fraction]:
    text, factor = entry.items(2)
    text.text(MAX_LENGTH_WITH_TABLES)
    alpha = factor.dyadic()
    factor.require(alpha != 0, "a factor is not 0")
    return text.program(), alpha


def _pair(entry: Entry) -> tuple[Fraction, Fraction]:
    first, second = entry.dyadics(2)
    return first, second


def _shift(entry: Entry) -> tuple[Fraction, Fraction] | str | None:
    if entry.value is None or entry.value == "any":
        return None if entry.value is None else "any"
    center, radius = entry.items(2)
    return center.dyadic(), radius.nonnegative()


def _form(entry: Entry, size: int, count: int) -> Form:
    given = entry.fields(("l", "is", "cuts", "offset", "upper", "lower"))
    kind, offset = given["is"].one_of(KINDS), given["offset"].nonnegative()
    upper, lower = given["upper"], given["lower"]
    given["offset"].require(not offset or kind == "offset", "only an offset form has one")
    return Form(
        given["l"].dyadics(size),
        kind,
        _cuts(given["cuts"]),
        offset,
        None if upper.value is None else _upper(upper),
        None if lower.value is None else _lower(lower, count),
    )


def _upper(entry: Entry) -> Upper:
    c, e, cuts = entry.items(3)
    return Upper(c.nonnegative(), e.nonnegative(), None if cuts.value is None else _cuts(cuts))


def _lower(entry: Entry, count: int) -> tuple[Fraction, int]:
    d, j = entry.items(2)
    return d.nonnegative(), j.index(count)


def _product(entry: Entry, count: int) -> ProductForm:
    k, q, c, cuts = entry.items(4)
    return ProductForm(k.index(count), q.index(count), c.dyadic(), _cuts(cuts))


def _point(entry: Entry, curves: Sequence[Curve], model: Model) -> Point:
    given = entry.fields(("curve", "row", "channels", "densities"))
    place = given["curve"].index(len(curves))
    curve = curves[place]
    channels = tuple(c.index(len(model.channels)) for c in given["channels"].items(len(curve.functions)))
    pairs = [pair.items(2) for pair in given["densities"].items()]
    densities = tuple((k.index(len(curve.forms)), mu.nonnegative()) for k, mu in pairs)
    return Point(place, given["row"].row(model.n), channels, densities)


def _identity(entry: Entry, entries: int) -> tuple[tuple[int, int, Fraction], ...]:
    """Return (i, j, sigma), i >= j, each place once at most."""
    listed = [each.items(3) for each in entry.items()]
    found = tuple((i.index(entries), j.index(entries), sigma.dyadic()) for i, j, sigma in listed)
    rise = all(i >= j for i, j, _ in found) and all(a[:2] < b[:2] for a, b in pairwise(found))
    entry.require(rise, "places (i, j) with i >= j rise")
    return found


def _facts(lists: Mapping[str, Entry], curves: Sequence[Curve], points: Sequence[Point]) -> tuple[Fact, ...]:
    widths = (ENTRIES_OF_A_FACT | MORE_FACTS).items()
    listed = ((kind, each.items(width)) for kind, width in widths if kind in lists for each in lists[kind].items())
    return tuple(_fact(kind, each, curves, points) for kind, each in listed)


def _fact(kind: str, entries: Sequence[Entry], curves: Sequence[Curve], points: Sequence[Point]) -> Fact:
    """[p, k, l, tau]; difference, step [p, q, sign, k, l, tau]; one-signed [p, k, q, l, tau]; constant [p, j, tau]."""
    at, *places, tau = entries
    other, sign = at, 0
    if kind == "one_signed":
        other = places.pop(1)
    elif kind in ("difference", "step"):
        other, sign = places.pop(0), _sign(places.pop(0), (1, -1, 0) if kind == "step" else (1, -1))
    p, q = at.index(len(points)), other.index(len(points))
    first, second = (_multiplied(kind, curves[points[i].curve]) for i in (p, q))
    k, l = places[0].index(len(first)), places[-1].index(len(second))  # noqa: E741
    return Fact(kind=kind, p=p, q=q, sign=sign, k=k, l=l, tau=tau.nonnegative())


def _sign(entry: Entry, signs: Sequence[int]) -> int:
    sign = entry.integer(2)
    return sign if sign in signs else entry.refuse("a difference has the sign 1 or -1, a step 0 as well")


def _multiplied(kind: str, curve: Curve) -> Sequence[object]:
    return curve.products if kind == "constant" else curve.forms


def _algebraic(
    entry: Entry, curves: Sequence[Curve], points: Sequence[Point], model: Model, v: int, claim: str
) -> Algebraic:  # fmt: skip
    given = entry.fields(("solvable", "equations", *["bounds"] * (claim == "region")))
    solvable, entries = given["solvable"].fields(("multipliers", "products", "proof")), model.n + len(model.channels)

    def rows(listed: Entry, size: int) -> tuple[Row, ...]:
        return tuple(row.row(size) for row in listed.items(model.algebraic))

    def facts(listed: Entry) -> tuple[Fact, ...]:
        return tuple(_fact("value", each.items(4), curves, points) for each in listed.items())

    def reach(bound: Entry) -> Reach:
        said = bound.fields(("equations", "value", "alpha", "beta", "proof"))
        alpha, beta = said["alpha"].nonnegative(), said["beta"].nonnegative()
        return Reach(rows(said["equations"], entries + v), facts(said["value"]), alpha, beta, said["proof"].factor())

    return Algebraic(
        rows(solvable["multipliers"], entries),
        facts(solvable["products"]),
        solvable["proof"].factor(),
        rows(given["equations"], entries + v),
        tuple(map(reach, given["bounds"].items())) if "bounds" in given else (),
    )


def _deviation(entry: Entry, n: int, size: int) -> Deviation:
    given = entry.fields(("columns", "C", "s", "epsilon"))
    columns, C = (tuple(row.row(of) for row in given[name].items()) for name, of in (("columns", n), ("C", size)))
    return Deviation(columns, C, given["s"].dyadic(), given["epsilon"].nonnegative())


def _spanning(entry: Entry, curves: Sequence[Curve], points: Sequence[Point]) -> tuple[int, int]:
    at, k = entry.items(2)
    p = at.index(len(points))
    return p, k.index(len(curves[points[p].curve].forms))


def _strip(entry: Entry, n: int) -> tuple[Row, Fraction, Fraction]:
    row, lo, hi = entry.items(3)
    return row.row(n), lo.dyadic(), hi.dyadic()


def _outputs(entry: Entry, form: Mapping[str, object], model: Model) -> Outputs:
    block = entry.fields(("sha256", *OUTPUT_FIELDS, "constants", "lipschitz"))
    found, stated = read_outputs(block, model.n, model.m), require_stated(block, form)
    rows = [{i: v for i, v in enumerate(row) if v} for row in found.C]
    maps = _maps(found.maps, block["lipschitz"], len(rows))
    entries = zip(found.names, rows, found.D, block["constants"].dyadics(len(rows)), maps, strict=True)
    return Outputs(stated, tuple(Output(*each) for each in entries))


def _maps(programs: Sequence[Program] | None, bounds: Entry, count: int) -> Sequence[Map | None]:
    fits = (programs is None) == (bounds.value is None)
    bounds.require(fits, "null without output_map, else a bound with cuts for each output")
    if programs is None:
        return [None] * count
    pairs = [each.items(2) for each in bounds.items(count)]
    return [Map(h, L.nonnegative(), _cuts(cuts)) for h, (L, cuts) in zip(programs, pairs, strict=True)]


def _proof(entry: Entry, arrays: "Arrays") -> dict[str, Factor | Root]:
    given = entry.fields(("P", "M", "V"))
    found = {name: _root(given[name], arrays) for name in ("P", "M")}
    return found | {"V": () if given["V"].value is None else given["V"].factor()}


def _root(entry: Entry, arrays: "Arrays") -> Factor | Root:
    """Return a factor T by rows, or a root: its L by rows, or the name of an array of a companion."""
    if not isinstance(entry.value, dict):
        return entry.factor()
    given = entry.fields(("shifts", "bits", "L"))
    shifts, L = tuple(shift.exponent() for shift in given["shifts"].items()), given["L"]
    lower = _lower_array(L, arrays, len(shifts)) if isinstance(L.value, str) else L.factor()
    return Root(shifts, given["bits"].exponent(), lower)


def _filled(form: object, arrays: "Arrays") -> object:
    from persid_check.ledger.arrays import filled

    return filled(form, arrays)


def _lower_array(L: Entry, arrays: "Arrays", size: int) -> "Matrix":
    from persid_check.ledger.arrays import lower_array

    return lower_array(L, arrays, size)
