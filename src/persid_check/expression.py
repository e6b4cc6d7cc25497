"""Scalar functions as text: the closed grammar of `f`, parsed into a postfix program.

    expression := term (("+" | "-") term)*          term   := factor (("*" | "/") factor)*
    factor     := ("+" | "-") factor | power        power  := atom ["**" exponent]
    atom       := number | "x" | name "(" expression ")" | "(" expression ")" | table
    exponent   := ["-"] number, an integer or a half-integer
    table      := "pwl" "(" "x" ";" point ("," point)* ")"       point := sign number ":" sign number

A number means the nearest binary64, as an exact fraction. A table is read as the sum of hinges that it is; no other
part of the checker knows of it. A program is a flat tuple, so nothing that reads one needs recursion: whoever gives
every instruction a meaning (floats, balls, power series, LaTeX) runs it on a stack.
"""

import math
import re
from dataclasses import dataclass
from fractions import Fraction
from itertools import pairwise

FUNCTIONS = frozenset({
    "sqrt", "abs", "exp", "log1p", "expm1", "sin", "cos", "tan", "sinh", "cosh", "tanh",
    "arcsinh", "arctan", "erf", "softsign", "softplus", "relu", "deadzone", "sat",
})  # fmt: skip
_KINKS = frozenset(["abs", "relu", "deadzone", "sat"])
_WORK = {"*": 2, "/": 4, "**": 8} | dict.fromkeys(FUNCTIONS - _KINKS, 4)
MAX_LENGTH = 1000  # characters of text
MAX_LENGTH_WITH_TABLES = 4000
MAX_KNOTS = 64  # of all tables of an expression
MAX_EXPONENT = 64
SHOWN = 200  # characters of an expression in an error

_TOKEN = re.compile(
    r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|([A-Za-z_]\w*)|(\*\*|[-+*/();:,]))", re.ASCII
)
_BINARY = ("+", "-", "*", "/")
_PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "neg": 3, "pos": 3, "**": 4}


class ExpressionError(ValueError):
    """The text is not an expression of the grammar; the message names the place."""


@dataclass(frozen=True)
class Instruction:
    """One step of a program: `number` and `**` carry a value; the rest is named by `name` alone."""

    name: str  # "number", "x", "+", "-", "*", "/", "neg", "**" or a member of FUNCTIONS
    value: Fraction | None = None


Program = tuple[Instruction, ...]
Table = tuple[tuple[Fraction, Fraction], ...]  # (knot, value), knots rising


def parse(text: str) -> Program:
    """Translate an expression in `x` to a postfix program, or raise ExpressionError."""
    return _Parser(text).run()


def table_of(text: str) -> Table | None:
    """Return the knots and values of an expression that is a table and nothing else; None for others."""
    parser = _Parser(text)
    program = parser.run()
    return parser.tables[0] if len(parser.tables) == 1 and program == hinges(parser.tables[0]) else None


def hinges(table: Table) -> Program:
    """Return the program of a piecewise linear function: f(0) + sum over pieces of slope * (the way of x in the piece).

    The way in a piece is the integral of its indicator from 0 to x. So f(0) is exact, and inside a piece the slopes of
    all others are 1 - 1 or 0, exactly, whatever the arithmetic.
    """
    pieces = [(a, b, (w - v) / (b - a)) for (a, v), (b, w) in pairwise(table)]
    at_zero = _value_at_zero(table, [slope for _, _, slope in pieces])
    found = [Instruction("number", at_zero)] if at_zero or not any(slope for _, _, slope in pieces) else []
    for k, (a, b, slope) in enumerate(pieces):
        if slope:
            moved = _moved(a if k else None, b if k < len(pieces) - 1 else None)
            joined = [Instruction("+")] if found else []
            found += [Instruction("number", slope), *moved, Instruction("*"), *joined]
    return tuple(found)


def _value_at_zero(table: Table, slopes: list[Fraction]) -> Fraction:
    """Return the exact value at 0: on the last piece that begins at 0 or before, or on the first one."""
    k = max((k for k, (t, _) in enumerate(table[:-1]) if t <= 0), default=0)
    return table[k][1] - slopes[k] * table[k][0]


def _moved(a: Fraction | None, b: Fraction | None) -> list[Instruction]:
    """Return the integral from 0 to x of the indicator of (a, b), an end None where there is none."""
    x = Instruction("x")
    right = [] if b is None else [x, Instruction("number", b), Instruction("-"), Instruction("relu"), Instruction("-")]
    if a is not None and a >= 0:
        return [x, Instruction("number", a), Instruction("-"), Instruction("relu"), *right]
    left = [] if a is None else [Instruction("number", a), x, Instruction("-"), Instruction("relu"), Instruction("+")]
    if b is not None and b <= 0:
        return [Instruction("number", b), x, Instruction("-"), Instruction("relu"), Instruction("neg"), *left]
    return [x, *right, *left]


def kinks(program: Program) -> tuple[Fraction, ...]:
    """Return the numbers t of all relu(x - t) and relu(t - x) in a program: pieces had better end there."""
    found = set()
    for k in range(3, len(program)):
        one, other, minus, hinge = program[k - 3 : k + 1]
        if (minus.name, hinge.name) == ("-", "relu") and {one.name, other.name} == {"x", "number"}:
            found.add(one.value if one.value is not None else other.value or Fraction(0))
    return tuple(sorted(found))


def work_of(program: Program) -> int:
    """Return the steps that one run of a program counts for: one for a sum or a kink, more for what takes longer."""
    return sum(_WORK.get(step.name, 1) for step in program)


def is_linear(program: Program) -> bool:
    """Whether a program is that of f = x, however it is spelled: x, (x), +x."""
    return program == (Instruction("x"),)


def _tokens(text: str) -> list[tuple[int, str]]:
    found, place = [], 0
    end = len(text.rstrip())
    while place < end:
        match = _TOKEN.match(text, place)
        if match is None:
            raise ExpressionError(f"unreadable at character {place + 1} of {text!r}")
        found.append((match.start(match.lastindex or 0), match.group(match.lastindex or 0)))
        place = match.end()
    return found


def _number(token: str) -> Fraction:
    value = float(token)
    if not math.isfinite(value):
        raise ExpressionError(f"{token} is too large for a binary64")
    return Fraction(value)


class _Parser:
    """Dijkstra's shunting yard: operators wait on a stack until one that binds less tightly comes."""

    def __init__(self, text: str) -> None:
        longest = MAX_LENGTH_WITH_TABLES if "pwl" in text else MAX_LENGTH
        if len(text) > longest:
            raise ExpressionError(f"an expression of {len(text)} characters; at most {longest} are read")
        self.text, self.tokens = text, _tokens(text)
        self.tables: list[Table] = []
        self.output: list[Instruction] = []
        self.waiting: list[str] = []
        self.place = 0

    def run(self) -> Program:
        operand_due = True
        while self.place < len(self.tokens):
            token = self.tokens[self.place][1]
            operand_due = self._operand(token) if operand_due else self._operator(token)
        if operand_due:
            raise self._error("the expression ends where a value is due")
        while self.waiting:
            if self.waiting[-1] not in _PRECEDENCE:
                raise self._error("a parenthesis is not closed")
            self._emit()
        return tuple(self.output)

    def _error(self, what: str) -> ExpressionError:
        where = self.tokens[self.place][0] + 1 if self.place < len(self.tokens) else len(self.text) + 1
        shown = self.text if len(self.text) <= SHOWN else f"{self.text[:SHOWN]}…"
        return ExpressionError(f"{what} (character {where} of {shown!r})")

    def _emit(self) -> None:
        name = self.waiting.pop()
        if name != "pos":
            self.output.append(Instruction(name))

    def _operand(self, token: str) -> bool:
        """Read a value or what may stand before one; tell whether a value is still due."""
        if token in "+-(":
            self.waiting.append({"+": "pos", "-": "neg", "(": "("}[token])
        elif token in FUNCTIONS:
            if self.place + 1 >= len(self.tokens) or self.tokens[self.place + 1][1] != "(":
                raise self._error(f"{token} needs its argument in parentheses")
            self.waiting.append(token)
            self.waiting.append("(")
            self.place += 1
        elif token == "pwl":
            self.output += hinges(self._table())
        elif token == "x":
            self.output.append(Instruction("x"))
        elif token[0].isdigit() or token[0] == ".":
            self.output.append(Instruction("number", _number(token)))
        elif token[0].isalpha() or token[0] == "_":
            raise self._error(f"unknown name {token!r}; known: x, {', '.join(sorted(FUNCTIONS))}, pwl")
        else:
            raise self._error(f"{token!r} where a value is due")
        self.place += 1
        return token in "+-(" or token in FUNCTIONS

    def _table(self) -> Table:
        """Read what follows `pwl`; the place is left at its closing parenthesis."""
        for due in ("(", "x", ";"):
            self._next(due)
        points: list[tuple[Fraction, Fraction]] = []
        while not points or self._following() == ",":
            self.place += bool(points)
            knot = self._signed()
            self._next(":")
            points.append((knot, self._signed()))
            if len(points) > 1 and points[-2][0] >= knot:
                raise self._error("the knots of a table rise: each one is larger than the one before")
        self._next(")")
        if len(points) < 2:
            raise self._error("a table needs two knots at least")
        self.tables.append(tuple(points))
        if sum(map(len, self.tables)) > MAX_KNOTS:
            raise self._error(f"more than {MAX_KNOTS} knots in an expression; keep those where the slope changes")
        return self.tables[-1]

    def _following(self) -> str:
        return self.tokens[self.place + 1][1] if self.place + 1 < len(self.tokens) else ""

    def _next(self, due: str) -> None:
        found = self._following()
        self.place += 1
        if found != due:
            raise self._error(f"{due!r} is due in a table, written pwl(x; knot: value, knot: value)")

    def _signed(self) -> Fraction:
        """Read the next number, with or without a sign."""
        sign = {"-": -1, "+": 1}.get(self._following(), 0)
        self.place += 1 + bool(sign)
        token = self.tokens[self.place][1] if self.place < len(self.tokens) else ""
        if not token[:1].isdigit() and token[:1] != ".":
            raise self._error("a number is due in a table, written pwl(x; knot: value, knot: value)")
        return (sign or 1) * _number(token)

    def _operator(self, token: str) -> bool:
        """Read what may follow a value; tell whether a value is due."""
        if token == ")":
            self._close()
        elif token == "**":
            self.output.append(Instruction("**", self._exponent()))
        elif token in _BINARY:
            while self.waiting and _PRECEDENCE.get(self.waiting[-1], 0) >= _PRECEDENCE[token]:
                self._emit()
            self.waiting.append(token)
        else:
            raise self._error("an operator is due")
        self.place += 1
        return token in _BINARY

    def _close(self) -> None:
        while self.waiting and self.waiting[-1] != "(":
            self._emit()
        if not self.waiting:
            raise self._error("a parenthesis closes that was never opened")
        self.waiting.pop()
        if self.waiting and self.waiting[-1] in FUNCTIONS:
            self._emit()

    def _exponent(self) -> Fraction:
        """Read the literal behind `**`; it applies at once, since nothing binds more tightly."""
        sign = 1
        self.place += 1
        if self.place < len(self.tokens) and self.tokens[self.place][1] == "-":
            sign, self.place = -1, self.place + 1
        token = self.tokens[self.place][1] if self.place < len(self.tokens) else ""
        if not token[:1].isdigit() and token[:1] != ".":
            raise self._error("an exponent is a number, an integer or a half-integer")
        value = sign * _number(token)
        if value.denominator > 2 or abs(value) > MAX_EXPONENT:
            raise self._error(f"an exponent is an integer or a half-integer of at most {MAX_EXPONENT}, not {token}")
        if self.place + 1 < len(self.tokens) and self.tokens[self.place + 1][1] == "**":
            raise self._error("a power of a power needs parentheses")
        return value
