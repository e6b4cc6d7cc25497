"""Engines: where passes over large measurements run. In this process, one chunk after the other, or on Dask.

A pass applies a function to every task and adds the answers up. A task is a tuple; what stands in it lazily (Dask's
`Delayed`) is there when the function is called.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from typing import Any, Protocol, TypeVar, runtime_checkable

from persid.errors import DataError

BRANCHES = 8  # sums are made in a tree with so many branches at each node

Task = tuple[object, ...]
Progress = Callable[[str], None]
Answer = TypeVar("Answer")


@runtime_checkable
class Summable(Protocol):
    """What can be added to its like."""

    def __add__(self: Answer, other: Answer, /) -> Answer:
        """Return the sum."""


Sum = TypeVar("Sum", bound=Summable)


@runtime_checkable
class Delayed(Protocol):
    """What Dask computes when it is asked to."""

    def __dask_graph__(self) -> object:
        """Return how it is computed."""

    def compute(self, *, scheduler: str) -> object:
        """Compute it."""


@runtime_checkable
class DaskClient(Protocol):
    """What is asked of a `distributed.Client`; its futures are known to itself alone."""

    def compute(self, collections: Sequence[object]) -> list[object]:
        """Return a future of each."""

    def submit(self, function: Callable[..., object], *args: object, pure: bool) -> object:
        """Return the future of a call, whose arguments may be futures."""

    def map(self, function: Callable[..., object], *args: object, pure: bool, **kwargs: object) -> list[Any]:
        """Return the futures of a call for each item."""

    def gather(self, futures: object) -> Any:
        """Return what a future, or each of a list, has come to."""

    def cancel(self, futures: Sequence[object]) -> object:
        """Forget them."""


def silent(line: str) -> None:
    """Take a line of progress and say nothing."""


def summed(parts: Iterable[dict[int, Sum]]) -> dict[int, Sum]:
    """Add dictionaries up, key by key."""
    total: dict[int, Sum] = {}
    for part in parts:
        for key, value in part.items():
            total[key] = total[key] + value if key in total else value
    return total


@dataclass(frozen=True)
class Here:
    """This process, one task after the other: never more than one chunk in memory."""

    progress: Progress = silent

    def each(self, function: Callable[..., Answer], tasks: Sequence[Task], what: str) -> list[Answer]:
        """Return the answers in order."""
        return list(self._answers(function, tasks, what))

    def total(self, function: Callable[..., dict[int, Sum]], tasks: Sequence[Task], what: str) -> dict[int, Sum]:
        """Return the sum of the answers."""
        return summed(self._answers(function, tasks, what))

    def _answers(self, function: Callable[..., Answer], tasks: Sequence[Task], what: str) -> Iterator[Answer]:
        for k, task in enumerate(tasks):
            self.progress(f"{what}: {k} of {len(tasks)} chunks")
            yield function(*(_here(part) for part in task))


def _here(part: object) -> object:
    """Compute what is lazy."""
    return part.compute(scheduler="synchronous") if isinstance(part, Delayed) else part


@dataclass(frozen=True)
class Threads:
    """Dask without a cluster: the threads of this process."""

    progress: Progress = silent

    def each(self, function: Callable[..., Answer], tasks: Sequence[Task], what: str) -> list[Answer]:
        """Return the answers in order."""
        return list(self._computed(_delayed(function, tasks), len(tasks), what)) if tasks else []

    def total(self, function: Callable[..., dict[int, Sum]], tasks: Sequence[Task], what: str) -> dict[int, Sum]:
        """Return the sum of the answers, added in a tree."""
        import dask

        add = dask.delayed(_sum, pure=False)
        nodes = _delayed(function, tasks)
        while len(nodes) > 1:
            nodes = [add(*nodes[k : k + BRANCHES]) for k in range(0, len(nodes), BRANCHES)]
        return self._computed(nodes, len(tasks), what)[0] if nodes else {}

    def _computed(self, nodes: Sequence[object], count: int, what: str) -> tuple[Any, ...]:
        import dask
        from dask.callbacks import Callback

        done: list[object] = []

        def tell(key: object, *rest: object) -> None:
            if str(key[0] if isinstance(key, tuple) else key).startswith(LEAF):
                done.append(key)
                self.progress(f"{what}: {len(done)} of {count} chunks")

        with Callback(posttask=tell):
            answers: tuple[Any, ...] = dask.compute(*nodes, scheduler="threads", optimize_graph=False)
        return answers


LEAF = "persid-chunk"


def _sum(*parts: dict[int, Sum]) -> dict[int, Sum]:
    return summed(parts)


def _delayed(function: Callable[..., object], tasks: Sequence[Task]) -> list[object]:
    import dask

    call = dask.delayed(function, pure=False)
    # A key of its own for every pass: answers of an earlier one are never taken for answers of this one.
    token = dask.base.tokenize(id(tasks), len(tasks), object())
    return [call(*task, dask_key_name=f"{LEAF}-{token}-{k}") for k, task in enumerate(tasks)]


@dataclass(frozen=True, eq=False)
class Cluster:
    """A Dask cluster behind a client. What a lost worker has computed is computed again by the others."""

    client: DaskClient
    progress: Progress = silent

    def each(self, function: Callable[..., Answer], tasks: Sequence[Task], what: str) -> list[Answer]:
        """Return the answers in order."""
        with self._submitted(function, tasks) as leaves:
            self._watch(leaves, len(leaves), what)
            return list(self.client.gather(leaves))

    def total(self, function: Callable[..., dict[int, Sum]], tasks: Sequence[Task], what: str) -> dict[int, Sum]:
        """Return the sum of the answers, added in a tree on the workers, which forget each answer once it is added."""
        if not tasks:
            return {}
        with self._submitted(function, tasks) as leaves:
            nodes = self._added(leaves)
            first = list(nodes)
            leaves.clear()
            while len(nodes) > 1:
                nodes = self._added(nodes)
            leaves += [*nodes, *first]  # to be cancelled where the pass is interrupted
            self._watch(first, len(tasks), what)
            return dict(self.client.gather(nodes[0]))

    @contextmanager
    def _submitted(self, function: Callable[..., object], tasks: Sequence[Task]) -> Iterator[list[object]]:
        futures = self.client.compute(_delayed(function, tasks)) if tasks else []
        try:
            yield futures
        except BaseException:
            with suppress(Exception):  # the cluster may be gone
                self.client.cancel(futures)
            raise

    def _added(self, nodes: Sequence[object]) -> list[object]:
        groups = [nodes[k : k + BRANCHES] for k in range(0, len(nodes), BRANCHES)]
        return [self.client.submit(_sum, *group, pure=False) for group in groups]

    def _watch(self, futures: Sequence[object], count: int, what: str) -> None:
        from distributed import as_completed

        self.progress(f"{what}: 0 of {count} chunks")
        for k, _ in enumerate(as_completed(futures), start=1):
            self.progress(f"{what}: {min(count, k * count // len(futures))} of {count} chunks")


Engine = Here | Threads | Cluster


def make_engine(engine: object = None, scheduler: str | None = None, progress: Progress | None = None) -> Engine:
    """Return the engine that is meant: None (this process), "dask", or a `distributed.Client`.

    "dask" is the cluster at the address `scheduler`, or else the client that is current, or else threads.

    Raises:
        DataError: no such engine, or no cluster at that address.
        ImportError: Dask is not installed.
    """
    tell = progress or silent
    if engine is None and scheduler is None:
        return Here(tell)
    if engine not in (None, "dask") if isinstance(engine, str | None) else not isinstance(engine, DaskClient):
        raise DataError(f'engine={engine!r}; choose None, "dask" or a distributed.Client')
    try:
        import dask  # noqa: F401
        from distributed import Client, default_client
    except ImportError:
        raise ImportError('Dask is not installed; pip install "persid[dask]"') from None
    if isinstance(engine, DaskClient):
        return Cluster(engine, tell)
    if scheduler is not None:
        try:
            return Cluster(Client(scheduler, set_as_default=False, timeout=10), tell)
        except (OSError, TimeoutError, ValueError) as error:
            raise DataError(f"no Dask scheduler answers at {scheduler}: {error}; give its address") from None
    try:
        return Cluster(default_client(), tell)
    except ValueError:  # there is none
        return Threads(tell)
