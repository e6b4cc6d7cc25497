"""Mutants of a certificate: every number, in turn, changed in several ways."""

import copy
import math
from collections.abc import Iterator
from typing import Any

from persid_check import FormatError, model_sha256

Path = tuple[Any, ...]


def places(value: Any, path: Path = ()) -> Iterator[Path]:
    """The places of all numbers: integers, and hexadecimal floats of the model."""
    if isinstance(value, dict):
        for key, entry in value.items():
            yield from places(entry, (*path, key))
    elif isinstance(value, list):
        for i, entry in enumerate(value):
            yield from places(entry, (*path, i))
    elif isinstance(value, int) or (isinstance(value, str) and "0x" in value):
        yield path


def changes(value: Any) -> list[Any]:
    """Other values for one number."""
    if isinstance(value, str):
        number = float.fromhex(value)
        others = [
            -number,
            0.0,
            2 * number,
            number / 2,
            number + 1,
            number - 1,
            number * 1.01,
            number * 0.9,
            number + 0.125,
        ]
        others += [
            math.nextafter(number, math.inf),
            math.nextafter(number, -math.inf),
            -number / 2,
            10 * number,
            number / 100,
        ]
        return [text for other in others if (text := (other + 0.0).hex()) != value]
    others = [
        value + 1,
        value - 1,
        -value,
        0,
        2 * value,
        value // 2,
        10 * value,
        3 * value,
        value + 7,
        value - 100,
        1 - value,
    ]
    others += [value ^ bit for bit in (2, 4, 8, 64, 1024)] + [value + value // k for k in (3, 10, 100, -50, -1000)]
    return [other for other in dict.fromkeys(others) if other != value]


def mutants(certificate: dict[str, Any]) -> Iterator[tuple[Path, Any, dict[str, Any]]]:
    """Each mutant with the place and the new value; the hash is made to fit a changed model."""
    for path in places(certificate):
        old: Any = certificate
        for key in path:
            old = old[key]
        for new in changes(old):
            mutant = copy.deepcopy(certificate)
            place: Any = mutant
            for key in path[:-1]:
                place = place[key]
            place[path[-1]] = new
            if path[0] == "model":
                try:
                    mutant["model_sha256"] = model_sha256(mutant["model"])
                except FormatError:
                    continue
            yield path, new, mutant
