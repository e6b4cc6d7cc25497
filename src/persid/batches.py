"""Batches: verdicts on many models at once, and how sure a fit is: verdicts on refits to resampled data."""

import multiprocessing
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certify import Certified, Reason, Undecided, Verdict, certify
from persid.distributed import Cluster, Progress, make_engine, silent
from persid.errors import DataError
from persid.fitting import sparse_coefficients
from persid.gram import Gram
from persid.model import PersidskiiModel, load_model
from persid.summary import summarize

QUANTILES = (0.05, 0.25, 0.5, 0.75, 0.95)


@dataclass(frozen=True)
class Failed:
    """No verdict: what went wrong with this model, in its place among the verdicts."""

    error: str

    @property
    def is_certified(self) -> bool:
        """Never."""
        return False

    def __str__(self) -> str:
        return f"Failed: {self.error}"


Answer = Verdict | Failed
Numbered = Iterator[tuple[int, Answer]]


def certify_many(
    models: Sequence[PersidskiiModel | str | Path],
    *,
    engine: Any = "processes",
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    **question: Any,
) -> tuple[Answer, ...]:
    """Decide many models, in this process, in several, or on Dask; the answers stand in the order of the models.

    What goes wrong with one model (a file that is no model, an error, a process that dies) is `Failed` in its place,
    and the others go on. After Ctrl-C the models without an answer are Undecided, with Reason.INTERRUPTED. Scripts
    that use processes need `if __name__ == "__main__":`.

    Args:
        models: models, or paths of model files.
        engine: None (this process), "processes", "dask" or a `distributed.Client`.  scheduler: the address of one.
        jobs: number of processes, by default one for each processor.
        progress: is called with a line of text whenever a model is decided.
        question: as for `persid.certify` (operating_point, u_op, domain, time_limit in s for each model, …).

    Raises:
        DataError: no such engine.
    """
    answers: dict[int, Answer] = {}
    tell = progress or silent
    decided = _engine(engine, scheduler, jobs)(list(models), question)
    try:
        tell(f"deciding: 0 of {len(models)} models")
        for k, answer in decided:
            answers[k] = answer
            tell(f"deciding: {len(answers)} of {len(models)} models")
            if engine is None and was_interrupted(answer):
                break
    except KeyboardInterrupt:
        decided.close()
    missing = Undecided(Reason.INTERRUPTED, "It was not decided when the batch ended.")
    return tuple(answers.get(k, missing) for k in range(len(models)))


def _engine(engine: Any, scheduler: str | None, jobs: int | None) -> Callable[[list[Any], dict[str, Any]], Any]:
    """Return what decides models one by one, in any order."""
    if scheduler is None and (engine is None or engine == "processes"):
        count = 1 if engine is None else jobs or os.cpu_count() or 1
        return _here if count == 1 else lambda models, question: _in_processes(models, question, count)
    made = make_engine(engine if engine != "processes" else None, scheduler)
    if not isinstance(made, Cluster):
        raise DataError('no Dask cluster is known; give its address (scheduler=), or take engine="processes"')
    return lambda models, question: _on_cluster(made.client, models, question)


def _decide(model: Any, question: dict[str, Any]) -> Answer:
    """Decide one model; whatever goes wrong becomes an answer."""
    try:
        return certify(model if isinstance(model, PersidskiiModel) else load_model(model), **question)
    except Exception as error:
        return Failed(f"{type(error).__name__}: {error}")


def was_interrupted(answer: Answer) -> bool:
    """Return whether an answer is missing because of Ctrl-C."""
    return isinstance(answer, Undecided) and answer.reason is Reason.INTERRUPTED


def _here(models: list[Any], question: dict[str, Any]) -> Numbered:
    for k, model in enumerate(models):
        yield k, _decide(model, question)


def _in_processes(models: list[Any], question: dict[str, Any], jobs: int) -> Numbered:
    """Decide in processes; where one dies, those without an answer go on one by one, each in a process of its own."""
    left = dict(enumerate(models))
    for k, answer in _pooled(left, question, min(jobs, len(left))):
        if answer is not None:
            del left[k]
            yield k, answer
    for k, model in left.items():
        for _, answer in _pooled({k: model}, question, 1):
            yield k, answer or Failed("the process that worked on it died (killed, or out of memory)")


def _pooled(models: dict[int, Any], question: dict[str, Any], jobs: int) -> Iterator[tuple[int, Answer | None]]:
    """Yield answers as they come; None for each model that has none because a process died."""
    before = set(multiprocessing.active_children())
    # Not fork: threads of linear algebra do not survive it.
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"), initializer=_one_thread)
    try:
        futures = {pool.submit(_decide, model, question): k for k, model in models.items()}
        for future in as_completed(futures):
            yield futures[future], _outcome(future)
    except BaseException:
        for process in set(multiprocessing.active_children()) - before:
            process.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _outcome(future: "Future[Answer]") -> Answer | None:
    try:
        return future.result()
    except BrokenProcessPool:
        return None


def _one_thread() -> None:
    """Keep the linear algebra of one process on one processor."""
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    threadpool_limits(1)


def _on_cluster(client: Any, models: list[Any], question: dict[str, Any]) -> Numbered:
    from distributed import as_completed as completed

    futures = client.map(_decide, models, question=question, pure=False)
    numbers = {future.key: k for k, future in enumerate(futures)}
    try:
        for future in completed(futures):
            error = future.exception()
            answer = future.result() if error is None else Failed(f"{type(error).__name__}: {error}")
            yield numbers[future.key], answer
    except BaseException:
        client.cancel(futures)
        raise


@dataclass(frozen=True, eq=False)
class Bootstrap:
    """Refits to resampled data with their verdicts.

    `coefficients` are those of every refit, in the order of the fit's `coef_`; `rates` (1/s) and `gains` those of the
    certified refits that have them. Refits without a verdict, after Ctrl-C, are left out.
    """

    models: tuple[PersidskiiModel, ...]
    verdicts: tuple[Answer, ...]
    coefficients: Float[ndarray, "k n p"]
    rates: Float[ndarray, " r"]
    gains: Float[ndarray, " r"]

    @property
    def certified(self) -> int:
        """Number of certified refits."""
        return sum(verdict.is_certified for verdict in self.verdicts)

    @property
    def share(self) -> float:
        """Share of certified refits."""
        return self.certified / max(len(self.verdicts), 1)

    @property
    def deviation(self) -> Float[ndarray, "n p"]:
        """Standard deviation of every coefficient over the refits; 0 without any."""
        return self.coefficients.std(axis=0) if len(self.coefficients) else np.zeros(self.coefficients.shape[1:])

    def quantiles(self, what: str, levels: Sequence[float] = QUANTILES) -> Float[ndarray, " q"]:
        """Return quantiles of the "rates" or the "gains"; NaN where no refit has one."""
        values = {"rates": self.rates, "gains": self.gains}[what]
        return np.quantile(values, levels) if len(values) else np.full(len(levels), np.nan)

    def __str__(self) -> str:
        rows = [f"certified  {self.certified} of {len(self.verdicts)} refits ({100 * self.share:.0f} %)"]
        for what, unit in (("rates", " 1/s"), ("gains", "")):
            low, _, middle, _, high = self.quantiles(what)
            if np.isfinite(middle):
                rows.append(f"{what:<9}  median {middle:.4g}{unit}, 5 % to 95 %: {low:.4g} to {high:.4g}{unit}")
        return "\n".join(rows)


def bootstrap(
    fit: Any,
    count: int = 200,
    *,
    seed: int = 0,
    engine: Any = "processes",
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    **question: Any,
) -> Bootstrap:
    """Refit a model to resampled data and ask for the verdict on every refit.

    What is drawn, with replacement, are the blocks whose Gram matrices the fit has kept (at most 60 stretches of
    consecutive samples, or groups of whole runs), so that a refit costs no pass over the data (block bootstrap: Künsch,
    1989). The basis, the ridge and the structure stay those of the fit. The spread speaks of the sampling alone, not of
    functions that are missing; and blocks must be longer than the memory of the system, or else it looks too small.
    Ctrl-C keeps what is done. For the other arguments see `certify_many`.

    Args:
        fit: a fitted PersidskiiIdentifier of method "weak" or "derivative".
        count: number of refits.
        seed: of the draws.

    Raises:
        DataError: the fit cannot be repeated from its Gram matrices.
    """
    grams = _blocks(fit)
    if count < 1:
        raise DataError(f"count = {count}; needed is at least one refit")
    rng = np.random.default_rng(seed)
    draws = rng.multinomial(len(grams), np.full(len(grams), 1 / len(grams)), size=count)
    thetas = [sparse_coefficients(_resampled(grams, draw), fit.ridge_, fit.threshold) for draw in draws]
    models = [fit.basis_.model(theta, domain=fit.model_.domain) for theta in thetas]
    answers = certify_many(models, engine=engine, jobs=jobs, scheduler=scheduler, progress=progress, **question)
    done = [k for k, answer in enumerate(answers) if not was_interrupted(answer)]
    briefs = [summarize(answer) for answer in answers if isinstance(answer, Certified)]
    rated = [(brief.rate, brief.gain) for brief in briefs if brief.rate is not None and brief.gain is not None]
    rates, gains = np.array(rated, float).reshape(-1, 2).T
    coefficients = np.stack([theta.T for theta in thetas])[done]
    return Bootstrap(tuple(models[k] for k in done), tuple(answers[k] for k in done), coefficients, rates, gains)


def _blocks(fit: Any) -> tuple[Gram, ...]:
    grams = getattr(fit, "blocks_", ())
    if not grams:
        raise DataError("bootstrap needs a fitted PersidskiiIdentifier; call fit first")
    if fit.method == "edmd":
        raise DataError('bootstrap needs method="weak" or "derivative": a Koopman matrix is not in the Gram matrices')
    if fit.refine or fit.gram_.root is not None:
        raise DataError(
            "bootstrap cannot repeat refine=True, nor a fit too ill-conditioned for its ridge; raise ridge="
        )
    if len(grams) < 2:
        raise DataError("bootstrap needs at least two blocks of data; give longer runs, or more of them")
    return tuple(grams)


def _resampled(grams: Sequence[Gram], draw: ndarray) -> Gram:
    """Return the Gram of the blocks, each as often as it was drawn."""
    drawn = [(int(times), gram) for times, gram in zip(draw, grams, strict=True) if times]
    G, H, yy = (sum(times * getattr(gram, name) for times, gram in drawn) for name in ("G", "H", "yy"))
    rows = sum(times * gram.rows for times, gram in drawn)
    return Gram(G, H, yy, rows, grams[0].basis, grams[0].structure)


def figures(found: Bootstrap, fit: Any) -> dict[str, Any]:
    """Return what a bootstrap found as an object for JSON; `coefficients` are those of the fit, one row a state."""
    spread = {
        what: dict(zip(map(str, QUANTILES), found.quantiles(what).tolist(), strict=True)) if len(values) else None
        for what, values in (("rates", found.rates), ("gains", found.gains))
    }
    return {
        "format": "persid-bootstrap-1",
        "refits": len(found.verdicts),
        "certified": found.certified,
        "share": found.share,
        **spread,
        "terms": [str(name) for name in fit.get_feature_names_out()],
        "coefficients": fit.coef_.tolist(),
        "deviations": found.deviation.tolist(),
    }
