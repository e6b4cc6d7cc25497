"""Files made to be slow, large or broken: each is answered with its place, within the budget of docs/trust-base.md."""

import copy
import json
import os
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from checker import known_ledgers, named
from checker.identities import below_one
from checker.maker import data, file, model
from checker.test_algebraic_regions import _content as fold_region
from checker.test_network import file as network_file
from checker.test_network import model as network_model
from persid_check import Accepted, FormatError, Malformed, Rejected, canonical_model, check, work
from persid_check.networks.certificate import FIELDS as NETWORK_FIELDS
from places import ROOT

MEMORY = 1_500 * 2**20  # address space of the process that checks them all; the interpreter and FLINT are in it


def unit(size: int) -> list[list[int]]:
    """The lower rows of an identity."""
    return [[int(i == j) for j in range(i + 1)] for i in range(size)]


def with_model(**fields: Any) -> bytes:
    """A certificate whose model has other fields; its hash is not the point."""
    content = copy.deepcopy(named.load("g_mixed_pair"))
    content["model"].update(fields)
    return data(content)


def triplets(*shape: Any) -> dict[str, Any]:
    """A sparse matrix without entries."""
    return {"shape": list(shape), "coo": [[], [], []]}


def tower(f: str) -> bytes:
    """Numbers of 61,440 binary places as arguments of waves."""
    text = "x" + f"+0*{f}(((2**64)**64)**15)" * 20
    groups = [{"forms": [[[1, 0], [0, 0]], [[0, 0], [1, 0]]], "mu": [[0, 0], [1, 0]], "products": []}]
    return data(
        file(
            model([(text, None, [[-1]])], [[-1]]),
            "G",
            operating_point=None,
            P={"diagonal": [[1, 0]]},
            groups=groups,
            dropped=[],
            gamma=[4, 0],
            proof={"P": [[1]], "Q": unit(3)},
        )
    )


def region(n: int, bits: int) -> bytes:
    """Claim R with a full P of long numbers, whose exact inverse takes minutes."""
    P = [[[(1 << (bits + 8)) + i if i == j else (i * 2**bits) // 3 + j, -bits] for j in range(i + 1)] for i in range(n)]
    stable = model([], [[-float(i == j) for j in range(n)] for i in range(n)], [[0.0]] * n, n=n)
    return data(
        file(
            stable,
            "R",
            operating_point=None,
            P={"lower": P},
            groups=[],
            dropped=[],
            gamma=[1, 0],
            kappa=[1, 0],
            p=[1, -1],
            box=[[[-1, 0], [1, 0]]] * n,
            level=[1, -1],
            input_bound=[1, -1],
            proof={"P": unit(n), "Q": unit(n + 1)},
        )
    )


def ball(n: int) -> bytes:
    """An operating point of a model with n dense argument rows."""
    rows = [[1.0 + i + j for j in range(n)] for i in range(n)]
    dense = model([("tanh(x)", rows, rows)], rows, [[0.0]] * n, n=n)
    point = {"x": [[0, 0]] * n, "radius": [1, -20], "u": [[0, 0]]}
    groups = [{"forms": [], "mu": [], "products": []}] * n
    return data(
        file(
            dense,
            "G",
            operating_point=point,
            P={"diagonal": [[1, 0]] * n},
            groups=groups,
            dropped=[],
            gamma=[1, 0],
            proof={"P": unit(n), "Q": unit(2 * n + 1)},
        )
    )


def obstruction(n: int) -> bytes:
    """128 forms for each of n groups."""
    A = [[-float(i == j) for j in range(n)] for i in range(n)]
    groups = [{"forms": [[[1, 0], [0, 0]]] * 128}] * n
    L = [[4 * int(i == j) for j in range(n)] for i in range(n)] + [[int(i == j) for j in range(n)] for i in range(n)]
    subject = model([("tanh(x)", None, A)], [[-2 * v for v in row] for row in A], [[0.0]] * n, n=n)
    return data(file(subject, "infeasible", family="diagonal", groups=groups, L=L, proof={}))


def products(count: int, functions: int) -> bytes:
    """All products of many forms over many functions of one argument."""
    texts = [f"tanh({i + 1}*x/{functions})" for i in range(functions)]
    subject = model([(texts, [[1.0]] * functions, [[-1.0] * functions])], [[-1]])
    pairs = [[a, b, [1, -4]] for a in range(count) for b in range(a + 1, count)]
    forms = [[[int(j == 0), 0] for j in range(functions + 1)]] * count
    groups = [{"forms": forms, "mu": [[1, 0]] * count, "products": pairs}]
    return data(
        file(
            subject,
            "G",
            operating_point=None,
            P={"diagonal": [[1, 0]]},
            groups=groups,
            dropped=[],
            gamma=[4, 0],
            proof={"P": [[1]], "Q": unit(functions + 2)},
        )
    )


def burning() -> bytes:
    """Forms that no method proves, of a function of many instructions."""
    text = "x-x" + "+erf(x)-erf(x)" * 60
    forms = [[[1000 + i, -10], [-1, 0]] for i in range(128)]
    groups = [{"forms": forms, "mu": [[1, 0]] * 128, "products": []}]
    return data(
        file(
            model([(text, None, [[-1]])], [[-1]]),
            "G",
            P={"diagonal": [[1, 0]]},
            groups=groups,
            dropped=[],
            operating_point={"x": [[0, 0]], "radius": [0, 0], "u": [[0, 0]]},
            gamma=[4, 0],
            proof={"P": [[1]], "Q": unit(3)},
        )
    )


def states_alone() -> bytes:
    """A network of four million states in 600 bytes."""
    network = {"states": 4_000_000, "inputs": [], "x_ref": None, "u_ref": [], "A0": None, "terms": [], "B": None}
    network |= {"format": "persid-model-1", "b": None, "domain": {"shape": [4_000_000, 2], "sha256": "0" * 64}}
    content = {"format": "persid-certificate-1", "claim": "L1", "statement": "", "model_sha256": "", "model": network}
    content |= {"operating_point": "every", "kinds": [{"functions": [], "forms": []}], "kappa": [1, 0]}
    return data(content | {"weights": None, "companion": None})


TERM = {"f": "tanh(x)", "R": None, "A": [["-0x1.0000000000000p+0", "0x0.0p+0"]] * 2}
FILES: dict[str, tuple[str, Callable[[], bytes]]] = {
    "a wide sparse matrix": ("Malformed", lambda: with_model(A0=triplets(1, 32_000_000))),
    "many wide sparse matrices": (
        "Malformed",
        lambda: with_model(terms=[{**TERM, "R": triplets(32_000_000, 2), "A": triplets(2, 32_000_000)}] * 20),
    ),
    "a negative shape": ("Malformed", lambda: with_model(A0=triplets(1, -5))),
    "an immense shape": ("Malformed", lambda: with_model(A0=triplets(1, 10**30))),
    "a companion elsewhere": ("Malformed", lambda: with_model(A0={"npz": "../x.npz", "name": "a", "sha256": "0"})),
    "f is a nested list": ("Malformed", lambda: with_model(terms=[{**TERM, "f": [["tanh(x)"], "x"]}])),
    "f is an object": ("Malformed", lambda: with_model(terms=[{**TERM, "f": [{"a": 1}, "x"]}])),
    "B is null": ("Malformed", lambda: with_model(B=None)),
    "b is an object": ("Malformed", lambda: with_model(b={"a": 1})),
    "a tower under a sine": ("Rejected", lambda: tower("sin")),
    "a tower under a tangent": ("Rejected", lambda: tower("tan")),
    "a long P in a region": ("Rejected", lambda: region(50, 2000)),
    "dense rows about a ball": ("Rejected", lambda: ball(120)),
    "many forms in an obstruction": ("Accepted", lambda: obstruction(100)),
    "many products": ("Rejected", lambda: products(128, 100)),
    "forms that take too many steps": ("Rejected", burning),
    "states without numbers": ("Malformed", states_alone),
    "brackets": ("Malformed", lambda: b"[" + b"[]," * 5_000_000 + b"[]]"),
    "deep brackets": ("Malformed", lambda: b"[" * 1_000_000),
    "no factor": ("Rejected", lambda: data(named.load("g_mixed_pair") | {"proof": {"P": [], "Q": []}})),
}  # fmt: skip

CHECKER = """
import resource, sys
resource.setrlimit(resource.RLIMIT_AS, (int(sys.argv[1]),) * 2)
from persid_check import check
for name in sys.argv[2:]:
    result = check(name)
    print(type(result).__name__, getattr(result, "where", ""), sep=chr(9))
"""


def test_hostile_files_are_answered_in_little_memory(tmp_path: Path) -> None:
    """Each of them is answered as it should be, with a place, by one process of 1.5 GB; none with a traceback."""
    names = [tmp_path / f"{k}.json" for k in range(len(FILES))]
    for name, (_, content) in zip(names, FILES.values(), strict=True):
        name.write_bytes(content())
    done = subprocess.run(
        [sys.executable, "-c", CHECKER, str(MEMORY), *map(str, names)],
        env={**os.environ, "PYTHONPATH": str(ROOT / "src")}, capture_output=True, text=True,
    )  # fmt: skip
    answers = [line.split("\t") for line in done.stdout.splitlines()]
    assert done.stderr == ""
    found = {name: kind for name, (kind, _) in zip(FILES, answers, strict=True)}
    assert found == {name: kind for name, (kind, _) in FILES.items()}
    assert all(place or kind == "Accepted" for kind, place in answers)


def test_steps_are_allowed_by_bytes_up_to_a_limit() -> None:
    """A file buys steps by its length, up to a limit that only a very long one passes."""
    assert work.allowance(1000) == work.STEPS + 1000 * work.STEPS_OF_A_BYTE
    assert work.allowance(10**5, work.SEARCHED) == work.MOST_STEPS
    assert work.allowance(10**6, work.SEARCHED, 10**7) == 10**7
    assert work.allowance(10**7) == work.MOST_OF_A_BYTE * 10**7


SPARSE = {
    "format": "persid-model-1", "states": ["x1"], "inputs": ["u1"], "A0": {"shape": [1, 1], "coo": [[0], [0], [-1]]},
    "terms": [{"f": "tanh(x)", "R": None, "A": [[-1]]}], "B": [[1]],
}  # fmt: skip


@pytest.mark.parametrize(
    "fields",
    [
        {"A0": triplets(1, 32_000_000)}, {"A0": triplets(1, -5)}, {"A0": triplets(1, 10**30)},
        {"A0": {"shape": [1, 1], "coo": [[0], [0], [10**400]]}}, {"A0": {"shape": [1, 1], "coo": [[10**30], [0], [1]]}},
        {"b": {"a": 1}}, {"b": triplets(1)}, {"domain": triplets(1, 2)}, {"terms": [SPARSE] * 65}, {"terms": {"a": 1}},
        {"terms": [{"f": [["x"]], "R": None, "A": [[1]]}]}, {"terms": [{"f": [{"a": 1}], "R": None, "A": [[1]]}]},
        {"states": 10**30}, {"inputs": {"a": 1}}, {"B": {}},
    ],
    ids=str,
)  # fmt: skip
def test_a_sparse_model_that_is_not_as_specified_is_refused(fields: dict[str, Any]) -> None:
    """The model beside a certificate, with its matrices in any form, is refused with a place before it is expanded."""
    assert canonical_model(SPARSE)
    with pytest.raises(FormatError):
        canonical_model({**SPARSE, **fields})


def test_a_wave_far_out_is_no_number_and_nothing_false() -> None:
    """Far out sine and cosine are enclosed by [-1, 1], and the tangent is not defined."""
    from persid_check.enclosure import UndefinedError, constant

    far = constant(Fraction(2) ** 200)
    for name in ("sin", "cos"):
        wave = far.apply(name)
        assert (float(wave.lo), float(wave.hi)) == (-1.0, 1.0)
    with pytest.raises(UndefinedError):
        far.apply("tan")


LEAVES = [10**699, -(2**600), 2**64, 1.5, "", "x", "tanh(x)", "0x1.0p+0", "nan", "x" * 1001, "../a.npz", "\u202e", "x1"]
ODD: st.SearchStrategy[Any] = st.recursive(
    st.none() | st.booleans() | st.integers(-3, 3) | st.sampled_from(LEAVES),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.sampled_from(["coo", "shape", "npz", "x", "lower"]), inner, max_size=3)
    ),
    max_leaves=6,
)


def network_of_one() -> dict[str, Any]:
    """A network of one node, and others with another coefficient."""
    alone = network_file(network_model([[-2.0]], [("tanh(x)", [[1.0]], [[-1.0]])], [[1.0]]),
                         [([("tanh(x)", 1.0)], [[0.0, 1.0]])], [1.0], 1.0, every=True)  # fmt: skip
    return alone | {"deviations": [{"state": 0, "C": [[[0, [1, -4]], [2, [1, -4]]]]}]}


def places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    """All places of a JSON value."""
    items = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, inner in items for place in places(inner, (*path, key)))]


BASES = {
    **{name: named.load(name) for name in named.MAKERS},
    **{
        name: known_ledgers.load(name)
        for name in ("plant", "difference", "slopes", "practical", "identity_rated", "steps_values")
    },
    "network": network_of_one(),
    "identity": below_one(),
    "algebraic": fold_region(),
}
PLACES = {name: places(content)[1:] for name, content in BASES.items()}


@settings(max_examples=250, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_any_place_of_a_file_may_hold_anything(draw: st.DataObject) -> None:
    """Types swapped, deep, huge and odd values at random places: always an answer, never an exception."""
    name = draw.draw(st.sampled_from(sorted(BASES)))
    content = copy.deepcopy(BASES[name])
    for path in draw.draw(st.lists(st.sampled_from(PLACES[name]), min_size=1, max_size=2)):
        place: Any = content
        try:
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = draw.draw(ODD)
        except (TypeError, KeyError, IndexError):
            continue  # an odd value stands above
    result = check(json.dumps(content).encode())
    assert isinstance(result, Accepted | Rejected | Malformed)
    if not isinstance(result, Accepted):
        assert result.where
        assert result.why


@pytest.mark.parametrize("claim", ["L1", "L1-infeasible", "G", "refuted", "infeasible", "iss"])
@pytest.mark.parametrize("model", [None, True, 1, "x", [], [1, 0], {}, {"terms": 1}, {"states": {}, "A0": {}}])
def test_a_model_may_be_anything(claim: str, model: object) -> None:
    """Of each kind of file what stands in place of the model is malformed, and no exception."""
    fields = {"G": "g_linear", "refuted": "refuted_line", "infeasible": "infeasible_full"}
    content = named.load(fields[claim]) if claim in fields else network_of_one()
    if claim == "iss":
        content = below_one()
    if claim == "L1-infeasible":
        content = {name: content.get(name) for name in NETWORK_FIELDS[claim]}
    answer = check(json.dumps(content | {"model": model, "claim": claim}).encode())
    assert isinstance(answer, Malformed)
    assert answer.where.startswith("model") or claim in ("L1", "L1-infeasible")


@pytest.mark.parametrize("text", [b"", b"null", b"[]", b'{"claim":"G","claim":"E"}', b"\xff", b'{"a":1e999}', b"NaN"])
def test_what_is_no_object_of_fields_is_malformed(text: bytes) -> None:
    """Empty files, other values, duplicate keys, bytes that are no text, numbers that are none."""
    assert isinstance(check(text), Malformed)
