"""Measured residuals against the residual margin: shares, and the doubt where few are inside."""

import numpy as np
import pytest

import persid as ps
from persid.certificates.margin import Margin
from persid.plants.residuals import doubt, inside, measured_residuals

MODEL = ps.PersidskiiModel([[-1.0]], B=[[1.0]], domain=[[-2.0, 2.0]])


@pytest.fixture(scope="module")
def margin() -> Margin:
    """The margin of x' = -x + u on [-2, 2]."""
    found = ps.certify(MODEL).margin
    assert found is not None
    return found


def _data(plant: ps.PersidskiiModel) -> ps.Trajectories:
    t = 0.05 * np.arange(600)
    return plant.simulate([1.5], t, np.sin(t)[:, None])


def test_residuals_of_the_model_itself_are_none(margin: Margin) -> None:
    """On runs of the model the residual is what Simpson's rule leaves, and all windows are inside."""
    found = measured_residuals(MODEL, margin, _data(MODEL))
    assert found.size.max() < 1e-3
    assert found.share(margin.delta) == 1.0
    assert doubt(found, margin) is None


def test_residuals_of_another_plant_are_its_difference(margin: Margin) -> None:
    """Of the plant x' = -1.3 x + u every window says |g| = .3 |x|, in half widths of the data."""
    plant = ps.PersidskiiModel([[-1.3]], B=[[1.0]])
    found = measured_residuals(MODEL, margin, _data(plant))
    far = found.distance > 0.2
    assert np.allclose(found.size[far] / found.distance[far], 0.3, rtol=0.05)
    assert found.epsilon(0.0) == pytest.approx(np.quantile(found.size, 0.95))
    assert "100 % of" in inside(found, margin)


def test_few_windows_inside_make_a_doubt(margin: Margin) -> None:
    """A plant with a constant push of its own is outside the margin near x*, and the certificate is not about it."""
    plant = ps.PersidskiiModel([[-1.0]], B=[[1.0]], b=[4.0])
    found = measured_residuals(MODEL, margin, _data(plant))
    said = doubt(found, margin)
    assert said is not None
    assert "must not be read as one of the plant" in said
