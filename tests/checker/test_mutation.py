"""Every number of every valid certificate is changed; what is still accepted must still be true."""

import random

import pytest

from checker import named
from checker.independent import faults
from checker.maker import data
from checker.mutation import mutants
from persid_check import Accepted, check


def _attack(names: list[str], share: float, seed: int) -> tuple[int, int, list[str]]:
    """Number of mutants, number accepted, and the faults found among those."""
    choose = random.Random(seed)
    total, accepted, found = 0, 0, []
    for name in names:
        for path, new, mutant in mutants(named.load(name)):
            if choose.random() >= share:
                continue
            total += 1
            if isinstance(check(data(mutant)), Accepted):
                accepted += 1
                found += [f"{name} {path} = {new}: {fault}" for fault in faults(mutant)]
    print(f"{total} mutants, {accepted} accepted, {len(found)} faults among these")
    return total, accepted, found


@pytest.mark.parametrize("name", sorted(named.MAKERS))
def test_valid_certificates_have_no_fault(name: str) -> None:
    """The independent look finds no fault with a valid certificate."""
    assert faults(named.load(name)) == []


@pytest.mark.long
def test_accepted_mutants_still_prove_true_claims() -> None:
    """Of a sample of mutants, every one that is accepted withstands the independent look."""
    total, accepted, found = _attack(sorted(named.MAKERS), 0.05, seed=1)
    assert found == []
    assert total > 500
    assert 0 < accepted < total


@pytest.mark.slow
def test_ten_thousand_mutants() -> None:
    """Of all mutants, more than 10,000, every accepted one withstands the independent look."""
    total, _, found = _attack(sorted(named.MAKERS), 1.0, seed=1)
    assert found == []
    assert total >= 10_000
