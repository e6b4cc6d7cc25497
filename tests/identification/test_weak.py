"""The pieces of a fit: integrals over windows, derivatives, Gram matrices, structures, free runs and diagnostics."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from persid.errors import DataError
from persid.identification import diagnostics
from persid.identification.basis import make_basis
from persid.identification.derivatives import embed, local_polynomial
from persid.identification.estimators.weak import window_rows
from persid.identification.free_runs import batch_errors, free_run_score, one_step, score
from persid.identification.gram import accumulate, condition_number, triangle, with_root
from persid.identification.structure import make_structure
from persid.identification.validation import Curve, partition, tail
from persid.identification.windows import choose_window
from persid.measurements.boxes import box_of
from persid.measurements.trajectories import Trajectories
from persid.measurements.trajectory import Trajectory
from persid.models.model import PersidskiiModel


def smooth(t: np.ndarray) -> np.ndarray:
    """Return two smooth signals."""
    return np.column_stack([np.sin(t), np.cos(0.7 * t)])


@pytest.mark.parametrize("window", [2, 4, 8, 32])
@pytest.mark.parametrize("irregular", [False, True])
def test_window_integrals_are_those_of_the_functions(window, irregular):
    """Simpson's rule over windows gives the integral of x and of x**2 to fourth order (third for unequal steps)."""
    rng = np.random.default_rng(0)
    steps = rng.uniform(0.005, 0.015, 300) if irregular else np.full(300, 0.01)
    t = np.concatenate([[0], np.cumsum(steps)])
    data = Trajectories.from_arrays(smooth(t), t=t)
    basis = make_basis(data, ["x", "x**2"], 0.0, 1.0)
    rows = list(window_rows(data[0], None, basis, window, "zoh"))
    found = np.concatenate([phi for phi, _ in rows])
    a, b = t[:-window], t[window:]
    assert np.allclose(found[:, 0], np.cos(a) - np.cos(b), atol=1e-8)
    assert np.allclose(found[:, 1], (np.sin(0.7 * b) - np.sin(0.7 * a)) / 0.7, atol=1e-8)
    assert np.allclose(found[:, 2], (b - a) / 2 - (np.sin(2 * b) - np.sin(2 * a)) / 4, atol=1e-8)
    assert np.allclose(found[:, -1], b - a)


@pytest.mark.parametrize("window", [2, 16])
def test_held_inputs_are_summed_exactly(window):
    """Under "zoh" the integral of an input is the sum of value times step."""
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.1, 0.3, 60))
    u = rng.normal(size=(60, 1))
    data = Trajectories.from_arrays(np.ones((60, 1)) + t[:, None], u, t=t)
    basis = make_basis(data, ["x"])
    phi = np.concatenate([phi for phi, _ in window_rows(data[0], None, basis, window, "zoh")])
    expected = [(u[k : k + window, 0] * np.diff(t[k : k + window + 1])).sum() for k in range(60 - window)]
    assert np.allclose(phi[:, 1], np.array(expected) - basis.u_ref * phi[:, -1], rtol=1e-12)


def test_blocks_do_not_change_the_sums():
    """A run longer than a block gives the Gram matrix of all its windows at once."""
    t = np.arange(9000) * 0.01
    data = Trajectories.from_arrays(smooth(t), np.sin(3 * t), dt=0.01)
    basis = make_basis(data, ["x", "tanh(x)"])
    structure = make_structure(basis)
    whole = accumulate(window_rows(data[0], None, basis, 4, "zoh"), basis, structure)
    cut = [
        accumulate(window_rows(data[0][a:], b - a, basis, 4, "zoh"), basis, structure)
        for a, b in ((0, 5000), (5000, 9000))
    ]
    assert whole.rows == 8996
    assert np.allclose((cut[0] + cut[1]).G, whole.G, rtol=1e-12)
    assert np.allclose((whole - cut[0]).H, cut[1].H, rtol=1e-9, atol=1e-12)


def test_the_window_grows_with_the_noise():
    """Clean data need the shortest window, noisy ones a longer."""
    t = np.arange(4000) * 0.01
    x = smooth(t)
    noisy = x + np.random.default_rng(0).normal(0, 0.005, x.shape)
    assert choose_window(Trajectories.from_arrays(x, dt=0.01)) == 2
    assert choose_window(Trajectories.from_arrays(noisy, dt=0.01)) >= 16


def regression(seed: int, collinear: float = 1.0) -> tuple:
    """Return a Gram of random rows with the rows themselves; column 1 is column 0 plus a small part."""
    rng = np.random.default_rng(seed)
    data = Trajectories.from_arrays(rng.normal(size=(50, 2)), dt=1.0)
    basis = make_basis(data, ["x", "tanh(x)"], 0.0, 1.0)
    phi = rng.normal(size=(200, basis.size)) + 3
    phi[:, 1] = phi[:, 0] + collinear * phi[:, 1]
    phi[:, -1] = 1
    y = rng.normal(size=(200, 2))
    return accumulate([(phi, y)], basis, make_structure(basis)), phi, y


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from([0.0, 1e-6, 1e-2, 1.0]))
def test_ridge_solutions_minimise_their_objective(seed, ridge):
    """theta is the least-squares solution with rows sqrt(ridge) * weights appended, the constant free."""
    gram, phi, y = regression(seed)
    rows = np.diag(np.sqrt(ridge * gram.rows) * gram.weights)
    expected = np.linalg.lstsq(np.vstack([phi, rows]), np.vstack([y, np.zeros((len(rows), 2))]), rcond=None)[0]
    assert np.allclose(gram.solve(ridge), expected, rtol=1e-6, atol=1e-8)


def test_a_triangular_factor_keeps_digits_that_a_gram_matrix_loses():
    """With columns that differ by 1e-9 the QR route finds the coefficients and the Gram matrix alone does not."""
    gram, phi, _ = regression(0, 1e-9)
    truth = np.random.default_rng(1).normal(size=(5, 2))
    exact = accumulate([(phi, phi @ truth)], gram.basis, gram.structure)
    assert condition_number(gram.scaled) > 1e8
    assert np.abs(with_root(exact, triangle([(phi, phi @ truth)])).solve(0.0) - truth).max() < 1e-4
    assert np.abs(exact.solve(0.0) - truth).max() > 1e-2


def test_shared_coefficients_are_one_least_squares_problem():
    """With shared=True the residual is the smallest that equal coefficients allow."""
    rng = np.random.default_rng(0)
    data = Trajectories.from_arrays(rng.normal(size=(60, 3)), dt=1.0)
    basis = make_basis(data, ["x"], 0.0, 1.0)
    structure = make_structure(basis, shared=True)
    phi = np.hstack([rng.normal(size=(100, 3)), np.ones((100, 1))])
    y = rng.normal(size=(100, 3))
    theta = accumulate([(phi, y)], basis, structure).solve(0.0)
    assert theta[0, 0] == theta[1, 1] == theta[2, 2]
    assert theta[1, 0] == theta[2, 1]
    design = np.zeros((300, structure.count))
    for i in range(3):
        for j in range(4):
            design[100 * i : 100 * (i + 1), structure.parameter[j, i]] += phi[:, j]
    expected = np.linalg.lstsq(design, y.T.ravel(), rcond=None)[0]
    assert np.allclose(theta, expected[structure.parameter])


def test_derivatives_are_exact_for_cubics():
    """Local cubics differentiate a cubic exactly, at unequal steps and at the ends."""
    t = np.cumsum(np.random.default_rng(0).uniform(0.05, 0.15, 40))
    x = np.column_stack([t**3 - 2 * t, 1 + t**2])
    value, slope = local_polynomial(t, x, 4)
    assert np.allclose(value, x, atol=1e-9)
    assert np.allclose(slope, np.column_stack([3 * t**2 - 2, 2 * t]), atol=1e-7)


def test_embeddings_align_states_with_their_past():
    """Row k of the delayed copies is row k - 1, k - 2 … of the measured states; inputs and times go along."""
    data = Trajectories.from_arrays(np.arange(20.0).reshape(10, 2), np.arange(10.0), dt=1.0)
    run = embed(data, delays=2)[0]
    assert run.x[0].tolist() == [4, 5, 2, 3, 0, 1]
    assert (run.t[0], run.u[0, 0], len(run)) == (2, 2, 8)
    with pytest.raises(DataError, match="delays"):
        embed(data, delays=9)


def test_scores_speak_of_states_and_of_all_together():
    """Two states about different means flatter the pooled R2."""
    truth = np.column_stack([np.sin(np.arange(50.0)), 100 + np.sin(np.arange(50.0))])
    found = score(truth, truth + 0.5 * np.cos(np.arange(50.0))[:, None])
    assert found.r2 > 0.999
    assert found.r2_mean < 0.8
    assert found.rmse == pytest.approx(0.5 / np.sqrt(2), rel=0.02)


def test_batched_free_runs_agree_with_simulations():
    """The validating Runge-Kutta runs of many candidates give the error of the accurate simulation."""
    model = PersidskiiModel([[-1, 0.5], [-0.3, -1]], [("tanh(x)", None, [[-0.5, 0], [0, -0.4]])], [[1.0], [0.2]])
    t = np.arange(300) * 0.02
    u = np.random.default_rng(0).normal(size=(300, 1))
    data = model.simulate([1, -1], t, u)
    basis = make_basis(data, ["x", "tanh(x)"], 0.0, 1.0)
    theta = basis.coefficients(model)
    other = theta * 1.1
    errors, out = batch_errors(basis, np.stack([theta, other])[None], [data[0]], box_of(data), "zoh")
    guess = basis.model(other).simulate([1, -1], t, u)[0].x
    width = np.diff(box_of(data), axis=1)[:, 0]
    expected = (((guess - data[0].x)[1:] / width) ** 2).mean()
    assert errors[0, 0] < 1e-10
    assert errors[0, 1] == pytest.approx(expected, rel=1e-3)
    assert not out.any()


def test_blow_ups_are_counted_and_cost_a_bounded_error():
    """A candidate that blows up is marked, and its error stays finite."""
    run = Trajectory(np.arange(100) * 0.1, np.ones((100, 1)) + np.arange(100)[:, None] * 1e-3, np.zeros((100, 0)))
    data = Trajectories((run,), ("x",), ())
    basis = make_basis(data, ["x", "x**3"], 0.0, 1.0)
    theta = np.array([[[[0.0], [0.0], [0.01]], [[5.0], [5.0], [0.0]]]])
    errors, out = batch_errors(basis, theta, [run], box_of(data), "zoh")
    assert out.tolist() == [[False, True]]
    assert np.isfinite(errors).all()
    found = free_run_score(basis.model(theta[0, 1]), data)
    assert found.blow_ups == 1
    assert np.isfinite(found.rmse)


def test_one_step_predictions_are_runge_kutta_steps():
    """Predicting the next sample from each one agrees with the simulation that made them."""
    model = PersidskiiModel([[-1.0]], [("x**3", None, [[-0.2]])], [[1.0]])
    data = model.simulate([1.0], np.arange(50) * 0.05, np.ones((50, 1)))
    assert np.allclose(one_step(model, data[0], "zoh")[:-1], data[0].x[1:], atol=1e-7)


def test_parts_cover_every_sample_once():
    """Blocks and tails are a partition of the runs, tails at the end, and many runs are left out whole."""
    one = Trajectories.from_arrays(np.zeros((103, 1)), dt=1.0)
    parts = partition(one, 0.2)
    assert [(p.start, p.stop) for p in parts] == [(0, 16), (16, 33), (33, 49), (49, 66), (66, 83), (83, 103)]
    assert len(tail(one, parts, 5000, 20)[0]) == 20
    many = partition(one.split(8), 0.0)
    assert len(many) == 8
    assert {p.fold for p in many} == set(range(5))


def test_the_strongest_of_equally_good_ridges_is_taken():
    """Within 2 % of the best error, more regularisation is better."""
    curve = Curve((1e-4, 1e-3, 1e-2, 1e-1), (1.0, 1.005, 1.01, 2.0), (0.0, 0.0, 0.0, 0.5))
    assert curve.best == 1e-2
    assert "blow-ups" in str(curve)


def test_diagnostics_tell_white_from_coloured_and_free_from_fed_back():
    """Whiteness bounds hold for white noise and fail for a random walk; an input made of states has no free share."""
    rng = np.random.default_rng(0)
    white = rng.normal(size=(500, 1))
    value, bound = diagnostics.whiteness(white)[0]
    assert value < bound < diagnostics.whiteness(np.cumsum(white, axis=0))[0][0]
    x = rng.normal(size=(500, 2))
    u = np.column_stack([x @ [1.0, -2.0], rng.normal(size=500)])
    data = Trajectories.from_arrays(x, u, dt=1.0)
    basis = make_basis(data, ["x"])
    phi = np.hstack([basis.values(x), u - basis.u_ref, np.ones((500, 1))])
    moved = diagnostics.excitation(data, accumulate([(phi, x)], basis, make_structure(basis)))
    assert moved[0].free_share < 1e-6
    assert moved[1].free_share > 0.9
