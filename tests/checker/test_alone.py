"""The checker's folder with python-flint is a program of its own, fit to be sent with a certificate."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import flint
import pytest

from checker import known_ledgers, named
from checker.ledgers import data
from persid_check import Accepted, check
from persid_check.__main__ import exit_code
from places import ROOT, VALID

RUN = "import runpy, sys; sys.path.insert(0, sys.argv.pop(1)); runpy.run_module('persid_check', run_name='__main__')"


@pytest.fixture(scope="module")
def alone(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a copy of the checker and of python-flint, and nothing else."""
    folder = tmp_path_factory.mktemp("alone")
    shutil.copytree(
        ROOT / "src" / "persid_check", folder / "persid_check", ignore=shutil.ignore_patterns("__pycache__")
    )
    library = Path(flint.__file__).parent
    shutil.copytree(library, folder / "flint", ignore=shutil.ignore_patterns("__pycache__", "test"))
    for shared in library.parent.glob("python_flint.libs"):
        shutil.copytree(shared, folder / shared.name)
    return folder


def _run(folder: Path, file: Path, *options: str) -> subprocess.CompletedProcess[str]:
    """Run the copy in an interpreter without site-packages and without the environment's paths."""
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    command = [sys.executable, "-I", "-S", "-c", RUN, str(folder), str(file), *options]
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


@pytest.mark.parametrize("name", ["spring", "region", "plant", "practical"])
def test_the_checker_alone_accepts_and_explains_a_ledger(name: str, alone: Path, tmp_path: Path) -> None:
    """Without persid, NumPy or any other package, the checker accepts a ledger and prints its steps in order."""
    file = tmp_path / "certificate.json"
    file.write_bytes(data(known_ledgers.load(name)))
    done = _run(alone, file, "--explain")
    assert done.returncode == (3 if name == "practical" else 0), done.stderr
    assert done.stdout.startswith("accepted")
    assert "\n1. The hash agrees" in done.stdout
    assert done.stdout.rstrip().splitlines()[-1].startswith("7. ")


@pytest.mark.parametrize(
    "path", sorted((ROOT / "tests" / "files" / "ledgers").glob("*.json")), ids=lambda path: path.stem
)
def test_kept_ledgers_stay_accepted(path: Path) -> None:
    """Ledgers that were written once are accepted, whatever has been added to the format since."""
    assert isinstance(check(path), Accepted)


OTHERS = (
    "version_1", "networks", "refutations", "search", "subject.py", "sparse.py", "companion.py", "digits.py",
    "large.py", "canonical.py", "ledger/arrays.py",
)  # fmt: skip


def test_a_ledger_is_checked_without_the_other_rooms(alone: Path, tmp_path: Path) -> None:
    """What reads version 1, networks and refutations, and what searches, may be deleted: ledgers are checked alike."""
    shutil.copytree(alone, tmp_path / "less")
    for name in OTHERS:
        path = tmp_path / "less" / "persid_check" / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    for name in ("spring", "outputs", "region", "practical"):
        file = tmp_path / f"{name}.json"
        file.write_bytes(data(known_ledgers.load(name)))
        done, whole = (_run(folder, file, "--explain") for folder in (tmp_path / "less", alone))
        assert done.stdout.startswith("accepted"), done.stderr
        assert done.stdout == whole.stdout


def test_the_checker_alone_accepts_files_of_version_1(alone: Path) -> None:
    """Kept files of format 1 are accepted by the same program."""
    for name in sorted(named.MAKERS)[:6]:
        assert _run(alone, VALID / f"{name}.json").returncode == 0, name


def test_practical_stability_ends_with_a_code_of_its_own() -> None:
    """What is practically stable is accepted, and not reported as stable by the exit code."""
    assert exit_code(check(data(known_ledgers.load("practical")))) == 3
    assert exit_code(check(data(known_ledgers.load("spring")))) == 0


def test_the_checker_alone_refuses_a_changed_ledger(alone: Path, tmp_path: Path) -> None:
    """A changed number is rejected with a place and a reason, on standard output, with an exit code of its own."""
    content = known_ledgers.load("spring") | {"kappa": [1, 0]}
    file = tmp_path / "certificate.json"
    file.write_bytes(data(content))
    done = _run(alone, file)
    assert done.returncode not in (0, 2)
    assert "rejected: " in done.stdout
    assert not done.stderr
