"""What is remembered of earlier answers: so many at most, found by keys whose hash no file can foresee.

A proof that was made before, for another file, is found again and counts as if it were made now. Numbers hash modulo
2^61 - 1: a file may hold thousands that share one hash, among which each search would be a long one. So arguments are
found by their text, whose hash Python salts in every process.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, is_dataclass
from fractions import Fraction
from functools import lru_cache, partial, wraps
from types import MethodType
from typing import ParamSpec, TypeVar

from persid_check.work import charged, known, measured

_Key = ParamSpec("_Key")
_Answer = TypeVar("_Answer")


@dataclass(frozen=True)
class Question:
    """The arguments of a function. Two are equal where these are; the text is for the hash alone."""

    text: str
    arguments: tuple[object, ...]

    @classmethod
    def of(cls, *arguments: object) -> "Question":
        """Return the question that arguments ask."""
        return cls(spelled(arguments), arguments)

    def __hash__(self) -> int:
        return hash(self.text)


def spelled(value: object) -> str:
    """Return a text, the same for equal values: numbers in full, of other objects the fields, of functions nothing."""
    if isinstance(value, Fraction):
        return f"{value.numerator:x}/{value.denominator:x}"
    if isinstance(value, tuple):
        return f"({','.join(map(spelled, value))})"
    if isinstance(value, MethodType):
        return spelled(value.__self__)
    if is_dataclass(value):
        return spelled(tuple(getattr(value, field.name) for field in fields(value)))
    return value if isinstance(value, str) else f"{value:x}" if isinstance(value, int) else ""


_memories: list[Callable[[], None]] = [known.clear]


def forget() -> None:
    """Forget every answer."""
    for clear in _memories:
        clear()


def answers(function: Callable[..., _Answer], most: int) -> Callable[[Question], _Answer]:
    """Return a function of questions that keeps the last answers of another one."""

    @lru_cache(maxsize=most)
    def found(question: Question) -> _Answer:
        return function(*question.arguments)

    _memories.append(found.cache_clear)
    return found


def remembered(proof: Callable[_Key, _Answer], most: int = 65536) -> Callable[_Key, _Answer]:
    """Remember the last answers of a proof, with the steps that each took; a file is charged once for each."""

    def made(*key: object) -> tuple[_Answer, int]:
        return measured(partial(proof, *key))  # type: ignore[arg-type]

    found = answers(made, most)

    @wraps(proof)
    def run(*key: _Key.args, **_: _Key.kwargs) -> _Answer:
        question = Question.of(*key)
        return charged((proof.__name__, question), lambda: found(question))

    return run
