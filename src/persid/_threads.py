"""BLAS threads: below a few hundred states the matrices of a proof are too small to be shared among processors."""

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

SHARED = 200  # states from which BLAS may use the threads that it likes


@contextmanager
def few_threads(states: int) -> Iterator[None]:
    """Keep BLAS on one thread inside, for a model with few states.

    Two copies of OpenBLAS, NumPy's and SciPy's, wake their threads at matrices of order 100 and let them spin, which
    takes several times as long as one thread, and far longer where other programs want the processors, too.
    """
    if states >= SHARED:
        yield
        return
    with _controller().limit(limits=1, user_api="blas"):
        yield


@cache
def _controller() -> Any:
    from threadpoolctl import ThreadpoolController  # type: ignore[import-untyped]

    return ThreadpoolController()
