"""Evidence beside an undecided verdict: what simulations did, said as what it is."""

import json

import numpy as np
import pytest

import persid as ps
from persid.verdicts.evidence import RUNS, Evidence, simulated
from persid.verdicts.summary import attempt_rows, summarize


def cubic(sign: float) -> ps.PersidskiiModel:
    """x' = -x + sign x^3 + u, in a box that reaches beyond 1."""
    return ps.PersidskiiModel([[-1.0]], [("x**3", None, [[sign]])], [[1.0]], domain=[[-2.0, 2.0]])


def test_divergence_is_found_with_its_start_and_time() -> None:
    """x' = -x + x^3 escapes in finite time from beyond 1: at t = log(x0^2 / (x0^2 - 1)) / 2."""
    found = simulated(cubic(1.0), np.zeros(1))
    assert 0 < found.diverged < RUNS
    assert found.x0 is not None
    x0 = found.x0[0]
    assert abs(x0) > 1
    assert found.time == pytest.approx(0.5 * np.log(x0**2 / (x0**2 - 1)), rel=1e-2)
    assert "evidence, not a proof" in str(found)


def test_nothing_diverges() -> None:
    """Runs that stay say so, and that it proves nothing."""
    found = simulated(cubic(-1.0), np.zeros(1))
    assert (found.diverged, found.x0, found.time) == (0, None, None)
    assert str(found) == f"None of {RUNS} simulated runs diverged, which proves nothing."


def test_runs_that_do_not_settle_are_counted() -> None:
    """x1' = x2, x2' = x2 - x2^3 - x1 circles for ever from wherever it starts: none diverged, all still move."""
    circling = ps.PersidskiiModel(
        [[0.0, 1.0], [-1.0, 1.0]], [("x**3", [[0.0, 1.0]], [[0.0], [-1.0]])], [[0.0], [1.0]], domain=[[-2.0, 2.0]] * 2
    )
    found = simulated(circling, np.zeros(1))
    assert (found.diverged, found.moving) == (0, RUNS)
    assert f"{RUNS} had not come to rest at their end" in str(found)
    assert simulated(cubic(-1.0), np.zeros(1)).moving == 0


def test_runs_start_in_the_box_that_was_asked_about() -> None:
    """Within [-1/2, 1/2] nothing of x' = -x + x^3 diverges."""
    assert simulated(cubic(1.0), np.zeros(1), np.array([[-0.5, 0.5]])).diverged == 0


def test_the_work_is_bounded() -> None:
    """A stiff model and one that jumps about end after a fixed number of steps."""
    stiff = ps.PersidskiiModel([[-1e6, 1.0], [0.0, -1e-6]], [], [[1.0], [1.0]])
    wild = ps.PersidskiiModel([[-1.0]], [("sin(1000*x)", None, [[500.0]])], [[1.0]])
    for model in (stiff, wild):
        assert simulated(model, np.zeros(1)).diverged == 0


def test_undecided_verdict_carries_evidence_and_stays_undecided() -> None:
    """A model whose runs diverge is not refuted by them; sentence and summary tell of them."""
    model = ps.PersidskiiModel([[-1.0, 0.4], [0.3, -1.0]], [("x**2", [[1.0, 0.5]], [[0.3], [0.2]])], np.eye(2))
    verdict = ps.certify(model, time_limit=1e-9)
    assert isinstance(verdict, ps.Refuted | ps.Undecided)
    if isinstance(verdict, ps.Undecided):
        assert verdict.evidence is not None
        assert str(verdict.evidence) in str(verdict)
        brief = summarize(verdict).to_dict()
        assert brief["evidence"]["runs"] == RUNS
        assert json.loads(json.dumps(brief)) is not None


def test_time_limit_still_leaves_evidence() -> None:
    """With too little time there is no verdict, and the simulations are still made."""
    verdict = ps.certify(cubic(-1.0), time_limit=1e-9)
    assert isinstance(verdict, ps.Undecided)
    assert verdict.evidence == Evidence(RUNS, 0)
    rows = attempt_rows(verdict)
    assert rows[-1][:2] == ("simulations from bounded states", f"0 of {RUNS} diverged")
    assert all(seconds.endswith(" s") for *_, seconds in rows)


def test_no_time_at_all() -> None:
    """With time_limit=0 nothing is simulated."""
    verdict = ps.certify(cubic(-1.0), time_limit=0)
    assert isinstance(verdict, ps.Undecided)
    assert verdict.evidence is None
    assert all("simulations" not in attempt.what for attempt in verdict.attempts)


def test_decided_verdicts_need_no_simulation() -> None:
    """A certified model has no evidence in its summary."""
    verdict = ps.certify(ps.PersidskiiModel([[-1.0]], [], [[1.0]]))
    assert summarize(verdict).evidence is None
