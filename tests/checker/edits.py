"""Places of a ledger that forgeries set: forms, what they are, and the function of the first term."""

from typing import Any

from checker.ledgers import number

R, M = "Rejected", "Malformed"
Edit = tuple[tuple[Any, ...], Any]
GONE = object()


def _l(k: int, *values: Any, curve: int = 0) -> Edit:
    return (("curves", curve, "forms", k, "l"), [number(v) for v in values])


def _is(k: int, kind: str, curve: int = 0) -> Edit:
    return (("curves", curve, "forms", k, "is"), kind)


def _f(text: str) -> tuple[Edit, ...]:
    return (("model", "terms", 0, "f"), text), (("curves", 0, "functions", 0, 0), text)
