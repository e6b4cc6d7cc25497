"""Models with products of states that cancel in V' are certified for all states, and only where they are stable."""

import time

import numpy as np
import pytest

import flows
import persid as ps
from checker.sampled import faults
from checker.test_identities import identity_is_zero
from further_problems import polynomial
from persid.lyapunov.identities import with_identities
from persid.lyapunov.shifted_model import Setting
from persid.verdicts.facts import frame_of
from published_problems import volume

HOW = "products of states that cancel"


def _certified(model: ps.PersidskiiModel, **asked: object) -> ps.Certified:
    verdict = ps.certify(model, **asked)
    assert isinstance(verdict, ps.Certified), verdict
    assert verdict.attempts[-1].what.startswith(HOW) or "ball" in verdict.attempts[-1].what
    assert verdict.certificate.scope == "global"
    assert faults(verdict.certificate.content, samples=200) == []
    return verdict


@pytest.mark.parametrize("r", [0.5, 0.9, 0.99, 0.9999])
def test_lorenz_is_certified_up_to_where_its_rest_is_lost(r: float) -> None:
    """Below r = 1 the rest at 0 attracts every run: certified, with nearly the rate of the linearisation."""
    model = flows.lorenz(r)
    verdict = _certified(model)
    truth = -np.linalg.eigvals(model.jacobian(np.zeros(3))).real.max()
    assert 0.85 * truth <= verdict.best_rate <= truth


@pytest.mark.parametrize("r", [1.0, 1.001, 28.0])
def test_lorenz_is_not_certified_from_there_on(r: float) -> None:
    """At r = 1 the linearisation is marginal, beyond the rest is unstable."""
    assert not ps.certify(flows.lorenz(r)).is_certified


def test_every_run_of_lorenz_comes_into_a_ball() -> None:
    """At r = 28 nothing rests, but |x|^2 about (0, 0, 38) falls outside a ball, of radius 39.3 in the literature."""
    verdict = _certified(flows.lorenz_about_a_ball(28.0), claim="practical")
    assert verdict.certificate.claim == "practical"
    assert 39.2 < verdict.certificate.spread < 60


def test_a_tumbling_body_with_damping_is_certified_for_all_torques() -> None:
    """Euler's rotating body: moments whose products do not cancel in binary64 alone, damping that mixes the axes."""
    damping = np.array([[0.1, 0.05, 0.0], [-0.05, 0.2, 0.0], [0.0, 0.01, 0.3]])
    verdict = _certified(flows.body((1.5, 2.25, 3.1), damping))
    assert verdict.certificate.gain < 100
    assert not ps.certify(flows.body((1.0, 2.0, 3.0), -damping)).is_certified


@pytest.mark.parametrize(("h", "certified"), [(1.0, True), (1.98, True), (2.02, False)])
def test_waves_are_certified_up_to_the_threshold(h: float, certified: bool) -> None:
    """Rabinovich's waves, whose products keep no |x|^2: the rest is stable for h^2 < 4, and so globally."""
    assert ps.certify(flows.rabinovich(h)).is_certified == certified


@pytest.mark.parametrize(("R", "certified"), [(1.0, True), (6.0, True), (6.2, False)])
def test_five_modes_of_a_flow_are_certified_up_to_the_threshold(R: float, certified: bool) -> None:
    """Five modes about a forced rest, which is unstable from R = 6.12 on."""
    assert ps.certify(flows.five_modes(R)).is_certified == certified


@pytest.mark.parametrize("n", [3, 5, pytest.param(9, marks=pytest.mark.long)])
def test_random_truncations_are_certified_where_they_are_damped(n: int) -> None:
    """Energy falls in them: certified within a minute, and their runs come to rest."""
    rng, started = np.random.default_rng(n), time.process_time()
    for _ in range(3 if n < 9 else 1):
        _certified(flows.drawn(rng, n, -0.5))
    assert time.process_time() - started < 60


@pytest.mark.parametrize("n", [3, 5])
def test_random_truncations_that_grow_are_never_certified(n: int) -> None:
    """One direction of growth, however small, and no verdict is Certified."""
    rng = np.random.default_rng(n)
    for growth in (0.5, 1e-3, 1e-9):
        assert not ps.certify(flows.drawn(rng, n, growth), time_limit=10).is_certified


def turned(rng: np.random.Generator, growth: float) -> ps.PersidskiiModel:
    """A random model x' = growth x - g y - d x^3, y' = -y + g x - e y^3: g of degree 2 turns, and d, e > 0 damp."""
    (a, b, c), (d, e) = rng.integers(-8, 9, 3) / 4, rng.integers(1, 5, 2) / 2
    cubes = {(0, (0, 0, 0)): -d, (0, (0, 0, 1)): -a, (0, (0, 1, 1)): -b, (0, (1, 1, 1)): -c,
             (1, (0, 0, 0)): a, (1, (0, 0, 1)): b, (1, (0, 1, 1)): c, (1, (1, 1, 1)): -e}  # fmt: skip
    return polynomial([[growth, 0], [0, -1]], {at: float(v) for at, v in cubes.items()})


def test_cubes_that_turn_and_damp_are_certified() -> None:
    """Six cubes of which four are apart have no margin each; what is known of their products gives one."""
    for seed in range(4):
        verdict = _certified(turned(np.random.default_rng(seed), -0.5))
        assert 0.4 < verdict.best_rate <= 0.5


def test_cubes_that_turn_are_not_certified_where_a_state_is_not_damped() -> None:
    """One direction of growth, or of none but by a cube, and no rate is certified."""
    for growth in (0.5, 1e-3, 1e-9, 0.0):
        assert not ps.certify(turned(np.random.default_rng(5), growth), time_limit=10).is_certified


def test_a_round_cycle_has_a_ball_that_holds_it() -> None:
    """x' = x - y - x r^2, y' = x + y - y r^2 comes to r = 1, and a ball not much larger is proved."""
    cubes = {(0, (0, 0, 0)): -1.0, (0, (0, 1, 1)): -1.0, (1, (0, 0, 1)): -1.0, (1, (1, 1, 1)): -1.0}
    verdict = ps.certify(polynomial([[1, -1], [1, 1]], cubes), claim="practical")
    assert isinstance(verdict, ps.Certified)
    assert 1 <= verdict.certificate.spread <= 1.7
    assert faults(verdict.certificate.content, samples=500) == []


def test_products_that_do_not_cancel_are_not_certified() -> None:
    """Without the product in one equation runs escape, or none is known not to."""
    rng = np.random.default_rng(0)
    for _ in range(3):
        A0 = -np.eye(3)
        products = {(0, 1, 2): 1.0, (1, 0, 2): 1.0, (2, 0, 1): float(rng.uniform(0.5, 2))}
        assert not ps.certify(flows.flow(A0, products), time_limit=10).is_certified


@pytest.mark.parametrize(
    ("model", "before", "least"),
    [
        pytest.param("prey", 0.369, 1.3, marks=pytest.mark.long),
        pytest.param("triad", 3.26, 10.0, marks=pytest.mark.slow),
    ],
)
def test_regions_of_models_with_products_are_larger(model: str, before: float, least: float) -> None:
    """What is known of products of functions, (x y)^2 against x^2 y^2, makes regions more than three times as large."""
    verdict = ps.certify({"prey": flows.prey, "triad": flows.triad}[model](), domain="auto", time_limit=60)
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.content["facts"]["identity"]
    assert volume(verdict.certificate) > least > 3 * before
    assert faults(verdict.certificate.content, samples=500) == []


def test_identities_of_a_model_are_zero() -> None:
    """Each identity that the search is given vanishes at random states, in fractions."""
    for model in (flows.lorenz(0.5), flows.five_modes(1.0), flows.drawn(np.random.default_rng(1), 5, -0.5)):
        frame = with_identities(frame_of(Setting.of(model, None)), None, "all")
        assert frame.identities
        channels = {at: frame.n + c for c, at in frame.places.items()}
        for identity in frame.identities[:50]:
            placed = [(channels.get(i, i), channels.get(j, j), sigma) for i, j, sigma in identity]
            assert identity_is_zero(frame.model, placed)


def test_a_model_whose_functions_are_no_polynomials_has_none() -> None:
    """Sines and relus have no identities, and certify tries none."""
    model = ps.PersidskiiModel(-np.eye(2), [("sin(x)", None, 0.1 * np.eye(2))], np.eye(2))
    assert with_identities(frame_of(Setting.of(model, None)), None, "all").identities == ()
