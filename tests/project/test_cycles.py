"""Imports between the modules of persid, and of its checker, those inside functions and for types alone included."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import persid

SOURCE = Path(persid.__file__).parents[1]
OPEN = {"persid"}  # its names are loaded when they are asked for
MODULES = {
    ".".join(path.relative_to(SOURCE).with_suffix("").parts).removesuffix(".__init__"): path
    for package in ("persid", "persid_check")
    for path in sorted((SOURCE / package).rglob("*.py"))
}


def imported(module: str, tree: ast.AST) -> set[str]:
    """Return the modules of persid that a module imports, wherever it does so."""
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            inner = {f"{base}.{alias.name}" for alias in node.names}
            found |= inner if inner & set(MODULES) else {base}
    return found & set(MODULES) - {module}


def cycle(modules: dict[str, str]) -> list[str]:
    """Return a cycle among modules, given with their source text; an empty list where there is none."""
    graph = {name: imported(name, ast.parse(text)) for name, text in modules.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def test_no_module_imports_itself_by_way_of_others() -> None:
    """The imports of persid and its checker have no cycle, those inside functions and for types alone included."""
    texts = {name: path.read_text(encoding="utf-8") for name, path in MODULES.items() if name not in OPEN}
    assert cycle(texts) == []


def test_a_cycle_by_an_import_inside_a_function_is_found() -> None:
    """Two modules that import each other, one of them inside a function, are found."""
    texts = {
        "persid.models.model": "def f():\n    from persid.models.tables import of_model",
        "persid.models.tables": "from persid.models import model",
    }
    assert set(cycle(texts)) == set(texts)
