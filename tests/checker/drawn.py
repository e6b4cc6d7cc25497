"""Random ledgers of models of known truth: how the checker answers, with every accepted one looked at."""

import random
from collections import Counter
from collections.abc import Callable
from typing import Any

from checker.ledgers import Sketch, data, solved
from checker.sampled import faults
from persid.errors import RoundingError
from persid_check import Accepted, check
from persid_check.results import FormatError, NotProvedError


def outcomes(
    draw: Callable[[random.Random], Sketch], is_stable: Callable[[dict[str, Any]], bool], count: int, seed: int
) -> Counter[str]:
    """Count the checker's answers; each accepted ledger must be of a stable model and hold at sampled states."""
    return answers(lambda choose: solved(draw(choose), ratio=1e3), is_stable, count, seed)


def answers(
    make: Callable[[random.Random], dict[str, Any]], is_true: Callable[[dict[str, Any]], bool], count: int, seed: int
) -> Counter[str]:
    """Count the answers to ledgers that are made; each accepted one must be true and hold at sampled states."""
    choose, counts = random.Random(seed), Counter[str]()
    for _ in range(count):
        try:
            content = make(choose)
        except Exception as error:  # the solver gives up, or rounding loses the margin
            made = isinstance(error, RoundingError | NotProvedError | FormatError)
            if not made and type(error).__name__ != "SolverError":
                raise
            counts["not made"] += 1
            continue
        answer = check(data(content))
        counts[type(answer).__name__] += 1
        if isinstance(answer, Accepted):
            assert is_true(content), content["model"]
            assert faults(content, samples=60) == [], content["model"]
    print(dict(counts))
    return counts
