"""Verdicts: what is asked, what comes out, and what must never come out."""

import itertools
import time
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

import persid as ps
from adversaries import policies, runs
from persid.lyapunov.inequality import assemble
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import Family
from persid.verdicts.verdict import Reason
from problems import BY_NAME
from questions import ASKED, PENDULUM, Case

QUICK = settings(
    max_examples=4,
    deadline=None,
    derandomize=True,
    phases=[Phase.generate],  # no shrinking: a counterexample is a model, readable as it is
    suppress_health_check=list(HealthCheck),
)
LONG = ("pendulum, |x1| <= 3.1", "pendulum, |x1| <= 2", "double well, right half")
WARNS = pytest.mark.filterwarnings("ignore:divide by zero")


def scalar(a: float = 0.0, b: float = 0.0, B: float = 1.0, **terms: float) -> ps.PersidskiiModel:
    """x' = a x + sum coefficient f(x) + B u + b; f named by the keyword."""
    return ps.PersidskiiModel([[a]], [(f"{f}(x)", None, [[c]]) for f, c in terms.items()], [[B]], [b])


@WARNS
@pytest.mark.parametrize(
    "case",
    [pytest.param(case, marks=pytest.mark.long if case.name in LONG else ()) for case in ASKED],
    ids=lambda case: case.name,
)
def test_questions(case: Case) -> None:
    """Each question about a point, an input or a region gets its verdict."""
    verdict = ps.certify(ps.PersidskiiModel(**case.model), time_limit=30.0, **case.question)
    assert type(verdict).__name__.lower() == case.expected, f"{case.why} {verdict}"


# Tempting rules that are false


def test_equilibria_at_another_input_refute_nothing() -> None:
    """x' = -(x^3 - 3x^2 + 2.5x) + u has three equilibria at u = 0.55 and is certified at u = 0, and there only."""
    model = ps.PersidskiiModel([[-2.5]], [("x**3-3*x**2", None, [[-1.0]])], [[1.0]])
    assert len(ps.find_operating_point(model, [0.55])) == 3
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Certified)
    assert "every equilibrium" not in verdict.certificate.statement
    assert isinstance(ps.certify(model, u_op=[0.55]), ps.Refuted)


def test_dead_zone_is_certified_only_where_it_pulls() -> None:
    """A dead zone is refuted at u = 0, where it rests on an interval, and certified about 1.5, but not everywhere."""
    assert isinstance(ps.certify(scalar(deadzone=-1.0)), ps.Refuted)
    verdict = ps.certify(scalar(deadzone=-1.0), u_op=[0.5])
    assert isinstance(verdict, ps.Certified)
    assert "every equilibrium" not in verdict.certificate.statement


@pytest.mark.parametrize("f", ["tanh", "arctan", "erf", "sat"])
def test_bounded_functions_alone_are_refuted(f: str) -> None:
    """A bounded restoring force is no match for a large constant input."""
    verdict = ps.certify(scalar(**{f: -2.0}))
    assert isinstance(verdict, ps.Refuted)
    assert verdict.witness.kind == "marginal-direction"


def test_direction_that_no_input_reaches() -> None:
    """With w'B = 0 a direction without linear restoring force refutes nothing."""
    verdict = ps.certify(scalar(tanh=-1.0, B=0.0))
    assert not isinstance(verdict, ps.Refuted)


def test_named_state_away_from_rest() -> None:
    """x' = -x + 2 is judged about its equilibrium 2, also where the state 1 is named."""
    verdict = ps.certify(scalar(-1.0, 2.0), operating_point=[1.0])
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.operating_point == pytest.approx([2.0])


def test_no_equilibrium_no_certificate() -> None:
    """A constant force that the function cannot balance leaves no point to speak of: never certified about x_ref."""
    model = ps.PersidskiiModel([[0.0]], [("(x-1)**3+1", None, [[-1.0]])], [[1.0]])
    verdict = ps.certify(model, u_op=[1.0])  # at rest at 1, where the slope is 0: it cannot be proved in a ball
    if isinstance(verdict, ps.Certified):
        assert verdict.certificate.operating_point == pytest.approx([1.0])
    assert not isinstance(verdict, ps.Refuted)
    cut = ps.PersidskiiModel([[0.0]], [("(x-1)**3*(x-2)**2+4", None, [[-1.0]])], [[1.0]], [4.0])
    assert not ps.certify(cut).is_certified  # it rests at 1 and at 2


def test_cross_products_of_different_rows() -> None:
    """x1' = -x1 - 2 relu(x2) + u1 and its mirror image are unstable at u = (3, 3): never certified for all inputs."""
    A = [[0.0, -2.0], [-2.0, 0.0]]
    at_zero = ps.PersidskiiModel(-np.eye(2), [("relu(x)", None, A)], np.eye(2))
    verdict = ps.certify(at_zero, u_op=[3.0, 3.0])
    assert isinstance(verdict, ps.Refuted)


def test_function_without_effect() -> None:
    """A function whose coefficients are all zero neither helps nor hurts, and the model keeps its rate."""
    verdict = ps.certify(scalar(-1.0, tanh=0.0, sinh=0.0))
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.rate == pytest.approx(0.5, rel=0.05)


# The verdict as a value


def test_verdict_is_no_truth_value() -> None:
    """Asking whether a verdict is true is an error, since a refuted model would count as true."""
    verdict = ps.certify(scalar(1.0))
    with pytest.raises(TypeError, match="is_certified"):
        bool(verdict)
    assert not verdict.is_certified
    assert verdict.seconds > 0
    assert [attempt.what for attempt in verdict.attempts][-1] == "witnesses against stability"


@pytest.mark.parametrize(
    "question",
    [
        {"u_op": [1.0, 2.0]},
        {"u_op": [np.nan]},
        {"u_op": "zero"},
        {"operating_point": "origin"},
        {"operating_point": [0.0, 0.0]},
        {"operating_point": [np.inf]},
        {"domain": "box"},
        {"domain": "data"},
        {"domain": [[1.0, 0.0]]},
        {"domain": [[-np.inf, np.inf]]},
        {"domain": [[0.0, np.nan]]},
        {"domain": [0.0, 1.0]},
        {"domain": 3},
        {"domain": [["a", "b"]]},
        {"time_limit": -1.0},
        {"time_limit": np.nan},
    ],
    ids=str,
)
def test_wrong_questions(question: dict[str, Any]) -> None:
    """A question that does not fit the model is a mistake of the caller and raises."""
    with pytest.raises(ps.ModelError):
        ps.certify(scalar(-1.0), **question)


# Time and interruption


def hard() -> ps.PersidskiiModel:
    """Six coupled states with four functions each: minutes of work."""
    rng = np.random.default_rng(3)
    n = 6
    names = ("x**3", "sinh(x)", "tanh(x)", "x*abs(x)")
    terms = [(f, None, 0.15 * rng.normal(size=(n, n)) - 0.5 * np.eye(n)) for f in names]
    return ps.PersidskiiModel(rng.normal(size=(n, n)) - 4 * np.eye(n), terms, np.eye(n), domain=[[-3.0, 3.0]] * n)


@pytest.mark.long
def test_time_limit() -> None:
    """A hard question stops soon after its time limit, with a reason or with what was reached."""
    started = time.perf_counter()  # which counts looks at the clock, see conftest
    verdict = ps.certify(hard(), time_limit=0.5)
    assert time.perf_counter() - started < 1.5
    if isinstance(verdict, ps.Undecided):
        assert verdict.reason is Reason.TIME


def test_no_time() -> None:
    """Without time even an easy model stays undecided, unless a witness is at hand."""
    assert ps.certify(scalar(-1.0), time_limit=0.0).reason is Reason.TIME  # type: ignore[union-attr]
    assert isinstance(ps.certify(scalar(1.0), time_limit=0.0), ps.Refuted)


@pytest.mark.parametrize("after", [1, 2, 3, 5, 8])
def test_interruption(after: int) -> None:
    """Ctrl-C at any line of progress gives a verdict: the best so far, or undecided because of it."""
    lines = itertools.count(1)

    def progress(line: str) -> None:
        if next(lines) == after:
            raise KeyboardInterrupt

    model = ps.PersidskiiModel([[-3.0, 1.0], [0.0, -3.0]], [("tanh(x)", None, np.eye(2))], [[1.0], [1.0]])
    verdict = ps.certify(model, progress=progress)
    if isinstance(verdict, ps.Undecided):
        assert verdict.reason is Reason.INTERRUPTED
        assert verdict.attempts[-1].outcome == "interrupted"
    else:
        assert verdict.is_certified
        assert after > 3


def test_interrupted_rate_keeps_the_certificate() -> None:
    """Ctrl-C while the rate is sought leaves the certificate without a rate."""

    def progress(line: str) -> None:
        if line == "rate and gain":
            raise KeyboardInterrupt

    verdict = ps.certify(scalar(-1.0), progress=progress)
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.claim == "iss"
    assert verdict.attempts[-1].outcome == "interrupted"


# Theorems about random models


@pytest.fixture(scope="module")
def without_rates() -> Iterator[None]:
    """Leave out rate and gain, which take most of the time."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(import_module("persid.verdicts.questions"), "RATED_STATES", 0)
        yield


ENTRY = st.integers(-8, 8)
PLANAR = st.tuples(
    st.lists(ENTRY, min_size=9, max_size=9),
    st.sampled_from(["tanh(x)", "x**3", "sinh(x)", "arctan(x)", "softsign(x)"]),
    st.integers(0, 1),
)


def planar(drawn: tuple[list[int], str, int]) -> ps.PersidskiiModel:
    """Return a two-state model, stable about as often as not."""
    numbers, f, damping = np.array(drawn[0]) / 4, drawn[1], drawn[2]
    A0, A = numbers[:4].reshape(2, 2) - 1.5 * np.eye(2), numbers[4:8].reshape(2, 2) / 2 - damping * np.eye(2)
    return ps.PersidskiiModel(A0, [(f, None, A)], [[1.0], [numbers[8]]])


@pytest.mark.long
@QUICK
@given(PLANAR)
def test_what_is_certified_is_accepted_and_decreases(tmp_path_factory: pytest.TempPathFactory, drawn: Any) -> None:
    """A certificate is accepted again from its file, reads back byte for byte, and V never increases at u = u*."""
    model = planar(drawn)
    verdict = ps.certify(model, time_limit=6.0)
    if not isinstance(verdict, ps.Certified):
        return
    path = tmp_path_factory.mktemp("certificate") / "c.json"
    verdict.certificate.save(path)
    assert isinstance(ps.check(path, model), ps.Accepted)
    assert ps.load_certificate(path).data == verdict.certificate.data == path.read_bytes()
    angles = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    starts = 2 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    _, x = runs(model, model.u_ref, starts, lambda t, x: np.zeros((len(x), 1)), 4.0, 800)
    V = np.array([verdict.certificate.V(states) for states in x])
    assert (np.diff(V, axis=0) <= 1e-9 * V[0]).all()


@pytest.mark.long
@QUICK
@given(PLANAR)
def test_no_model_is_both(without_rates: None, drawn: Any) -> None:
    """A model with a witness is never certified, and one that is certified has no witness."""
    from persid.certificates.witness import find_witness
    from persid.verdicts.log import Log
    from persid.verdicts.questions import Question, _global

    model = planar(drawn)
    points = ps.find_operating_point(model)
    witness = find_witness(model, model.u_ref, points)
    log = Log(time.perf_counter() + 6, lambda line: None)
    found = _global(Question(model, None, model.u_ref, None, each=False, rate=None), points, log)
    assert isinstance(found, ps.Refuted) == (witness is not None)
    if witness is not None:  # and if no witness had been looked for
        assert not _without_witness(model, points[:1], log)


def _without_witness(model: ps.PersidskiiModel, points: Any, log: Any) -> bool:
    """Whether the search for a Lyapunov function succeeds on a model that is refuted."""
    from functools import partial

    from persid.certificates.certificate import Certificate
    from persid.lyapunov.shifted_model import Setting
    from persid.verdicts.searches import margin, settled

    setting = Setting.of(model, points[0] if points else None)
    tried = [settled(setting, partial(margin, full_P=full, log=log), log)[0] for full in (False, True)]
    return any(isinstance(answer, Certificate) for answer in tried)


def test_refutation_survives_small_changes() -> None:
    """A refuted model that is made stable by a little more damping is certified, and never both."""
    words = [type(ps.certify(scalar(-1.0, tanh=gain))).__name__ for gain in (0.9, 0.99, 1.01, 1.1)]
    assert words == ["Certified", "Certified", "Refuted", "Refuted"]


@pytest.mark.long
def test_region_keeps_its_trajectories() -> None:
    """From the edge of a certified region no admissible input, however adverse, drives the pendulum out of it."""
    model = ps.PersidskiiModel(**PENDULUM)
    verdict = ps.certify(model, domain=[[-2.0, 2.0], [-6.0, 6.0]])
    assert isinstance(verdict, ps.Certified)
    found = verdict.certificate
    assert found.claim == "region"
    assert found.scope == "regional"
    assert found.input_bound is not None
    assert found.level is not None
    assert found.input_bound > 0.3
    angles = np.linspace(0, 2 * np.pi, 6, endpoint=False)
    circle = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    starts = np.array([_edge(found, c, found.level) for c in circle])
    for policy in policies(found, model, found.input_bound).values():
        t, x = runs(model, model.u_ref, starts, policy, 12.0, 160)
        assert max(found.V(states).max() for states in x) <= found.level
        bounds = np.stack([found.bound(start, found.input_bound, t) for start in starts], axis=1)
        assert (np.linalg.norm(x, axis=2) <= bounds).all()


def _edge(found: ps.Certificate, direction: np.ndarray, level: float) -> np.ndarray:
    """Return a state in a direction from the operating point with V a little below the level."""
    low, high = 0.0, 0.1
    while found.V(found.operating_point + high * direction[None])[0] < level:
        high *= 2
    for _ in range(40):
        middle = (low + high) / 2
        inside = found.V(found.operating_point + middle * direction[None])[0] < 0.999 * level
        low, high = (middle, high) if inside else (low, middle)
    return found.operating_point + low * direction


def test_undecided_explains_itself() -> None:
    """An undecided verdict has its reason as a sentence, and its proved reason where there is one."""
    verdict = ps.certify(ps.PersidskiiModel(**BY_NAME["tanh of a sum with B = 0"].model))
    assert isinstance(verdict, ps.Undecided)
    assert str(verdict).startswith("Undecided: ")
    assert str(verdict).endswith(".")
    assert all(reason.value.endswith(".") for reason in Reason)


def test_example_of_a_witness_reads_well(tmp_path: Path) -> None:
    """The sentence of a refutation names the two states of rest."""
    verdict = ps.certify(scalar(-1.0, tanh=2.0))
    assert isinstance(verdict, ps.Refuted)
    assert "rests at both" in str(verdict)
    verdict.witness.save(tmp_path / "w.json")
    assert isinstance(ps.check(tmp_path / "w.json"), ps.Accepted)


def test_whole_seconds() -> None:
    """A time limit is a number of seconds, whole or not."""
    model = scalar(-1.0)
    assert ps.certify(model, time_limit=20).is_certified
    assert ps.certify_many([model], engine=None, time_limit=20)[0].is_certified
    assert ps.CertifiedIdentifier(time_limit=20).time_limit == 20


# Functions that are not defined, or not finite, everywhere


@pytest.mark.parametrize("f", ["sqrt(x+1)-1", "log1p(x)", "(x+1)**1.5-1", "tan(x)", "1-1/(x+1)"])
@pytest.mark.parametrize("coefficient", [-1.0, 0.0])
def test_functions_not_defined_everywhere(f: str, coefficient: float) -> None:
    """A function that is not defined for all states leaves a model undecided globally and is certified in a region."""
    model = ps.PersidskiiModel([[-1.0]], [(f, None, [[coefficient]])], [[1.0]])
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Undecided)
    assert verdict.reason is Reason.OUTSIDE
    assert f"{f} is defined and continuous for all states" in verdict.detail
    assert verdict.evidence is None  # a simulation that leaves the domain would tell nothing
    assert isinstance(ps.certify(model, domain=[[-0.5, 0.5]]), ps.Certified)
    wide = ps.certify(model, domain=[[-2.0, 2.0]])
    assert isinstance(wide, ps.Undecided)
    assert "in the whole box; give a smaller one" in wide.detail


def test_the_box_of_the_data_is_tried_where_a_function_ends() -> None:
    """A global question about a model with a box of data is answered in the box, or says that the box is too wide."""
    terms = [("sqrt(x+1)-1", None, [[-1.0]])]
    inside, beyond = (ps.PersidskiiModel([[-1.0]], terms, [[1.0]], domain=[[-w, w]]) for w in (0.9, 1.1))
    assert isinstance(ps.certify(inside), ps.Certified)
    assert "whole box" in str(ps.certify(beyond))


def test_slopes_that_floating_point_does_not_know() -> None:
    """x |x|^(1/2) is certified, though its slope at 0 is 0 times infinity in floating point."""
    verdict = ps.certify(ps.PersidskiiModel([[-1.0]], [("x*abs(x)**0.5", None, [[-1.0]])], [[1.0]]))
    assert isinstance(verdict, ps.Certified)


def test_functions_that_vanish_together() -> None:
    """Points at which every function in z is zero spoil no first dual matrix: nothing is asked of a norm of 0."""
    model = ps.PersidskiiModel([[0.0]], [("deadzone(x)", None, [[-1.0]])], [[1.0]])
    setting = Setting.of(model, None)
    families = [Family.full(np.array([[0.0, 1.0]]))]
    assert np.isfinite(assemble(setting.system, families).problem.C.data).all()
