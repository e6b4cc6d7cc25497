"""Random JSON in the place of any part of a ledger: every text is answered with a place, whatever its form."""

import copy
import json
import resource
import time
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from checker import known_ledgers
from persid_check import Accepted, Malformed, Rejected, check

NAMES = ("spring", "region", "plant", "practical", "outputs", "one_signed", "m_cubes")
_integers = st.one_of(st.integers(-3, 3), st.integers(-(2**70), 2**70), st.sampled_from([2**2047, 2**2048, -(10**699)]))
_dyadics = st.tuples(_integers, st.one_of(st.integers(-9, 9), st.sampled_from([-2001, -2000, 2000, 2001, 2**64])))
_texts = st.one_of(
    st.sampled_from(["x", "any", "", "tanh(x)", "1/x", "x**-1", "sqrt(x)", "x**64.5", "0x1.0p+0", "nan", "\ud800"]),
    st.text(max_size=5),
)  # fmt: skip
_companions = st.fixed_dictionaries(
    {"shape": st.lists(_integers, max_size=3)},
    optional={"npz": st.sampled_from(["../a.npz", "/dev/zero", "a.npz", ""]), "name": _texts, "sha256": _texts,
              "coo": st.lists(st.lists(_integers, max_size=2), max_size=3), "rows": st.just([])},
)  # fmt: skip
_leaves = st.one_of(st.none(), st.booleans(), _integers, _dyadics.map(list), _texts, _companions)
_keys = st.one_of(st.sampled_from(["lower", "diagonal", "x", "is", "l", "cuts", "shape", "P"]), st.text(max_size=3))
_values = st.recursive(
    _leaves,
    lambda inner: st.one_of(st.lists(inner, max_size=4), st.dictionaries(_keys, inner, max_size=3)),
    max_leaves=8,
)  # fmt: skip


@pytest.fixture(autouse=True, scope="module")
def _made() -> None:
    """The ledgers are made before texts are drawn from them."""
    for name in NAMES:
        known_ledgers.load(name)


def _places(value: Any, path: tuple[Any, ...] = ()) -> list[tuple[Any, ...]]:
    inner = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    return [path, *(place for key, entry in inner for place in _places(entry, (*path, key)))]


@st.composite
def _changed(draw: st.DrawFn) -> bytes:
    """A known ledger with one to three places set to anything, left out, doubled, repeated often or exchanged."""
    content: Any = {"": copy.deepcopy(known_ledgers.load(draw(st.sampled_from(NAMES))))}
    for _ in range(draw(st.integers(1, 3))):
        path = draw(st.sampled_from(_places(content)[1:]))
        at = content
        for key in path[:-1]:
            at = at[key]
        match draw(st.sampled_from(["set", "set", "leave out", "double", "repeat", "exchange"])):
            case "leave out" if len(path) > 1:
                del at[path[-1]]
            case "double" if isinstance(at, list):
                at.insert(path[-1], copy.deepcopy(at[path[-1]]))
            case "repeat" if isinstance(at, list) and len(json.dumps(at[path[-1]])) < 300:
                at[path[-1] : path[-1]] = [at[path[-1]]] * draw(st.sampled_from([30, 300, 2000]))
            case "exchange":
                other = content
                for key in draw(st.sampled_from(_places(content)[1:])):
                    other = other[key]
                at[path[-1]] = copy.deepcopy(other)
            case _:
                at[path[-1]] = draw(_values)
    return json.dumps(content[""]).encode()


def _answered(data: bytes) -> None:
    """An answer within the work and the memory that so many bytes may take, with a place where it is not accepted."""
    before, started = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss, time.process_time()
    answer = check(data)
    assert time.process_time() - started < 5 + 2e-4 * len(data)
    assert 1024 * (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) < 1e8 + 400 * len(data)
    assert isinstance(answer, Accepted | Rejected | Malformed)
    if not isinstance(answer, Accepted):
        assert answer.where
        assert answer.where != "arithmetic", answer
        assert answer.why


@given(_changed())
@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
def test_any_json_in_any_place_is_answered(data: bytes) -> None:
    """Swapped types, odd numbers, companions and exchanged parts are answered with a place, never a traceback."""
    _answered(data)


@pytest.mark.slow
@given(_changed())
@settings(max_examples=5_000, deadline=None, suppress_health_check=list(HealthCheck))
def test_any_json_in_any_place_is_answered_of_five_thousand(data: bytes) -> None:
    """The same for 5,000 texts."""
    _answered(data)


@given(_values, st.integers(1, 30))
@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
def test_texts_that_are_cut_deep_or_double_are_malformed(value: Any, depth: int) -> None:
    """A doubled key, brackets without end and any other JSON under the format's name are malformed with a place."""
    named = '"format": "persid-certificate-2"'
    whole = json.dumps(value)
    for text in (f"{{{named}, {named}}}", f'{{{named}, "claim": {"[" * depth}{whole}{"]" * depth}}}', whole[:-1] + "["):
        answer = check(text.encode())
        assert isinstance(answer, Malformed)
        assert answer.where
