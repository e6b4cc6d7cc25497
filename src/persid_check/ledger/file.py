"""certificate.json, format 2, as values: every field is read here, and what is not specified is refused.

Section 8 of the specification (docs/ledger.md). Nothing is expanded: what is read is as long as the file.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

from persid_check.definite import Root
from persid_check.expression import MAX_LENGTH_WITH_TABLES, ExpressionError, Program, parse
from persid_check.fields import ALGEBRAIC
from persid_check.ledger import FORMAT
from persid_check.ledger.lemmas import Cuts, positions
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
    Row,
    Upper,
)
from persid_check.model import Model
from persid_check.outputs import FIELDS as OUTPUT_FIELDS
from persid_check.outputs import read_stated, rows_of
from persid_check.reading import (
    MAX_BITS,
    MAX_EXPONENT,
    MAX_FORMS,
    Factor,
    filled,
    read_ball,
    read_dropped,
    read_dyadic,
    read_dyadics,
    read_factor,
    read_gamma,
    read_index,
    read_integer,
    read_list,
    read_nonnegative,
    read_object,
    read_P,
    read_root,
    read_row,
    read_text,
    read_written,
)
from persid_check.results import FormatError

if TYPE_CHECKING:
    from persid_check.companion import Arrays

COMPANION = "companion"  # the one field that a file may lack
CLAIMS = ("iss", "rate-and-gain", "region", "practical")
KINDS = ("sector", "growing", "nondecreasing", "rising", "one-signed", "offset")
ENTRIES_OF_A_FACT = {"value": 4, "one_signed": 5, "difference": 6, "constant": 3, "slope": 4}
OPTIONAL_FACTS = ("slope", "identity")  # that a file may lack

FIELDS = (
    "format", "claim", "statement", "model_sha256", "model", "operating_point", "curves", "points", "facts", "P",
    "gamma", "deviations", "dropped", "spanning", "kappa", "p", "strips", "level", "input_bound", "outputs", "proof",
)  # fmt: skip


def read_ledger(data: object, arrays: "Arrays | None" = None) -> Ledger:
    """Return the value of a certificate's JSON object; what its companion holds is in the arrays.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    stated = data.get("model") if isinstance(data, dict) else None
    equations = isinstance(stated, dict) and ALGEBRAIC in stated
    companion = isinstance(data, dict) and COMPANION in data and not equations
    data = read_object("file", data, (*FIELDS, *[COMPANION] * companion, *[ALGEBRAIC] * equations))
    if data["format"] != FORMAT:
        raise FormatError("format", f'"{FORMAT}" is needed')
    if equations and (data["outputs"] != [] or data["deviations"] != []):
        raise FormatError("outputs, deviations", "a model with algebraic variables has none here")
    claim = _one_of("claim", data["claim"], CLAIMS)
    read_text("statement", data["statement"], 5000)
    sha256 = read_text("model_sha256", data["model_sha256"], 64)
    form: Any = filled(data["model"], arrays or {})
    model = read_written(form, discrete=True, algebraic=True)
    n, m, entries = model.n, model.m, model.n + len(model.channels)
    ball = None if data["operating_point"] is None else read_ball("operating_point", data["operating_point"], model)
    v = m + (ball is None and any(model.b))
    curves = tuple(_curve(f"curves[{i}]", value) for i, value in enumerate(_short("curves", data["curves"], 3000)))
    points = tuple(
        _point(f"points[{i}]", value, curves, model) for i, value in enumerate(_short("points", data["points"], 10000))
    )
    stored, inside = _inside(data["P"], len(model.channels))
    diagonal, P = read_P(stored, model.order + len(inside))
    return Ledger(
        claim=claim,
        sha256=sha256,
        form=form,
        model=model,
        ball=ball,
        curves=curves,
        points=points,
        facts=_facts(data["facts"], curves, points),
        identity=_identity(data["facts"], entries),
        diagonal=diagonal,
        P=P,
        inside=inside,
        gamma=read_gamma(data["gamma"], v),
        deviations=tuple(
            _deviation(f"deviations[{j}]", value, n, entries + v) for j, value in _listed("deviations", data)
        ),
        dropped=read_dropped(data["dropped"], entries),
        spanning=_spanning(data["spanning"], curves, points),
        kappa=read_dyadic("kappa", data["kappa"]),
        p=read_dyadic("p", data["p"]),
        strips=tuple(_strip(f"strips[{i}]", value, n) for i, value in _listed("strips", data)),
        level=read_dyadic("level", data["level"]),
        input_bound=read_dyadic("input_bound", data["input_bound"]),
        outputs=_outputs(data["outputs"], form),
        proof=_proof(data["proof"], arrays or {}),
        algebraic=(
            _algebraic(data[ALGEBRAIC], curves, points, model, v, regional=claim == "region") if equations else None
        ),
    )


def _listed(name: str, data: Mapping[str, object]) -> list[tuple[int, object]]:
    return list(enumerate(read_list(name, data[name])))


def _inside(stored: object, count: int) -> tuple[object, tuple[int, ...]]:
    """Return P without its channels, and these."""
    if not isinstance(stored, dict) or "channels" not in stored:
        return stored, ()
    listed = read_list("P.channels", stored["channels"])
    inside = tuple(read_index(f"P.channels[{i}]", c, count) for i, c in enumerate(listed))
    if not inside or any(a >= b for a, b in pairwise(inside)):
        raise FormatError("P.channels", "channels rise, and there is one at least")
    return read_object("P", {name: rows for name, rows in stored.items() if name != "channels"}, ("lower",)), inside


def _short(where: str, value: object, longest: int) -> list[object]:
    found = read_list(where, value)
    if len(found) > longest:
        raise FormatError(where, f"at most {longest} are read")
    return found


def _one_of(where: str, value: object, known: Sequence[str]) -> str:
    if not isinstance(value, str) or value not in known:
        raise FormatError(where, f"one of {', '.join(known)} is needed")
    return value


def _cuts(where: str, value: object) -> Cuts:
    exponent, listed = read_list(where, value, 2)
    if abs(read_integer(f"{where}[0]", exponent, 64)) > MAX_EXPONENT:
        raise FormatError(where, f"an exponent of at most {MAX_EXPONENT} is needed")
    cuts = [read_integer(f"{where}[1][{i}]", m, MAX_BITS) for i, m in enumerate(read_list(f"{where}[1]", listed))]
    if not cuts or any(a >= b for a, b in pairwise(cuts)):
        raise FormatError(where, "cuts rise, and there is one at least")
    return positions(cuts, exponent)


def _curve(where: str, value: object) -> Curve:
    fields = ("functions", "shift", "domain", "continuous", "forms", "products")
    value = read_object(where, value, fields)
    functions = tuple(
        _function(f"{where}.functions[{j}]", pair)
        for j, pair in enumerate(_short(f"{where}.functions", value["functions"], 3000))
    )
    rows = _short(f"{where}.forms", value["forms"], MAX_FORMS)
    forms = tuple(_form(f"{where}.forms[{k}]", row, 1 + len(functions), len(rows)) for k, row in enumerate(rows))
    products = tuple(
        _product(f"{where}.products[{j}]", row, len(forms))
        for j, row in enumerate(_short(f"{where}.products", value["products"], MAX_FORMS))
    )
    return Curve(
        functions,
        _shift(f"{where}.shift", value["shift"]),
        None if value["domain"] is None else _pair(f"{where}.domain", value["domain"]),
        _cuts(f"{where}.continuous", value["continuous"]),
        forms,
        products,
    )


def _function(where: str, value: object) -> tuple[Program, Fraction]:
    text, alpha = read_list(where, value, 2)
    try:
        program = parse(read_text(where, text, MAX_LENGTH_WITH_TABLES))
    except ExpressionError as error:
        raise FormatError(where, str(error)) from None
    scale = read_dyadic(where, alpha)
    if scale <= 0:
        raise FormatError(where, "a factor is positive")
    return program, scale


def _pair(where: str, value: object) -> tuple[Fraction, Fraction]:
    first, second = read_dyadics(where, value, 2)
    return first, second


def _shift(where: str, value: object) -> tuple[Fraction, Fraction] | str | None:
    if value is None or (isinstance(value, str) and value == "any"):
        return value
    center, radius = _pair(where, value)
    if radius < 0:
        raise FormatError(where, "a radius is not negative")
    return center, radius


def _form(where: str, value: object, size: int, count: int) -> Form:
    value = read_object(where, value, ("l", "is", "cuts", "offset", "upper", "lower"))
    kind = _one_of(f"{where}.is", value["is"], KINDS)
    offset = read_nonnegative(f"{where}.offset", value["offset"])
    if offset and kind != "offset":
        raise FormatError(f"{where}.offset", "only an offset form has one")
    lower = value["lower"]
    if lower is not None:
        d, j = read_list(f"{where}.lower", lower, 2)
        lower = (read_nonnegative(f"{where}.lower", d), read_index(f"{where}.lower", j, count))
    return Form(
        read_dyadics(f"{where}.l", value["l"], size),
        kind,
        _cuts(f"{where}.cuts", value["cuts"]),
        offset,
        None if value["upper"] is None else _upper(f"{where}.upper", value["upper"]),
        lower,
    )


def _upper(where: str, value: object) -> Upper:
    c, e, cuts = read_list(where, value, 3)
    found = None if cuts is None else _cuts(where, cuts)
    return Upper(read_nonnegative(where, c), read_nonnegative(where, e), found)


def _product(where: str, value: object, count: int) -> ProductForm:
    k, q, c, cuts = read_list(where, value, 4)
    return ProductForm(
        read_index(where, k, count), read_index(where, q, count), read_dyadic(where, c), _cuts(where, cuts)
    )


def _point(where: str, value: object, curves: Sequence[Curve], model: Model) -> Point:
    value = read_object(where, value, ("curve", "row", "channels", "densities"))
    place = read_index(f"{where}.curve", value["curve"], len(curves))
    curve = curves[place]
    listed = read_list(f"{where}.channels", value["channels"], len(curve.functions))
    channels = tuple(read_index(f"{where}.channels[{j}]", c, len(model.channels)) for j, c in enumerate(listed))
    densities = []
    for i, pair in enumerate(read_list(f"{where}.densities", value["densities"])):
        k, mu = read_list(f"{where}.densities[{i}]", pair, 2)
        k = read_index(f"{where}.densities[{i}]", k, len(curve.forms))
        densities.append((k, read_nonnegative(f"{where}.densities[{i}]", mu)))
    return Point(place, read_row(f"{where}.row", value["row"], model.n), channels, tuple(densities))


def _identity(value: object, entries: int) -> tuple[tuple[int, int, Fraction], ...]:
    """Return (i, j, sigma), i >= j, each place once at most."""
    found = []
    for k, entry in enumerate(read_list("facts.identity", _lists_of_facts(value).get("identity", []))):
        where = f"facts.identity[{k}]"
        i, j, sigma = read_list(where, entry, 3)
        found.append((read_index(where, i, entries), read_index(where, j, entries), read_dyadic(where, sigma)))
    places = [(i, j) for i, j, _ in found]
    if any(j > i for i, j in places) or any(a >= b for a, b in pairwise(places)):
        raise FormatError("facts.identity", "places (i, j) with i >= j rise")
    return tuple(found)


def _facts(value: object, curves: Sequence[Curve], points: Sequence[Point]) -> tuple[Fact, ...]:
    lists, found = _lists_of_facts(value), []
    for kind, width in ENTRIES_OF_A_FACT.items():
        for i, entry in enumerate(read_list(f"facts.{kind}", lists.get(kind, []))):
            where = f"facts.{kind}[{i}]"
            found.append(_fact(where, kind, read_list(where, entry, width), curves, points))
    return tuple(found)


def _lists_of_facts(value: object) -> Mapping[str, object]:
    optional = [name for name in OPTIONAL_FACTS if isinstance(value, dict) and name in value]
    needed = [name for name in ENTRIES_OF_A_FACT if name not in OPTIONAL_FACTS]
    return read_object("facts", value, (*needed, *optional))


def _fact(where: str, kind: str, entry: list[object], curves: Sequence[Curve], points: Sequence[Point]) -> Fact:
    *places, tau = entry
    p = q = read_index(where, places[0], len(points))
    sign = 0
    if kind == "constant":
        k = l = read_index(where, places[1], len(curves[points[p].curve].products))  # noqa: E741
        return Fact(kind=kind, p=p, q=q, sign=sign, k=k, l=l, tau=read_nonnegative(where, tau))
    if kind == "one_signed":
        q, places = read_index(where, places[2], len(points)), [places[0], places[1], places[3]]
    if kind == "difference":
        q, sign = read_index(where, places[1], len(points)), read_integer(where, places[2], 2)
        if sign not in (1, -1):
            raise FormatError(where, "a difference has the sign 1 or -1")
        places = [places[0], *places[3:]]
    k = read_index(where, places[1], len(curves[points[p].curve].forms))
    l = read_index(where, places[2], len(curves[points[q].curve].forms))  # noqa: E741
    return Fact(kind=kind, p=p, q=q, sign=sign, k=k, l=l, tau=read_nonnegative(where, tau))


def _algebraic(
    value: object, curves: Sequence[Curve], points: Sequence[Point], model: Model, v: int, *, regional: bool
) -> Algebraic:  # fmt: skip
    value = read_object(ALGEBRAIC, value, ("solvable", "equations", *["bounds"] * regional))
    solvable = read_object("algebraic.solvable", value["solvable"], ("multipliers", "products", "proof"))
    entries = model.n + len(model.channels)

    def rows(where: str, given: object, size: int) -> tuple[Row, ...]:
        listed = read_list(where, given, model.algebraic)
        return tuple(read_row(f"{where}[{i}]", row, size) for i, row in enumerate(listed))

    def facts(where: str, given: object) -> tuple[Fact, ...]:
        listed = enumerate(read_list(where, given))
        return tuple(
            _fact(f"{where}[{i}]", "value", read_list(f"{where}[{i}]", row, 4), curves, points) for i, row in listed
        )

    def reach(where: str, given: object) -> Reach:
        entry = read_object(where, given, ("equations", "value", "alpha", "beta", "proof"))
        return Reach(
            rows(f"{where}.equations", entry["equations"], entries + v),
            facts(f"{where}.value", entry["value"]),
            read_nonnegative(f"{where}.alpha", entry["alpha"]),
            read_nonnegative(f"{where}.beta", entry["beta"]),
            read_factor(f"{where}.proof", entry["proof"]),
        )

    bounds = enumerate(read_list("algebraic.bounds", value["bounds"]) if regional else ())
    return Algebraic(
        rows("algebraic.solvable.multipliers", solvable["multipliers"], entries),
        facts("algebraic.solvable.products", solvable["products"]),
        read_factor("algebraic.solvable.proof", solvable["proof"]),
        rows("algebraic.equations", value["equations"], entries + v),
        tuple(reach(f"algebraic.bounds[{i}]", entry) for i, entry in bounds),
    )


def _deviation(where: str, value: object, n: int, size: int) -> Deviation:
    value = read_object(where, value, ("columns", "C", "s", "epsilon"))
    columns = tuple(
        read_row(f"{where}.columns[{i}]", row, n)
        for i, row in enumerate(read_list(f"{where}.columns", value["columns"]))
    )
    C = tuple(read_row(f"{where}.C[{i}]", row, size) for i, row in enumerate(read_list(f"{where}.C", value["C"])))
    return Deviation(
        columns, C, read_dyadic(f"{where}.s", value["s"]), read_nonnegative(f"{where}.epsilon", value["epsilon"])
    )


def _spanning(value: object, curves: Sequence[Curve], points: Sequence[Point]) -> tuple[tuple[int, int], ...]:
    found = []
    for i, pair in enumerate(read_list("spanning", value)):
        p, k = read_list(f"spanning[{i}]", pair, 2)
        p = read_index(f"spanning[{i}]", p, len(points))
        found.append((p, read_index(f"spanning[{i}]", k, len(curves[points[p].curve].forms))))
    return tuple(found)


def _strip(where: str, value: object, n: int) -> tuple[Row, Fraction, Fraction]:
    row, lo, hi = read_list(where, value, 3)
    return read_row(where, row, n), read_dyadic(where, lo), read_dyadic(where, hi)


def _outputs(value: object, model: Mapping[str, object]) -> Outputs | None:
    if isinstance(value, list) and not value:
        return None
    block = read_object("outputs", value, ("sha256", *OUTPUT_FIELDS, "constants", "lipschitz"))
    stated, count = read_stated(block, model), len(block["outputs"])
    maps = _maps(block["output_map"], block["lipschitz"], count)
    rows = [{i: v for i, v in enumerate(row) if v} for row in rows_of(block["C"])]
    constants = read_dyadics("outputs.constants", block["constants"], count)
    entries = zip(block["outputs"], rows, rows_of(block["D"]), constants, maps, strict=True)
    return Outputs(stated, tuple(Output(*entry) for entry in entries))


def _maps(texts: list[str] | None, bounds: object, count: int) -> Sequence[Map | None]:
    if (texts is None) != (bounds is None):
        raise FormatError("outputs.lipschitz", "null without output_map, else a bound with cuts for each output")
    if texts is None:
        return [None] * count
    found = []
    for i, (text, value) in enumerate(zip(texts, read_list("outputs.lipschitz", bounds, count), strict=True)):
        where = f"outputs.lipschitz[{i}]"
        L, cuts = read_list(where, value, 2)
        found.append(Map(parse(text), read_nonnegative(where, L), _cuts(where, cuts)))
    return found


def _proof(value: object, arrays: "Arrays") -> dict[str, Factor | Root]:
    proof = read_object("proof", value, ("P", "M", "V"))
    found: dict[str, Factor | Root] = {}
    for name, entry in proof.items():
        where = f"proof.{name}"
        if name != "V" and isinstance(entry, dict):
            found[name] = read_root(where, entry, arrays)
        else:
            found[name] = () if entry is None and name == "V" else read_factor(where, entry)
    return found
