"""Practical stability: a ball that every run comes into, where nothing stronger is certified for all states."""

import json
import random

import numpy as np
import pytest

import persid as ps
from persid.commands.cli import main
from persid.identification.learned import ramps

DOUBLE_WELL = ps.PersidskiiModel([[0, 1], [1, -0.5]], [("x**3", [[1, 0]], [[0], [-1.0]])], [[0], [1.0]])
DEAD_BAND = ps.PersidskiiModel([[-1.0]], [("tanh(2*x)", None, [[1.0]])], [[1.0]])
LEARNED = ps.PersidskiiModel([[0.0]], [("pwl(x; -2: -2, -0.5: 0.25, 0: 0, 0.5: -0.25, 2: 2)", None, [[-1.0]])], [[1.0]])


def ends(model: ps.PersidskiiModel, seed: int, push: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Starts near and far, and where runs with the constant input `push` are after a long time."""
    rng, h = np.random.default_rng(seed), 0.01
    start = x = rng.normal(size=(12, model.n)) * np.geomspace(0.01, 8, 12)[:, None]
    u = np.full((12, model.m), push)
    for _ in range(6000):
        a = model.rhs(x, u)
        b = model.rhs(x + h / 2 * a, u)
        x = x + h * b
    return start, x


@pytest.mark.parametrize(
    ("model", "least", "most"),
    [
        (DOUBLE_WELL, 1.0, 1.75),
        (DEAD_BAND, 0.957, 1.25),
        pytest.param(LEARNED, 0.66, 1.2, marks=pytest.mark.long),
    ],
)
def test_a_ball_is_certified_that_holds_every_rest(model: ps.PersidskiiModel, least: float, most: float) -> None:
    """The ball holds the equilibria at its edge, is not much larger, and bounds every run."""
    verdict = ps.certify(model, claim="practical")
    assert isinstance(verdict, ps.Certified)
    certificate = verdict.certificate
    assert certificate.claim == "practical"
    assert least <= certificate.spread <= most
    assert "practically" in certificate.statement
    assert "ball" in verdict.headline
    for push in (0.0, 1.5):
        for start, end in zip(*ends(model, 0, push), strict=True):
            assert np.linalg.norm(end - model.x_ref) <= certificate.bound(start, abs(push), [60.0])[0]


@pytest.mark.parametrize("model", [DOUBLE_WELL, DEAD_BAND])
def test_the_default_question_still_refutes(model: ps.PersidskiiModel) -> None:
    """Several equilibria refute input-to-state stability; a ball is an answer to another question."""
    assert isinstance(ps.certify(model), ps.Refuted)


def test_the_strongest_that_holds_is_told() -> None:
    """A model that is stable about its point gets that claim, though a ball was asked for."""
    model = ps.PersidskiiModel([[-1.0]], [("tanh(x)", None, [[0.5]])], [[1.0]])
    assert ps.certify(model, claim="practical").certificate.claim == "rate-and-gain"


def test_a_ball_that_is_not_found_is_among_the_attempts() -> None:
    """Where no ball is found the verdict is that of the stronger question, and tells that a ball was sought."""
    oscillator = ps.PersidskiiModel([[1, -1], [1, 0]], [("x**3", [[1, 0]], [[-1 / 3], [0]])], [[0], [1.0]])
    verdict = ps.certify(oscillator, claim="practical", time_limit=5)
    assert isinstance(verdict, ps.Refuted)
    assert "a ball" in verdict.attempts[-1].what


@pytest.mark.parametrize("slope", [0.5, 0.0])
def test_what_escapes_has_no_ball(slope: float) -> None:
    """Bounded functions hold neither an unstable linear part nor, for inputs, an integrator."""
    model = ps.PersidskiiModel([[slope]], [("tanh(x)", None, [[-1.0]])], [[1.0]])
    assert isinstance(ps.certify(model, claim="practical"), ps.Refuted)


def test_a_ball_is_about_all_states() -> None:
    """A box, or a region to be found, does not go with the question."""
    with pytest.raises(ps.ModelError, match="about all states"):
        ps.certify(DOUBLE_WELL, claim="practical", domain="auto")


def test_the_command_line_asks_for_a_ball(tmp_path, capsys) -> None:
    """`--claim practical` writes a file that the checker accepts, ends as proved, and says which ball."""
    model, target = str(tmp_path / "model.json"), str(tmp_path / "c.json")
    DOUBLE_WELL.save(model)
    assert main(["certify", model, "--claim", "practical", "-o", target]) == 0
    assert "comes into a ball about x_ref" in capsys.readouterr().out
    assert main(["check", target, "--json"]) == 3  # practically stable is not stable
    assert json.loads(capsys.readouterr().out)["claim"] == "practical"


def drawn(choose: random.Random) -> ps.PersidskiiModel:
    """x' = a x + c f(k x) + b + u with functions that leave their sector, or none that pulls back."""
    text = choose.choice(("tanh(x)", "x**3", "sin(x)", "cos(x)", "relu(x)", "x**3-3*x**2+x", "sat(x)", "deadzone(x)"))
    a, c, k = choose.uniform(-2, 0.5), choose.uniform(-2, 3), choose.choice((0.5, 1.0, 4.0))
    b = choose.choice((0.0, 0.0, choose.uniform(-1, 1)))
    return ps.PersidskiiModel([[a]], [(text, [[k]], [[c]])], [[1.0]], [b])


@pytest.mark.slow
def test_random_models_keep_to_their_balls() -> None:
    """Of random models of one state, every one that is certified keeps to its bound in simulation, pushed or not."""
    choose, certified = random.Random(3), 0
    for seed in range(16):
        model = drawn(choose)
        verdict = ps.certify(model, claim="practical", time_limit=10)
        if not isinstance(verdict, ps.Certified) or not hasattr(verdict.certificate, "bound"):
            continue
        certificate, rated = verdict.certificate, verdict.certificate.rate is not None
        certified += certificate.claim == "practical"
        for push in (0.0, 0.5) if rated else ():
            with np.errstate(all="ignore"):
                starts, last = ends(model, seed, push)
            sup = float(np.abs(push - certificate.input).max())
            for start, end in zip(starts, last, strict=True):
                distance = np.linalg.norm(end - certificate.operating_point)
                assert not distance > certificate.bound(start, sup, [60.0])[0] * (1 + 1e-6) + 1e-9
    assert certified >= 2


@pytest.mark.parametrize(
    ("model", "rest"),
    [
        (ps.PersidskiiModel([[-1.0]], [("sin(3*x)", None, [[2.0]])], None, [4.0]), 3.267),
        (ps.PersidskiiModel([[-1.0]], [("tanh(2*x)", None, [[1.0]])], [[1.0]], [5.0]), 6.0),
    ],
)
def test_the_ball_holds_where_a_constant_alone_takes_the_state(model: ps.PersidskiiModel, rest: float) -> None:
    """Where b counts as one more input its part belongs to the radius that headline and certificate name."""
    verdict = ps.certify(model, claim="practical")
    assert isinstance(verdict, ps.Certified)
    run = model.simulate([0.0], np.linspace(0, 40, 400), np.zeros((400, model.m)) if model.m else None)[0]
    assert abs(run.x[-1, 0]) == pytest.approx(rest, abs=1e-3)
    assert verdict.certificate.spread is not None
    assert rest <= verdict.certificate.spread
    assert verdict.certificate.spread == pytest.approx(verdict.certificate.bound([0.0], 0.0, [1e3])[0], rel=0.5)


def _learned_well(ends: float, seed: int) -> ps.PersidskiiModel:
    """x' = g(x) + u with seven ramps as a fit of `pwl` gives them: a hill about 0, random slopes, `ends` far out."""
    rng, at = np.random.default_rng(seed), np.array([-1.5, -0.75, -0.25, 0.25, 0.75, 1.5])
    slopes = np.concatenate([[ends], rng.uniform(-3, 1, 2), [rng.uniform(0.5, 2)], rng.uniform(-3, 1, 2), [ends]])
    beside = np.delete(slopes - slopes[3], 3)  # the ramp about 0 is x itself
    terms = [(f, None, [[a]]) for f, a in zip(ramps(at, beside_x=True), beside, strict=True)]
    return ps.PersidskiiModel([[slopes[3]]], terms, [[1.0]])


@pytest.mark.long
@pytest.mark.parametrize("seed", [0, 1])
def test_learned_functions_outside_their_sector_have_a_ball(seed: int) -> None:
    """A piecewise linear hill is split into a sector part and a bounded one: runs come into a ball by their bound."""
    model = _learned_well(-2.0, seed)
    assert isinstance(ps.certify(model), ps.Refuted)
    verdict = ps.certify(model, claim="practical")
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.claim == "practical"
    rng, t = np.random.default_rng(seed), np.linspace(0, 40, 401)
    for start in (-20.0, -1.0, 0.01, 20.0):
        size = float(rng.uniform(0, 2))
        run = model.simulate([start], t, size * rng.choice([-1.0, 1.0], (len(t), 1)))[0].x[:, 0]
        bound = verdict.certificate.bound([start], size, t)
        assert (np.abs(run) <= bound * (1 + 1e-9)).all()
    assert verdict.certificate.spread < 8


@pytest.mark.long
def test_a_learned_function_that_rises_far_out_has_no_ball() -> None:
    """With slopes that rise beyond the last knot runs go away, and no ball is certified."""
    assert not ps.certify(_learned_well(0.1, 0), claim="practical", time_limit=3).is_certified


def test_a_ball_needs_functions_that_are_defined_for_all_states() -> None:
    """Of x**1.5 of both signs, which no state but zero has, no ball is sought; the verdict says why."""
    model = ps.PersidskiiModel([[-2.989]], [("x**1.5", [[-0.25], [1.58]], [[0.127, -0.792]])], [[-0.16]], x_ref=[0.49])
    verdict = ps.certify(model, claim="practical")
    assert isinstance(verdict, ps.Undecided)
    assert verdict.reason.name == "OUTSIDE"
    assert "x**1.5" in str(verdict.detail)


def test_a_ball_of_a_model_with_constants_among_its_functions() -> None:
    """Constants and their opposites are forms of which the cone has no facets; the ball is certified all the same."""
    terms = [("1", [[0.57], [1.31]], [[-0.57, -1.31]]), ("softsign(x)", [[-1.0], [2.0]], [[0.5, -1.0]])]
    model = ps.PersidskiiModel([[-2.518]], terms, [[-1.41, 0.04]], b=[-0.36], x_ref=[0.44])
    assert isinstance(ps.certify(model, claim="practical"), ps.Certified)
