"""What few forged files reach: each refusal of the ledger's checker by a file, or a lemma, in which it alone is due."""

import copy
import json
from fractions import Fraction
from typing import Any

import pytest

from checker import known_ledgers
from checker.ledgers import Sketch, curve, data, draft, model_object, point, seeing, solved
from persid.certificates.ledger import with_proof
from persid_check import Accepted, FormatError, Malformed, Rejected, check, model_sha256
from persid_check.expression import parse
from persid_check.ledger.file import read_ledger
from persid_check.ledger.lemmas import Lemma, Product, discontinuous, is_odd, vanishes

ONE, HALF = Fraction(1), Fraction(1, 2)
CUTS = (-ONE, Fraction(0), ONE)


def lazy(P22: int = 0, **more: Any) -> dict[str, Any]:
    """x1' = -x1 + u and x2' = 0, which is not stable: the row of x2, and of x2^3, is zero in M whatever stands in V."""
    cube = curve([("x**3", 1)], ((1, 0), "rising"), ((0, 1), "growing"), ((0, 0), "sector"))
    model = model_object([("x**3", [[0.0, 1.0]], [[0.0], [0.0]])], [[-1.0, 0.0], [0.0, 0.0]], [[1.0], [0.0]], n=2)
    content = draft(Sketch(model, [cube], [point(0, {1: 1}, [0], [])], [], full=False))
    content |= {"P": {"diagonal": [[1, 0], [P22, 0]]}, "gamma": [4, 0], "dropped": [1, 2]} | more
    return with_proof(content)


def density(k: int) -> dict[str, Any]:
    """The point of `lazy` with form k in V."""
    return {"points": [point(0, {1: 1}, [0], [k]) | {"densities": [[k, [1, 0]]]}]}


def test_a_state_that_never_moves_is_not_stable() -> None:
    """No zero row makes x2' = 0 stable: not without a span, nor with P, a rate, a form of its own or a lower bound."""
    bounded = copy.deepcopy(lazy()["curves"])
    bounded[0]["forms"][0]["lower"] = [[1, 0], 2]
    why = {
        "do not span": lazy(),
        "P has an entry": lazy(1),
        "only claim iss": lazy(kappa=[1, -3], p=[1, -2], claim="rate-and-gain"),
        "no density has a lower bound": lazy(curves=bounded, **density(0)),
        "reads a dropped entry": lazy(spanning=[[0, 1]], **density(1)),
        "is not growing, or not in V": lazy(spanning=[[0, 1]]),
    }
    for reason, content in why.items():
        answer = check(data(content))
        assert isinstance(answer, Rejected), reason
        assert reason in answer.why, answer


def of_any_centre() -> dict[str, Any]:
    """A known ledger with a curve that is proved about every centre."""
    found = (known_ledgers.load(name) for name in known_ledgers.NAMES)
    return copy.deepcopy(next(c for c in found if c["curves"] and c["curves"][0]["shift"] == "any"))


def test_what_holds_about_any_centre_has_no_ends_and_no_sharper_bound() -> None:
    """With any centre a curve has no domain, and an integral is bounded by monotony alone."""
    content = of_any_centre()
    content["curves"][0]["domain"] = [[-1, 0], [1, 0]]
    assert "with any centre it is all of R" in check(data(content)).why
    content = of_any_centre()
    content["curves"][0]["forms"][0]["upper"] = [[1, -2], [0, 0], [0, [-1, 0, 1]]]
    assert "with any centre the bound is" in check(data(content)).why


def test_products_and_sums_belong_where_they_are_proved() -> None:
    """A product with a constant is on all of R, and a sum of two points of one domain needs a symmetric one."""
    content = copy.deepcopy(known_ledgers.load("practical"))
    i = next(i for i, each in enumerate(content["curves"]) if each["products"])
    content["curves"][i]["domain"] = [[-1, -4], [1, -4]]
    assert "not shifted, and on all of R" in check(data(content)).why
    content = copy.deepcopy(known_ledgers.load("difference"))
    content |= {"claim": "region", "kappa": [1, -9], "p": [1, -9], "level": [1, 0]}
    content["curves"][0]["domain"] = [[-2, 0], [1, 0]]
    assert "a sum needs a symmetric domain" in check(data(content)).why


def test_a_curve_has_the_functions_of_its_channels() -> None:
    """A point is refused where the curve's function is another one of the same forms."""
    content = copy.deepcopy(known_ledgers.load("difference"))
    content["curves"] = [curve([("arctan(x)", 1)], ((0, 1), "nondecreasing"), ((1, -1), "nondecreasing"))]
    assert "has another function" in check(data(content)).why


def test_lemmas_that_are_not_proved_say_where() -> None:
    """Growth on an interval, cuts that miss an end, and functions that are not defined are not proved."""
    x = ((parse("x**3"), ONE),)
    assert "all of R" in str(Lemma(x, (ONE, ONE), "growing").unproved(CUTS, (-ONE, ONE)))
    assert "cover the domain" in str(Lemma(x, (ONE, ONE), "sector").unproved(CUTS, (-ONE, 2 * ONE)))
    pole = ((parse("1/x"), ONE),)
    assert Lemma(pole, (ONE, ONE), "upper", c=ONE).unproved(CUTS, None) is not None
    assert not vanishes(pole, (ONE, ONE))
    assert Product(pole, ((ONE, ONE), (ONE, ONE)), ONE).unproved(CUTS) is not None
    wave = ((parse("tan(x)"), ONE),)
    assert "beyond" in str(Product(wave, ((ONE, 0 * ONE), (0 * ONE, ONE)), 4 * ONE).unproved((-HALF, HALF)))
    assert "beyond" in str(discontinuous(wave, (-HALF, HALF), None))


@pytest.mark.parametrize(
    ("text", "odd"),
    [
        ("x", True), ("-x", True), ("x**3 - x", True), ("x*abs(x)", True), ("sin(x)*cos(x)", True), ("x**-3", True),
        ("tanh(x)/cosh(x)", True), ("sat(deadzone(x))", True), ("tanh(x**3 + 2*x)", True), ("x*x*x", True),
        ("x + 1", False), ("x**2", False), ("x**0.5", False), ("relu(x)", False), ("exp(x) - exp(-x)", False),
        ("x**0", False), ("tanh(x + 1)", False), ("x*sin(x)", False), ("cos(x)", False), ("x - x**2", False),
        ("tanh(relu(x))", False), ("abs(x**3)", False), ("1", False), ("expm1(x)*x", False), ("x**1.5", False),
    ],
)  # fmt: skip
def test_oddness_is_told_from_the_form_alone(text: str, odd: bool) -> None:
    """A function is called odd only where each step of its form says so."""
    assert is_odd(((parse(text), ONE),)) == odd


def _set(path: tuple[Any, ...], value: Any) -> bytes:
    content = copy.deepcopy(known_ledgers.load("rated"))
    at: Any = content
    for key in path[:-1]:
        at = at[key]
    at[path[-1]] = value
    if path[0] == "model":
        content["model_sha256"] = model_sha256(content["model"])
    return data(content)


@pytest.mark.parametrize(
    ("path", "value", "why"),
    [
        (("kappa",), [True, 0], "an integer is needed"),
        (("kappa",), [2**2048, 0], "at most 2048 bits"),
        (("kappa",), [1, 2001], "an exponent of at most 2000"),
        (("curves",), [None] * 3001, "at most 3000 are read"),
        (("curves", 0, "functions", 0, 0), "wobble(x)", "wobble"),
    ],
)  # fmt: skip
def test_entries_beyond_their_limits_are_malformed(path: tuple[Any, ...], value: Any, why: str) -> None:
    """Numbers, lists, models and texts that are none or too large are malformed, with the limit in words."""
    answer = check(_set(path, value))
    assert isinstance(answer, Malformed)
    assert why in answer.why


def test_limits_of_a_file_hold_wherever_it_names_its_format() -> None:
    """16 MiB are the limit where the format stands far inside, too; matrices are no larger than the file pays for."""
    answer = check(b" " * 2**24 + data(known_ledgers.load("spring")))
    assert isinstance(answer, Malformed)
    assert "16777216" in answer.why
    wide = {"columns": [[]] * 5000, "C": [], "s": [1, 0], "epsilon": [0, 0]}
    answer = check(data(known_ledgers.load("rated") | {"deviations": [wide]}))
    assert isinstance(answer, Rejected)
    assert "too large for a file of this length" in answer.why
    with pytest.raises(FormatError, match="persid-certificate-2"):
        read_ledger(known_ledgers.load("spring") | {"format": "persid-certificate-3"})


def test_outputs_are_worded_for_every_kind_of_input() -> None:
    """Without inputs, with b as one, and with a gain for each input, each part of the bound stands in the sentence."""
    alone = solved(Sketch(model_object([], [[-1.0]], [[]]), [], [], [], "rate-and-gain", HALF))
    assert "sup" not in check(data(seeing(alone, y=([1], [])))).statement
    pushed = solved(Sketch(model_object([], [[-1.0]], b=[1.0]), [], [], [], "rate-and-gain", HALF))
    answer = check(data(seeing(pushed, y=([1], [2]))))
    assert isinstance(answer, Accepted)
    assert " sup|(u - u*, 1)| + 2.00001 sup|u - u*|; for all t" in answer.statement
    assert "sup|u - u*|;" not in check(data(seeing(pushed, y=([1], [0])))).statement
    each = known_ledgers.load("e_gains")
    n, m = len(each["model"]["states"]), len(each["model"]["inputs"])
    assert isinstance(each["gamma"], dict)
    answer = check(data(seeing(each, y=([1] * n, [1] * m))))
    assert isinstance(answer, Accepted)
    assert all(f" sup|u{i + 1} - u{i + 1}*|" in answer.statement for i in range(m))
    assert json.loads(data(each))["outputs"] == []


def valued(text: str, kind: str = "nondecreasing", other: str = "nondecreasing") -> dict[str, Any]:
    """x' = -x + u beside a function without effect, whose value P reads."""
    model = model_object([(text, [[1.0]], [[0.0]])], [[-1.0]], [[1.0]])
    forms = curve([(text, 1)], ((1, 0), kind), ((0, 1), other))
    content = draft(Sketch(model, [forms], [point(0, {0: 1}, [0], [])], [("slope", 0, 0, 0)], inside=(0,)))
    content["P"]["lower"] = [[[1, 0]], [[0, 0], [1, -9]]]
    return content | {"gamma": [4, 0]}


def test_a_value_in_V_has_a_derivative_and_is_0_at_rest() -> None:
    """A value that P reads must be Lipschitz, so that it has a derivative along solutions, and 0 at x*."""
    why = {
        "inequality is not proved": valued("tanh(x)"),
        "locally Lipschitz: on the piece": valued("sqrt(abs(x))", other="one-signed"),
        "not 0 at the operating point": valued("tanh(x)+1"),
        "both forms must be nondecreasing": valued("tanh(x)", "sector"),
        "form 1 reads a channel": valued("tanh(x)") | {
            "P": {"lower": [[[1, 0]]]}, "facts": valued("tanh(x)")["facts"] | {"slope": [[0, 0, 1, [1, 0]]]}
        },
    }  # fmt: skip
    for reason, content in why.items():
        answer = check(data(content))
        assert isinstance(answer, Rejected), reason
        assert reason in answer.why, answer


@pytest.mark.parametrize("cuts", [(-2, -1), (1, 2), (0, 1), (-1, 0)])
def test_products_are_asked_about_on_both_sides_of_zero(cuts: tuple[int, int]) -> None:
    """Cuts that all lie on one side of 0 leave an end from which no half-line leads outward."""
    line = ((parse("x"), ONE),)
    assert Product(line, ((ONE, 0 * ONE), (ONE, 0 * ONE)), ONE).unproved((-ONE, ONE)) is None
    assert "beyond" in str(
        Product(line, ((ONE, 0 * ONE), (ONE, 0 * ONE)), ONE).unproved((cuts[0] * ONE, cuts[1] * ONE))
    )
