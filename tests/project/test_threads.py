"""BLAS threads: one while a small model is certified, and afterwards as many as before."""

import numpy as np
import pytest

from persid import CertifiedIdentifier, PersidskiiModel, certify
from persid._threads import SHARED, few_threads

threadpoolctl = pytest.importorskip("threadpoolctl")


def _threads() -> list[int]:
    return [library["num_threads"] for library in threadpoolctl.threadpool_info() if library["user_api"] == "blas"]


def test_one_thread_inside_and_as_before_outside() -> None:
    """A large model leaves BLAS alone."""
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        before = _threads()
        with few_threads(3):
            assert set(_threads()) == {1}
        assert _threads() == before
        with few_threads(SHARED):
            assert _threads() == before


@pytest.mark.long
def test_proofs_and_constrained_fits_use_one_thread() -> None:
    """What certify and CertifiedIdentifier do is done with one thread; an interruption gives the others back."""
    seen: list[int] = []

    def look(line: str) -> None:
        seen.extend(_threads())

    def stop(line: str) -> None:
        raise KeyboardInterrupt

    model = PersidskiiModel([[-2.0]], [("tanh(x)", None, [[1.0]])], [[1.0]])
    t = np.linspace(0, 10, 200)
    data = model.simulate([1.0], t, np.sin(t)[:, None])
    with threadpoolctl.threadpool_limits(2, user_api="blas"):
        before = _threads()
        certify(model, progress=look)
        assert seen
        assert set(seen) == {1}
        certify(model, progress=stop)
        assert _threads() == before
        seen.clear()
        CertifiedIdentifier(progress=look, time_limit=5).fit(data)
        assert seen
        assert set(seen) == {1}
        assert _threads() == before
