"""What is tried of models by their size: the rules that the page on decisions states."""

import array_api_strict
import numpy as np
import pytest

import persid as ps
from persid._memory import memory
from persid.lyapunov.arrays import HOST, Standard
from persid.verdicts import questions
from persid.verdicts.questions import FACTS_STATES, FULL_P_STATES, largest_full
from persid.verdicts.searches import SHORTENED_STATES
from persid.verdicts.verdict import RATED, Reason

GIB = 2**30


def _needs_full_P(n: int) -> ps.PersidskiiModel:
    """Return a model of pairs that no diagonal P certifies, loosely coupled."""
    pairs = np.kron(np.eye(n // 2), [[1.0, -3.0], [2.0, -2.0]])
    coupling = 0.01 * np.random.default_rng(0).normal(size=(n, n)) / np.sqrt(n)
    return ps.PersidskiiModel(pairs + coupling, [("tanh(x)", None, -0.05 * np.eye(n))], np.eye(n)[:, :1])


def test_a_full_P_is_tried_as_far_as_half_of_the_memory_goes() -> None:
    """Fifty states always, more by the fourth root of the memory: 136 with 16 GiB, 233 with 139."""
    assert [largest_full(size * GIB) for size in (0, 8, 16, 139)] == [FULL_P_STATES, 114, 136, 233]


@pytest.mark.long
@pytest.mark.parametrize(("bytes_left", "proved"), [(8 * GIB, True), (GIB // 2, False)])
def test_of_many_states_a_full_P_comes_last(bytes_left: int, proved: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Above fifty states what is cheap is tried first, and a full P after it where there is memory."""
    monkeypatch.setattr("persid.lyapunov.arrays.memory", lambda: bytes_left)
    monkeypatch.setattr(questions, "RATED_STATES", 0)  # rates take a minute here
    verdict = ps.certify(_needs_full_P(FACTS_STATES + 2), time_limit=1e6)
    assert verdict.is_certified == proved
    tried = [attempt.what for attempt in verdict.attempts if attempt.what.endswith((" P", "l1 norm"))]
    full = ["global Lyapunov function, full P"] if proved else []
    assert tried == ["global Lyapunov function, diagonal P", "a weighted l1 norm", *full]


@pytest.mark.long
def test_four_times_the_pairs_of_a_full_P_are_held() -> None:
    """What a step of a full P holds with some forms grows as the rule says: at most 25 times n^4 bytes."""
    import tracemalloc

    from persid.lyapunov.inequality import assemble
    from persid.lyapunov.interior_point import solve
    from persid.lyapunov.shifted_model import Setting
    from persid.lyapunov.system import Family

    n = 40
    setting = Setting.of(_needs_full_P(n), None)
    families = [Family.full(setting.pools[group.curve][:6]) for group in setting.system.groups]
    problem = assemble(setting.system, families, full_P=True).problem
    tracemalloc.start()
    solve(problem, iterations=2)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0.3 * questions.PAIRS * n**4 < peak < questions.PAIRS * n**4


def test_memory_is_that_of_the_machine_or_less() -> None:
    """The memory of this process is known, and a limit of its address space counts."""
    resource = pytest.importorskip("resource", reason="limits of a process are not known here")
    assert memory() > 2**28
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    try:
        resource.setrlimit(resource.RLIMIT_AS, (2**36 - 1, hard))
        assert memory() < 2**36
    finally:
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


def test_a_model_of_more_states_than_a_small_one_has_rate_and_gain() -> None:
    """Where a V without a rate is proved first, 21 states and more, the certificate with rate and gain is delivered."""
    n = SHORTENED_STATES + 1
    coupling = 0.05 * np.random.default_rng(0).normal(size=(n, n)) / np.sqrt(n)
    model = ps.PersidskiiModel(coupling - np.eye(n), [("tanh(x)", None, -0.05 * np.eye(n))], np.eye(n)[:, :1])
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.claim == "rate-and-gain"
    assert 0.3 < verdict.certificate.rate < 1.1
    assert {"global Lyapunov function, diagonal P", RATED} <= {attempt.what for attempt in verdict.attempts}


@pytest.mark.parametrize(("device", "rated"), [("cpu", False), ("elsewhere", True)])
def test_on_a_device_rates_are_sought_of_any_number_of_states(
    device: str, rated: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Where the inequality is not solved on the host, rate and gain are sought above the usual size, too."""
    elsewhere = Standard(array_api_strict)
    monkeypatch.setattr("persid.verdicts.certify.arrays_on", lambda name: HOST if name == "cpu" else elsewhere)
    monkeypatch.setattr(questions, "RATED_STATES", 1)
    verdict = ps.certify(ps.PersidskiiModel([[-1.0, 0.2], [0.1, -2.0]], B=[[1.0], [0.0]]), device=device)
    assert isinstance(verdict, ps.Certified)
    assert (verdict.certificate.rate is not None) == rated


class OutOfMemoryError(RuntimeError):
    """PyTorch's error by that name."""


@pytest.mark.parametrize("error", [MemoryError("no pages"), OutOfMemoryError("CUDA out of memory")])
def test_memory_that_runs_out_is_a_reason(error: Exception, monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that needs more memory than there is leaves a model undecided, and says so; other errors are errors."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr("persid.verdicts.searches.search", fail)
    model = _needs_full_P(FACTS_STATES + 2)
    with monkeypatch.context() as patch:
        patch.setattr("persid.lyapunov.arrays.memory", lambda: GIB)
        verdict = ps.certify(model, time_limit=1e6)
    assert isinstance(verdict, ps.Undecided)
    assert verdict.reason is Reason.MEMORY
    monkeypatch.setattr("persid.verdicts.searches.search", lambda *_, **__: (_ for _ in ()).throw(RuntimeError("else")))
    with pytest.raises(RuntimeError, match="else"):
        ps.certify(model, time_limit=1e6)


@pytest.mark.long
def test_a_dense_model_of_more_than_a_thousand_states_is_certified() -> None:
    """Its matrices stand in a companion; the checker reads them, and proves the inequality of 1,101 rows."""
    n = 1100
    coupling = 0.1 * np.random.default_rng(0).normal(size=(n, n)) / np.sqrt(n)
    one = np.eye(n)[:, :1]
    verdict = ps.certify(
        ps.PersidskiiModel(coupling - np.eye(n), [("tanh(x)", one.T, -0.1 * one)], one), time_limit=1e6
    )
    assert verdict.is_certified
    assert "companion" in verdict.certificate.content


@pytest.mark.parametrize(
    "model",
    [
        ps.PersidskiiModel(-np.eye(2001), B=np.eye(2001)[:, :1]),
        ps.PersidskiiModel(-np.eye(1501), [(f, None, -np.eye(1501)) for f in ("tanh(x)", "x**3")]),
    ],
    ids=["states", "functions"],
)
def test_what_the_checker_does_not_read_is_undecided(model: ps.PersidskiiModel) -> None:
    """More states or functions of them than it reads are a verdict before any search, not an exception."""
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Undecided)
    assert verdict.reason is Reason.OUTSIDE
    assert "2,000 states" in verdict.detail
    assert not verdict.attempts
