"""Numbers of a plain model as canonical text; what is no number stays as it is, for the strict reader to refuse."""

from array import array
from math import isfinite

ZERO, NEGATIVE_ZERO = (0.0).hex(), (-0.0).hex()


class Texts(list[str]):
    """Finite numbers as text that remembers them: what was written here is not read again. It is not to be changed."""

    __slots__ = ("numbers",)

    def __init__(self, numbers: list[float]) -> None:
        self.numbers = array("d", [number + 0.0 for number in numbers])
        super().__init__(map(float.hex, self.numbers))


def texts(values: object, size: int) -> object:
    """Return numbers as text, zeros where none are given."""
    if values is None:
        return [ZERO] * size
    if not isinstance(values, list):
        return values
    finite = set(map(type, values)) == {float} and all(map(isfinite, values))
    return Texts(values) if finite else list(map(text, values))


def numbers(listed: list[str]) -> list[float]:
    """Return the numbers of canonical text."""
    return listed.numbers.tolist() if isinstance(listed, Texts) else list(map(float.fromhex, listed))


def text(value: object) -> object:
    """Return a number as float.hex() writes it, zero without a sign; else what is given."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        return ZERO if value == NEGATIVE_ZERO else value
    try:
        return (float(value) + 0.0).hex()
    except OverflowError:
        return value
