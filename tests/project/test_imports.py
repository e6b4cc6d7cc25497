"""Imports beyond what the contracts in pyproject.toml say: nothing else in the checker, and nothing heavy."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import persid as ps
from places import ROOT

SOURCE = Path(ps.__file__).parent
CHECKER = SOURCE.parent / "persid_check"
LIGHT = 60  # modules that `import persid` may load, those of the standard library among them


def roots(path: Path) -> set[str]:
    """Return the names of the packages that a file imports."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return {name.split(".")[0] for name in plain | {n.module for n in nodes if isinstance(n, ast.ImportFrom)} if name}


def test_checker_stands_alone() -> None:
    """The checker imports the standard library, python-flint and NumPy (a contract says where), and nothing else."""
    found = {name for path in CHECKER.glob("*.py") for name in roots(path)}
    assert found - set(sys.stdlib_module_names) == {"flint", "numpy", "persid_check"}


def test_checker_shares_public_names_only() -> None:
    """No module of the checker takes a private name from another one."""
    taken = {
        (path.stem, alias.name)
        for path in CHECKER.glob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("persid_check")
        for alias in node.names
    }
    assert {(stem, name) for stem, name in taken if name.startswith("_")} == set()


def test_checker_loads_numpy_for_large_networks_only() -> None:
    """Importing the checker, or its reader of models, does not load NumPy."""
    code = "import sys, persid_check.__main__; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], cwd=SOURCE.parent, check=False).returncode == 0


def test_import_is_light() -> None:
    """Importing persid loads a few modules, and none of NumPy, SciPy, pandas and matplotlib."""
    code = (
        "import sys; before = set(sys.modules); import persid; new = set(sys.modules) - before;"
        "heavy = {'numpy', 'scipy', 'pandas', 'matplotlib', 'sklearn', 'click'} & new; print(len(new), *heavy)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=SOURCE.parent, check=True)
    count, *heavy = done.stdout.split()
    assert heavy == []
    assert int(count) < LIGHT


def test_small_models_need_little_of_scipy() -> None:
    """To certify a model of two states and two functions loads linear algebra, and no solvers, hulls or integrators."""
    code = (
        "import sys, persid as ps; model = ps.PersidskiiModel([[-2.0, 0.3], [0.1, -1.5]], [('tanh(x)', None,"
        "[[-1.0, 0.2], [0.3, -0.8]]), ('sin(x)', None, [[-0.3, 0.1], [0.05, -0.4]])], [[1.0], [0.5]]);"
        "assert ps.certify(model).is_certified;"
        "print(*{'scipy.optimize', 'scipy.spatial', 'scipy.integrate', 'scipy.special', 'scipy.sparse.csgraph'}"
        " & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=SOURCE.parent, check=True)
    assert done.stdout.split() == []


def test_command_line_starts_without_the_mathematics() -> None:
    """Help texts appear without loading NumPy."""
    code = "import sys, persid.commands.cli; sys.exit(persid.commands.cli.main(['--help']) or 'numpy' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=SOURCE.parent, check=False)
    assert done.returncode == 0, done.stderr
    assert "identify" in done.stdout


@pytest.mark.parametrize("name", ps.__all__)
def test_public_names_exist(name: str) -> None:
    """Every public name can be had, and is listed."""
    assert getattr(ps, name) is not None
    assert name in dir(ps)


def test_unknown_names_are_refused() -> None:
    """A name that persid does not have is an AttributeError that says so."""
    with pytest.raises(AttributeError, match="no attribute 'nonsense'"):
        _ = ps.nonsense


def test_oldest_requirements_are_those_of_the_project() -> None:
    """The constraints of the job with the oldest requirements are the lower bounds in pyproject.toml."""
    done = subprocess.run(
        [sys.executable, ROOT / ".ci" / "lower_bounds.py"], capture_output=True, text=True, check=True
    )
    assert done.stdout == (ROOT / ".ci" / "oldest.txt").read_text("utf-8"), "run .ci/lower_bounds.py > .ci/oldest.txt"
