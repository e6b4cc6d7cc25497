"""The paper's road: EDMD, the generator and its refusals, and both readings of Gamma."""

import resource
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from persid.errors import DataError, GeneratorError
from persid.identification.basis import make_basis
from persid.identification.identifier import PersidskiiIdentifier
from persid.identification.koopman import (
    edmd,
    elementary_generators,
    extract,
    gamma,
    index_matrices,
    koopman_generator,
    make_lifting,
    sample_step,
)
from persid.measurements.trajectories import Trajectories
from persid.models.model import PersidskiiModel

A = np.array([[-0.5, 0.3, 0.0], [-0.2, -0.4, 0.1], [0.1, 0.0, -0.8]])
B = np.array([[1.0], [0.5], [-0.3]])
DT = 0.2


def linear_data(seed: int = 0, count: int = 400) -> Trajectories:
    """Simulate x' = A x + B u exactly, the input white and held."""
    u = np.random.default_rng(seed).normal(size=(count, 1))
    step = expm(np.block([[A, B], [np.zeros((1, 4))]]) * DT)
    x = [np.ones(3)]
    for k in range(count - 1):
        x.append((step @ np.concatenate([x[-1], u[k]]))[:3])
    return Trajectories.from_arrays(np.array(x), u, dt=DT)


def nonlinear_data(count: int = 2000, dt: float = 0.02) -> Trajectories:
    """Simulate a small model with a smooth input, from several starts."""
    model = PersidskiiModel([[-1, 0.5], [-0.3, -1]], [("tanh(x)", None, [[-0.5, 0.2], [0, -0.4]])], [[1.0], [0.2]])
    t = np.arange(count) * dt
    u = (np.sin(1.3 * t) + np.sin(0.37 * t))[:, None]
    runs = [model.simulate(start, t, u)[0] for start in ([1, -1], [-2, 1], [0, 2])]
    return Trajectories(tuple(runs), model.states, model.inputs)


def test_edmd_of_a_linear_system_is_the_matrix_exponential():
    """With coordinates, held inputs and 1 as lifting functions, K is the exact step and log K the exact system."""
    data = linear_data()
    basis = make_basis(data, ["x"], 0.0, 1.0)
    K = edmd(data, make_lifting(basis))
    block = np.zeros((5, 5))
    block[:3, :3], block[:3, 3:4] = A, B
    assert np.allclose(K.T, expm(block * DT), atol=1e-11)
    assert np.allclose(koopman_generator(K, DT).T, block, atol=1e-9)


def test_the_estimator_gives_the_linear_system():
    """PersidskiiIdentifier(method="edmd") returns A and B."""
    model = PersidskiiIdentifier(["x"], method="edmd").fit(linear_data()).model_
    assert np.allclose(model.A0, A, atol=1e-9)
    assert np.allclose(model.B, B, atol=1e-9)


def test_ill_conditioned_liftings_are_solved_by_qr():
    """A lifting function that is nearly another one leaves the exact step intact."""
    data = linear_data()
    small = Trajectories.from_arrays(data[0].x * [1.0, 1e-9, 1.0], data[0].u, dt=DT)
    shifted = Trajectories.from_arrays(small[0].x + np.array([1e8, 0, 0]), data[0].u, dt=DT)
    basis = make_basis(shifted, ["x"], 0.0, 1.0)
    K = edmd(shifted, make_lifting(basis))
    psi = make_lifting(basis).values(shifted[0].x[:-1], shifted[0].u[:-1])
    assert np.allclose(psi @ K[:, 2], shifted[0].x[1:, 2], atol=1e-5)


def test_an_input_that_never_varies_is_refused():
    """A lifting that the samples do not determine is an error that counts what they determine."""
    data = Trajectories.from_arrays(linear_data()[0].x, np.ones((400, 1)), dt=DT)
    with pytest.raises(DataError, match="only 4 of 5"):
        edmd(data, make_lifting(make_basis(data, ["x"], 0.0, 1.0)))


@pytest.mark.parametrize(
    ("eigenvalues", "words"),
    [
        ([1.0, 0.9, -0.2], "-0.2 is real and negative"),
        ([1.0, 0.9, 0.0], "cannot be told from 0"),
        ([1.0, 0.9, 1e-14], "cannot be told from 0"),
    ],
)
def test_untrustworthy_logarithms_are_refused_by_name(eigenvalues, words):
    """Zero and negative eigenvalues are named, the spectrum is described and the alternative offered."""
    T = np.array([[1.0, 0.4, 0.1], [0.2, 1.0, 0.3], [0, 0.5, 1.0]])
    with pytest.raises(GeneratorError, match=words) as error:
        koopman_generator(T @ np.diag(eigenvalues) @ np.linalg.inv(T), 0.1)
    assert "3 eigenvalues" in str(error.value)
    assert 'method="weak"' in str(error.value)


def test_aliasing_is_refused():
    """A mode that turns nearly half a circle a sample is named as aliasing."""
    angle = 0.95 * np.pi
    K = 0.9 * np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    with pytest.raises(GeneratorError, match="aliasing"):
        koopman_generator(K, 0.1)
    slow = 0.9 * np.array([[np.cos(1.0), -np.sin(1.0)], [np.sin(1.0), np.cos(1.0)]])
    assert np.allclose(expm(koopman_generator(slow, 0.1) * 0.1), slow)


def test_regressed_inputs_are_judged_by_their_sampling_error():
    """An eigenvalue of 0.02 from 1e5 pairs is refused under hold="paper" and accepted under hold="zoh"."""
    K = np.diag([1.0, 0.9, 0.02])
    with pytest.raises(GeneratorError, match=r"limit 0\.032"):
        koopman_generator(K, 0.1, samples=100_000, hold="paper")
    assert koopman_generator(K, 0.1, samples=100_000)[2, 2] == pytest.approx(np.log(0.02) / 0.1)


def test_noisy_measurements_are_refused_by_their_sampling_error():
    """An eigenvalue that noise has made small or negative is within its sampling error of 0, and is refused."""
    data = nonlinear_data(300)
    for seed in range(4):
        rng = np.random.default_rng(seed)
        runs = [run.x + rng.normal(0, 0.6, run.x.shape) for run in data]
        noisy = Trajectories.from_arrays(runs, [run.u for run in data], t=[run.t for run in data])
        with pytest.raises(GeneratorError, match=r"cannot be told from 0|negative"):
            PersidskiiIdentifier(["x", "x**3", "tanh(x)"], method="edmd").fit(noisy)


@pytest.mark.long
def test_white_held_inputs_need_zoh():
    """With a white held input every coefficient is right under "zoh" and the fit is refused under "paper"."""
    truth = PersidskiiModel([[-1, 0.4], [-0.3, -0.8]], [("tanh(x)", None, [[-0.5, 0.2], [0.1, -0.6]])], [[1.0], [0.5]])
    t = np.arange(8_000) * 0.01
    u = 3 * np.random.default_rng(0).normal(size=(len(t), 1))
    data = truth.simulate([1, -1], t, u, rtol=1e-6, atol=1e-9)
    found = PersidskiiIdentifier(["x", "tanh(x)"], method="edmd", scale=1.0).fit(data).model_
    assert np.allclose(found.A0, truth.A0, rtol=2e-3, atol=1e-3)
    assert np.allclose(found.terms[0].A, truth.terms[0].A, rtol=2e-3, atol=1e-3)
    assert np.allclose(found.B, truth.B, rtol=2e-3)
    with pytest.raises(GeneratorError, match="cannot be told from 0"):
        PersidskiiIdentifier(["x", "tanh(x)"], method="edmd", hold="paper", scale=1.0).fit(data)


@settings(max_examples=25, deadline=None)
@given(st.integers(1, 4), st.integers(1, 3), st.integers(1, 3), st.integers(0, 99))
def test_the_papers_index_matrices_are_a_reshape(n, m, M, seed):
    """E_j' and B~ as printed pick the same numbers as a plain reshape."""
    vector = np.random.default_rng(seed).normal(size=(n + m) * (n * M + m))
    E, Bt = index_matrices(n, m, M)
    Gammas, B = extract(vector, n, m, M)
    for j in range(M):
        assert np.array_equal((E[j] @ vector).reshape(n, n, order="F").T, Gammas[j])
    assert np.array_equal((Bt @ vector).reshape(m, n, order="F").T, B)


def test_the_literal_reading_is_the_pseudoinverse_over_all_of_L():
    """State by state or as one stacked problem, eq:Gamma_cal gives the same Gamma."""
    data = nonlinear_data(300)
    basis = make_basis(data, ["x", "tanh(x)"], 0.0, 1.0)
    lifting = make_lifting(basis)
    L = koopman_generator(edmd(data, lifting), sample_step(data))
    x, u = (np.concatenate([getattr(run, name) for run in data]) for name in ("x", "u"))
    elementary = elementary_generators(lifting, x, u)
    stacked = elementary.reshape(-1, lifting.size**2).T
    whole = (np.linalg.pinv(stacked, rcond=1e-12) @ L.ravel()).reshape(3, basis.size)
    assert np.allclose(gamma(L, lifting, x, u, "literal"), whole[:2], atol=1e-6)


def test_elementary_generators_represent_the_operator():
    """On a lifting that is invariant, sum lambda_ij L_ij,rep is the generator (eq. L_rep_sum)."""
    data = linear_data()
    basis = make_basis(data, ["x"], 0.0, 1.0)
    lifting = make_lifting(basis)
    elementary = elementary_generators(lifting, data[0].x, data[0].u)
    coefficients = np.zeros(elementary.shape[:2])
    coefficients[:3, :3], coefficients[:3, 3:4] = A, B
    L = koopman_generator(edmd(data, lifting), DT)
    assert np.allclose(np.einsum("cp,cpkl->kl", coefficients, elementary), L, atol=1e-8)


def test_both_readings_find_the_coefficients_of_invariant_liftings():
    """Where the lifting is invariant, literal and coordinate readings agree with the truth."""
    for reading in ("coordinates", "literal"):
        fit = PersidskiiIdentifier(["x"], method="edmd", gamma=reading).fit(linear_data())
        assert np.allclose(fit.model_.A0, A, atol=1e-8)


@pytest.mark.long
def test_further_lifting_functions_are_projected_on_the_basis():
    """`lifting=` enlarges the lifting but not the model."""
    data = nonlinear_data()
    fit = PersidskiiIdentifier(["x", "tanh(x)"], method="edmd", lifting=["x**3"], hold="paper", scale=1.0).fit(data)
    assert len(fit.model_.terms) == 1
    assert np.allclose(fit.model_.A0, [[-1, 0.5], [-0.3, -1]], atol=0.15)


def test_functions_of_states_and_inputs_can_be_lifted():
    """A bilinear system is exact with x u among the lifting functions, held inputs being paired with both states."""
    rng = np.random.default_rng(0)
    u, dt = rng.uniform(-1, 1, size=(500, 1)), 0.1
    x = [np.array([1.0])]
    for k in range(499):
        rate = -1 + 0.5 * u[k, 0]
        x.append((x[-1] + u[k] / rate) * np.exp(rate * dt) - u[k] / rate)
    data = Trajectories.from_arrays(np.array(x), u, dt=dt)
    lifting = make_lifting(make_basis(data, ["x"], 0.0, 1.0), lambda x, u: np.hstack([x * u, x * u**2, u**2, u**3]))
    L = koopman_generator(edmd(data, lifting), dt)
    assert L[:2, 0] == pytest.approx([-1, 0.5], abs=2e-3)
    assert L[5, 0] == pytest.approx(1, abs=2e-3)
    fit = PersidskiiIdentifier(["x"], method="edmd", lifting=lambda x, u: x * u).fit(data)
    assert fit.model_.A0[0, 0] == pytest.approx(-1, abs=0.2)
    with pytest.raises(DataError, match="coordinates"):
        PersidskiiIdentifier(["x"], method="edmd", lifting=lambda x, u: x * u, gamma="literal").fit(data)


def test_unequal_steps_are_refused():
    """EDMD says that it needs equal steps and what to use instead."""
    run = linear_data()[0]
    data = Trajectories.from_arrays(run.x, run.u, t=run.t + 0.05 * np.sin(np.arange(400)))
    with pytest.raises(DataError, match='method="weak"'):
        PersidskiiIdentifier(["x"], method="edmd").fit(data)


LARGE = """
import numpy as np
from persid.identification.identifier import PersidskiiIdentifier
from persid.measurements.trajectories import Trajectories
n, dt, runs, count = 100, 0.01, 200, 30
A = -np.eye(n) + 0.5 * np.eye(n, k=1)
rng = np.random.default_rng(0)
x, u = rng.uniform(-2, 2, (runs, n)), rng.normal(size=(runs, count, 1))
states = np.empty((runs, count, n))
for k in range(count):
    states[:, k] = x
    x = x + dt * (x @ A.T - 0.3 * np.tanh(x) + u[:, k])
fit = PersidskiiIdentifier(["x", "x**3", "sin(x)", "tanh(x)"], method="edmd", holdout=0.0)
fit.fit(Trajectories.from_arrays(list(states), list(u), dt=dt))
print(fit.coef_.shape)
"""


@pytest.mark.long
def test_four_hundred_functions_fit_in_two_gibibytes():
    """A lifting of 400 functions of 100 states works in the `coordinates` reading within 2 GiB."""
    limit = (2 << 30, 2 << 30)
    done = subprocess.run(
        [sys.executable, "-c", LARGE],
        capture_output=True, text=True, check=False,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_AS, limit),
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("(100, 402)")
