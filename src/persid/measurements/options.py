"""The arguments of `persid.read_measurements` that other functions hand on to it."""

from collections.abc import Mapping, Sequence
from typing import Required, TypedDict


class Reading(TypedDict, total=False):
    """How a table is read whose columns are known; see `persid.read_measurements`."""

    time: str | None
    dt: float | int | None
    gap: float | int | None
    missing: str
    na: Sequence[object]
    run: str | None
    delay: Mapping[str, float | int] | None


class ReadingOf(Reading, total=False):
    """The same, with the names of its columns."""

    states: Required[Sequence[str]]
    inputs: Sequence[str]
