"""Batches: verdicts on many models at once, and how sure a fit is: verdicts on refits to resampled data."""

import multiprocessing
import os
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

from persid.errors import DataError
from persid.measurements.engines import Cluster, DaskClient, Progress, make_engine, silent
from persid.models.descriptor import DescriptorModel
from persid.models.files import load_model
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.verdicts.certify import certify
from persid.verdicts.options import AskedAtRate
from persid.verdicts.verdict import Reason, Undecided, Verdict


@dataclass(frozen=True)
class Failed:
    """No verdict: what went wrong with this model, in its place among the verdicts.

    Examples:
        >>> answers = ps.certify_many(["no.json"], engine=None)
        >>> isinstance(answers[0], ps.Failed)
        True
    """

    error: str

    @property
    def is_certified(self) -> bool:
        """Never."""
        return False

    def __str__(self) -> str:
        return f"Failed: {self.error}"


Answer = Verdict | Failed
Numbered = Generator[tuple[int, Answer], None, None]
Subject = PersidskiiModel | OutputModel | DescriptorModel | str | Path


def certify_many(
    models: Sequence[Subject],
    *,
    engine: object = "processes",
    jobs: int | None = None,
    scheduler: str | None = None,
    progress: Progress | None = None,
    **question: Unpack[AskedAtRate],
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
        question: as for `persid.verdicts.certify` (operating_point, u_op, domain, time_limit in s for each model, …).

    Raises:
        DataError: no such engine.

    Examples:
        >>> stable, unstable = (ps.PersidskiiModel(A0=[[a]], B=[[1.0]]) for a in (-1.0, 1.0))
        >>> [type(answer).__name__ for answer in ps.certify_many([stable, unstable, "no.json"], engine=None)]
        ['Certified', 'Refuted', 'Failed']
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


def _engine(
    engine: object, scheduler: str | None, jobs: int | None
) -> Callable[[list[Subject], AskedAtRate], Numbered]:
    """Return what decides models one by one, in any order."""
    if scheduler is None and (engine is None or engine == "processes"):
        count = 1 if engine is None else jobs or os.cpu_count() or 1
        return _here if count == 1 else lambda models, question: _in_processes(models, question, count)
    made = make_engine(engine if engine != "processes" else None, scheduler)
    if not isinstance(made, Cluster):
        raise DataError('no Dask cluster is known; give its address (scheduler=), or take engine="processes"')
    return lambda models, question: _on_cluster(made.client, models, question)


def _decide(model: Subject, question: AskedAtRate) -> Answer:
    """Decide one model; whatever goes wrong becomes an answer."""
    try:
        return certify(load_model(model) if isinstance(model, str | Path) else model, **question)
    except Exception as error:
        return Failed(f"{type(error).__name__}: {error}")


def was_interrupted(answer: Answer) -> bool:
    """Return whether an answer is missing because of Ctrl-C."""
    return isinstance(answer, Undecided) and answer.reason is Reason.INTERRUPTED


def _here(models: list[Subject], question: AskedAtRate) -> Numbered:
    for k, model in enumerate(models):
        yield k, _decide(model, question)


def _in_processes(models: list[Subject], question: AskedAtRate, jobs: int) -> Numbered:
    """Decide in processes; where one dies, the next models go on each in a process of its own, then all together.

    Models are begun in their order, so those that were at work are the first without an answer, but for a few whose
    answers were lost on the way.
    """
    left = dict(enumerate(models))
    while left:
        for k, answer in _pooled(left, question, min(jobs, len(left))):
            if answer is not None:
                del left[k]
                yield k, answer
        for k in list(left)[: jobs + 1]:
            for _, answer in _pooled({k: left.pop(k)}, question, 1):
                yield k, answer or Failed("the process that worked on it died (killed, or out of memory)")


def _pooled(models: dict[int, Subject], question: AskedAtRate, jobs: int) -> Iterator[tuple[int, Answer | None]]:
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
    except Exception as error:  # the answer cannot be sent
        return Failed(f"{type(error).__name__}: {error}")


def _one_thread() -> None:
    """Keep the linear algebra of one process on one processor."""
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    threadpool_limits(1)


def _on_cluster(client: DaskClient, models: list[Subject], question: AskedAtRate) -> Numbered:
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
