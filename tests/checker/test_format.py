"""Reading: canonical models, hashes, groups, strict JSON; and fuzzing of all that reads."""

import copy
import json
import math
import random
import shutil
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from checker import named
from checker.independent import faults
from checker.maker import data, model
from persid_check import (
    Accepted,
    FormatError,
    Malformed,
    Rejected,
    canonical_model,
    check,
    is_positive_definite,
    model_sha256,
)
from persid_check.expression import ExpressionError, parse
from persid_check.model import model_of
from persid_check.subject import groups_of

PLAIN = model([("tanh(x)", [[1, -1]], [[-1], [0.5]])], [[-1, 0], [0, -2]], n=2)
RESULTS = (Accepted, Rejected, Malformed)


def test_canonical_form_is_a_fixed_point_and_hashes_alike() -> None:
    """The canonical form of a canonical form is itself, and both forms have one hash."""
    form = canonical_model(PLAIN)
    assert canonical_model(form) == form
    assert model_sha256(form) == model_sha256(PLAIN) == model_sha256(json.loads(json.dumps(PLAIN)))
    assert form["b"] == ["0x0.0p+0"] * 2


def test_what_is_no_part_of_the_mathematics_does_not_change_the_hash() -> None:
    """Provenance, minus zero, null for zero, one text for equal functions leave the hash; a last bit does not."""
    same = copy.deepcopy(PLAIN) | {"provenance": {"seed": 1}, "x_ref": [0, -0.0], "b": [0, 0]}
    same["terms"][0]["f"] = ["tanh(x)"]
    assert model_sha256(same) == model_sha256(PLAIN)
    other = copy.deepcopy(PLAIN)
    other["A0"][0][0] = math.nextafter(-1.0, 0)
    assert model_sha256(other) != model_sha256(PLAIN)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("A0", [[1, 2]]),
        ("A0", [[1, True], [0, 1]]),
        ("A0", [[1, "2"], [0, 1]]),
        ("A0", [[1, math.nan], [0, 1]]),
        ("A0", [[1, 10**400], [0, 1]]),
        ("B", [[1], [1, 2]]),
        ("b", [1]),
        ("x_ref", {"0": 1}),
        ("states", ["a", "a"]),
        ("states", ["a", "b\n"]),
        ("states", "ab"),
        ("terms", {}),
        ("terms", [{"f": "tanh(x)"}]),
        ("terms", [{"f": "tanh(x)", "R": None, "A": [[1, 0], [0, 1]], "g": 1}]),
        ("terms", [{"f": ["tanh(x)"], "R": None, "A": [[1, 0], [0, 1]]}]),
        ("terms", [{"f": "tanh(y)", "R": None, "A": [[1, 0], [0, 1]]}]),
        ("terms", [{"f": "tanh(x)", "R": [], "A": [[], []]}]),
        ("domain", [[0, 1]]),
        ("format", "persid-model-2"),
        ("extra", 1),
    ],
)
def test_malformed_models_are_refused_by_place(field: str, value: object) -> None:
    """A model with one malformed field raises an error that names the place."""
    with pytest.raises(FormatError, match=r"^model"):
        canonical_model({**PLAIN, field: value})


def test_groups_join_positive_multiples_only() -> None:
    """Rows that are positive multiples share a group; a negative multiple begins its own; f = x makes no channel."""
    rows = [[1, -1], [-1, 1], [3, -3], [0, 0], [0, 1]]
    form = canonical_model(model([("x", None, [[1, 0], [0, 1]]), ("tanh(x)", rows, [[1] * 5] * 2)], n=2))
    found = groups_of(model_of(form))
    assert [group.members for group in found] == [((0, 1), (2, 3)), ((1, 1),), ((3, 1),), ((4, 1),)]
    assert found[0].row == {0: 1, 1: -1}
    assert found[2].row == {}


def test_nearly_equal_rows_are_not_joined() -> None:
    """A row that is a multiple up to rounding only begins its own group."""
    form = canonical_model(model([("tanh(x)", [[0.1, 0.3], [0.2, 0.6], [0.3, 0.9]], [[1] * 3] * 2)], n=2))
    assert len(groups_of(model_of(form))) == 2


def test_definiteness_is_exact() -> None:
    """A matrix with determinant 0, or 2^-200 below, is refused; 2^-200 above is accepted with a good factor."""
    tiny = Fraction(1, 2**200)
    factor = [[2**100], [-(2**101), 2**101]]
    assert is_positive_definite([[1, 1], [1, 1 + tiny]], factor)
    assert not is_positive_definite([[1, 1], [1, 1]], factor)
    assert not is_positive_definite([[1, 1], [1, 1 - tiny]], factor)
    assert not is_positive_definite([[1, 2], [0, 1]], [[1], [0, 1]])
    assert not is_positive_definite([[1, 0], [0, -5]], [[1]])
    assert is_positive_definite([], [])


@settings(max_examples=300, deadline=None)
@given(st.lists(st.lists(st.integers(-6, 6), min_size=3, max_size=3), min_size=3, max_size=3), st.data())
def test_no_factor_proves_an_indefinite_matrix(L: list[list[int]], more: st.DataObject) -> None:
    """Whatever the factor, a symmetric integer matrix is accepted only if its leading minors are positive."""
    M = [[L[i][j] + L[j][i] for j in range(3)] for i in range(3)]
    T = [more.draw(st.lists(st.integers(-50, 50), min_size=i + 1, max_size=i + 1)) for i in range(3)]
    two = M[0][0] * M[1][1] - M[0][1] ** 2
    three = (
        M[0][0] * (M[1][1] * M[2][2] - M[1][2] ** 2)
        - M[0][1] * (M[0][1] * M[2][2] - M[1][2] * M[0][2])
        + M[0][2] * (M[0][1] * M[1][2] - M[1][1] * M[0][2])
    )
    if is_positive_definite(M, T):
        assert M[0][0] > 0
        assert two > 0
        assert three > 0


@settings(max_examples=300, deadline=None)
@given(st.lists(st.integers(-9, 9), min_size=3, max_size=3), st.lists(st.integers(-2, 3), min_size=3, max_size=3))
def test_the_best_factor_proves_just_what_is_positive(below: list[int], heads: list[int]) -> None:
    """Of T M T' = diag(heads), T a unit factor, nothing is in doubt: M is accepted where all heads are positive."""
    a, b, c = below
    T = [[1], [a, 1], [b, c, 1]]
    inverse = [[1, 0, 0], [-a, 1, 0], [a * c - b, -c, 1]]
    M = [[sum(v * h * w for v, h, w in zip(row, heads, other, strict=True)) for other in inverse] for row in inverse]
    assert is_positive_definite(M, T) == all(head > 0 for head in heads)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=400))
def test_bytes_never_crash_the_checker(content: bytes) -> None:
    """Random bytes are malformed, never an exception."""
    assert isinstance(check(content), Malformed)


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers(-(2**70), 2**70) | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=10,
)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(sorted(named.MAKERS)), st.integers(0, 10**9), _JSON)
@pytest.mark.long
def test_replaced_values_never_crash_the_checker(name: str, seed: int, value: object) -> None:
    """A valid certificate with any value replaced by any JSON is answered, and not accepted with a changed shape."""
    certificate, choose = named.load(name), random.Random(seed)
    place, key = certificate, choose.choice(sorted(certificate))
    while isinstance(place[key], dict | list) and place[key] and choose.random() < 0.8:
        place = place[key]
        key = choose.choice(sorted(place)) if isinstance(place, dict) else choose.randrange(len(place))
    place[key] = value
    result = check(data(certificate))
    assert isinstance(result, RESULTS)
    if isinstance(result, Accepted) and not isinstance(value, int):
        assert key in ("statement", "dropped", "products") or certificate == named.load(name) or value in ([], None)


@settings(max_examples=300, deadline=None)
@given(st.sampled_from(sorted(named.MAKERS)), st.integers(0, 10**9), st.binary(max_size=3))
def test_overwritten_bytes_never_crash_the_checker(name: str, seed: int, patch: bytes) -> None:
    """A valid file with bytes overwritten anywhere is answered."""
    content, choose = bytearray(data(named.load(name))), random.Random(seed)
    place = choose.randrange(len(content))
    content[place : place + len(patch)] = patch
    assert isinstance(check(bytes(content)), RESULTS)


_TOKENS = [
    "x",
    "1",
    "2.5",
    ".5",
    "1e3",
    "1e999",
    "+",
    "-",
    "*",
    "/",
    "**",
    "(",
    ")",
    "sin",
    "tanh",
    "sqrt",
    "softsign",
    "relu",
    "abs",
    "erf",
    "y",
    "__import__",
    ",",
    ";",
    "'a'",
    "٣",
    "\n",
]


@pytest.mark.parametrize("text", ["x neg", "x pos", "tanh(x) neg neg", "x neg**2", "neg x", "x (x)", "x 2"])
def test_words_of_the_machine_are_no_operators(text: str) -> None:
    """What signs are called inside is not read outside: the grammar knows four operators and the power."""
    with pytest.raises(ExpressionError):
        parse(text)


@settings(max_examples=500, deadline=None)
@given(st.lists(st.sampled_from(_TOKENS), max_size=25).map("".join) | st.text(max_size=30))
def test_the_parser_answers_every_text(text: str) -> None:
    """Any text is either a program that uses the stack properly or an ExpressionError."""
    try:
        program = parse(text)
    except ExpressionError:
        return
    height = 0
    for step in program:
        takes = 2 if step.name in "+-*/" else 0 if step.name in ("x", "number") else 1
        assert height >= takes
        height += 1 - takes
    assert height == 1
    if not text.isprintable():
        return
    form = canonical_model(model([(text, None, [[-1]])]))
    assert isinstance(check(data(_claim(form))), RESULTS)


def _claim(form: dict) -> dict:
    """A certificate for a model of one channel, that uses its function."""
    certificate = named.load("g_linear") | {"model": form, "model_sha256": model_sha256(form)}
    one, none = [1, 0], [0, 0]
    certificate["groups"] = [{"forms": [[none, one]], "mu": [one], "products": []}]
    certificate["proof"]["Q"] = [[1], [0, 1], [0, 0, 1]]
    return certificate


@pytest.mark.parametrize(
    "text", ["(" * 500 + "x" + ")" * 499, "-" * 999 + "x", "x**" * 300, "x" * 2000, "((x)" * 200, "x**1e9"]
)
def test_long_texts_are_answered(text: str) -> None:
    """Texts made to be hard for a parser are answered at once."""
    try:
        assert parse(text)
    except ExpressionError:
        return


def test_nesting_and_quotes_are_read_in_linear_time() -> None:
    """Files of a million brackets, quotes or backslashes are malformed within a second or two."""
    for content in (b"[" * 10**6, b'"' * 10**6, b'"' + b"\\" * 10**6, b'"\\' * 500_000, b'{"a":' * 200_000):
        assert isinstance(check(content), Malformed)


@pytest.mark.slow
def test_atheris_finds_no_crash(tmp_path: Path) -> None:
    """Coverage-guided fuzzing from the valid files ends without a crash or a slow input, and accepts nothing false."""
    pytest.importorskip("atheris", reason="atheris is not installed")
    script, accepted, corpus = (
        Path(__file__).with_name("fuzzing.py"),
        tmp_path / "accepted",
        tmp_path / "corpus",
    )
    accepted.mkdir()
    shutil.copytree(named.VALID, corpus)
    options = ["-runs=100000", "-max_total_time=300", "-timeout=10", "-max_len=4096"]
    run = subprocess.run([sys.executable, str(script), str(accepted), str(corpus), *options], timeout=600, check=False)
    assert run.returncode == 0
    assert [fault for path in accepted.iterdir() for fault in faults(json.loads(path.read_bytes()))] == []
