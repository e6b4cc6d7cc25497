"""Values of a file with their places: what an error names, and what each reader refuses."""

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np
import pytest

import persid as ps
from persid_check import FormatError, canonical_model, entry
from persid_check.entry import Entry
from persid_check.model import model_of
from persid_check.plain import ZERO, numbers, texts

Read = Callable[[Entry], object]


def test_a_place_is_named_from_the_whole_down() -> None:
    """Fields are joined by dots, items stand in brackets, and the whole file is called the file."""
    whole = Entry({"curves": [{"forms": [[1, 2]]}]})
    number = whole.fields(("curves",))["curves"].items()[0].fields(("forms",))["forms"].items()[0].items()[1]
    assert number.where == "curves[0].forms[0][1]"
    assert Entry({}, "model").where == "model"
    with pytest.raises(FormatError, match=r"^file: an object"):
        Entry(3).fields(("curves",))


@pytest.mark.parametrize(
    ("value", "read", "where", "why"),
    [
        ({"a": 1, "b": 2}, lambda entry: entry.fields(("a",)), "v", "unknown field 'b'"),
        ({"b": 2}, lambda entry: entry.fields(("a",), ("b",)), "v", "'a' is missing"),
        ([1, 2, 3], lambda entry: entry.items(2), "v", "a list of 2"),
        ([1, 2, 3], lambda entry: entry.items(longest=2), "v", "at most 2"),
        (["a", "a"], lambda entry: entry.names(), "v", "different"),
        (["a", ""], lambda entry: entry.names(), "v", "1 to 200"),
        ([["a"]], lambda entry: entry.names(), "v", "1 to 200"),
        ("y + 1", lambda entry: entry.program(), "v", "unknown name 'y'"),
        (7, lambda entry: entry.program(), "v", "printable"),
        (["0x1.0000000000000p+0", "1.0"], lambda entry: entry.vector(2), "v[1]", "'1.0'"),
        (["0x1.0000000000000p+0", "-0x0.0p+0"], lambda entry: entry.vector(2), "v[1]", "'-0x0.0p"),
        (["nan"], lambda entry: entry.vector(1), "v[0]", "finite"),
        ([["0x0.0p+0"], 3], lambda entry: entry.matrix(2, 1), "v[1]", "a list of 1"),
        (True, lambda entry: entry.integer(8), "v", "not 'True'"),
        (2**9, lambda entry: entry.integer(8), "v", "8 bits"),
        (-1, lambda entry: entry.index(5), "v", "from 0 to 4"),
        ([1, 1], lambda entry: entry.indices(5), "v", "twice"),
        ([1, 2001], lambda entry: entry.dyadic(), "v[1]", "2000"),
        ([-1, 0], lambda entry: entry.nonnegative(), "v", "not negative"),
        ([[1, [1, 0]], [1, [1, 0]]], lambda entry: entry.row(3), "v[1]", "rise"),
        ([[[1, 0]], [[1, 0]]], lambda entry: entry.lower(2), "v[1]", "a list of 2"),
        ([[1], [1, 2.5]], lambda entry: entry.factor(), "v[1][1]", "an integer"),
    ],
)
def test_what_is_not_specified_is_refused_at_its_place(value: Any, read: Read, where: str, why: str) -> None:
    """Each reader names the place of the value that it refuses, and what is needed."""
    with pytest.raises(FormatError) as refused:
        read(Entry(value, "v"))
    assert refused.value.where == where
    assert why in refused.value.why


def test_what_is_specified_is_read_exactly() -> None:
    """Dyadics, rows without zeros, and numbers of a model have their exact values."""
    assert Entry([3, -2]).dyadic() == Fraction(3, 4)
    assert Entry([[0, [0, 0]], [2, [5, 1]]]).row(3) == {2: 10}
    assert Entry([(0.1).hex()]).vector(1) == [0.1]
    assert Entry([0, 1]).indices(2) == (0, 1)


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"terms": [{"f": ["tanh(x)"], "R": None, "A": [["0x1.0000000000000p+0"]]}]}, "model.terms[0].f"),
        ({"terms": [{"f": "tanh(x)", "A": [["0x1.0000000000000p+0"]]}]}, "model.terms[0]"),
        ({"terms": [{"f": "tanh(x)", "R": [], "A": [[]]}]}, "model.terms[0].R"),
        ({"time": "continuous"}, "model.time"),
        ({"time": "discrete"}, "model.time"),
        ({"time": "discrete", "dt": "0x0.0p+0"}, "model.dt"),
        ({"algebraic": []}, "model.algebraic"),
        ({"algebraic": ["x1"]}, "model.algebraic"),
        ({"provenance": {}}, "model"),
        ({"b": None}, "model.b"),
        ({"A0": [[1.0]]}, "model.A0[0][0]"),
        ({"domain": [["0x0.0p+0"]]}, "model.domain[0]"),
    ],
)
def test_only_the_canonical_form_of_a_model_is_read(change: dict[str, Any], where: str) -> None:
    """What is left out, spelled in another way or written as a number is refused: nothing is filled in."""
    form = canonical_model({"format": "persid-model-1", "states": ["x1"], "inputs": ["u"], "terms": [], "B": [[1.0]]})
    assert model_of(form).n == 1
    with pytest.raises(FormatError) as refused:
        model_of(form | change, discrete=True, algebraic=True)
    assert refused.value.where == where


def test_what_was_written_is_not_read_again(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of rows that the canonical form writes no text is parsed."""
    parsed: list[object] = []
    monkeypatch.setattr(entry, "_numbers", lambda texts: parsed.append(texts))
    plain = ps.PersidskiiModel(-np.eye(4), [("tanh(x)", None, 0.1 * np.ones((4, 4)))], np.eye(4)).to_dict()
    assert model_of(canonical_model(plain)).linear.entry(0, 0) == -1
    assert parsed == []


@pytest.mark.parametrize("number", [float("nan"), float("inf"), 10**400, True, "1.0"])
def test_what_is_no_finite_number_is_refused_by_its_text(number: object) -> None:
    """Rows with such an entry are not taken for written ones."""
    plain = ps.PersidskiiModel(-np.eye(2), [], np.eye(2)).to_dict()
    plain["A0"][1][0] = number
    with pytest.raises(FormatError, match=r"^model.A0\[1\]\[0\]: "):
        canonical_model(plain)


def test_zero_has_no_sign_and_numbers_are_those_of_their_text() -> None:
    """Of extreme numbers, too."""
    row = [-0.0, 5e-324, -1.7976931348623157e308, 0.1]
    written = texts(row, 4)
    assert written == [ZERO, *map(float.hex, row[1:])]
    assert numbers(written) == numbers(list(written)) == Entry(written, "v").vector(4) == row
    assert str(Entry(written, "v").vector(4)[0]) == "0.0"
