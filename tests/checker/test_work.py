"""The checker's work on one file is counted and limited, and depends on the file alone."""

from fractions import Fraction

import pytest

from checker import known_ledgers, ledgers, named
from checker.maker import data
from persid_check import Accepted, Rejected, check, work
from persid_check.expression import parse
from persid_check.ledger import check as ledger_check
from persid_check.ledger.lemmas import Lemma
from persid_check.refutations import check as refutations
from persid_check.search import memory, prover
from persid_check.version_1 import check as version_1


def allow(patch: pytest.MonkeyPatch, steps: int) -> None:
    """Let every file take so many steps, whatever its length."""
    for kind in (version_1, refutations, ledger_check):
        patch.setattr(kind, "allowance", lambda *given: steps)


def spent(name: str) -> int:
    """Return the steps that the proofs of a valid certificate take."""
    for steps in range(4, 30):
        with pytest.MonkeyPatch.context() as patch:
            allow(patch, 2**steps)
            if isinstance(check(data(named.load(name))), Accepted):
                return 2**steps
    raise ValueError("it is not accepted")


@pytest.mark.parametrize("name", ["g_mixed_pair", "e_shifted", "r_pendulum", "refuted_marginal"])
def test_a_file_beyond_the_limit_is_rejected(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """With too small a limit a valid certificate is rejected, with a reason that says so."""
    allow(monkeypatch, 3)
    result = check(data(named.load(name)))
    assert isinstance(result, Rejected)
    assert "steps" in result.why


@pytest.mark.parametrize("name", ["g_mixed_pair", "e_shifted", "r_pendulum"])
def test_the_answer_does_not_depend_on_what_was_checked_before(name: str) -> None:
    """A proof found again counts as much as one that is made: with and without a memory the limit is the same."""
    check(data(named.load(name)))
    warm = spent(name)
    memory.forget()
    assert spent(name) == warm


@pytest.mark.parametrize("name", ["spring", "difference"])
def test_a_ledger_costs_the_same_steps_again(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """The step at which a ledger is refused for its length is the same before and after its lemmas are known."""
    file = ledgers.data(known_ledgers.load(name))

    def holds(steps: int) -> bool:
        allow(monkeypatch, steps)
        return isinstance(check(file), Accepted)

    def least() -> int:
        low, high = 0, 10**5
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if holds(middle) else (middle, high)
        return high

    memory.forget()
    cold = [holds(10**5)]
    warm = least()
    for steps in (warm - 1, warm):
        memory.forget()
        cold.append(holds(steps))
    assert cold == [True, False, True]


def test_a_proof_is_counted_once() -> None:
    """Another group with the same functions and forms costs a file no further step, and another file the same again."""
    curve, form = ((parse("tanh(x)"), Fraction(1)),), (Fraction(1), Fraction(-1))
    totals = []
    for repeats in (1, 3):
        with work.limited(10**6) as account:
            totals += [prover.prove_sector_form(curve, form) for _ in range(repeats)]
        totals.append(account.spent)
    assert totals[1] == totals[-1] > 0
    assert all(totals)


def test_honest_files_are_far_from_the_limit() -> None:
    """The kept certificates take less than a twentieth of what the shortest file may."""
    assert max(spent(name) for name in ("g_mixed_pair", "e_shifted", "r_pendulum")) < work.STEPS / 20


def test_without_a_file_there_is_no_limit(monkeypatch: pytest.MonkeyPatch) -> None:
    """Proofs that the producer asks for are not counted."""
    allow(monkeypatch, 0)
    memory.forget()
    assert prover.prove_sector_form((), [1])


def test_a_lemma_counts_once_and_is_never_taken_for_another() -> None:
    """Asked for twice in a file a lemma takes no steps again; another does, be its numbers alike in hash, or long."""
    line, longest = ((parse("x"), Fraction(1)),), Fraction(2**2048 - 1) * 2**2000
    cuts = [(-cut, Fraction(0), cut) for cut in (Fraction(1), Fraction(2**61), longest)]
    answers = []
    with work.limited(1000) as account:
        for slope in (Fraction(1), Fraction(-1)):
            for each in (*cuts, *cuts):
                before = account.spent
                reason = Lemma(line, (slope, Fraction(0)), "nondecreasing").unproved(each, None)
                answers.append((reason is None, account.spent > before))
    assert hash(cuts[0]) == hash(cuts[1])
    assert [proved for proved, _ in answers] == [True] * 6 + [False] * 6
    assert [took for _, took in answers] == ([True] * 3 + [False] * 3) * 2
