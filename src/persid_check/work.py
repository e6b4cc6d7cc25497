"""The work of one file, counted and limited: what is refused for its length is refused on every machine alike.

A step is one instruction of a program run on one interval (an expansion counts as many). A proof that stands in a file
twice counts once; the answer depends on the file alone.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial, wraps
from hashlib import sha256
from typing import Any, ParamSpec, TypeVar

from persid_check.results import NotProvedError

STEPS = 2 * 10**5  # that the proofs of a file may take, and more for each byte
STEPS_OF_A_BYTE = 16
MOST_STEPS = 4 * 10**6  # or, of longer files, so many for each byte:
MOST_OF_A_BYTE = 8
SEARCHED = 100  # steps of a byte of a file without partitions: they are sought
KNOWN = 8192  # proofs that a process remembers, each with its steps: files of one model share lemmas

_Key = ParamSpec("_Key")
_Answer = TypeVar("_Answer")


def allowance(size: int, of_a_byte: int = STEPS_OF_A_BYTE, most: int = MOST_STEPS) -> int:
    """Return the steps that a file of so many bytes may take."""
    return min(STEPS + of_a_byte * size, max(most, MOST_OF_A_BYTE * size))


class Account:
    """Steps spent in a file or in a proof, and the answers of its proofs, by their text."""

    def __init__(self, limit: float) -> None:
        self.spent, self.limit = 0, limit
        self.answers: dict[object, Any] = {}


known: dict[bytes, tuple[Any, int]] = {}

account: ContextVar[Account | None] = ContextVar("account", default=None)


@contextmanager
def limited(steps: float) -> Iterator[Account]:
    """Within this context a proof may take so many steps in all; then NotProvedError ends it."""
    current = Account(steps)
    token = account.set(current)
    try:
        yield current
    finally:
        account.reset(token)


def spend(steps: int) -> None:
    """Count steps."""
    current = account.get()
    if current is not None:
        current.spent += steps
        if current.spent > current.limit:
            raise NotProvedError("file", "its proof takes too many steps: fewer or simpler forms are needed")


def once(proof: Callable[_Key, _Answer]) -> Callable[_Key, _Answer]:
    """Make a proof once, however often a file asks for it, and charge each file for it once, as if it were made anew.

    Numbers hash modulo 2^61 - 1: a file may hold thousands that share one hash, among which each search would be a long
    one. So proofs are found by the SHA-256 of their text.
    """

    @wraps(proof)
    def run(*key: _Key.args, **named: _Key.kwargs) -> _Answer:
        current = account.get()
        if current is None:
            return proof(*key, **named)
        digest = sha256(f"{proof.__qualname__}{key!r}{named!r}".encode()).digest()
        if digest not in current.answers:
            current.answers[digest] = _charged(digest, partial(proof, *key, **named), current)
        answer: _Answer = current.answers[digest]
        return answer

    return run


def _charged(digest: bytes, proof: Callable[[], _Answer], current: Account) -> _Answer:
    """Return the answer of a proof that the process knows, or make it; its steps count either way."""
    if digest in known:
        answer, steps = known[digest]
        spend(steps)
        return answer  # type: ignore[no-any-return]
    before, answer = current.spent, proof()
    if len(known) >= KNOWN:
        known.clear()
    known[digest] = answer, current.spent - before
    return answer
