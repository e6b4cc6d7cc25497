"""A value of a file's JSON with its place: each is read strictly, and what is not specified is refused there.

A number of a certificate is an integer or a dyadic [mantissa, exponent], one of a model the text of a binary64. Nothing
is expanded: what is read is as long as the file.
"""

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any, NoReturn

from persid_check.expression import ExpressionError, Program, parse
from persid_check.plain import Texts
from persid_check.results import FormatError

MAX_BITS = 2048  # of a mantissa
MAX_EXPONENT = 2000
MAX_FACTOR_BITS = 512  # of an entry of T or L

Factor = tuple[tuple[int, ...], ...]
Lower = tuple[tuple[Fraction, ...], ...]  # lower rows of a symmetric matrix
Row = dict[int, Fraction]  # the entries that are not 0


class Entry:
    """A value and where it stands: the name of the whole, or a field or an item of another entry."""

    __slots__ = ("_name", "_of", "value")

    def __init__(self, value: Any, name: str | int = "", of: "Entry | None" = None) -> None:
        self.value, self._name, self._of = value, name, of

    @property
    def where(self) -> str:
        """The place as errors name it: curves[3].forms."""
        above = "" if self._of is None else self._of.where
        if isinstance(self._name, int):
            return f"{above}[{self._name}]"
        return f"{above}.{self._name}" if above else self._name

    def refuse(self, why: str) -> NoReturn:
        """Raise FormatError with the place."""
        raise FormatError(self.where or "file", why)

    def require(self, holds: object, why: str) -> None:
        """Raise FormatError with the place unless something holds."""
        if not holds:
            self.refuse(why)

    def fields(self, known: Sequence[str], optional: Sequence[str] = ()) -> "dict[str, Entry]":
        """Return the fields of an object: all that are known, of optional ones those it has, and no other."""
        if not isinstance(self.value, Mapping):
            self.refuse(f"an object with {', '.join(known)} is needed")
        for name in self.value:
            if name not in known and name not in optional:
                self.refuse(f"unknown field {str(name)[:60]!r}; known: {', '.join([*known, *optional])}")
        for name in known:
            if name not in self.value:
                self.refuse(f"the field {name!r} is missing")
        return {name: Entry(value, name, self) for name, value in self.value.items()}

    def items(self, size: int | None = None, longest: int | None = None) -> "list[Entry]":
        """Return the items of a list, of a given length where one is given, or of so many at most."""
        listed = self._listed(size)
        self.require(longest is None or len(listed) <= longest, f"at most {longest} are read")
        return [Entry(value, i, self) for i, value in enumerate(listed)]

    def _listed(self, size: int | None) -> list[Any]:
        if not isinstance(self.value, list) or (size is not None and len(self.value) != size):
            self.refuse("a list is needed" if size is None else f"a list of {size} is needed")
        return self.value

    def text(self, longest: int) -> str:
        """Return a text that is not too long."""
        short = isinstance(self.value, str) and len(self.value) <= longest
        self.require(short, f"text of at most {longest} characters is needed")
        return str(self.value)

    def one_of(self, known: Sequence[str]) -> str:
        """Return one of some words."""
        self.require(isinstance(self.value, str) and self.value in known, f"one of {', '.join(known)} is needed")
        return str(self.value)

    def names(self) -> list[str]:
        """Return names, each once."""
        names = [each.value for each in self.items()]
        printable = all(isinstance(name, str) and 0 < len(name) <= 200 and name.isprintable() for name in names)
        self.require(printable, "names are printable texts of 1 to 200 characters")
        self.require(len(set(names)) == len(names), "names are different")
        return names

    def program(self) -> Program:
        """Return what an expression means."""
        self.require(isinstance(self.value, str) and self.value.isprintable(), "an expression is printable text")
        try:
            return parse(self.value)
        except ExpressionError as error:
            self.refuse(str(error))

    def binary64(self) -> float:
        """Return the number of a text as float.hex() writes it."""
        if (found := _numbers([self.value])) is None:
            self.refuse(f"{str(self.value)[:40]!r} is not a finite number as float.hex() writes it")
        return found[0]

    def vector(self, size: int) -> list[float]:
        """Return so many numbers of a model."""
        listed = self._listed(size)
        numbers = listed.numbers.tolist() if isinstance(listed, Texts) else _numbers(listed)
        return [item.binary64() for item in self.items()] if numbers is None else numbers

    def matrix(self, height: int, width: int) -> list[list[float]]:
        """Return rows of such numbers."""
        return [row.vector(width) for row in self.items(height)]

    def integer(self, bits: int) -> int:
        """Return an integer of at most so many bits."""
        if isinstance(self.value, bool) or not isinstance(self.value, int):
            self.refuse(f"an integer is needed, not {str(self.value)[:40]!r}")
        if self.value.bit_length() > bits:
            self.refuse(f"an integer of at most {bits} bits is needed")
        return self.value

    def index(self, size: int) -> int:
        """Return an index into so many entries."""
        index = self.integer(64)
        if not 0 <= index < size:
            self.refuse(f"an index from 0 to {size - 1} is needed, not {index}")
        return index

    def indices(self, size: int) -> tuple[int, ...]:
        """Return indices, each once."""
        found = tuple(each.index(size) for each in self.items())
        self.require(len(set(found)) == len(found), "an entry stands twice")
        return found

    def exponent(self) -> int:
        """Return an exponent of two."""
        exponent = self.integer(64)
        if abs(exponent) > MAX_EXPONENT:
            self.refuse(f"an exponent of at most {MAX_EXPONENT} is needed")
        return exponent

    def dyadic(self) -> Fraction:
        """Return the number mantissa * 2**exponent of a pair."""
        first, second = self.items(2)
        mantissa, exponent = first.integer(MAX_BITS), second.exponent()
        return dyadic(mantissa, exponent)

    def nonnegative(self) -> Fraction:
        """Return a dyadic that is at least 0."""
        number = self.dyadic()
        self.require(number >= 0, "a number that is not negative is needed")
        return number

    def dyadics(self, size: int | None = None) -> tuple[Fraction, ...]:
        """Return a list of dyadics."""
        return tuple(each.dyadic() for each in self.items(size))

    def row(self, size: int) -> Row:
        """Return a list of [entry, dyadic], entries rising, as a row of so many."""
        found: Row = {}
        last = -1
        for pair in self.items():
            at, number = pair.items(2)
            pair.require(at.index(size) > last, "indices rise")
            last, found[at.value] = at.value, number.dyadic()
        return {i: value for i, value in found.items() if value}

    def lower(self, size: int) -> Lower:
        """Return the lower rows of a symmetric matrix."""
        return tuple(row.dyadics(i + 1) for i, row in enumerate(self.items(size)))

    def integers(self, size: int) -> tuple[int, ...]:
        """Return a row of a factor."""
        return tuple(each.integer(MAX_FACTOR_BITS) for each in self.items(size))

    def factor(self) -> Factor:
        """Return a square lower triangular matrix of integers, by its rows."""
        return tuple(row.integers(i + 1) for i, row in enumerate(self.items()))


def dyadic(mantissa: int, exponent: int) -> Fraction:
    """Return mantissa * 2**exponent."""
    return Fraction(mantissa << exponent) if exponent >= 0 else Fraction(mantissa, 1 << -exponent)


def _numbers(texts: Sequence[Any]) -> list[float] | None:
    """Return the numbers that float.hex() writes as these texts, None where one is not finite; zero has no sign."""
    try:
        numbers = [float.fromhex(text) + 0.0 for text in texts]
    except (TypeError, ValueError, OverflowError):
        return None
    return numbers if all(map(math.isfinite, numbers)) and [x.hex() for x in numbers] == texts else None
