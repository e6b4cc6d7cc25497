"""Values are handed over by name where there are many: nobody counts to the seventh position."""

import ast
from collections.abc import Iterator

from places import ROOT

MOST = 6
SOURCES = ROOT / "src"


def too_many(text: str) -> Iterator[str]:
    """Yield the functions of a module that take more than six values by position, and the calls that give as many."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef):
            taken = [arg.arg for arg in (*node.args.posonlyargs, *node.args.args) if arg.arg not in ("self", "cls")]
            if len(taken) > MOST:
                yield f"{node.lineno}: def {node.name}"
        if isinstance(node, ast.Call) and len(node.args) > MOST and ast.unparse(node.func) != "together":
            yield f"{node.lineno}: {ast.unparse(node.func)}(...)"


def test_a_long_list_of_positions_is_seen() -> None:
    """The check finds a function with seven positions and a call with seven values, and no options by name."""
    found = list(
        too_many("def f(a, b, c, d, e, f, g): ...\ndef h(a, *, b, c, d, e, f, g): ...\nf(1, 2, 3, 4, 5, 6, 7)")
    )
    assert found == ["1: def f", "3: f(...)"]


def test_no_more_than_six_by_position() -> None:
    """More than six values have names in every call (decorators of commands, each an option, are listed one by one)."""
    found = {str(path.relative_to(SOURCES)): list(too_many(path.read_text("utf-8"))) for path in SOURCES.rglob("*.py")}
    assert {name: where for name, where in found.items() if where} == {}
