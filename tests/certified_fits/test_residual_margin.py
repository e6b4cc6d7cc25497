"""Fits under the condition that plants near the model are certified with it."""

import pytest

import persid as ps
from persid.errors import DataError


@pytest.mark.long
def test_a_fit_has_the_margin_that_is_asked_for() -> None:
    """Of the example of traffic a fit shows exactly the margin asked for, about as good as one without it."""
    data = ps.read_csv("examples/traffic.csv", time="t", states=["x1", "x2"], inputs=["u"])
    free = ps.PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-4)
    best = ps.CertifiedIdentifier(free, ridge=1e-4, residual_margin=0.3).fit(data)
    assert isinstance(best.verdict_, ps.Certified)
    margin = best.verdict_.margin
    assert margin is not None
    assert 0.3 <= margin.delta <= min(margin.radius, margin.resting)
    assert isinstance(ps.check(margin.certificate, best.model_), ps.Accepted)
    assert best.score(data) > 0.9


def test_a_margin_is_a_positive_number() -> None:
    """Nothing else is taken for a margin."""
    with pytest.raises(DataError, match="residual_margin=-1"):
        ps.CertifiedIdentifier(residual_margin=-1.0).fit([[0.0], [1.0]], dt=1.0)
