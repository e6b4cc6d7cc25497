"""Files that took minutes once: each is answered soon, whatever numbers it holds and however they hash."""

import copy
import json
import random
from collections.abc import Callable
from fractions import Fraction
from time import process_time
from typing import Any

import numpy as np
import pytest
from flint import ctx

from checker import known_ledgers
from checker.identities import known
from checker.ledgers import Sketch, curve, draft, point
from checker.maker import data
from checker.maker import model as model_object
from checker.test_algebraic_regions import _content as fold_region
from checker.test_network import file as network_file
from checker.test_network import model as network_model
from persid.certificates.ledger import with_proof
from persid_check import Accepted, Malformed, Rejected, canonical_model, check, model_sha256
from persid_check.enclosure import PRECISION, constant
from persid_check.ledger.algebraic import prove_algebraic
from persid_check.ledger.file import read_ledger
from persid_check.ledger.identities import prove_identity
from persid_check.model import model_of
from persid_check.networks import certificate as of_networks
from persid_check.networks import check as networks
from persid_check.networks.members import Members
from persid_check.results import NotProvedError
from persid_check.search.memory import Question
from persid_check.work import MOST_STEPS, SEARCHED, STEPS, limited

PRIME = 2**61 - 1  # Python's numbers hash modulo it
SECONDS = 30  # of the processor of a busy machine, for files of half a megabyte at most, which took minutes
Content = dict[str, Any]


def many_inputs() -> Content:
    """1,000 inputs, and an ellipsoid of 3,500 rows that read none of them."""
    alone = network_file(network_model([[-2.0]], [], [[0.0] * 1000]), [([], [])], [1.0], 1.0, every=True)
    return alone | {"deviations": [{"state": 0, "C": [[[0, [1, -12]]]] * 3500}]}


def one_hash() -> Content:
    """2,600 lemmas, y times multiples of a number that hashes to 0."""
    content = copy.deepcopy(known_ledgers.load("incremental"))
    curve = content["curves"][0]
    form = curve["forms"][0] | {"upper": None, "lower": None, "is": "nondecreasing"}
    rest = [[0, 0]] * len(curve["functions"])
    for first in range(1, 2600, 128):
        forms = [form | {"l": [[PRIME * k, -80], *rest]} for k in range(first, first + 128)]
        content["curves"].append(copy.deepcopy(curve) | {"forms": forms})
    return content


def long_forms() -> Content:
    """A node with eight functions and twelve forms of 2,048 bits: their generators have 36,000."""
    draw, slopes = random.Random(1), [1 + i / 8 for i in range(8)]
    model = network_model([[-2.0]], [(["tanh(x)"] * 8, [[a] for a in slopes], [[-1.0] * 8])], [[1.0]])
    kind = ([("tanh(x)", a) for a in slopes], [])
    content = network_file(model, [kind], [1.0], 1.0, every=True)
    content["kinds"][0]["forms"] = [[_long(draw) for _ in range(9)] for _ in range(12)]
    return content


def long_tails() -> Content:
    """1,500 curves of a function whose expansions at infinity have thousands of terms; no channel stands on them."""
    content = copy.deepcopy(known_ledgers.load("incremental"))
    text = "abs(" + "+".join(["expm1(tanh(softplus(x)))"] * 3) + ")"
    empty = {"shift": None, "domain": None, "continuous": [0, [-2, 2]], "forms": [], "products": []}
    content["curves"] += [empty | {"functions": [[text, [k, 0]]]} for k in range(1, 1501)]
    return content


def long_pieces() -> Content:
    """30,000 pieces of a function of 564 symbols."""
    content = copy.deepcopy(known_ledgers.load("rated"))
    text = "+".join(["tanh(tanh(tanh(x)))"] * 47)
    content["model"]["terms"][0]["f"] = content["curves"][0]["functions"][0][0] = text
    content["curves"][0] |= {"continuous": [0, [-32, 0, 32]]}
    content["curves"][0]["forms"][0] |= {"cuts": [-10, list(range(-30_000, 30_000))]}
    return content | {"model_sha256": model_sha256(content["model"])}


def many_strips() -> Content:
    """x' = -x of 100 states and 12,000 strips: each is bounded by a sum of 100 quotients of long numbers."""
    model = model_object([], (-np.eye(100)).tolist(), n=100)
    content = draft(Sketch(model, [], [], [], "region", 1, full=False))
    content["P"]["diagonal"], content["gamma"] = [[1, 0]] * 100, [1, 9]
    strip = [[[0, [1, 0]]], [-9, 0], [9, 0]]
    return with_proof(content | {"p": [1, -1], "level": [1, 0], "strips": [strip] * 12_000})


def many_points() -> Content:
    """1,500 points, each with 30 channels: a program of 899 instructions is compared for every one."""
    text = "+".join(["x"] * 450)
    model = model_object([(text, [[1.0]], [[0.0]])], [[-1.0]])
    sketch = Sketch(model, [curve([(text, 1)] * 30)], [point(0, {0: 1}, [0] * 30, [])] * 1500, [])
    return with_proof(draft(sketch) | {"P": {"lower": [[[1, 0]]]}, "gamma": [1, 0], "dropped": [1]})


def long_products() -> Content:
    """2,000 facts, each the product of two rows of 120 numbers of 2,040 bits: 2.7 million products."""
    draw = random.Random(0)
    long = [((0, *[0] * 120), "nondecreasing")] * 2
    model = model_object([("2*x", [[1.0]] * 120, [[0.0] * 120])], [[-1.0]])
    content = draft(
        Sketch(model, [curve([("2*x", 1)] * 120, *long)], [point(0, {0: 1}, [*range(120)], [])], [("value", 0, 0, 1)])
    )
    for form in content["curves"][0]["forms"]:
        form["l"] = [[1, 0]] + [_long(draw) for _ in range(120)]
    content["facts"]["value"] = [[0, 0, 1, [1, 0]]] * 2000
    content["gamma"] = [1, 0]
    return content


def many_squares() -> Content:
    """8,000 densities of a form of 150 long numbers: whether its bound is one by its square is asked of each."""
    draw = random.Random(0)
    model = model_object([("2*x", [[1.0]] * 150, [[0.0] * 150])], [[-1.0]])
    line, at = curve([("2*x", 1)] * 150, *[((0, *[0] * 150), "nondecreasing")] * 2), point(0, {0: 1}, [*range(150)], [])
    content = draft(Sketch(model, [line], [at], []))
    d, rest = _long(draw), [_long(draw) for _ in range(150)]
    for form, head in zip(content["curves"][0]["forms"], ([d[0] + 1, d[1]], [1, d[1]]), strict=True):
        form["l"] = [head, *rest]
    content["curves"][0]["forms"][0]["lower"] = [d, 1]
    content["points"][0]["densities"], content["gamma"] = [[0, [1, 0]]] * 8000, [1, 0]
    return content


def many_centres() -> Content:
    """4,000 differences of points whose centres are sums of 100 products of numbers of 2,040 bits; all points rest."""
    draw, line = random.Random(0), curve([], ((1,), "nondecreasing"), shift="any")
    content = draft(Sketch(model_object([], [[0.0] * 100] * 100, [[]] * 100, n=100), [line], [], [], full=False))
    content["points"] = [point(0, {}, [], []) | {"row": [[i, _long(draw)] for i in range(100)]}] * 2
    content["facts"]["difference"] = [[0, 1, -1, 0, 0, [0, 0]]] * 4000
    content["gamma"] = [1, 0]
    return content | {"operating_point": {"x": [_long(draw) for _ in range(100)], "radius": [0, 0], "u": []}}


def short_functions() -> Content:
    """80,000 pieces of 100 functions that are x itself: what is done with each counts, not its instruction alone."""
    content = draft(
        Sketch(model_object([], [[-1.0]]), [curve([("x", 1)] * 100, ((1, *[1] * 100), "nondecreasing"))], [], [])
    )
    content["curves"][0]["forms"][0]["cuts"] = [-20, list(range(-40_000, 40_000))]
    content["gamma"] = [1, 0]
    return content


def _long(draw: random.Random) -> list[int]:
    return [draw.getrandbits(2040) | 1, -draw.randrange(2000)]


@pytest.mark.parametrize(
    ("content", "answer"),
    [
        (many_inputs, Accepted),
        (one_hash, Accepted),
        (long_forms, Rejected),
        (many_strips, Rejected),
        (many_centres, Rejected),
        pytest.param(long_products, Rejected, marks=pytest.mark.long),
        pytest.param(many_squares, Rejected, marks=pytest.mark.long),
        pytest.param(short_functions, Rejected, marks=pytest.mark.long),
        pytest.param(many_points, Rejected, marks=pytest.mark.long),
        pytest.param(long_tails, Rejected, marks=pytest.mark.long),
        pytest.param(long_pieces, Rejected, marks=pytest.mark.long),
    ],
    ids=[
        "inputs",
        "hashes",
        "long_forms",
        "strips",
        "centres",
        "long_products",
        "squares",
        "short_functions",
        "points",
        "long_tails",
        "long_pieces",
    ],
)
def test_no_file_takes_long(content: Callable[[], Content], answer: type) -> None:
    """Of 60 to 500 kB each."""
    written = data(content())
    begun = process_time()
    assert isinstance(check(written), answer)
    assert process_time() - begun < SECONDS


@pytest.mark.parametrize(("channels", "bits"), [(1000, 1000), (1350, 2000)])
def test_a_short_file_has_no_matrix_of_long_numbers(channels: int, bits: int) -> None:
    """All channels stand at points of one curve with two long forms: 156 kB took 5 s and 2 GB before."""
    terms = [("tanh(x)", [[1.0]] * channels, [[-1.0] * channels])]
    one = curve([("tanh(x)", 1)], ((1, 0), "nondecreasing"), ((0, 1), "nondecreasing"))
    for form in one["forms"]:
        form["l"] = [[m and 2**bits - 1, -bits] for m, _ in form["l"]]
    points = [point(0, {0: 1}, [c], [0]) for c in range(channels)]
    sketch = Sketch(canonical_model(model_object(terms)), [one], points, [("value", c, 0, 1) for c in range(channels)])
    content = draft(sketch) | {"P": {"diagonal": [[1, 0]]}, "gamma": [1, 0]}
    for at in content["points"]:
        at["densities"] = [[0, [1, 0]]]
    for fact in content["facts"]["value"]:
        fact[-1] = [1, 0]
    written = data(content | {"proof": {"P": [[1]], "M": [[1]], "V": None}})
    assert len(written) < 220_000
    answer = check(written)
    assert isinstance(answer, Rejected)
    assert "too many digits for a file of this length" in answer.why


def test_linear_terms_are_merged_by_one_product() -> None:
    """A dense term f = x of 200 states is read in a second: its products took half a minute one by one."""
    dense = np.random.default_rng(0).normal(size=(200, 200)).tolist()
    written = canonical_model(model_object([("x", dense, dense)], n=200))
    begun = process_time()
    assert len(model_of(written).channels) == 0
    assert process_time() - begun < SECONDS / 3


def test_long_monomials_count_as_such() -> None:
    """Two powers of rows whose product has three million monomials of 24 factors are refused before it is made."""
    rows = [[float(k // 5 == side) for k in range(10)] for side in (0, 1)]
    model = model_object(
        [("x**12", rows, [[0.0, 0.0]] * 10)], [[-float(i == j) for j in range(10)] for i in range(10)], n=10
    )
    content = known(model, [[int(i == j) for j in range(10)] for i in range(10)], [(11, 10, 1)])
    ledger, begun = read_ledger(json.loads(json.dumps(content))), process_time()
    with pytest.raises(NotProvedError, match="too many steps"), limited(MOST_STEPS):
        prove_identity(ledger)
    assert process_time() - begun < SECONDS / 6


def test_many_kinds_with_long_expansions_are_within_the_limit() -> None:
    """Networks of a thousand different softplus take a few thousand steps for each kind, which its bytes allow."""
    form, rest = [[0.0, 1.0], [1.0, -1.0]], [[0.0]] * 8
    A0 = [[-9.0 * (i == j) for j in range(8)] for i in range(8)]
    R, A = ([[a * (i == j) for j in range(8)] for i in range(8)] for a in (1.0, -0.1))
    R = [[R[i][j] * (0.5 + i / 128) for j in range(8)] for i in range(8)]
    kinds = [([("softplus(x)", 0.5 + i / 128)], form) for i in range(8)]
    content = network_file(network_model(A0, [("softplus(x)", R, A)], rest), kinds, [1.0] * 8, 1.0, every=True)
    claim = of_networks.read_network(content)
    with limited(10**6) as account:
        of_networks.prove_network(claim)
    kind = len(json.dumps(content["kinds"][0], separators=(",", ":")))
    assert 8 * kind * SEARCHED + STEPS > account.spent > 10_000
    assert 1000 * account.spent / 8 < networks.MOST_STEPS


def test_kinds_that_no_node_has_are_not_read(monkeypatch: pytest.MonkeyPatch) -> None:
    """Their number alone shows that some are too many."""
    content = network_file(network_model([[-2.0]], [], [[1.0]]), [([], [])], [1.0], 1.0, every=True)
    assert isinstance(check(data(content)), Accepted)
    content["kinds"] += [{"functions": [["tanh(x)", [k, 0]]], "forms": []} for k in range(1, 4)]
    monkeypatch.delattr(of_networks, "_kind")
    answer = check(data(content))
    assert isinstance(answer, Malformed)
    assert answer.why.startswith("1 occur among the nodes")


def test_each_kind_of_the_nodes_is_needed() -> None:
    """As many as there are, but another one, or one twice, are not those of the nodes."""
    model = network_model([[-2.0, 0.0], [0.0, -2.0]], [("tanh(x)", [[1.0, 0.0]], [[-1.0], [0.0]])], [[1.0], [1.0]])
    kinds = [([("tanh(x)", 1.0)], [[0.0, 1.0]]), ([], [])]
    assert isinstance(check(data(network_file(model, kinds, [1.0, 1.0], 1.0, every=True))), Accepted)
    for other in ([([("tanh(x)", 2.0)], [[0.0, 1.0]]), ([], [])], [([], []), ([], [])]):
        answer = check(data(network_file(model, other, [1.0, 1.0], 1.0, every=True)))
        assert isinstance(answer, Malformed)
        assert answer.where == "kinds"


def test_numbers_of_one_hash_are_found_apart() -> None:
    """What is remembered has another hash in every process, and equal arguments have the same."""
    numbers = [Fraction(PRIME * k) for k in range(1, 101)]
    assert len({hash(number) for number in numbers}) == 1
    assert len({hash(Question.of("lemma", (number,))) for number in numbers}) == 100
    assert Question.of(numbers[0], None) == Question.of(Fraction(PRIME), None)
    assert Question.of(Fraction(1, 2)) != Question.of(Fraction(1, 3))


def test_a_constant_is_the_same_whoever_asked_first() -> None:
    """Asked with few bits before, it is as sharp as ever."""
    for value in (Fraction(1, 1234577), Fraction(1, 3**200)):
        with ctx.workprec(20):
            first = constant(value)
        with ctx.workprec(PRECISION):
            second = constant(value)
            assert (second.hi - second.lo) * 2**180 < second.hi
        assert (first.lo, first.hi) == (second.lo, second.hi)


def test_products_of_the_equations_are_counted() -> None:
    """Each that is read takes steps, those with the factor 0, too."""
    spent = []
    for more in (0, 1000):
        content = json.loads(json.dumps(fold_region()))
        content["algebraic"]["solvable"]["products"] += [[0, 1, 1, [0, 0]]] * more
        ledger = read_ledger(content)
        with limited(10**6) as account, ctx.workprec(PRECISION):
            prove_algebraic(ledger, ledger.algebraic)
        spent.append(account.spent)
    assert spent[1] - spent[0] >= 4 * 1000


def test_entries_at_inputs_are_counted_once() -> None:
    """What the rows of C read is gone through once, not for every input."""
    content = many_inputs()
    with limited(10**6) as account:
        claim = of_networks.read_network(content)
        assert isinstance(claim, of_networks.NetworkClaim)
        assert isinstance(claim.members, Members)
        assert not any(claim.members.of_input(j) for j in range(1000))
    assert account.spent == 3500
