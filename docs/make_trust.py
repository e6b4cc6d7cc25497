"""Count the lines of the checker, for docs/trust-base.md: what there is to read for which kind of file.

python docs/make_trust.py          write the table
"""

import ast
import io
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path

CHECKER = Path(__file__).resolve().parents[1] / "src" / "persid_check"
PAGE = Path(__file__).with_name("trust-base.md")
HEAD = ["| | code | lines |", "|---|---|---|"]
OF_A_LEDGER = {
    "door, program, results, steps": "__init__ __main__ check identity results work",
    "reading: JSON, numbers, models, outputs, expressions": "entry expression json_text model outputs reading words",
    "functions: intervals, expansions, series at 0": "enclosure expansion taylor",
    "matrices and equilibria": "definite equilibrium exact flint_matrix",
    "the ledger: what it proves of the model and its plants": "ledger/__init__ ledger/assembly ledger/check ledger/file"
    " ledger/further ledger/lemmas ledger/theorem ledger/values",
    "the ledger: its sentences": "ledger/sentences",
    "the ledger: algebraic variables, identities (sections 11 and 12)": "ledger/algebraic ledger/identities",
}
OTHERS = {
    "digits of large matrices, with NumPy (without it FLINT multiplies them)": "digits large",
    "which model is meant, where a model.json is given: its canonical form": "canonical plain",
    "companions of ledgers, which NumPy reads": "companion ledger/arrays",
    "version 1, claims G, M, E and R (closed)": "version_1/* subject",
    "networks, with sparse models": "networks/* sparse",
    "refutations and obstructions": "refutations/*",
    "search, for files without partitions": "search/*",
}
LAYOUT = {tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT, tokenize.ENDMARKER}


def files(patterns: str) -> list[Path]:
    """Return the files that a row counts."""
    return [path for pattern in patterns.split() for path in sorted(CHECKER.glob(f"{pattern}.py"))]


def counted(path: Path) -> tuple[int, int]:
    """Return the lines of a file that are code, without blank lines, comments and docstrings, and all."""
    text = path.read_text("utf-8")
    tokens = [t for t in tokenize.generate_tokens(io.StringIO(text).readline) if t.type not in LAYOUT]
    lines = {line for token in tokens for line in range(token.start[0], token.end[0] + 1)}
    return len(lines - set(_docstrings(ast.parse(text)))), len(text.splitlines())


def _docstrings(tree: ast.Module) -> Iterator[int]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node, clean=False):
            yield from range(node.body[0].lineno, (node.body[0].end_lineno or 0) + 1)


def total(paths: Iterable[Path]) -> tuple[int, int]:
    """Return the sums of code and lines."""
    pairs = [counted(path) for path in paths]
    return sum(code for code, _ in pairs), sum(lines for _, lines in pairs)


def table() -> str:
    """Return the table in Markdown."""
    whole = [path for patterns in OF_A_LEDGER.values() for path in files(patterns)]
    rows = [(name, total(files(patterns))) for name, patterns in OF_A_LEDGER.items()]
    rows.append(("*of a ledger, all that it can claim*", total(whole)))
    rows += [(name, total(files(patterns))) for name, patterns in OTHERS.items()]
    return "\n".join([*HEAD, *(f"| {name} | {code:,} | {lines:,} |" for name, (code, lines) in rows)])


def renewed(page: str) -> str:
    """Return the page with the table as it is now."""
    before, _, rest = page.partition(HEAD[0])
    return before + table() + rest[rest.index("\n\n") :]


if __name__ == "__main__":
    PAGE.write_text(renewed(PAGE.read_text("utf-8")), "utf-8")
