"""Batches: verdicts in order, failures in their places, and refits to resampled data."""

import json
import os
import pickle
import signal
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import persid as ps
from persid.measurements.trajectories import Trajectories
from persid.verdicts import batches
from persid.verdicts.verdict import Reason, Undecided

ENDLESS = 1e6  # s: in other processes the clock runs, and must not decide
STABLE = ps.PersidskiiModel([[-1.0, 0.5], [0.5, -2.0]], [("tanh(x)", None, -np.eye(2))], [[1.0], [0.0]])
UNSTABLE = ps.PersidskiiModel([[0.5, 1.0], [-1.0, 0.5]], B=[[1.0], [0.0]])


def names(answers: tuple[Any, ...]) -> list[str]:
    """Return the kinds of answers."""
    return [type(answer).__name__ for answer in answers]


@pytest.mark.parametrize("engine", [None, "processes"])
@pytest.mark.long
def test_order_is_kept_and_failures_stand_in_their_place(tmp_path: Path, engine: Any) -> None:
    """Answers stand in the order of the models, and one that fails does not stop the others."""
    (tmp_path / "broken.json").write_text(json.dumps({"format": "persid-model-1", "states": 5}))
    STABLE.save(tmp_path / "stable.json")
    models = [UNSTABLE, tmp_path / "broken.json", tmp_path / "absent.json", tmp_path / "stable.json", STABLE]
    lines: list[str] = []
    answers = ps.certify_many(models, engine=engine, jobs=2, progress=lines.append, time_limit=ENDLESS)
    assert names(answers) == ["Refuted", "Failed", "Failed", "Certified", "Certified"]
    assert "broken.json" in str(answers[1])
    assert not answers[1].is_certified
    assert lines[-1] == "deciding: 5 of 5 models"
    assert answers[3].certificate.data == ps.certify(STABLE, time_limit=ENDLESS).certificate.data


def test_verdicts_can_be_sent() -> None:
    """A verdict that has been looked at is pickled as what it was: the bytes of its certificate and what they say."""
    verdict = ps.certify(STABLE)
    assert verdict.certificate.rate > 0  # and what is read from the bytes is kept, but not sent
    again = pickle.loads(pickle.dumps(verdict))
    assert again.certificate.data == verdict.certificate.data
    assert (again.certificate.rate, again.certificate.P.tolist()) == (
        verdict.certificate.rate,
        verdict.certificate.P.tolist(),
    )
    assert again.attempts == verdict.attempts


def unsendable(model: Any, question: Any) -> Any:
    """Stand for an answer that no process can send."""
    return batches.Failed("fine") if model == "a" else lambda: model


@pytest.mark.long
def test_an_answer_that_cannot_be_sent_is_one_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """An answer that is lost on its way to this process fails its own model alone."""
    monkeypatch.setattr(batches, "_decide", unsendable)
    answers = ps.certify_many(["a", "b", "a"], jobs=2)
    assert [str(answer) for answer in answers[::2]] == ["Failed: fine"] * 2
    assert "pickle" in str(answers[1])


def die(model: Any, question: Any) -> Any:
    """Stand for a process that is killed by one of its models."""
    if model == "bad":
        os.kill(os.getpid(), signal.SIGKILL)
    return batches.Failed(f"seen {model}")


@pytest.mark.long
def test_a_process_that_dies_is_one_failure(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that is killed fails the one model that kills it; the others have their answers."""
    monkeypatch.setattr(batches, "_decide", die)
    answers = ps.certify_many(["a", "bad", "b", "c"], jobs=2)
    assert [str(answer) for answer in answers if "seen" in str(answer)] == [f"Failed: seen {m}" for m in "abc"]
    assert "died" in str(answers[1])


def process(model: Any, question: Any) -> Any:
    """Name the process that works on a model; one model kills it."""
    die(model, question)
    return batches.Failed(f"{model} in {os.getpid()}")


@pytest.mark.long
def test_a_long_batch_goes_on_together_where_a_process_dies(monkeypatch: pytest.MonkeyPatch) -> None:
    """After a process was killed few models have one of their own: a batch of many costs hardly more."""
    monkeypatch.setattr(batches, "_decide", process)
    models = [*range(30), "bad", *range(31, 60)]
    words = [str(answer) for answer in ps.certify_many(models, jobs=2)]
    assert "died" in words.pop(30)
    assert [word.split()[1] for word in words] == [str(model) for model in models if model != "bad"]
    assert len({word.split()[-1] for word in words}) <= 8


@pytest.mark.long
@pytest.mark.filterwarnings("ignore")
def test_a_lost_worker_of_a_cluster_is_survived() -> None:
    """Where a worker of Dask is killed its models are decided again by the others, and the order is kept."""
    distributed = pytest.importorskip("distributed")
    models = [STABLE, UNSTABLE] * 6
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, silence_logs=50
        ) as local,
        distributed.Client(local) as client,
    ):
        pids = list(client.run(os.getpid).values())

        def kill(line: str) -> None:
            if line.startswith("deciding: 2 "):
                os.kill(pids[0], signal.SIGKILL)

        answers = ps.certify_many(models, engine=client, progress=kill, time_limit=ENDLESS)
        assert pids[0] not in client.run(os.getpid).values()
    assert names(answers) == ["Certified", "Refuted"] * 6


def test_an_interruption_keeps_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """After Ctrl-C the answers there are stand, and the other models are Undecided, interrupted."""
    calls: list[Any] = []

    def decide(model: Any, question: Any) -> Any:
        calls.append(model)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return batches.Failed("done")

    monkeypatch.setattr(batches, "_decide", decide)
    answers = ps.certify_many([STABLE] * 5, engine=None)
    assert names(answers) == ["Failed", "Failed", "Undecided", "Undecided", "Undecided"]
    assert answers[4].reason is Reason.INTERRUPTED
    assert len(calls) == 3


def test_unknown_engines_are_refused() -> None:
    """An engine of another name is wrong use, and those that there are, are listed."""
    with pytest.raises(ps.DataError, match="choose None"):
        ps.certify_many([STABLE], engine="spark")


def test_dask_without_a_cluster_is_refused() -> None:
    """Dask without a cluster is wrong use."""
    pytest.importorskip("distributed")
    with pytest.raises(ps.DataError, match="no Dask cluster"):
        ps.certify_many([STABLE], engine="dask")


def fitted(samples: int = 2000, noise: float = 0.01, **how: Any) -> ps.PersidskiiIdentifier:
    """Fit to a simulated run of the stable model with noise."""
    rng = np.random.default_rng(1)
    u = np.repeat(rng.normal(size=(samples // 20, 1)), 20, axis=0)
    run = STABLE.simulate([1.0, -1.0], np.arange(samples) * 0.05, 2 * u)[0]
    data = Trajectories.from_arrays(run.x + noise * rng.normal(size=run.x.shape), 2 * u, t=run.t)
    return ps.PersidskiiIdentifier(["x", "tanh(x)"], **{"ridge": 1e-4, **how}).fit(data)


@pytest.mark.long
def test_bootstrap_of_a_stable_system() -> None:
    """Refits scatter about the fit as their errors say, and nearly all are certified, with rates and gains."""
    fit = fitted()
    found = ps.bootstrap(fit, 6, engine=None, seed=3, time_limit=20.0)
    assert found.coefficients.shape == (6, *fit.coef_.shape)
    assert found.share > 0.8
    assert found.certified == len(found.rates) == len(found.gains)
    low, high = found.quantiles("rates", [0.0, 1.0])
    assert 0 < low < high
    assert (np.abs(found.coefficients.mean(axis=0) - fit.coef_) <= 2 * found.deviation + 1e-12).all()
    assert "of 6 refits" in str(found)
    again = ps.bootstrap(fit, 6, engine=None, seed=3, time_limit=0.0)
    assert np.array_equal(again.coefficients, found.coefficients)


@pytest.mark.long
def test_the_spread_is_that_of_new_data(monkeypatch: pytest.MonkeyPatch) -> None:
    """The standard deviations of coefficients agree, to a factor of two, with those over repeated experiments."""
    monkeypatch.setattr(
        "persid.certified_fits.bootstrap.certify_many",
        lambda models, **how: (batches.Failed("not asked"),) * len(models),
    )
    rng = np.random.default_rng(0)

    def fit() -> ps.PersidskiiIdentifier:
        u = np.repeat(rng.normal(size=(50, 1)), 20, axis=0)
        run = STABLE.simulate([0.0, 0.0], np.arange(1000) * 0.05, 2 * u)[0]
        data = Trajectories.from_arrays(run.x + 0.02 * rng.normal(size=run.x.shape), 2 * u, t=run.t)
        return ps.PersidskiiIdentifier(["x"], ridge=0.0, x_ref=0.0, scale=1.0, window=16).fit(data)

    repeated = np.stack([fit().coef_ for _ in range(16)]).std(axis=0)
    drawn = np.mean([ps.bootstrap(fit(), 60, engine=None).deviation for _ in range(2)], axis=0)
    ratio = (drawn / repeated)[:, :3]
    assert (ratio > 0.5).all()
    assert (ratio < 2).all()


@pytest.mark.long
def test_an_interrupted_bootstrap_keeps_what_is_done(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C leaves the refits that have a verdict."""
    fit, calls = fitted(), [0]
    original = batches.certify

    def certify(model: Any, **how: Any) -> Any:
        calls[0] += 1
        return original(model, **how) if calls[0] < 3 else Undecided(Reason.INTERRUPTED)

    monkeypatch.setattr(batches, "certify", certify)
    found = ps.bootstrap(fit, 8, engine=None)
    assert len(found.models) == len(found.verdicts) == len(found.coefficients) == 2
    assert calls[0] == 3


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: ps.PersidskiiIdentifier(), "call fit first"),
        (lambda: fitted(noise=0.0, method="edmd"), "Koopman"),
        (lambda: fitted(200, refine=True), "refine=True"),
    ],
)
def test_fits_that_cannot_be_repeated(make: Any, message: str) -> None:
    """Bootstrap refuses a fit that its Gram matrices do not determine."""
    with pytest.raises(ps.DataError, match=message):
        ps.bootstrap(make(), 3)


@pytest.mark.filterwarnings("ignore")
def test_on_a_cluster() -> None:
    """On Dask the answers are those of this process, in order."""
    distributed = pytest.importorskip("distributed")
    with (
        distributed.LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, dashboard_address=None, silence_logs=50
        ) as local,
        distributed.Client(local) as client,
    ):
        answers = ps.certify_many([UNSTABLE, "absent.json", STABLE], engine=client)
    assert names(answers) == ["Refuted", "Failed", "Certified"]
