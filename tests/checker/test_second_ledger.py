"""A second checker of ledgers, written from the specification alone, agrees on every file that it supports."""

import random
from collections import Counter

import pytest

from checker import known_ledgers
from checker.false_ledgers import FALSEHOODS
from checker.ledgers import data
from checker.mutation import mutants
from checker.second_ledger import verdict
from persid_check import Accepted, Malformed, check


def _compare(files: dict[str, bytes]) -> Counter[str]:
    """Count agreements; fail where one accepts what the other does not. Mere form is the first one's affair."""
    counts: Counter[str] = Counter()
    for name, content in files.items():
        answer, first = verdict(content), check(content)
        if answer == "unsupported" or isinstance(first, Malformed):
            counts["unsupported or malformed"] += 1
            continue
        assert (answer == "accepted") == isinstance(first, Accepted), (name, answer, first)
        counts[answer] += 1
    print(dict(counts))
    return counts


def test_both_agree_on_known_ledgers() -> None:
    """Both accept the known ledgers that the second one supports."""
    counts = _compare({name: data(known_ledgers.load(name)) for name in known_ledgers.NAMES})
    assert counts["accepted"] >= 8
    assert counts["refused"] == 0


# The second one makes its own partitions, and does not read the file's.
_PARTITIONS = ("cuts_", "upper_unproved")


def test_both_agree_on_forgeries() -> None:
    """Both refuse the forgeries that change mathematics."""
    files = {f.name: f.content() for f in FALSEHOODS if not f.name.startswith(_PARTITIONS)}
    assert _compare(files)["refused"] >= 35


@pytest.mark.long
def test_both_agree_on_mutants() -> None:
    """Both agree on a sample of changed numbers of the supported ledgers, cuts left as they are."""
    choose, files = random.Random(7), {}
    for name in ("difference", "incremental", "rated", "plant", "g_mixed_pair", "g_full", "e_gains", "g_rows_dropped",
                 "steps_network", "steps_plant", "slopes", "steps_values", "steps_values_apart"):  # fmt: skip
        for path, new, mutant in mutants(known_ledgers.load(name)):
            if path[0] != "model" and not {"cuts", "continuous"} & set(path) and choose.random() < 0.06:
                files[f"{name} {path} {new}"] = data(mutant)
    counts = _compare(files)
    assert counts["accepted"] > 20
    assert counts["refused"] > 60
