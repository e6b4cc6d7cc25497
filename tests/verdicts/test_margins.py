"""Residual margins of certified models: what they say, and that plants within them obey it."""

from functools import cache

import numpy as np
import pytest

import persid as ps
from persid.certificates.encoding import encode
from persid.certificates.ledger import with_proof
from persid.certificates.margin import Margin

TANH = ps.PersidskiiModel([[-1.0, 0.5], [-0.5, -1.0]], [("tanh(x)", None, [[-0.5, 0.1], [0.0, -0.5]])], [[1.0], [0.5]])
PENDULUM = ps.PersidskiiModel([[0.0, 1.0], [-2.0, -1.0]], [("sin(x)", [[1.0, 0.0]], [[0.0], [-1.0]])], [[0.0], [1.0]])
MODELS = {"tanh": TANH, "pendulum": PENDULUM}


def _margin(model: ps.PersidskiiModel, **question: object) -> Margin:
    verdict = ps.certify(model, **question)
    assert isinstance(verdict, ps.Certified)
    assert verdict.margin is not None
    return verdict.margin


@cache
def _global(name: str) -> Margin:
    """The margin of a model by its name, found once."""
    return _margin(MODELS[name])


def test_a_margin_is_certified_at_nine_tenths_of_the_largest() -> None:
    """The certificate speaks of every plant within .9 of the largest delta, which stays below both bounds."""
    margin = _global("tanh")
    assert margin.delta == pytest.approx(0.9 * margin.largest, rel=1e-9)
    assert margin.largest < min(margin.radius, margin.resting)
    assert isinstance(ps.check(margin.certificate, TANH), ps.Accepted)
    assert margin.certificate.statement.startswith("Every plant within the stated deviations")
    assert "assumed, not proved" in margin.certificate.statement


def test_the_margin_is_in_half_widths_of_the_data() -> None:
    """In a box of data a margin does not depend on the units of the states."""
    box = np.array([[-2.0, 2.0], [-1.0, 3.0]])
    scale = np.array([1000.0, 0.01])
    rows = np.diag(1 / scale)
    model = ps.PersidskiiModel(TANH.A0, TANH.terms, TANH.B, domain=box)
    other = ps.PersidskiiModel(
        TANH.A0 * scale[:, None] / scale, [("tanh(x)", rows, TANH.terms[0].A * scale[:, None])],
        TANH.B * scale[:, None], domain=box * scale[:, None],
    )  # fmt: skip
    assert _margin(other).largest == pytest.approx(_margin(model).largest, rel=0.03)


def test_equations_that_are_known_have_no_residual() -> None:
    """The equation x1' = x2 of a pendulum counts as exact, and a region in a box has a margin too."""
    whole, region = _global("pendulum"), _margin(PENDULUM, domain=[[-2.0, 2.0], [-2.0, 2.0]])
    assert whole.known == region.known == ("x1",)
    assert region.certificate.claim == "region"
    assert 0 < region.delta < region.radius


def test_a_margin_that_reads_less_says_less() -> None:
    """Where one number of the bound is made smaller, the delta that is reported is the smaller one."""
    margin = _global("tanh")
    content = dict(margin.certificate.content)
    (deviation,) = content["deviations"]
    mantissa, exponent = deviation["C"][1][0][1]
    lesser = [deviation["C"][0], [[1, [mantissa, exponent - 1]]]]
    data = with_proof(content | {"deviations": [deviation | {"C": lesser}]})
    weaker = ps.Certificate.accept(encode(data))
    less = Margin(margin.largest, margin.radius, margin.resting, margin.width, margin.known, weaker)
    assert less.delta == pytest.approx(margin.delta / 2, rel=1e-12)


@pytest.mark.parametrize(("name", "epsilon"), [("tanh", 0.25), ("pendulum", 0.0)])
def test_plants_within_a_margin_keep_its_bound(name: str, epsilon: float) -> None:
    """Of 200 plants drawn inside a certified (delta, epsilon), with w along V's gradient, none leaves the bound."""
    model, margin = MODELS[name], _global(name).with_constant(epsilon)
    certificate, L = margin.certificate, np.diag(margin.width)
    L[[name in margin.known for name in model.states]] = 0.0
    rng = np.random.default_rng(1)
    x0, share = rng.normal(0, 1.5, (200, 2)), rng.uniform(0.5, 1.0, (200, 1))
    ways, turn = rng.normal(size=(200, 2, 2)), rng.uniform(0, 1, (200, 1))
    unit = lambda v: v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), 1e-12)  # noqa: E731

    def F(s: float, x: np.ndarray) -> np.ndarray:
        size = share * np.hypot(margin.delta * np.linalg.norm(x / margin.width, axis=1, keepdims=True), epsilon)
        w = turn * unit(2 * x @ certificate.P @ L) + (1 - turn) * (ways @ np.array([np.sin(3 * s), 1.0]))
        return model.rhs(x, np.zeros((200, 1))) + size * unit(w) @ L.T

    x, h, steps = x0, 0.01, 1200
    largest = np.zeros(200)
    times = h * np.arange(1, steps + 1)
    start = np.sqrt(certificate.V(x0) / float(certificate.stated.p))
    bounds = start[:, None] * np.exp(-certificate.rate * times) + certificate.spread
    assert bounds[0, -1] <= certificate.bound(x0[0], 0.0, times[-1:])[0]
    for k in range(steps):
        a = F(k * h, x)
        b = F((k + 0.5) * h, x + h / 2 * a)
        c = F((k + 0.5) * h, x + h / 2 * b)
        x = x + h / 6 * (a + 2 * b + 2 * c + F((k + 1) * h, x + h * c))
        largest = np.maximum(largest, np.linalg.norm(x, axis=1) / bounds[:, k])
    assert largest.max() <= 1
    assert largest.max() > 0.3  # the bound is not empty talk


def test_a_state_that_takes_no_part_leaves_no_margin() -> None:
    """Where V reads a state through its functions alone, a deviation that reads it has no place: there is no margin."""
    terms = [("relu(x)", None, [[-1.0]]), ("x*abs(x)", None, [[-1.1]])]
    verdict = ps.certify(ps.PersidskiiModel([[0.0]], terms, [[0.8]]))
    assert isinstance(verdict, ps.Certified)
    assert verdict.margin is None
