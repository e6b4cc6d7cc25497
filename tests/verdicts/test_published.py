"""Published stability problems keep their figures: what is proved of them today, and what is not true is not proved."""

import pytest

import persid as ps
from further_problems import FURTHER, Ball, Between
from other_problems import OTHER, Gain
from published_problems import PUBLISHED, Published, Region, Slope, Stable, volume

ALL = (*PUBLISHED, *FURTHER, *OTHER)
BY_NAME = {problem.name: problem for problem in ALL}

QUICK = (
    "x' = -x - x^3 + u", "spring that hardens, damping .5", "spring that hardens, damping .02", "x' = -sat(x) + u",
    "van der Pol's oscillator", "Chua's circuit", "Hopfield's network, two neurons",
    "Goodwin's oscillator below its threshold", "Euler's rotating body, damped", "Lorenz, sigma = 10, b = 8/3: r",
    "five modes of a forced flow", "Rabinovich's waves, dampings 4, 1, 1",
    "one eigenvalue 0", "neurons that take turns", "Selkov's sugar", "Sprott A, no rest", "steps: Lozi's map",
    "gain: x' = -2x + tanh(x) + u", "x' = -2x + sin(x) + u", "hidden oscillation",
)  # fmt: skip
SLOW = (  # of these each takes a quarter of a minute to all of the minute that one question may take
    "equilibrium network, 10 states, 20 tanh", "equilibrium network, 6 states, 20 tanh",
    "x'' + 3x' + 2x = x^2 + x x' - x'^2", "pendulum under two layers of four tanh",
    "Davison & Kurak's cubic of three states", "x3' = -3x1 - 3x2 - 2x3 + x1^3 + x2^3 + x3^3",
    "two species that compete", "three masses under two layers of six tanh", "x1' = -x1 + 2 x1^2 x2, x2' = -x2",
    "two machines at an infinite bus", "predators and prey that fills its room", "epidemic with births",
    "x' = -2x + xy, y' = -y + xy", "x1' = -50x1 - 16x2 + 13.8x1x2, x2' = 13x1 - 9x2 + 5.5x1x2",
    "disc, r' = -r(1 - r^2)", "disc within a cycle, r' = -r(1 - r^2)(1 - r^2/4)",
    "x1' = -x1 + x2 x3^2, x2' = -x2 + x1 x2, x3' = -x3",
    "x1' = -.42x1 - 1.05x2 - 2.3x1^2 - .5x1x2 - x1^3, x2' = 1.98x1 + x1x2", "stirred tank in logarithms",
    "plate that is pulled, x'' + x'/2 + x = .1/(1 - x)^2", "jerk x''' + 2x'' + 3x' + x = x^2",
    "three coupled oscillators", "Chua's circuit with a hidden attractor", "double integrator, saturated feedback",
    "species that compete, in logarithms", "excitable neuron at rest",
    "inverted pendulum, saturated feedback", "machine at a bus, two harmonics", "repressilator, Hill exponent 3",
)  # fmt: skip


def holds(problem: Published) -> None:
    """Assert that a problem's figure is reached, by one question; 0 where it is still lost."""
    match problem:
        case Region() if not problem.reached:
            assert isinstance(ps.certify(problem.model, domain="auto"), ps.Undecided)
        case Slope():
            assert ps.certify(problem.family(problem.reached)).is_certified
            if problem.truth is not None:
                assert not ps.certify(problem.family(1.01 * problem.truth)).is_certified
        case Region():
            point = "auto" if problem.near is None else list(problem.near)
            verdict = ps.certify(problem.model, domain="auto", operating_point=point)
            assert isinstance(verdict, ps.Certified)
            assert problem.reached <= volume(verdict.certificate) <= 1.01 * (problem.truth or float("inf"))
        case Stable(truth=0.0):
            assert isinstance(ps.certify(problem.model), ps.Refuted)
        case Ball() | Between() | Gain() if problem.reached:
            assert problem.reached <= problem.largest({}) <= 1.001 * (problem.truth or float("inf"))
        case Ball() | Between() | Gain():
            assert problem.largest({}) == 0
        case Stable() if problem.reached:
            verdict = ps.certify(problem.model)
            assert isinstance(verdict, ps.Certified)
            assert problem.reached <= (verdict.best_rate or 0.0) <= 1.001 * (problem.truth or float("inf"))
        case Stable():
            assert isinstance(ps.certify(problem.model), ps.Undecided)


@pytest.mark.parametrize("name", QUICK)
def test_quick_published_problems_keep_their_figures(name: str) -> None:
    """What is asked and answered within a second is a test that always runs."""
    holds(BY_NAME[name])


@pytest.mark.long
@pytest.mark.parametrize(
    "name",
    [pytest.param(each.name, marks=[pytest.mark.slow] * (each.name in SLOW)) for each in ALL if each.name not in QUICK],
)
def test_published_problems_keep_their_figures(name: str) -> None:
    """Every other figure is reached, and none is larger than the truth."""
    holds(BY_NAME[name])


@pytest.mark.slow
@pytest.mark.parametrize("problem", ALL, ids=lambda problem: problem.name)
def test_figures_are_measured_as_the_table_has_them(problem: Published) -> None:
    """The search of the table, whole, reaches at least what is asked of it by one question."""
    assert problem.largest({}) >= problem.reached
