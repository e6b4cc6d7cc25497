"""The work of one file, counted and limited: what is refused for its length is refused on every machine alike.

A step is one instruction of a program run on one interval (an expansion counts as many). A proof that was made before,
for another file, is found again and counts as if it were made now: the answer depends on the file alone.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import wraps
from typing import ParamSpec, TypeVar

from persid_check.memory import Question, answers
from persid_check.results import NotProvedError

STEPS = 2 * 10**5  # that the proofs of a file may take, and more for each byte
STEPS_OF_A_BYTE = 16
MOST_STEPS = 4 * 10**6  # or, of longer files, so many for each byte:
MOST_OF_A_BYTE = 8
SEARCHED = 100  # steps of a byte of a file without partitions: they are sought

_Key = ParamSpec("_Key")
_Answer = TypeVar("_Answer")


def allowance(size: int, of_a_byte: int = STEPS_OF_A_BYTE, most: int = MOST_STEPS) -> int:
    """Return the steps that a file of so many bytes may take."""
    return min(STEPS + of_a_byte * size, max(most, MOST_OF_A_BYTE * size))


class _Account:
    """Steps spent in a file or in a proof, and the proofs of the file that have been counted."""

    def __init__(self, limit: float) -> None:
        self.spent, self.limit = 0, limit
        self.counted: set[tuple[str, Question]] = set()


_account: ContextVar[_Account | None] = ContextVar("_account", default=None)


@contextmanager
def limited(steps: float) -> Iterator[_Account]:
    """Within this context a proof may take so many steps in all; then NotProvedError ends it."""
    account = _Account(steps)
    token = _account.set(account)
    try:
        yield account
    finally:
        _account.reset(token)


def spend(steps: int) -> None:
    """Count steps."""
    account = _account.get()
    if account is not None:
        account.spent += steps
        if account.spent > account.limit:
            raise NotProvedError("file", "its proof takes too many steps: fewer or simpler forms are needed")


def remembered(proof: Callable[_Key, _Answer], most: int = 65536) -> Callable[_Key, _Answer]:
    """Remember the last answers of a proof, with the steps that each took; a file is charged once for each."""

    def charged(*key: object) -> tuple[_Answer, int]:
        outer = _account.get()
        with limited(float("inf") if outer is None else outer.limit - outer.spent) as inner:
            answer = proof(*key)  # type: ignore[arg-type, call-arg]
        return answer, inner.spent

    found = answers(charged, most)

    @wraps(proof)
    def run(*key: _Key.args, **_: _Key.kwargs) -> _Answer:
        question = Question.of(*key)
        answer, steps = found(question)
        account = _account.get()
        if account is not None and (proof.__name__, question) not in account.counted:
            account.counted.add((proof.__name__, question))
            spend(steps)
        return answer

    return run
