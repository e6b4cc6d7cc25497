"""Forged deviation blocks: a certificate of plants holds for what its numbers say, and for no more."""

import copy
import json
from collections.abc import Callable
from functools import cache
from typing import Any

import pytest

import persid as ps
from checker import known_ledgers
from checker.ledgers import data
from persid.certificates.ledger import with_proof
from persid.errors import RoundingError
from persid_check import Accepted, Malformed, Rejected, check

Content = dict[str, Any]
MODEL = ps.PersidskiiModel([[-1.0, 0.5], [-0.5, -1.0]], [("tanh(x)", None, [[-0.5, 0.1], [0.0, -0.5]])], [[1.0], [0.5]])


@cache
def _produced() -> bytes:
    verdict = ps.certify(MODEL)
    assert isinstance(verdict, ps.Certified)
    assert verdict.margin is not None
    return verdict.margin.certificate.data


def _content() -> Content:
    return json.loads(_produced())


def _changed(change: Callable[[Content], Any]) -> Content:
    content = copy.deepcopy(_content())
    change(content["deviations"][0])
    return content


def _larger(row: list[Any]) -> None:
    """Let one entry of C be larger by a half than the proof was made for."""
    mantissa, exponent = row[0][1]
    row[0][1] = [3 * mantissa, exponent - 1]


FORGED: dict[str, Callable[[Content], Any]] = {
    "the proof's C is too small in its first entry": lambda d: _larger(d["C"][0]),
    "the proof's C is too small in its second entry": lambda d: _larger(d["C"][1]),
    "L gets a column that the proof has not seen": lambda d: d["columns"].append([[0, [1, -2]]]),
    "L misses a column that the proof has seen": lambda d: d["columns"].pop(),
    "s is 0": lambda d: d.update(s=[0, 0]),
    "s is a thousand times too small": lambda d: d.update(s=[d["s"][0], d["s"][1] - 10]),
    "s is a thousand times too large": lambda d: d.update(s=[d["s"][0], d["s"][1] + 10]),
    "a column of L is twice as long": lambda d: d["columns"][0][0].__setitem__(1, [2, 0]),
}


@pytest.mark.parametrize("name", FORGED)
def test_forged_blocks_are_rejected(name: str) -> None:
    """A certificate that certify has written does not survive a stronger deviation, or one without its proof."""
    assert isinstance(check(_produced()), Accepted)
    forged = check(data(_changed(FORGED[name])))
    assert isinstance(forged, Rejected), forged


@pytest.mark.parametrize("field", ["columns", "C", "s", "epsilon"])
def test_no_part_of_a_deviation_may_be_left_out(field: str) -> None:
    """A deviation without its L, C, s or epsilon is malformed; nothing is assumed to be 0."""
    assert isinstance(check(data(_changed(lambda d: d.pop(field)))), Malformed)


def test_a_proof_made_anew_does_not_help() -> None:
    """Where C goes beyond the largest margin no factors exist, whoever makes them."""
    content = _changed(lambda d: [_larger(row) for row in d["C"]])
    try:
        answer = check(data(with_proof(content)))
    except RoundingError:
        return
    assert isinstance(answer, Rejected)


def test_what_is_left_out_of_a_deviation_is_left_out_of_the_sentence() -> None:
    """With fewer columns and a new proof the file is true, and its sentence names the columns that are left."""
    content = with_proof(_changed(lambda d: d["columns"].pop()))
    statement = check(data(content)).statement
    assert "L = (1 e(x1)) and" in statement
    assert "L = (1 e(x1), 1 e(x2)) and" in check(_produced()).statement


def test_no_deviation_reads_or_moves_a_deleted_entry() -> None:
    """Of the hardening spring, whose cube has a zero row, no deviation may read the cube or move the position."""
    content = copy.deepcopy(known_ledgers.load("spring"))
    speed = {"columns": [[[1, [1, 0]]]], "C": [[[1, [1, -6]]]], "s": [1, 1], "epsilon": [0, 0]}
    assert isinstance(check(data(with_proof(content | {"deviations": [speed]}))), Accepted)
    reading = speed | {"C": [[[2, [1, -20]]]]}
    moving = speed | {"columns": [[[0, [1, -20]]]]}
    for forged in (reading, moving):
        answer = check(data(content | {"deviations": [forged]}))
        assert isinstance(answer, Rejected)
        assert "row 2 of M is not zero" in answer.why


def test_the_sentence_rounds_towards_what_is_proved() -> None:
    """The C that a statement prints is not larger than the C of the file, so that no plant is promised too much."""
    content = _content()
    exact = min(m * 2.0**e for row in content["deviations"][0]["C"] for _, (m, e) in row)
    statement = check(_produced()).statement
    printed = float(statement.split("|w|^2 <= |(")[1].split(" ")[0])
    assert 0.999 * exact < printed <= exact
