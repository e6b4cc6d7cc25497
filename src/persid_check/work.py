"""The work of one file, counted and limited: what is refused for its length is refused on every machine alike.

A step is one instruction of a program run on one interval (an expansion counts as many). A proof that stands in a file
twice counts once; the answer depends on the file alone.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from fractions import Fraction
from functools import partial, wraps
from hashlib import sha256
from typing import Any, ParamSpec, TypeVar

from persid_check.results import require

STEPS = 2 * 10**5  # that the proofs of a file may take, and more for each byte
STEPS_OF_A_BYTE = 16
MOST_STEPS = 4 * 10**6  # or, of longer files, so many for each byte:
MOST_OF_A_BYTE = 8
DIGITS = 2**24  # of all large matrices, and more for each byte of a file and its companion
DIGITS_OF_A_BYTE = 96
PRODUCTS = 2**36  # multiplications in products of large matrices, and more for each byte of both
PRODUCTS_OF_A_BYTE = 2**14
SEARCHED = 100  # steps of a byte of a file without partitions: they are sought
BITS_OF_A_STEP = 512  # of the factors of a product of fractions
KNOWN = 8192  # proofs that a process remembers, each with its steps: files of one model share lemmas

_Key = ParamSpec("_Key")
_Answer = TypeVar("_Answer")


def allowance(size: int, of_a_byte: int = STEPS_OF_A_BYTE, most: int = MOST_STEPS) -> int:
    """Return the steps that a file of so many bytes may take."""
    return min(STEPS + of_a_byte * size, max(most, MOST_OF_A_BYTE * size))


class Account:
    """Steps spent in a file or in a proof, what its large matrices may still take, and answers by their text."""

    def __init__(self, limit: float, digits: float, products: float) -> None:
        self.spent, self.limit, self.digits, self.products = 0, limit, digits, products
        self.answers: dict[object, Any] = {}


known: dict[bytes, tuple[Any, int]] = {}

account: ContextVar[Account | None] = ContextVar("account", default=None)


@contextmanager
def limited(steps: float, size: float = float("inf")) -> Iterator[Account]:
    """Within this context a proof may take so many steps, and what matrices of `size` bytes may; then it is refused."""
    current = Account(steps, DIGITS + DIGITS_OF_A_BYTE * size, PRODUCTS + PRODUCTS_OF_A_BYTE * size)
    token = account.set(current)
    try:
        yield current
    finally:
        account.reset(token)


def spend(steps: int) -> None:
    """Count steps."""
    if (current := account.get()) is not None:
        current.spent += steps
        require(
            current.spent <= current.limit, "file", "its proof takes too many steps: fewer or simpler forms are needed"
        )


def spend_digits(count: int) -> None:
    """Count digits of a large matrix."""
    if (current := account.get()) is not None:
        current.digits -= count
        require(current.digits >= 0, "file", "its matrices have too many digits for a file of this length")


def spend_multiplications(count: int) -> None:
    """Count multiplications in a product of large matrices."""
    if (current := account.get()) is not None:
        current.products -= count
        require(current.products >= 0, "file", "the products of its matrices are too long for a file of this length")


def spend_products(count: int, *factors: Iterable[Fraction]) -> None:
    """Count so many products of fractions, each with a factor of every kind: one of long numbers counts as several."""
    bits = sum(
        max((v.numerator.bit_length() + v.denominator.bit_length() for v in kind), default=0) for kind in factors
    )
    spend(count * (1 + bits // BITS_OF_A_STEP))


def once(proof: Callable[_Key, _Answer]) -> Callable[_Key, _Answer]:
    """Make a proof once, however often a file asks for it, and charge each file for it once, as if it were made anew.

    Numbers hash modulo 2^61 - 1: a file may hold thousands that share one hash, among which each search would be a long
    one. So proofs are found by the SHA-256 of their text.
    """

    @wraps(proof)
    def run(*key: _Key.args, **named: _Key.kwargs) -> _Answer:
        digest = sha256(f"{proof.__qualname__}{key!r}{named!r}".encode()).digest()
        return charged(digest, lambda: _known(digest, partial(proof, *key, **named)))

    return run


def _known(digest: bytes, proof: Callable[[], _Answer]) -> tuple[_Answer, int]:
    """Return the answer of a proof that the process knows, or make it; and its steps."""
    found: tuple[_Answer, int] | None = known.get(digest)
    if found is None:
        found = measured(proof)
        if len(known) >= KNOWN:
            known.clear()
        known[digest] = found
    return found


def measured(proof: Callable[[], _Answer]) -> tuple[_Answer, int]:
    """Return the answer of a proof, which may take the steps that are left, and those that it took."""
    outer = account.get()
    with limited(float("inf") if outer is None else outer.limit - outer.spent) as inner:
        answer = proof()
    return answer, inner.spent


def charged(key: object, find: Callable[[], tuple[_Answer, int]]) -> _Answer:
    """Return an answer that is found with its steps: a file that asks for it is charged once."""
    current = account.get()
    if current is None:
        return find()[0]
    if key not in current.answers:
        current.answers[key], steps = find()
        spend(steps)
    answer: _Answer = current.answers[key]
    return answer
