"""Rates and gains: near what is known to be best."""

import numpy as np
import pytest

import persid as ps
from persid.lyapunov.rates import Question, best_rate, smallest_gain
from persid.lyapunov.shifted_model import Setting


def question(model: ps.PersidskiiModel, full: bool = False) -> Question:
    """Return the global question about a model at x_ref."""
    setting = Setting.of(model, None)
    return Question(setting.system, setting.pools, setting.upper, setting.below, full)


def plenty() -> float:
    """Return the time left: a minute, always."""
    return 60.0


def test_linear() -> None:
    """x' = -2x + u: the best rate is 2, and at half of it the smallest gain is 1/2 times a factor near 1."""
    asked = question(ps.PersidskiiModel([[-2.0]], [], [[1.0]]))
    best = best_rate(asked, 4.0, plenty)
    assert best is not None
    kappa = best.assembly.unknowns.target.kappa
    assert 3.6 <= kappa <= 4.0
    found = smallest_gain(asked, 0.5 * kappa, best, plenty)
    assert found is not None
    assert found.assembly.unknowns.target.ratio is not None
    assert 0.5 <= np.sqrt(found.assembly.unknowns.target.ratio / found.assembly.unknowns.target.kappa) <= 0.55


def test_rotation() -> None:
    """A spiral decays at the real part of its eigenvalues."""
    best = best_rate(question(ps.PersidskiiModel([[-1.0, 5.0], [-5.0, -1.0]], [], [[1.0], [0.0]])), 2.0, plenty)
    assert best is not None
    assert 1.8 <= best.assembly.unknowns.target.kappa <= 2.0


def test_no_time() -> None:
    """Without time there is no rate."""
    asked = question(ps.PersidskiiModel([[-1.0]], [], [[1.0]]))
    assert best_rate(asked, 2.0, lambda: 0.0) is None


def test_certificate_says_half() -> None:
    """The certificate's rate is kappa/2, rounded down, and its gain the stated one, rounded up."""
    verdict = ps.certify(ps.PersidskiiModel([[-1.0]], [], [[1.0]]))
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.claim == "rate-and-gain"
    assert verdict.certificate.rate == pytest.approx(0.5, rel=0.05)
    assert verdict.certificate.gain == pytest.approx(1.0, rel=0.05)
    assert verdict.certificate.gain is not None
    assert verdict.certificate.gain >= 1
