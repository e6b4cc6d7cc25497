"""Loops in discrete time that only values and integrals of functions in V certify, and what is said of them."""

from functools import cache

import numpy as np
import pytest

import persid as ps
from further_problems import FURTHER
from published_problems import Slope

HOW = "slopes from step to step"
FAMILIES = {each.name: each.family for each in FURTHER if isinstance(each, Slope) and each.name.startswith("steps")}
SLOPES = (12.8, 0.745, 2.42, 0.905)  # those with V quadratic end at .70, .19, 1.02 and .65


@cache
def certified(k: float = 8.0) -> ps.Certificate:
    """The certificate of the first loop."""
    return ps.certify(next(iter(FAMILIES.values()))(k)).certificate


@pytest.mark.parametrize(("name", "k"), [*zip(FAMILIES, SLOPES, strict=True)])
def test_published_loops_are_certified_nearly_as_far_as_is_known(name: str, k: float) -> None:
    """Each published plant is certified far beyond what a quadratic V reaches, with a rate and a gain."""
    verdict = ps.certify(FAMILIES[name](k))
    assert isinstance(verdict, ps.Certified)
    assert (verdict.certificate.claim, verdict.attempts[-1].what) == ("rate-and-gain", HOW)
    assert not verdict.certificate.is_incremental
    assert "every equilibrium" not in verdict.certificate.statement


@pytest.mark.parametrize("f", ["tanh(x)", "sat(x)", "relu(x)", "pwl(x; -1: -0.5, 0: 0, 2: 0.25, 3: 1.25)"])
def test_kinks_do_no_harm(f: str) -> None:
    """Functions with kinks, one-sided ones and tables, are certified beyond what a quadratic V reaches, too."""
    model = ps.PersidskiiModel(
        [[1.8, -0.81], [1.0, 0.0]], [(f, [[0.5, 0.0]], [[-1.0], [0.0]])], [[1.0], [0.0]], dt=1.0, time="discrete"
    )
    assert ps.certify(model).is_certified


def _loop(rng: np.random.Generator, f: str) -> tuple[ps.PersidskiiModel, float]:
    """A random stable plant with a function in its loop, and the slope at which the loop loses its stability."""
    n = int(rng.integers(2, 4))
    A, (row, column) = rng.normal(size=(n, n)), rng.normal(size=(2, n))
    A *= rng.uniform(0.4, 0.95) / np.abs(np.linalg.eigvals(A)).max()
    slopes = np.geomspace(1e-2, 1e2, 4000)
    unstable = [k for k in slopes if np.abs(np.linalg.eigvals(A + k * np.outer(column, row))).max() > 1]
    limit = unstable[0] if unstable else np.inf
    terms = [(f, [1.02 * limit * row], column[:, None])] if unstable else []
    return ps.PersidskiiModel(A, terms, np.eye(n), dt=1.0, time="discrete"), limit


@pytest.mark.parametrize("f", ["tanh(x)", "deadzone(x)", "sat(x)"])
def test_beyond_the_linear_limit_nothing_is_certified(f: str) -> None:
    """Of random loops two percent beyond the slope that one linear function may have, none is certified."""
    rng, seen = np.random.default_rng(4), 0
    while seen < 6:
        model, limit = _loop(rng, f)
        if np.isfinite(limit):
            seen += 1
            assert not ps.certify(model, time_limit=5).is_certified, (model.A0, limit)


def test_V_falls_along_runs_as_is_stated() -> None:
    """V(x+) <= (1 - kappa) V(x) + gamma |u|^2 in each step, and the printed bound holds, for inputs that jump."""
    certificate, rng = certified(), np.random.default_rng(0)
    model, stated = certificate.model, certificate.stated
    kappa, gamma = float(stated.kappa), float(stated.gamma)
    for size in (0.0, 1.0):
        for _ in range(5):
            x0, u = rng.normal(size=2) * 10 ** rng.uniform(-1, 3), size * rng.choice([-1.0, 1.0], (80, 1))
            x = model.simulate(x0, np.arange(80.0), u)[0].x
            V = certificate.V(x)
            assert (V[1:] <= (1 - kappa) * V[:-1] + gamma * size**2 + 1e-9 * V[:-1]).all()
            assert (np.linalg.norm(x, axis=1) <= certificate.bound(x0, size, np.arange(80.0)) * (1 + 1e-9)).all()


def test_about_an_equilibrium_that_is_not_the_reference() -> None:
    """With a constant input the loop rests elsewhere, where its function has other slopes: it is certified there."""
    verdict = ps.certify(next(iter(FAMILIES.values()))(4.0), u_op=[0.5])
    assert isinstance(verdict, ps.Certified)
    assert verdict.attempts[-1].what == HOW


def test_a_rate_that_is_asked_for_is_worth_a_dearer_attempt() -> None:
    """Near where a quadratic V ends its rate is slow; one that is asked for is proved by values, the gain is less."""
    model = next(iter(FAMILIES.values()))(0.6)
    usual, asked = ps.certify(model), ps.certify(model, rate=0.03)
    assert usual.best_rate < 0.02
    assert asked.certificate.rate >= 0.03
    assert asked.certificate.gain < 0.6 * usual.certificate.gain
    too_fast = ps.certify(model, rate=0.2)  # no solution is that fast: no dearer attempt is made
    assert HOW not in [attempt.what for attempt in too_fast.attempts]
    assert too_fast.best_rate == pytest.approx(usual.best_rate, rel=0.05)


def test_what_a_quadratic_V_certifies_stays_as_it_was() -> None:
    """Cheap attempts come first: where V = x'P x does, it is V, and the attempt is not made."""
    verdict = ps.certify(next(iter(FAMILIES.values()))(0.5))
    assert verdict.is_certified
    assert HOW not in [attempt.what for attempt in verdict.attempts]
    assert verdict.certificate.P.shape == (2, 2)
