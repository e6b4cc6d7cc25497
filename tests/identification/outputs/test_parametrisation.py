"""Every parameter gives a model with a proof."""

import numpy as np
import pytest
from flint import fmpq, fmpq_mat
from hypothesis import given, settings
from hypothesis import strategies as st

from persid.identification.outputs.latent import Latent
from persid.identification.outputs.parametrisation import Multiplied, Shape, parameters_beside, parameters_of, proved
from persid.identification.outputs.starts import Freedom, stable_batch

SHAPES = [Shape(2, 3, 0.0, 1e-4), Shape(3, 2, 0.1, 1e-4), Shape(1, 1, 0.0, 1e-4), Shape(3, 0, 0.1, 1e-4)]


def exact(matrix: np.ndarray) -> fmpq_mat:
    return fmpq_mat([[fmpq(*float(v).as_integer_ratio()) for v in row] for row in matrix])


def is_positive(Z: fmpq_mat) -> bool:
    leading = [fmpq_mat([[Z[i, j] for j in range(k)] for i in range(k)]).det() for k in range(1, Z.nrows() + 1)]
    return all(minor > 0 for minor in leading)


def inequality(A, A1, R, M, T, kappa) -> fmpq_mat:
    """Return Z of `StableFit`, every product and sum being exact."""
    n, q = A.shape[0], len(M)
    A, A1, R, M, T = exact(A), exact(A1), exact(R), exact(np.diag(M)), exact(np.diag(T))
    kappa, eye = fmpq(*float(kappa).as_integer_ratio()), exact(np.eye(n))
    RM = R.transpose() * M
    corner = (A + A.transpose() + eye * kappa) * fmpq(-1)
    side = (A1 + A.transpose() * RM + R.transpose() * T + RM * kappa) * fmpq(-1)
    last = T * fmpq(2) - RM.transpose() * A1 - A1.transpose() * RM
    rows = [[corner[i, j] for j in range(n)] + [side[i, c] for c in range(q)] for i in range(n)]
    return fmpq_mat(rows + [[side[i, c] for i in range(n)] + [last[c, e] for e in range(q)] for c in range(q)])


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10**6), st.sampled_from(SHAPES[:3]), st.floats(0.1, 1.5))
def test_every_parameter_gives_an_inequality_that_holds_exactly(seed, shape, size):
    """The inequality of a parametrised model is positive definite in exact arithmetic, with the rounded numbers."""
    found, _ = proved(shape, size * np.random.default_rng(seed).normal(size=(1, shape.size)))
    if found.valid[0]:
        parts = (getattr(found, name)[0] for name in ("A", "A1", "R", "M", "T"))
        assert is_positive(inequality(*parts, shape.kappa))


@pytest.mark.parametrize("shape", SHAPES)
def test_derivatives_are_those_of_differences(shape):
    """The chain rule through the parametrisation agrees with central differences."""
    v = 0.4 * np.random.default_rng(1).normal(size=(2, shape.size))

    def flat(v):
        found, _ = proved(shape, v)
        return np.concatenate([part.reshape(2, -1) for part in (found.A, found.A1, found.R)], 1)

    slopes = proved(shape, v)[1]
    expected = np.stack([(flat(v + h) - flat(v - h)) / 2e-6 for h in 1e-6 * np.eye(shape.size)], 1)
    np.testing.assert_allclose(slopes, expected, atol=1e-7 * np.abs(expected).max())


def test_a_stable_linear_model_has_parameters():
    """The parameters of a linear model give it back, its neurons having no effect."""
    rng = np.random.default_rng(2)
    A, shape = -np.eye(3) + 0.3 * rng.normal(size=(3, 3)), Shape(3, 4, 0.0, 1e-4)
    found, _ = proved(shape, parameters_of(shape, A, rng.normal(size=(4, 3)))[None])
    np.testing.assert_allclose(found.A[0], A, atol=1e-12)
    np.testing.assert_allclose(found.A1[0], 0, atol=1e-12)


@pytest.mark.parametrize(("most", "moved"), [(1 - 1e-6, 1e-9), (0.5, 0.5)])
def test_one_neuron_more_leaves_a_model_as_it_was(most: float, moved: float):
    """A proved model keeps its rows and its linear part, its effects give way as asked, and the new one has none."""
    rng = np.random.default_rng(3)
    shape, grown = Shape(3, 2, 0.0, 1e-4), Shape(3, 3, 0.0, 1e-4)
    had, _ = proved(shape, 0.5 * rng.normal(size=(1, shape.size)))
    assert had.valid[0]
    R, A1 = np.vstack([had.R[0], rng.normal(size=(1, 3))]), np.hstack([had.A1[0], np.zeros((3, 1))])
    M, T, idle = np.append(had.M[0], 0.0), np.append(had.T[0], 0.0), np.array([False, False, True])
    found, _ = proved(grown, parameters_beside(grown, Multiplied(had.A[0], A1, R, M, T), idle, most)[None])
    assert found.valid[0]
    assert found.T[0, 2] > 0
    np.testing.assert_allclose(found.A[0], had.A[0], atol=1e-12)
    np.testing.assert_allclose(found.R[0], R, atol=1e-12)
    np.testing.assert_allclose(found.A1[0], A1, atol=moved * np.abs(A1).max())


def test_a_model_that_is_too_slow_has_none():
    """A linear model that does not decay at the rate asked for is refused."""
    with pytest.raises(ValueError, match="not negative"):
        parameters_of(Shape(1, 0, 1.0), np.array([[-0.1]]), np.zeros((0, 1)))


def test_a_start_with_a_pole_ten_thousand_times_slower_than_another_is_reached():
    """The slack of the parametrisation never asks for more decay than a stiff linear model has."""
    A = np.array([[[-5.0, 0.0], [0.0, -1e-4]]])
    O = np.ones((1, 1, 4))  # noqa: E741
    linear = Latent(
        np.concatenate([A, np.ones((1, 2, 2))], 2), np.zeros((1, 0, 3)), O, np.zeros((1, 1, 2)), np.zeros((1, 0, 0))
    )
    parameters, batch, _ = stable_batch(linear, Freedom(True))
    found = parameters.latent(batch)[0].A[0]
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(found)), [-5.0, -1e-4], rtol=1e-6)
