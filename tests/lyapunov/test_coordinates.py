"""Coordinates of the states in which a search bears what companion forms do to it."""

import numpy as np
import pytest

import persid as ps
from persid.lyapunov.coordinates import Coordinates
from persid.lyapunov.shifted_model import Setting
from published_problems import BY_NAME, Slope


def test_schur_coordinates_are_of_the_size_of_the_poles() -> None:
    """In companion form the coefficients are the products of all poles; turned they are not larger than their sum."""
    poles = np.array([-1.0, -3.0, -10.0, -30.0, -100.0])
    companion = np.diag(np.ones(4), -1)
    companion[0] = -np.poly(poles)[1:]
    system = Setting.of(ps.PersidskiiModel(companion, [("tanh(x)", np.eye(5)[:1], np.eye(5)[:, :1])]), None).system
    found = Coordinates.of(system, companion)
    assert found is not None
    turned = found.turned.G[:, :5]
    assert np.sort(np.linalg.eigvals(turned).real) == pytest.approx(np.sort(poles), rel=1e-6)
    assert np.abs(turned).max() < 200 < 1e4 < np.abs(companion).max()


def test_a_channel_reads_the_same_in_other_coordinates() -> None:
    """Rows of groups turn with the states, columns and inputs with the equations."""
    rng = np.random.default_rng(0)
    A0, R, A, B = -2 * np.eye(3) + rng.normal(size=(3, 3)) / 4, *rng.normal(size=(2, 1, 3)), rng.normal(size=(3, 1))
    system = Setting.of(ps.PersidskiiModel(A0, [("tanh(x)", R, A.T)], B), None).system
    found = Coordinates.of(system, A0)
    assert found is not None
    x = rng.normal(size=3)
    turned = found.turned
    assert turned.groups[0].row @ (found.S @ x) == pytest.approx(system.groups[0].row @ x)
    assert turned.G[:, 3:] == pytest.approx(found.S @ system.G[:, 3:])
    assert pytest.approx(found.S @ system.B) == turned.B


@pytest.mark.long
def test_a_plant_in_companion_form_is_certified_as_in_good_coordinates() -> None:
    """Of seven states with coefficients up to 8e6 rate and gain are proved at 5.8; the search stalled at 4.7."""
    problem = BY_NAME["plant of seven states"]
    assert isinstance(problem, Slope)
    assert ps.certify(problem.family(5.8)).certificate.claim == "rate-and-gain"
