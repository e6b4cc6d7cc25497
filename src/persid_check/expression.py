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

_TOKEN = re.compile(r"\s*((?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|[A-Za-z_]\w*|\*\*|[-+*/();:,])", re.ASCII)
_BINARY = ("+", "-", "*", "/")
_PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "neg": 3}  # a power binds more tightly, and is written at once


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


def work_of(program: Program) -> int:
    """Return the steps that one run of a program counts for: one for a sum or a kink, more for what takes longer."""
    return sum(_WORK.get(step.name, 1) for step in program)


def is_linear(program: Program) -> bool:
    """Whether a program is that of f = x, however it is spelled: x, (x), +x."""
    return program == (Instruction("x"),)


def _tokens(text: str) -> list[tuple[int, str]]:
    found, place, end = [], 0, len(text.rstrip())
    while place < end:
        match = _TOKEN.match(text, place)
        if match is None:
            raise ExpressionError(f"unreadable at character {place + 1} of {text!r}")
        found.append((match.start(1), match.group(1)))
        place = match.end()
    return found


def _is_number(token: str) -> bool:
    return token[:1].isdigit() or token[:1] == "."


def _number(token: str) -> Fraction:
    value = float(token)
    if not math.isfinite(value):
        raise ExpressionError(f"{token} is too large for a binary64")
    return Fraction(value)


class _Parser:
    """Dijkstra's shunting yard: operators wait on a stack until one that binds less tightly comes.

    What opens a parenthesis waits there, too, with the name of its function: "(", "tanh(".
    """

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
        while token := self._token():
            operand_due = self._operand(token) if operand_due else self._operator(token)
            self.place += 1
        if operand_due:
            raise self._error("the expression ends where a value is due")
        self._emit()
        if self.waiting:
            raise self._error("a parenthesis is not closed")
        return tuple(self.output)

    def _token(self, ahead: int = 0) -> str:
        """Return the token at the place, or some places ahead; beyond the end there is none."""
        place = self.place + ahead
        return self.tokens[place][1] if place < len(self.tokens) else ""

    def _error(self, what: str) -> ExpressionError:
        where = self.tokens[self.place][0] + 1 if self.place < len(self.tokens) else len(self.text) + 1
        shown = self.text if len(self.text) <= SHOWN else f"{self.text[:SHOWN]}…"
        return ExpressionError(f"{what} (character {where} of {shown!r})")

    def _emit(self, least: int = 1) -> None:
        """Write the operators that wait and bind at least as tightly, as far as a parenthesis."""
        while self.waiting and _PRECEDENCE.get(self.waiting[-1], 0) >= least:
            self.output.append(Instruction(self.waiting.pop()))

    def _operand(self, token: str) -> bool:
        """Read a value or what may stand before one; tell whether a value is still due."""
        if token in FUNCTIONS and self._token(1) != "(":
            raise self._error(f"{token} needs its argument in parentheses")
        if token in FUNCTIONS:
            self.place += 1
            self.waiting.append(f"{token}(")
        elif token in "-(":
            self.waiting.append("neg" if token == "-" else "(")
        elif token == "pwl":
            self.output += hinges(self._table())
        elif token == "x":
            self.output.append(Instruction("x"))
        elif _is_number(token):
            self.output.append(Instruction("number", _number(token)))
        elif token[0].isalpha() or token[0] == "_":
            raise self._error(f"unknown name {token!r}; known: x, {', '.join(sorted(FUNCTIONS))}, pwl")
        elif token != "+":  # which changes nothing before a value
            raise self._error(f"{token!r} where a value is due")
        return token in "+-(" or token in FUNCTIONS

    def _operator(self, token: str) -> bool:
        """Read what may follow a value; tell whether a value is due."""
        if token == ")":
            self._close()
        elif token == "**":
            self.output.append(Instruction("**", self._exponent()))
        elif token in _BINARY:
            self._emit(_PRECEDENCE[token])
            self.waiting.append(token)
        else:
            raise self._error("an operator is due")
        return token in _BINARY

    def _close(self) -> None:
        self._emit()
        if not self.waiting:
            raise self._error("a parenthesis closes that was never opened")
        if name := self.waiting.pop()[:-1]:
            self.output.append(Instruction(name))

    def _exponent(self) -> Fraction:
        """Read the literal behind `**`; it applies at once, since nothing binds more tightly."""
        value = self._literal(("-",), "an exponent is a number, an integer or a half-integer")
        if value.denominator > 2 or abs(value) > MAX_EXPONENT:
            token = self._token()
            raise self._error(f"an exponent is an integer or a half-integer of at most {MAX_EXPONENT}, not {token}")
        if self._token(1) == "**":
            raise self._error("a power of a power needs parentheses")
        return value

    def _literal(self, signs: tuple[str, ...], due: str) -> Fraction:
        """Read the next number, with or without a sign; the place is left at it."""
        self.place += 1
        sign = self._token()
        self.place += sign in signs
        if not _is_number(self._token()):
            raise self._error(due)
        return _number(self._token()) * (-1 if sign == "-" else 1)

    def _table(self) -> Table:
        """Read what follows `pwl`; the place is left at its closing parenthesis."""
        for due in ("(", "x", ";"):
            self._next(due)
        points = [self._point()]
        while self._token(1) == ",":
            self.place += 1
            points.append(self._point())
            if points[-2][0] >= points[-1][0]:
                raise self._error("the knots of a table rise: each one is larger than the one before")
        self._next(")")
        if len(points) < 2:
            raise self._error("a table needs two knots at least")
        self.tables.append(tuple(points))
        if sum(map(len, self.tables)) > MAX_KNOTS:
            raise self._error(f"more than {MAX_KNOTS} knots in an expression; keep those where the slope changes")
        return self.tables[-1]

    def _point(self) -> tuple[Fraction, Fraction]:
        signs, due = ("-", "+"), "a number is due in a table, written pwl(x; knot: value, knot: value)"
        knot = self._literal(signs, due)
        self._next(":")
        return knot, self._literal(signs, due)

    def _next(self, due: str) -> None:
        self.place += 1
        if self._token() != due:
            raise self._error(f"{due!r} is due in a table, written pwl(x; knot: value, knot: value)")
