"""Kept certificates are accepted, and every falsehood is refused in the way that is due."""

import os
import shutil
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import pytest

from checker import named
from checker.falsehoods import FALSEHOODS
from checker.maker import Wanted, data, dyadic, file, make, model
from persid_check import Accepted, Rejected, check, model_sha256
from places import ROOT

SOURCES = ROOT / "src"


@pytest.mark.parametrize("name", sorted(named.MAKERS))
def test_a_valid_certificate_is_accepted_and_explained(name: str) -> None:
    """Every kept valid certificate is accepted, with a statement and numbered steps."""
    result = check(named.VALID / f"{name}.json")
    assert isinstance(result, Accepted), result
    assert result.steps[0].startswith("1. ")
    assert model_sha256(named.load(name)["model"]) in result.statement


@pytest.mark.parametrize("falsehood", FALSEHOODS, ids=lambda falsehood: falsehood.name)
def test_a_falsehood_is_refused(falsehood) -> None:
    """A file with one false entry is rejected or malformed, as its row says, with a place and a reason."""
    result = check(falsehood.content())
    assert type(result).__name__ == falsehood.expected, (falsehood.why, result)
    assert result.where
    assert result.why


def test_there_are_at_least_sixty_kinds_of_falsehood() -> None:
    """The table holds more than sixty falsehoods with different names."""
    assert len({falsehood.name for falsehood in FALSEHOODS}) == len(FALSEHOODS) >= 60


def test_certified_at_one_input_is_not_certified_at_every_input() -> None:
    """x' = -(x^3 - 3 x^2 + 2.5 x) + u is certified at u* = 0 only: at u = 0.55 there are three equilibria."""
    cubic = model([("x**3-3*x**2+2.5*x", None, [[-1]])])
    result = check(data(make(Wanted(cubic, [[(1, 0), (0, 1), (Fraction(-3, 16), 1)]]))))
    assert isinstance(result, Accepted), result
    assert "every equilibrium" not in result.statement


def test_nothing_certifies_crossed_relus() -> None:
    """x1' = -x1 - 2 relu(x2) + u1 and its mirror image, unstable at (1, 1) for u = (3, 3), get no certificate."""
    crossed = model([("relu(x)", None, [[0, -2], [-2, 0]])], [[-1, 0], [0, -1]], [[1, 0], [0, 1]], n=2)
    forms = [(1, 0), (0, 1), (1, -1)]
    for full in (False, True):
        assert isinstance(check(data(make(Wanted(crossed, [forms, forms], full=full)))), Rejected)


def test_another_model_is_noticed(tmp_path: Path) -> None:
    """With --model, a certificate of another model is rejected."""
    other = tmp_path / "model.json"
    other.write_bytes(data(model([("x**3", None, [[-1]])], [[-1.5]], b=[2.0])))
    same = tmp_path / "same.json"
    same.write_bytes(data(named.OFFSET))
    assert isinstance(check(named.VALID / "g_ball.json", other), Rejected)
    assert isinstance(check(named.VALID / "g_ball.json", same), Accepted)


def _identity(size: int) -> list[list[int]]:
    return [[int(i == j) for j in range(i + 1)] for i in range(size)]


def test_infeasible_speaks_of_no_density_but_the_forms_in_the_file() -> None:
    """Diagonal P alone fails and diagonal P with the density y of the row (1, 1) succeeds: both are told apart."""
    sheared = model([("tanh(x)", [[1, 1]], [[0], [0]])], [[0.125, 1], [-1, -1]], n=2)
    without = file(
        sheared, "infeasible", family="diagonal", groups=[{"forms": []}], L=[[-2, 6], [1, 0], [0, 0]], proof={}
    )
    result = check(data(without))
    assert isinstance(result, Accepted), result
    assert "Lyapunov densities of the 0 forms in the file and with in-group products of these forms and y" in (
        result.statement
    )
    assert isinstance(check(data(make(Wanted(sheared, [[(1, 0)]], dropped=(2,))))), Accepted)


def test_a_box_is_not_stated_larger_than_it_is() -> None:
    """Sides that are rounded or left out of the sentence are marked: the claim holds in the file's box only."""
    n, half = 13, dyadic(1 - Fraction(1, 2**30))
    decay = model([], [[-float(i == j) for j in range(n)] for i in range(n)], [[0.0]] * n, n=n)
    regional = file(
        decay, "R", operating_point=None, P={"diagonal": [[1, 0]] * n}, groups=[], dropped=[], gamma=[1, 0],
        kappa=[1, 0], p=[1, -1], box=[[[-half[0], half[1]], half]] * n, level=[1, -1], input_bound=[1, -1],
        proof={"P": _identity(n), "Q": _identity(n + 1)},
    )  # fmt: skip
    result = check(data(regional))
    assert isinstance(result, Accepted), result
    assert "[~-1.00000, ~0.999999], ... (13 sides) with" in result.statement


def _unstable(function: str, name: str = "x1") -> bytes:
    growing = model([(function, None, [[1]])]) | {"states": [name]}
    witness = {
        "kind": "unstable-equilibrium", "point": {"x": [[0, 0]], "radius": [0, 0]}, "S": [[[1, 0]]],
        "sigma": [0, 0], "direction": [[1, 0]], "T": [[1]],
    }  # fmt: skip
    return data(file(growing, "refuted", u=[[0, 0]], witness=witness))


def test_names_in_a_sentence_are_quoted() -> None:
    """A state may be named like a claim; within quotation marks it cannot be taken for one."""
    name = "x (1) is globally input-to-state stable. The model with state y"
    result = check(_unstable("sinh(x)", name))
    assert isinstance(result, Accepted), result
    assert result.statement.startswith(f"The model with state {name!r} (1), 1 input and")


def test_a_jacobian_of_immense_numbers_is_refused_at_once() -> None:
    """A slope of 2^(64^6) at 0 is not written out as an integer."""
    immense = "x*(" + "(" * 6 + "2" + "**64)" * 6 + ")"
    assert isinstance(check(_unstable(immense)), Rejected)


def _run(arguments: list[str], *options: str) -> subprocess.CompletedProcess[str]:
    """The checker in a process where NumPy and persid cannot be imported."""
    block = "import sys; sys.modules.update(dict.fromkeys(['numpy', 'scipy', 'persid', 'cvxpy']));"
    code = f"{block} sys.argv[1:] = {arguments!r}; from persid_check.__main__ import main; sys.exit(main())"
    environment = {**os.environ, "PYTHONPATH": str(SOURCES)}
    return subprocess.run([sys.executable, *options, "-c", code], env=environment, capture_output=True, text=True)


@pytest.mark.parametrize("options", [(), ("-O",), ("-OO",)])
def test_exit_codes_alone_and_optimized(tmp_path: Path, options: tuple[str, ...]) -> None:
    """Alone, and with python -O, the program exits 0 for accepted, 5 for rejected, 2 for malformed or missing files."""
    outcomes = {falsehood.name: falsehood for falsehood in FALSEHOODS}
    rejected, malformed = tmp_path / "rejected.json", tmp_path / "malformed.json"
    rejected.write_bytes(outcomes["negative_mu"].content())
    malformed.write_bytes(outcomes["float_mantissa"].content())
    accepted = _run([str(named.VALID / "g_mixed_pair.json"), "--explain"], *options)
    assert (accepted.returncode, accepted.stderr) == (0, "")
    assert "accepted, claim iss" in accepted.stdout
    assert _run([str(rejected)], *options).returncode == 5
    assert _run([str(malformed)], *options).returncode == 2
    assert _run([str(tmp_path / "absent.json")], *options).returncode == 2


@pytest.mark.parametrize("path", sorted(named.VALID.glob("*.json")), ids=lambda path: path.stem)
def test_exit_codes_say_what_is_proved(path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The program and persid check exit alike: 0 proved stable, 1 not stable, 3 only that no certificate exists."""
    from persid.commands.cli import main as persid
    from persid_check.__main__ import main as program

    proved = {"infeasible": 3, "refuted": 1}.get(path.stem.split("_")[0], 0)
    assert program([str(path)]) == proved
    assert persid(["check", str(path)]) == proved


def test_the_program_alone_needs_the_file_and_flint(tmp_path: Path) -> None:
    """A folder with persid_check and python-flint, and no other package, checks a certificate."""
    import flint

    shutil.copytree(SOURCES / "persid_check", tmp_path / "persid_check")
    for folder in (Path(flint.__file__).parent, Path(flint.__file__).parents[1] / "python_flint.libs"):
        if folder.is_dir():
            (tmp_path / folder.name).symlink_to(folder)
    program = [sys.executable, "-S", "-m", "persid_check", str(named.VALID / "e_mixed_pair.json")]
    done = subprocess.run(program, cwd=tmp_path, env={"PYTHONPATH": str(tmp_path)}, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert "accepted, claim rate-and-gain" in done.stdout


@pytest.mark.parametrize(
    ("error", "code"), [(KeyboardInterrupt(), 130), (RuntimeError("x"), 4), (OSError(5, "I/O"), 2)]
)
def test_the_program_never_ends_by_a_traceback(error, code, monkeypatch, capsys) -> None:
    """Whatever happens, the program ends with a code of the contract: never with the 1 that an exception would give."""
    import persid_check.__main__ as program

    def fail(*given):
        raise error

    monkeypatch.setattr(program, "check", fail)
    assert program.main(["any.json"]) == code
    assert "Traceback" not in capsys.readouterr().err


def test_the_sources_hold_no_assertion_and_no_evaluation() -> None:
    """The checker's source has no assert, eval, exec or pickle, and imports only flint and the standard library.

    Modules of claim L1 import NumPy, within functions alone, to read large arrays; `digits`, which holds large
    matrices, is itself imported only then.
    """
    import ast

    allowed = {*sys.stdlib_module_names, "flint", "persid_check"} - {"pickle", "marshal"}
    for path in sorted((SOURCES / "persid_check").rglob("*.py")):
        tree = ast.parse(path.read_text())
        here = allowed | (
            {"numpy"} if path.stem in {"companion", "certificate", "claims", "digits", "sparse", "table"} else set()
        )
        heads = [ast.dump(node) for node in tree.body if isinstance(node, ast.Import | ast.ImportFrom)]
        assert not any("numpy" in head or "'digits'" in head for head in heads) or path.stem == "digits", path
        for node in ast.walk(tree):
            assert not isinstance(node, ast.Assert), path
            if isinstance(node, ast.Name):
                assert node.id not in {"eval", "exec", "compile", "__import__"}, path
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert {name.split(".")[0] for name in names} <= here, path
