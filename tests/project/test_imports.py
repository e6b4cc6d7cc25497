"""Imports: they go one way, the checker stands alone, and `import persid` costs nothing."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import persid as ps

SOURCE = Path(ps.__file__).parent
CHECKER = SOURCE.parent / "persid_check"

# A module may import what stands before it; modules of one line do not import each other.
ORDER = """
errors files extras threads
functions trajectories
drift
readers integrate algebra moments distributed
chunks
recordings
surveys samples
labelled compiled columns
model
equations mathml basis sindy
structure freerun
gram
derivatives weak koopman validation refine
fitting diagnostics
identify
baselines
bounds
certificate bilinear pairs
iterate
sector equilibrium interior_point barrier
evidence
system integrals descent
lmi
network
network_proof
search proof witness
obstruction setting rates frame
polish
starts candidates
certify comparison
constrained
checking summary folder
batches
tables
plots
drawings
portraits
report interop
talk options signals
outcomes
studies
fit_commands proof_commands result_commands
cli
"""
DEFERRED = {  # a method asks the module when it is called
    ("trajectories", "readers"),
    ("trajectories", "labelled"),
    ("model", "interop"),
    ("model", "tables"),
    ("certificate", "tables"),
    ("certificate", "network_proof"),
    ("network_proof", "tables"),
    ("certify", "tables"),
}
OUTSIDE = {"__init__", "__main__"}


def imported(path: Path, package: str) -> set[str]:
    """Return the modules of a package that a file imports, anywhere but under TYPE_CHECKING."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    hidden = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and getattr(node.test, "id", "") == "TYPE_CHECKING"
        for inner in ast.walk(node)
    }
    found = set()
    for node in ast.walk(tree):
        if id(node) in hidden:
            continue
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module == package:
            found |= {f"{package}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
    return {name.split(".")[1] if "." in name else name for name in found if name.split(".")[0] == package}


def roots(path: Path) -> set[str]:
    """Return the names of the packages that a file imports."""
    nodes = list(ast.walk(ast.parse(path.read_text(encoding="utf-8"))))
    plain = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    return {name.split(".")[0] for name in plain | {n.module for n in nodes if isinstance(n, ast.ImportFrom)} if name}


def test_checker_stands_alone() -> None:
    """The checker imports the standard library and python-flint, and NumPy in the four modules of large networks."""
    found = {(path.stem, name) for path in CHECKER.glob("*.py") for name in roots(path)}
    outside = {(stem, name) for stem, name in found if name not in {*sys.stdlib_module_names, "flint", "persid_check"}}
    assert outside == {(stem, "numpy") for stem in ("companion", "network", "sparse", "table")}


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
    """Importing persid takes well under half a second and loads neither NumPy, SciPy, pandas nor matplotlib."""
    code = (
        "import sys, time; t = time.perf_counter(); import persid; s = time.perf_counter() - t;"
        "heavy = {'numpy', 'scipy', 'pandas', 'matplotlib', 'sklearn', 'click'} & set(sys.modules);"
        "print(heavy or ''); sys.exit(s > 0.5)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=SOURCE.parent, check=False)
    assert (done.stdout.strip(), done.returncode) == ("", 0)


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
