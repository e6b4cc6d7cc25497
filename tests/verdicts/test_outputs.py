"""Verdicts on fits to inputs and outputs: the fit's own multipliers prove it, and a search may better its gains."""

from dataclasses import replace

import numpy as np
import pytest

import persid as ps
from persid.certificates.certificate import Certificate
from persid.models.stable_fit import StableFit
from persid.verdicts.outputs import certify_fit
from stable_fits import random_fit


def decided(fit: StableFit, time_limit: float = 0.0, min_rate: float | None = None) -> Certificate:
    """The certificate of a fit."""
    verdict = certify_fit(fit, ps.OutputModel.from_fit(fit), time_limit=time_limit, min_rate=min_rate)
    assert isinstance(verdict, ps.Certified), verdict
    assert isinstance(verdict.certificate, Certificate)
    return verdict.certificate


@pytest.mark.parametrize("activation", ["tanh", "softsign", "arctan"])
@pytest.mark.parametrize("seed", range(4))
def test_the_multipliers_of_a_fit_are_a_proof(seed: int, activation: str) -> None:
    """Every fit of the parametrisation is certified without any search, P = I and all."""
    fit = random_fit(seed, n=1 + seed, q=seed, activation=activation, kappa=0.1 * (seed % 2))
    certificate = decided(fit)
    assert certificate.claim == "rate-and-gain"
    assert np.array_equal(certificate.P, np.eye(1 + seed))
    assert certificate.rate is not None
    assert certificate.rate > 0


def hardening(fit: StableFit, count: int) -> StableFit:
    """The fit with s - f(s) in place of its first neurons, written with f."""
    assert fit.M is not None
    hard, A1, M = slice(0, count), fit.A1.copy(), fit.M.copy()
    A1[:, hard] *= -1
    M[hard] *= -1
    return replace(
        fit, A=fit.A + fit.A1[:, hard] @ fit.R[hard], b=fit.b + fit.A1[:, hard] @ fit.beta[hard], A1=A1, M=M,
        P=np.eye(len(fit.A)) + (fit.R[hard].T * fit.M[hard]) @ fit.R[hard],
    )  # fmt: skip


@pytest.mark.parametrize("seed", range(3))
def test_a_fit_that_hardens_is_proved_by_the_integral_of_what_hardens(seed: int) -> None:
    """With s - tanh(s) in place of some neurons M is negative there, P grows by as much, and the proof stands."""
    turned = hardening(random_fit(seed, n=2, q=3), 1 + seed % 2)
    assert np.linalg.eigvalsh(turned.inequality()).min() > 0
    assert decided(turned).claim == "rate-and-gain"


@pytest.mark.parametrize("seed", range(12))
def test_neurons_whose_rows_are_multiples_of_one_are_proved_together(seed: int) -> None:
    """Of one state all rows are multiples of each other: neurons of one group keep multipliers of their own."""
    turned = hardening(random_fit(seed, n=1, q=1 + seed % 4, densities=seed % 3 > 0), seed % 2)
    assert len(certify_fit(turned, ps.OutputModel.from_fit(turned), time_limit=0.0).attempts) == 1
    assert decided(turned).claim == "rate-and-gain"


def test_a_neuron_without_effect_has_no_place_in_the_proof() -> None:
    """Where a column of A1 is zero the others' multipliers are the proof."""
    fit = random_fit(3, n=2, q=3)
    A1 = fit.A1.copy()
    A1[:, 1] = 0.0
    assert fit.M is not None
    assert fit.T is not None
    still = replace(fit, A1=A1)
    kept = replace(fit, R=fit.R[[0, 2]], beta=fit.beta[[0, 2]], A1=fit.A1[:, [0, 2]], M=fit.M[[0, 2]], T=fit.T[[0, 2]])
    assert np.linalg.eigvalsh(kept.inequality()).min() > 0
    assert decided(still).claim == "rate-and-gain"


@pytest.mark.long
def test_a_search_may_better_the_gains() -> None:
    """With time left the certificate with the smaller gain of the output is kept."""
    fit = random_fit(2)
    own, searched = decided(fit), decided(fit, time_limit=30.0)
    assert own.output_gains is not None
    assert searched.output_gains is not None
    assert searched.output_gains[0] <= own.output_gains[0]


def test_a_rate_may_be_asked_for() -> None:
    """A rate that the multipliers allow is kept to, at the price of the gain."""
    fit = random_fit(6)
    usual, fastest = decided(fit), decided(fit, min_rate=np.inf).rate
    assert usual.rate is not None
    assert fastest is not None
    assert fastest > usual.rate
    wanted = 0.9 * fastest + 0.1 * usual.rate
    fast = decided(fit, min_rate=wanted)
    assert fast.rate is not None
    assert fast.rate >= wanted
    assert usual.output_gains is not None
    assert fast.output_gains is not None
    assert fast.output_gains[0] >= usual.output_gains[0]


@pytest.mark.long
def test_wrong_multipliers_prove_nothing() -> None:
    """Multipliers with which the inequality fails are no certificate; then the search alone decides."""
    fit = random_fit(1)
    assert fit.T is not None
    broken = replace(fit, T=-fit.T)
    model = ps.OutputModel.from_fit(broken)
    assert not certify_fit(broken, model, time_limit=0.0).is_certified
    verdict = certify_fit(broken, model, time_limit=30.0)
    assert verdict.is_certified
    assert verdict.attempts[0].outcome == "no certificate"


def test_a_free_fit_is_decided_by_the_search() -> None:
    """Without multipliers the model is certified, or refuted, as any other."""
    fit = replace(random_fit(3), M=None, T=None)
    assert certify_fit(fit, ps.OutputModel.from_fit(fit)).is_certified
    unstable = replace(fit, A=fit.A + 100 * np.eye(2))
    assert isinstance(certify_fit(unstable, ps.OutputModel.from_fit(unstable)), ps.Refuted)


def test_a_fit_without_inputs_or_neurons_is_certified() -> None:
    """m = 0 and q = 0 occur."""
    for how in ({"m": 0}, {"q": 0}, {"m": 0, "q": 0}):
        certificate = decided(random_fit(5, **how))
        assert certificate.output_gains is not None


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_a_proof_goes_along_into_measured_coordinates(seed: int) -> None:
    """In coordinates in which outputs are states, the inequality and the certified bounds of outputs are the same."""
    fit = replace(random_fit(seed, n=3, q=2, outputs=2, kappa=0.05), D=np.zeros((2, 1)))
    mapped = fit.with_states(["y2"])
    assert np.linalg.eigvalsh(mapped.inequality()).min() > 0
    before, after = decided(fit), decided(mapped)
    assert before.output_gains is not None
    assert after.output_gains is not None
    np.testing.assert_allclose(after.output_gains, before.output_gains, rtol=1e-3)
    model = ps.OutputModel.from_fit(mapped)
    np.testing.assert_allclose(model.output(mapped.x0[0])[1], mapped.x0[0, 0])
    first, last = ps.OutputModel.from_fit(fit), np.linspace(0, 3, 31)
    old, new = first.simulate(last, x0=fit.x0[0]), model.simulate(last, x0=mapped.x0[0])
    np.testing.assert_allclose(new[0].x, old[0].x, rtol=1e-6, atol=1e-8)
