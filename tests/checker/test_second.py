"""A second checker, written from the specification alone, agrees on every file that it supports."""

import random

import pytest

from checker import named
from checker.falsehoods import FALSEHOODS
from checker.maker import data
from checker.mutation import mutants
from checker.second import verdict
from persid_check import Accepted, check


def _compare(files: dict[str, bytes]) -> dict[str, int]:
    """Count agreements and unsupported files; fail where one accepts what the other does not."""
    counts = {"accepted by both": 0, "refused by both": 0, "unsupported": 0}
    for name, content in files.items():
        answer, accepted = verdict(content), isinstance(check(content), Accepted)
        if answer == "unsupported":
            counts["unsupported"] += 1
            continue
        assert (answer == "accepted") == accepted, (name, answer, check(content))
        counts["accepted by both" if accepted else "refused by both"] += 1
    print(counts)
    return counts


def test_both_agree_on_the_kept_files() -> None:
    """Both checkers agree on the valid certificates; those that the second one does not support are counted."""
    counts = _compare({name: data(named.load(name)) for name in named.MAKERS})
    assert counts["accepted by both"] >= 5
    assert counts["refused by both"] == 0


# The second checker reads JSON leniently, and does not know these rules of the file's form.
_FORM = """
unknown_field unknown_group_field extra_factor missing_gamma both_P model_minus_zero model_provenance format_2
model_same_names statement_number duplicate_field not_a_number byte_order_mark nested bool_mantissa model_no_states
"""


def test_both_agree_on_falsehoods() -> None:
    """Both checkers refuse the falsehoods that change mathematics; mere form is the first one's affair."""
    form = set(_FORM.split())
    counts = _compare({f.name: f.content() for f in FALSEHOODS if f.name not in form})
    assert counts["refused by both"] >= 40


@pytest.mark.long
def test_both_agree_on_mutants() -> None:
    """Both checkers agree on a sample of mutants of the supported certificates."""
    choose = random.Random(5)
    names = ["g_linear", "g_mixed_pair", "g_rows_dropped", "g_full", "g_constant_input"]
    files = {}
    for name in names:
        for path, new, mutant in mutants(named.load(name)):
            if path[0] != "model" and choose.random() < 0.05:
                files[f"{name} {path} {new}"] = data(mutant)
    counts = _compare(files)
    assert counts["accepted by both"] > 20
    assert counts["refused by both"] > 20
