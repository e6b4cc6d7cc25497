"""Identities are expanded exactly: what is zero as a polynomial is accepted, everything else is refused."""

import copy
import json
import random
import time
from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

from checker import identities
from checker.identities import cubic, known, lorenz, quadratic
from checker.ledgers import data, number
from checker.sampled import faults
from persid.certificates.ledger import with_proof
from persid.errors import RoundingError
from persid_check import Accepted, Malformed, Rejected, check, model_sha256
from persid_check.ledger.file import read_ledger
from persid_check.ledger.identities import prove_identity
from persid_check.results import NotProvedError
from persid_check.work import limited

Certificate = dict[str, Any]


@pytest.mark.parametrize("name", identities.MAKERS)
def test_a_true_identity_is_accepted(name: str) -> None:
    """Lorenz's system below r = 1, its ball at r = 28, and a moved equilibrium: products of states cancel."""
    content = identities.MAKERS[name]()
    result = check(data(content))
    assert isinstance(result, Accepted), result
    assert any("zero as a polynomial" in line for line in result.steps)
    assert faults(content, samples=1000) == []


def _function(text: str) -> Callable[[Certificate], None]:
    def edit(content: Certificate) -> None:
        content["model"]["terms"][0]["f"] = text
        content["curves"][0]["functions"][0][0] = text

    return edit


def _row(channel: int, state: int, value: float) -> Callable[[Certificate], None]:
    def edit(content: Certificate) -> None:
        content["model"]["terms"][0]["R"][channel][state] = value.hex()
        content["points"][channel]["row"] = [
            [i, number(float.fromhex(v))] for i, v in enumerate(content["model"]["terms"][0]["R"][channel])
            if float.fromhex(v)
        ]  # fmt: skip

    return edit


def _entries(change: Callable[[list[Any]], list[Any]]) -> Callable[[Certificate], None]:
    def edit(content: Certificate) -> None:
        content["facts"]["identity"] = change(content["facts"]["identity"])

    return edit


def _ball(content: Certificate) -> None:
    content["operating_point"]["radius"] = [1, -20]


def _not_subtracted(content: Certificate) -> None:
    """The operating point is another equilibrium, (0, 2, 0), held by other inputs; the entry is that of (0, 1, 0)."""
    content["operating_point"] |= {"x": [number(v) for v in (0, 2, 0)], "u": [number(v) for v in (-20, 2, 0)]}


POWER = "(" * 30 + "x" + ")**64" * 30
LARGE = "(" * 40 + "1e300" + ")**64" * 40 + "*x**2"
FALSE: dict[str, tuple[str, Callable[[Certificate], None]]] = {
    "a coefficient in the last bit": ("below_one", _entries(lambda S: [*S[:3], [6, 1, [-(2**60) - 1, -62]]])),
    "a sign": ("below_one", _entries(lambda S: [*S[:3], [6, 1, [1, -2]]])),
    "an entry too few": ("below_one", _entries(lambda S: S[:3])),
    "an entry too many": ("below_one", _entries(lambda S: [[2, 1, [1, -900]], *S])),
    "another entry": ("below_one", _entries(lambda S: [*S[:3], [6, 0, [-1, -2]]])),
    "a square alone": ("below_one", _entries(lambda _: [[3, 3, [1, -2]]])),
    "cubes for squares": ("below_one", _function("x**3")),
    "a function's factor in the last bit": ("moved", _function("x**2+1e-300*x**3")),
    "a cosine": ("below_one", _function("cos(x)-1")),
    "an absolute value": ("below_one", _function("abs(x)**2")),
    "a quotient that is a square": ("below_one", _function("x**4/x**2")),
    "a root that is a square": ("below_one", _function("sqrt(x**4)")),
    "half powers that are a square": ("below_one", _function("(x**1.5)*(x**0.5)")),
    "a power of zero": ("below_one", _function("x**2*(x**2+1)**0")),
    "a relu": ("below_one", _function("relu(x)*x+relu(-x)*(-x)")),
    "a division by zero": ("below_one", _function("x**2+x*(1/(1-1))")),
    "a row in the last bit": ("below_one", _row(0, 1, 1.0000000000000002)),
    "a shift forgotten": ("moved", _entries(lambda S: S[1:])),
    "the shift of another point": ("moved", _not_subtracted),
    "a ball": ("moved", _ball),
    "an enormous degree": ("below_one", _function(POWER)),
    "enormous numbers": ("below_one", _function(LARGE)),
    "degree 17": ("below_one", _function("x**17-x**17+x**2")),
}


@pytest.mark.parametrize("name", FALSE)
def test_a_false_identity_is_rejected(name: str) -> None:
    """The rest of the proof holds, which knows channels by their numbers alone: the identity is what is refused."""
    base, edit = FALSE[name]
    content = copy.deepcopy(identities.MAKERS[base]())
    edit(content)
    content["model_sha256"] = model_sha256(content["model"])
    if name not in ("a ball",):
        content = _refactored(content)
    started = time.process_time()
    with pytest.raises(NotProvedError) as refused, limited(10**6):
        prove_identity(read_ledger(content))
    assert time.process_time() - started < 2
    assert refused.value.where in ("facts.identity", "file")
    result = check(data(content))
    assert isinstance(result, Rejected), result


def _refactored(content: Certificate) -> Certificate:
    try:
        return with_proof(content)
    except RoundingError:  # then the factors stay as they are
        return content


def test_an_identity_is_what_is_rejected() -> None:
    """Where nothing but the entries of the list is false the answer names them: M alone would be proved."""
    content = known(lorenz(), identities.ENERGY, cubic())
    content["model"]["terms"][0]["f"] = "x**4"
    content["curves"][0]["functions"][0][0] = "x**4"
    content["model_sha256"] = model_sha256(content["model"])
    result = check(data(with_proof(content)))
    assert isinstance(result, Rejected)
    assert result.where == "facts.identity"


MALFORMED: dict[str, Any] = {
    "above the diagonal": [[2, 3, [1, -2]]],
    "twice": [[3, 2, [1, -2]], [3, 2, [1, -2]]],
    "not rising": [[4, 2, [1, -2]], [3, 2, [1, -2]]],
    "of an input": [[7, 2, [1, -2]]],
    "negative": [[-1, -1, [1, -2]]],
    "of two numbers": [[3, 2]],
    "a fraction": [[3, 2, [1, 2, 3]]],
    "a float": [[3, 2, 0.25]],
    "an object": {"3": 2},
    "of a channel by name": [["x", 2, [1, -2]]],
    "an exponent": [[3, 2, [1, 2001]]],
}


@pytest.mark.parametrize("name", MALFORMED)
def test_a_list_that_is_not_as_specified_is_malformed(name: str) -> None:
    """Places rise strictly, i >= j, both are entries of (x, s), and numbers are dyadic."""
    content = copy.deepcopy(identities.below_one())
    content["facts"]["identity"] = MALFORMED[name]
    assert isinstance(check(data(content)), Malformed)


@pytest.mark.long
@pytest.mark.parametrize(("n", "degree"), [(6, 8), (12, 16), (30, 4)])
def test_the_work_of_an_expansion_is_limited(n: int, degree: int) -> None:
    """Forty powers of long rows, each with each: refused for its steps, in seconds, whatever the degree."""
    R = [[1.1 + i / 8 + c / 7 for i in range(n)] for c in range(40)]
    model = quadratic((-np.eye(n)).tolist(), {(0, 0, 0): 1.0}) | {"terms": [
        {"f": f"x**{degree}", "R": R, "A": [[0.0] * 40] * n}
    ]}  # fmt: skip
    pairs = [(n + i, n + j, 1) for i in range(40) for j in range(i + 1)]
    ledger = read_ledger(json.loads(data(known(model, np.eye(n).tolist(), pairs))))
    started = time.process_time()
    with pytest.raises(NotProvedError, match="too many steps"), limited(4 * 10**6):
        prove_identity(ledger)
    assert time.process_time() - started < 40


def test_steps_have_no_identity() -> None:
    """In discrete time a list, even an empty form, is refused."""
    content = copy.deepcopy(identities.rated())
    content["model"] |= {"time": "discrete", "dt": (1.0).hex()}
    content["model_sha256"] = model_sha256(content["model"])
    with pytest.raises(NotProvedError, match="discrete"):
        prove_identity(read_ledger(content))


def _plain(identity: list[Any]) -> Certificate:
    """A linear decay with channels that do nothing, whose proof is one of any two solutions."""
    model = quadratic((-np.eye(3)).tolist(), {(0, 1, 2): 0.0, (1, 0, 2): 0.0})
    content = known(model, np.eye(3).tolist(), identity, claim="rate-and-gain", kappa=Fraction(1, 2))
    return with_proof(content | {"p": [1, -1]})


def test_an_identity_forgoes_what_is_said_of_two_solutions() -> None:
    """With an entry in the list, be it 0, nothing is said of two solutions or of other equilibria."""
    result = check(data(_plain([])))
    assert isinstance(result, Accepted)
    assert {"incremental", "everywhere"} <= set(result.further)
    result = check(data(_plain([(3, 2, 0)])))
    assert isinstance(result, Accepted)
    assert not {"incremental", "everywhere", "members"} & set(result.further)


def _value(model: Any, identity: Any, x: list[Fraction], ball: Any = None) -> Fraction:
    """The form of an identity of powers at x, from x*, by arithmetic alone."""
    zeta = list(x)
    for channel in model.channels:
        degree = int(channel.text[3:])
        at = sum((r * (ball.x[i] - model.x_ref[i]) for i, r in channel.row.items()), Fraction(0)) if ball else 0
        zeta.append((at + sum(r * x[i] for i, r in channel.row.items())) ** degree - Fraction(at) ** degree)
    return sum((2 * sigma * zeta[i] * zeta[j] for i, j, sigma in identity), Fraction(0))


def identity_is_zero(model: Any, identity: Any, ball: Any = None, seed: int = 0) -> bool:
    """Whether an identity of powers is 0 at thirty random states, in fractions."""
    choose = random.Random(seed)
    states = [[Fraction(choose.randint(-99, 99), 7) for _ in range(model.n)] for _ in range(30)]
    return all(_value(model, identity, x, ball) == 0 for x in states)


def _drawn(choose: random.Random) -> Certificate:
    """A model of squares, cubes or fourth powers on random rows about a random point, with a relation among them."""
    n, degree = choose.randint(1, 4), choose.randint(2, 4)
    first, second = ([choose.randint(-3, 3) for _ in range(n)] for _ in range(2))
    first[0], second[0] = 1, choose.choice((1, 2, 3))
    R = [first, [2 * v for v in first], second, [-v for v in second]]
    model = quadratic((-np.eye(n)).tolist(), {(0, 0, 0): 1.0}) | {"terms": [
        {"f": f"x**{degree}", "R": R, "A": [[0.0] * 4] * n}
    ]}  # fmt: skip
    content = known(model, np.eye(n).tolist(), [], shift=choose.choice((None, "any")))
    if content["curves"][0]["shift"]:
        x = [choose.randint(-2, 2) for _ in range(n)]
        content["operating_point"] = {"x": [number(v) for v in x], "radius": [0, 0], "u": [number(0)]}
    one, two = choose.randint(-3, 3), choose.randint(-3, 3)
    few = choose.randint(1, n)  # s of 2 r is 2^d s of r and that of -r is (-1)^d, both about 0 alone
    truth: dict[tuple[int, int], Any] = {(n + 1, i): one for i in range(few)}
    truth |= {(n, i): -one * 2**degree for i in range(few)}
    truth |= {(n + 3, n + 2): two * (-1) ** degree, (n + 2, n + 2): -two}
    if choose.random() < 0.5:
        place = choose.choice(sorted(truth))
        truth[place] = truth[place] + choose.choice((1, -1, Fraction(1, 2**70)))
    content["facts"]["identity"] = [[i, j, number(v)] for (i, j), v in sorted(truth.items())]
    return content


def test_the_expansion_agrees_with_values_at_random_points() -> None:
    """Of random forms those are proved whose value is 0 at thirty random points, in fractions, and no others."""
    choose, answers = random.Random(5), {True: 0, False: 0}
    for seed in range(400):
        ledger = read_ledger(json.loads(data(_drawn(choose))))
        zero = identity_is_zero(ledger.model, ledger.identity, ledger.ball, seed)
        try:
            prove_identity(ledger)
            proved = True
        except NotProvedError:
            proved = False
        assert proved == zero
        answers[zero] += 1
    assert min(answers.values()) > 50, answers


def _galerkin(choose: random.Random, n: int, growth: float) -> Certificate:
    """x' = L x + Q(x, x) with x'Q(x, x) = 0 and x'L x <= growth |x|^2, with equality somewhere, and its energy."""
    products, entries, columns = {}, {}, {}
    for i in range(n):
        for j in range(i + 1, n):
            for k in range(j + 1, n):
                a, b = choose.randint(-4, 4), choose.randint(-4, 4)
                for place, value in (((i, j, k), a), ((j, i, k), b), ((k, i, j), -a - b)):
                    products[place] = float(value)
    model = quadratic([[0.0] * n for _ in range(n)], products)
    skew = [[choose.randint(-3, 3) for _ in range(n)] for _ in range(n)]
    model["A0"] = [[float(skew[i][j] - skew[j][i]) if i != j else (growth if i == 0 else -1.0) for j in range(n)]
                   for i in range(n)]  # fmt: skip
    for i, line in enumerate(model["terms"][0]["A"]):
        for c, value in enumerate(line):
            columns[n + c, i] = -Fraction(value)
    entries = {place: value for place, value in columns.items() if value}
    return known(model, np.eye(n).tolist(), [(*place, value) for place, value in entries.items()])


@pytest.mark.parametrize("n", [3, 5, 7])
def test_models_that_keep_energy_are_certified_if_and_only_if_they_lose_it(n: int) -> None:
    """Random truncations of flows: damping and energy prove them; without it, or with a wrong product, nothing."""
    choose = random.Random(n)
    for _ in range(5):
        assert isinstance(check(data(with_proof(_galerkin(choose, n, -0.5)))), Accepted)
        with pytest.raises(RoundingError):
            with_proof(_galerkin(choose, n, 0.5))
        wrong = _galerkin(choose, n, -0.5)
        wrong["model"]["terms"][0]["A"][0][-1] = (float.fromhex(wrong["model"]["terms"][0]["A"][0][-1]) + 1).hex()
        wrong["facts"]["identity"] = sorted(
            [*(e for e in wrong["facts"]["identity"] if e[:2] != [n + len(wrong["points"]) - 1, 0]),
             [n + len(wrong["points"]) - 1, 0, number(-float.fromhex(wrong["model"]["terms"][0]["A"][0][-1]))]]
        )  # fmt: skip
        wrong["model_sha256"] = model_sha256(wrong["model"])
        result = check(data(with_proof(wrong)))
        assert isinstance(result, Rejected)
        assert result.where == "facts.identity"
