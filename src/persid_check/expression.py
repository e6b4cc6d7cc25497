"""Scalar functions as text: the closed grammar of `f`, parsed into a postfix program.

    expression := term (("+" | "-") term)*          term   := factor (("*" | "/") factor)*
    factor     := ("+" | "-") factor | power        power  := atom ["**" exponent]
    atom       := number | "x" | name "(" expression ")" | "(" expression ")"
    exponent   := ["-"] number, an integer or a half-integer

A number means the nearest binary64, as an exact fraction. A program is a flat tuple, so nothing that reads one
needs recursion: whoever gives every instruction a meaning (floats, balls, power series, LaTeX) runs it on a stack.
"""

import math
import re
from dataclasses import dataclass
from fractions import Fraction

FUNCTIONS = frozenset({
    "sqrt", "abs", "exp", "log1p", "expm1", "sin", "cos", "tan", "sinh", "cosh", "tanh",
    "arcsinh", "arctan", "erf", "softsign", "softplus", "relu", "deadzone", "sat",
})  # fmt: skip
MAX_LENGTH = 1000  # characters of text
MAX_EXPONENT = 64

_TOKEN = re.compile(
    r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|([A-Za-z_]\w*)|(\*\*|[-+*/()]))", re.ASCII
)
_PRECEDENCE = {"+": 1, "-": 1, "*": 2, "/": 2, "neg": 3, "pos": 3, "**": 4}


class ExpressionError(ValueError):
    """The text is not an expression of the grammar; the message names the place."""


@dataclass(frozen=True)
class Instruction:
    """One step of a program: `number` and `**` carry a value; the rest is named by `name` alone."""

    name: str  # "number", "x", "+", "-", "*", "/", "neg", "**" or a member of FUNCTIONS
    value: Fraction | None = None


Program = tuple[Instruction, ...]


def parse(text: str) -> Program:
    """Translate an expression in `x` to a postfix program, or raise ExpressionError."""
    if len(text) > MAX_LENGTH:
        raise ExpressionError(f"an expression of {len(text)} characters; at most {MAX_LENGTH} are read")
    return _Parser(text).run()


def work_of(program: Program) -> int:
    """Return the steps that one run of a program counts for: a function or a power takes as long as four sums."""
    return sum(4 if step.name in FUNCTIONS or step.name == "**" else 1 for step in program)


def is_linear(program: Program) -> bool:
    """Whether a program is that of f = x, however it is spelled: x, (x), +x."""
    return program == (Instruction("x"),)


def _tokens(text: str) -> list[tuple[int, str]]:
    found, place = [], 0
    while text[place:].strip():
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
        self.text, self.tokens = text, _tokens(text)
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
        return ExpressionError(f"{what} (character {where} of {self.text!r})")

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
        elif token == "x":
            self.output.append(Instruction("x"))
        elif token[0].isdigit() or token[0] == ".":
            self.output.append(Instruction("number", _number(token)))
        elif token[0].isalpha() or token[0] == "_":
            raise self._error(f"unknown name {token!r}; known: x, {', '.join(sorted(FUNCTIONS))}")
        else:
            raise self._error(f"{token!r} where a value is due")
        self.place += 1
        return token in "+-(" or token in FUNCTIONS

    def _operator(self, token: str) -> bool:
        """Read what may follow a value; tell whether a value is due."""
        if token == ")":
            self._close()
        elif token == "**":
            self.output.append(Instruction("**", self._exponent()))
        elif token in _PRECEDENCE:
            while self.waiting and _PRECEDENCE.get(self.waiting[-1], 0) >= _PRECEDENCE[token]:
                self._emit()
            self.waiting.append(token)
        else:
            raise self._error("an operator is due")
        self.place += 1
        return token in "+-*/"

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
