"""certificate.json, format 2, as values: every field is read here, and what is not specified is refused.

Section 8 of the specification (docs/ledger.md). Nothing is expanded: what is read is as long as the file.
"""

from collections.abc import Mapping, Sequence
from fractions import Fraction
from itertools import pairwise
from typing import Any

from persid_check.expression import ExpressionError, Program, parse
from persid_check.format import (
    MAX_BITS,
    MAX_ENTRIES,
    MAX_EXPONENT,
    MAX_FACTOR_BITS,
    read_dyadic,
    read_dyadics,
    read_gamma,
    read_index,
    read_list,
    read_object,
    read_P,
    read_text,
)
from persid_check.ledger.lemmas import Cuts, positions
from persid_check.ledger.values import (
    Ball,
    Curve,
    Deviation,
    Fact,
    Factor,
    Form,
    Ledger,
    Output,
    Point,
    ProductForm,
    Row,
    Upper,
)
from persid_check.model import Model, canonical_model, model_of
from persid_check.results import FormatError

FORMAT = "persid-certificate-2"
MAX_BYTES = 2**24
MAX_FORMS = 128  # of a curve
CLAIMS = ("iss", "rate-and-gain", "region", "practical")
KINDS = ("sector", "growing", "nondecreasing", "rising", "one-signed", "offset")

FIELDS = (
    "format", "claim", "statement", "model_sha256", "model", "operating_point", "curves", "points", "facts", "P",
    "gamma", "deviations", "dropped", "spanning", "kappa", "p", "strips", "level", "input_bound", "outputs", "proof",
)  # fmt: skip


def read_ledger(data: Any) -> Ledger:
    """Return the value of a certificate's JSON object.

    Raises:
        FormatError: anything is not as specified; the message names the place.
    """
    data = read_object("file", data, FIELDS)
    if data["format"] != FORMAT:
        raise FormatError("format", f'"{FORMAT}" is needed')
    claim = _one_of("claim", data["claim"], CLAIMS)
    read_text("statement", data["statement"], 5000)
    sha256 = read_text("model_sha256", data["model_sha256"], 64)
    model = _model(data["model"])
    n, m, entries = model.n, model.m, model.n + len(model.channels)
    ball = None if data["operating_point"] is None else _ball(data["operating_point"], model)
    v = m + (ball is None and any(model.b))
    curves = tuple(_curve(f"curves[{i}]", value) for i, value in enumerate(_short("curves", data["curves"], 3000)))
    points = tuple(
        _point(f"points[{i}]", value, curves, model) for i, value in enumerate(_short("points", data["points"], 10000))
    )
    diagonal, P = read_P(data["P"], n)
    return Ledger(
        claim,
        sha256,
        data["model"],
        model,
        ball,
        curves,
        points,
        _facts(data["facts"], curves, points),
        diagonal,
        P,
        read_gamma(data["gamma"], v),
        tuple(_deviation(f"deviations[{j}]", value, n, entries + v) for j, value in _listed("deviations", data)),
        _dropped(data["dropped"], entries),
        _spanning(data["spanning"], curves, points),
        read_dyadic("kappa", data["kappa"]),
        read_dyadic("p", data["p"]),
        tuple(_strip(f"strips[{i}]", value, n) for i, value in _listed("strips", data)),
        read_dyadic("level", data["level"]),
        read_dyadic("input_bound", data["input_bound"]),
        tuple(_output(f"outputs[{i}]", value, n, m) for i, value in _listed("outputs", data)),
        _proof(data["proof"]),
    )


def _listed(name: str, data: Mapping[str, Any]) -> list[tuple[int, Any]]:
    return list(enumerate(read_list(name, data[name])))


def _short(where: str, value: Any, longest: int) -> list[Any]:
    found = read_list(where, value)
    if len(found) > longest:
        raise FormatError(where, f"at most {longest} are read")
    return found


def _one_of(where: str, value: Any, known: Sequence[str]) -> str:
    if not isinstance(value, str) or value not in known:
        raise FormatError(where, f"one of {', '.join(known)} is needed")
    return value


def _model(form: Any) -> Model:
    """Read the canonical form of a model in plain lists; nothing else is expanded."""
    _refuse_companions("model", form)
    if canonical_model(form) != form:
        raise FormatError("model", "not in canonical form")
    model = model_of(form, discrete=True)
    if model.n + len(model.channels) > MAX_ENTRIES:
        raise FormatError("model", f"more than {MAX_ENTRIES} states and channels")
    return model


def _refuse_companions(where: str, form: Any) -> None:
    form = form if isinstance(form, dict) else {}
    terms = form.get("terms")
    for i, part in enumerate([form, *(terms if isinstance(terms, list) else [])]):
        if isinstance(part, dict) and any(isinstance(value, dict) for value in part.values()):
            raise FormatError(where if i == 0 else f"{where}.terms[{i - 1}]", "matrices stand in the file as lists")


def _integer(where: str, value: Any, bits: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int):
        raise FormatError(where, f"an integer is needed, not {str(value)[:40]!r}")
    if value.bit_length() > bits:
        raise FormatError(where, f"an integer of at most {bits} bits is needed")
    return value


def _cuts(where: str, value: Any) -> Cuts:
    exponent, listed = read_list(where, value, 2)
    if abs(_integer(f"{where}[0]", exponent, 64)) > MAX_EXPONENT:
        raise FormatError(where, f"an exponent of at most {MAX_EXPONENT} is needed")
    cuts = [_integer(f"{where}[1][{i}]", m, MAX_BITS) for i, m in enumerate(read_list(f"{where}[1]", listed))]
    if not cuts or any(a >= b for a, b in pairwise(cuts)):
        raise FormatError(where, "cuts rise, and there is one at least")
    return positions(cuts, exponent)


def _row(where: str, value: Any, size: int) -> Row:
    found: dict[int, Fraction] = {}
    last = -1
    for k, pair in enumerate(read_list(where, value)):
        i, number = read_list(f"{where}[{k}]", pair, 2)
        index = read_index(f"{where}[{k}]", i, size)
        if index <= last:
            raise FormatError(f"{where}[{k}]", "indices rise")
        last, found[index] = index, read_dyadic(f"{where}[{k}]", number)
    return {i: value for i, value in found.items() if value}


def _curve(where: str, value: Any) -> Curve:
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


def _function(where: str, value: Any) -> tuple[Program, Fraction]:
    text, alpha = read_list(where, value, 2)
    try:
        program = parse(read_text(where, text, 1000))
    except ExpressionError as error:
        raise FormatError(where, str(error)) from None
    scale = read_dyadic(where, alpha)
    if scale <= 0:
        raise FormatError(where, "a factor is positive")
    return program, scale


def _pair(where: str, value: Any) -> tuple[Fraction, Fraction]:
    first, second = read_dyadics(where, value, 2)
    return first, second


def _shift(where: str, value: Any) -> tuple[Fraction, Fraction] | str | None:
    if value is None or (isinstance(value, str) and value == "any"):
        return value
    center, radius = _pair(where, value)
    if radius < 0:
        raise FormatError(where, "a radius is not negative")
    return center, radius


def _form(where: str, value: Any, size: int, count: int) -> Form:
    value = read_object(where, value, ("l", "is", "cuts", "offset", "upper", "lower"))
    kind = _one_of(f"{where}.is", value["is"], KINDS)
    offset = _nonnegative(f"{where}.offset", value["offset"])
    if offset and kind != "offset":
        raise FormatError(f"{where}.offset", "only an offset form has one")
    lower = value["lower"]
    if lower is not None:
        d, j = read_list(f"{where}.lower", lower, 2)
        lower = (_nonnegative(f"{where}.lower", d), read_index(f"{where}.lower", j, count))
    return Form(
        read_dyadics(f"{where}.l", value["l"], size),
        kind,
        _cuts(f"{where}.cuts", value["cuts"]),
        offset,
        None if value["upper"] is None else _upper(f"{where}.upper", value["upper"]),
        lower,
    )


def _nonnegative(where: str, value: Any) -> Fraction:
    number = read_dyadic(where, value)
    if number < 0:
        raise FormatError(where, "a number that is not negative is needed")
    return number


def _upper(where: str, value: Any) -> Upper:
    c, e, cuts = read_list(where, value, 3)
    found = None if cuts is None else _cuts(where, cuts)
    return Upper(_nonnegative(where, c), _nonnegative(where, e), found)


def _product(where: str, value: Any, count: int) -> ProductForm:
    k, q, c, cuts = read_list(where, value, 4)
    return ProductForm(
        read_index(where, k, count), read_index(where, q, count), read_dyadic(where, c), _cuts(where, cuts)
    )


def _point(where: str, value: Any, curves: Sequence[Curve], model: Model) -> Point:
    value = read_object(where, value, ("curve", "row", "channels", "densities"))
    place = read_index(f"{where}.curve", value["curve"], len(curves))
    curve = curves[place]
    listed = read_list(f"{where}.channels", value["channels"], len(curve.functions))
    channels = tuple(read_index(f"{where}.channels[{j}]", c, len(model.channels)) for j, c in enumerate(listed))
    densities = []
    for i, pair in enumerate(read_list(f"{where}.densities", value["densities"])):
        k, mu = read_list(f"{where}.densities[{i}]", pair, 2)
        k = read_index(f"{where}.densities[{i}]", k, len(curve.forms))
        densities.append((k, _nonnegative(f"{where}.densities[{i}]", mu)))
    return Point(place, _row(f"{where}.row", value["row"], model.n), channels, tuple(densities))


def _facts(value: Any, curves: Sequence[Curve], points: Sequence[Point]) -> tuple[Fact, ...]:
    lists = read_object("facts", value, ("value", "one_signed", "difference", "constant"))
    found = []
    for kind, width in (("value", 4), ("one_signed", 5), ("difference", 6), ("constant", 3)):
        for i, entry in enumerate(read_list(f"facts.{kind}", lists[kind])):
            where = f"facts.{kind}[{i}]"
            found.append(_fact(where, kind, read_list(where, entry, width), curves, points))
    return tuple(found)


def _fact(where: str, kind: str, entry: list[Any], curves: Sequence[Curve], points: Sequence[Point]) -> Fact:
    *places, tau = entry
    p = q = read_index(where, places[0], len(points))
    sign = 0
    if kind == "constant":
        k = l = read_index(where, places[1], len(curves[points[p].curve].products))  # noqa: E741
        return Fact(kind, p, q, sign, k, l, _nonnegative(where, tau))
    if kind == "one_signed":
        q, places = read_index(where, places[2], len(points)), [places[0], places[1], places[3]]
    if kind == "difference":
        q, sign = read_index(where, places[1], len(points)), _integer(where, places[2], 2)
        if sign not in (1, -1):
            raise FormatError(where, "a difference has the sign 1 or -1")
        places = [places[0], *places[3:]]
    k = read_index(where, places[1], len(curves[points[p].curve].forms))
    l = read_index(where, places[2], len(curves[points[q].curve].forms))  # noqa: E741
    return Fact(kind, p, q, sign, k, l, _nonnegative(where, tau))


def _deviation(where: str, value: Any, n: int, size: int) -> Deviation:
    value = read_object(where, value, ("columns", "C", "s", "epsilon"))
    columns = tuple(
        _row(f"{where}.columns[{i}]", row, n) for i, row in enumerate(read_list(f"{where}.columns", value["columns"]))
    )
    C = tuple(_row(f"{where}.C[{i}]", row, size) for i, row in enumerate(read_list(f"{where}.C", value["C"])))
    return Deviation(
        columns, C, read_dyadic(f"{where}.s", value["s"]), _nonnegative(f"{where}.epsilon", value["epsilon"])
    )


def _ball(value: Any, model: Model) -> Ball:
    value = read_object("operating_point", value, ("x", "radius", "u"))
    return Ball(
        read_dyadics("operating_point.x", value["x"], model.n),
        _nonnegative("operating_point.radius", value["radius"]),
        read_dyadics("operating_point.u", value["u"], model.m),
    )


def _dropped(value: Any, size: int) -> tuple[int, ...]:
    entries = tuple(read_index(f"dropped[{i}]", entry, size) for i, entry in enumerate(read_list("dropped", value)))
    if len(set(entries)) != len(entries):
        raise FormatError("dropped", "an entry stands twice")
    return entries


def _spanning(value: Any, curves: Sequence[Curve], points: Sequence[Point]) -> tuple[tuple[int, int], ...]:
    found = []
    for i, pair in enumerate(read_list("spanning", value)):
        p, k = read_list(f"spanning[{i}]", pair, 2)
        p = read_index(f"spanning[{i}]", p, len(points))
        found.append((p, read_index(f"spanning[{i}]", k, len(curves[points[p].curve].forms))))
    return tuple(found)


def _strip(where: str, value: Any, n: int) -> tuple[Row, Fraction, Fraction]:
    row, lo, hi = read_list(where, value, 3)
    return _row(where, row, n), read_dyadic(where, lo), read_dyadic(where, hi)


def _output(where: str, value: Any, n: int, m: int) -> Output:
    value = read_object(where, value, ("row", "direct", "bound"))
    direct = read_dyadics(f"{where}.direct", value["direct"], m)
    return Output(_row(f"{where}.row", value["row"], n), direct, read_dyadic(f"{where}.bound", value["bound"]))


def _proof(value: Any) -> dict[str, Factor]:
    proof = read_object("proof", value, ("P", "M", "V"))
    return {
        name: () if rows is None and name == "V" else _factor(f"proof.{name}", rows) for name, rows in proof.items()
    }


def _factor(where: str, value: Any) -> Factor:
    rows = read_list(where, value)
    return tuple(_integers(f"{where}[{i}]", row, i + 1) for i, row in enumerate(rows))


def _integers(where: str, values: Any, size: int) -> tuple[int, ...]:
    return tuple(_integer(where, value, MAX_FACTOR_BITS) for value in read_list(where, values, size))
