"""Verdicts on named models, on badly scaled ones, and on models that no certificate may exist for."""

import importlib
import sys
from collections.abc import Iterator

import numpy as np
import pytest

from persid.certificates.certificate import Certificate
from persid.lyapunov.interior_point import Status
from persid.lyapunov.pairs import pairings
from persid.lyapunov.search import search
from persid.lyapunov.shifted_model import Setting
from persid.models.model import PersidskiiModel
from places import SHARED
from problems import BY_NAME, PROBLEMS, Problem

certify_module = importlib.import_module("persid.verdicts.certify")
questions = importlib.import_module("persid.verdicts.questions")


@pytest.fixture(autouse=True)
def without_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    """The verdict alone is tested here; rate and gain take most of the time."""
    monkeypatch.setattr(questions, "RATED_STATES", 0)


def verdict(model: PersidskiiModel) -> str:
    """Return the verdict as a word; what is certified or refuted has passed the checker."""
    return type(certify_module.certify(model, time_limit=60.0)).__name__.lower()


@pytest.mark.parametrize("problem", PROBLEMS, ids=lambda problem: problem.name)
@pytest.mark.long
def test_named_model(problem: Problem) -> None:
    """Every named model gets its verdict."""
    assert verdict(problem.build()) == problem.verdict, problem.why


def test_forty_models_are_named() -> None:
    """The file of problems holds at least forty models, each under its own name and with all three verdicts."""
    assert len({problem.name for problem in PROBLEMS}) == len(PROBLEMS) >= 40
    assert {problem.verdict for problem in PROBLEMS} == {"certified", "refuted", "undecided"}


def rescaled(model: PersidskiiModel, seconds: float, units: np.ndarray) -> PersidskiiModel:
    """Return the same system with time in units of `seconds` and state i in units of `units[i]`."""
    terms = []
    for term in model.terms:
        R = np.eye(model.n) if term.R is None else term.R
        terms.append(([f.text for f in term.f], R * units, seconds * term.A / units[:, None]))
    A0 = seconds * model.A0 / units[:, None] * units
    return PersidskiiModel(A0, terms, seconds * model.B / units[:, None])


def magnified(model: PersidskiiModel, factor: float) -> PersidskiiModel:
    """Return the same system with every function multiplied by a factor and its columns divided by it."""
    terms = [([f"{factor!r}*({f.text})" for f in term.f], term.R, term.A / factor) for term in model.terms]
    return PersidskiiModel(model.A0, terms, model.B)


PAIR = PersidskiiModel(
    [[-1.0, 0.5], [-0.4, -1.5]],
    [("tanh(x)", None, [[0.5, 0.3], [0.2, 0.4]]), ("x**3", None, [[-1.0, 0.2], [0.3, -1.0]])],
    [[1.0], [0.5]],
)
UNSTABLE = PersidskiiModel([[0.3, 1.0], [-1.0, 0.1]], [("tanh(x)", None, [[-0.1, 0.0], [0.0, -0.1]])], [[1.0], [0.0]])
BOTH = [(PAIR, "certified"), (UNSTABLE, "refuted")]


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "expected"), [(PAIR, "certified"), (UNSTABLE, "refuted")], ids=["stable", "unstable"]
)
@pytest.mark.parametrize("factor", [1e-6, 1e3, 1e6])
def test_scaled_functions(model: PersidskiiModel, expected: str, factor: float) -> None:
    """Functions a million times larger or smaller, with columns to match, change no verdict."""
    assert verdict(magnified(model, factor)) == expected


@pytest.mark.parametrize(
    ("model", "expected"), [(PAIR, "certified"), (UNSTABLE, "refuted")], ids=["stable", "unstable"]
)
@pytest.mark.parametrize("seconds", [1e-3, 3600.0])
def test_units_of_time(model: PersidskiiModel, expected: str, seconds: float) -> None:
    """Time in milliseconds or hours changes no verdict."""
    assert verdict(rescaled(model, seconds, np.ones(2))) == expected


@pytest.mark.long
@pytest.mark.parametrize(
    ("model", "expected"), [(PAIR, "certified"), (UNSTABLE, "refuted")], ids=["stable", "unstable"]
)
@pytest.mark.filterwarnings("ignore:Input .a. has an eigenvalue pair:RuntimeWarning")
@pytest.mark.parametrize("units", [(1e-3, 1e3), (1e3, 1.0), (1e-3, 1e-3)])
def test_units_of_states(model: PersidskiiModel, expected: str, units: tuple[float, float]) -> None:
    """States in units of a thousandth or a thousand, rows to match, change no verdict."""
    assert verdict(rescaled(model, 1.0, np.array(units))) == expected


def infeasible_models() -> Iterator[PersidskiiModel]:
    """Yield models of the shared families that are not ISS."""
    if not (SHARED / "families.py").is_file():
        pytest.skip("families.py of the shared data is not on this machine")
    sys.path.insert(0, str(SHARED))
    import families

    for family in ("unstable_origin", "saturated", "cooperative_bistable"):
        for n in (1, 3):
            for _, _, data in families.draw(family, n, 1, 1):
                yield PersidskiiModel.from_dict(data)


def test_infeasible_models_are_never_candidates() -> None:
    """On models that are not ISS the search ends with a verified dual matrix or stalls, never with a candidate."""
    for model in infeasible_models():
        for full_P in (False, True):
            setting = Setting.of(model, None)
            found = search(setting.system, setting.pools, full_P=full_P)
            if len(setting.system.states) < model.n:  # claim M also asks for unbounded functions: the checker says so
                assert certify_module.certify(model).__class__.__name__ != "Certified"
                continue
            assert found.status in (Status.INFEASIBLE, Status.STALLED)
            if found.status is Status.INFEASIBLE:
                problem, solution = found.assembly.problem, found.solution
                slack = (pairings(problem, solution.X) + solution.upper * problem.cost)[problem.free :]
                assert solution.upper < 0
                assert np.linalg.eigvalsh(solution.X)[0] > 0
                assert (slack >= -1e-9 * np.trace(solution.X)).all()


def test_rejected_certificate_is_no_verdict(monkeypatch: pytest.MonkeyPatch) -> None:
    """When the checker rejects a file the verdict says so and is not Certified."""
    from persid.errors import RejectedError

    def refuse(data: bytes) -> Certificate:
        raise RejectedError("the checker does not accept it: Q: not positive definite")

    monkeypatch.setattr(Certificate, "accept", refuse)
    monkeypatch.setattr(questions, "certify_network", lambda *question: None)
    answer = certify_module.certify(BY_NAME["linear"].build(), time_limit=60.0)
    assert not answer.is_certified
    assert "does not accept" in str(answer)
