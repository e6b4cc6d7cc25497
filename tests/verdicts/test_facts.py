"""Rows that are exactly zero, and facts across channels: springs, chains of masses, networks of equal neurons."""

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

import persid as ps

HOW = "facts across functions, rows that are zero"


def chain(masses: int, f: str, seed: int) -> ps.PersidskiiModel:
    """Masses between springs that harden by f, and dampers, from a wall; a force acts on the last."""
    rng, k = np.random.default_rng(seed), masses
    R = np.eye(k) - np.eye(k, k=-1)
    mass, stiffness, damping, cubic = (rng.uniform(lo, hi, k) for lo, hi in ((0.5, 2), (0.5, 2), (0.3, 1), (0.5, 2)))
    stiff, damped = (-(R.T * w @ R) / mass[:, None] for w in (stiffness, damping))
    A0 = np.block([[np.zeros((k, k)), np.eye(k)], [stiff, damped]])
    column = np.vstack([np.zeros((k, k)), -(R.T * cubic) / mass[:, None]])
    return ps.PersidskiiModel(A0, [(f, np.hstack([R, 0 * R]), column)], np.eye(2 * k)[:, -1:])


def network(f: str, n: int, share: float, seed: int) -> ps.PersidskiiModel:
    """x' = -x + g W f(x) + u, g a share of the value at which the linearisation loses its stability."""
    W = np.random.default_rng(seed).normal(size=(n, n))
    g = share / np.linalg.eigvals(W).real.max()
    return ps.PersidskiiModel(-np.eye(n), [(f, None, g * W)], np.ones((n, 1)))


def turned(model: ps.PersidskiiModel, T: Float[ndarray, "n n"]) -> ps.PersidskiiModel:
    """The model in coordinates T x."""
    back = np.linalg.inv(T)
    terms = [(list(term.f), np.asarray(term.R) @ back, T @ np.asarray(term.A)) for term in model.terms]
    return ps.PersidskiiModel(T @ model.A0 @ back, terms, T @ model.B)


def test_a_mass_on_a_hardening_spring_is_certified_globally() -> None:
    """The cube stands in V' beside the position alone: its row is exactly zero, rate and gain are proved."""
    verdict = ps.certify(chain(1, "x**3", 0))
    assert isinstance(verdict, ps.Certified)
    assert (verdict.certificate.claim, verdict.attempts[-1].what) == ("rate-and-gain", HOW)
    assert verdict.certificate.stated.dropped == (2,)


@pytest.mark.parametrize("f", ["x**3", "sinh(x)"])
@pytest.mark.parametrize("masses", [2, 3])
def test_chains_of_masses_are_certified_globally(masses: int, f: str) -> None:
    """So are chains, whose equations need fractions of many digits."""
    assert ps.certify(chain(masses, f, masses)).is_certified


@pytest.mark.long
@pytest.mark.parametrize("f", ["x**3", "sinh(x)"])
@pytest.mark.parametrize("masses", [4, 5])
def test_long_chains_are_certified_globally(masses: int, f: str) -> None:
    """So are chains of ten states."""
    assert ps.certify(chain(masses, f, masses)).is_certified


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_spring_and_its_twins_have_the_same_figures(sign: float) -> None:
    """Signs of rows and coordinates, the order of states, and units change no verdict, and no rate by 10 %."""
    one = ps.certify(chain(1, "x**3", 0)).certificate
    other = ps.certify(turned(chain(1, "x**3", 0), np.array([[0.0, sign], [4.0, 0.0]]))).certificate
    assert other.rate == pytest.approx(one.rate, rel=0.1)


def test_an_undamped_spring_is_not_certified() -> None:
    """Without damping energy stays, with negative damping it grows: no verdict is 'certified'."""
    for damping in (0.0, 0.5):
        A0 = [[0.0, 1.0], [-1.0, damping]]
        model = ps.PersidskiiModel(A0, [("x**3", [[1.0, 0.0]], [[0.0], [-1.0]])], [[0.0], [1.0]])
        assert not ps.certify(model).is_certified


def test_an_input_in_the_equation_of_the_position_has_no_such_proof() -> None:
    """A force that moves the position directly meets the cube, which the zero row forbids."""
    model = ps.PersidskiiModel([[0, 1], [-1, -0.5]], [("x**3", [[1, 0]], [[0], [-1.0]])], [[1.0], [0.0]])
    assert not ps.certify(model).is_certified


def test_the_certified_rate_and_gain_hold_in_simulation() -> None:
    """Of a chain under a force no run leaves its bound."""
    model = chain(2, "x**3", 2)
    certificate, rng, t = ps.certify(model).certificate, np.random.default_rng(0), np.linspace(0, 30, 301)
    for _ in range(5):
        x0, u = rng.normal(size=4), rng.uniform(-1, 1, (len(t), 1))
        run = model.simulate(x0, t, u)[0]
        assert (np.linalg.norm(run.x, axis=1) <= certificate.bound(x0, 1.0, t) * (1 + 1e-9)).all()


@pytest.mark.long
@pytest.mark.parametrize(("f", "share", "seed"), [("tanh(x)", 0.95, 0), ("tanh(x)", 0.95, 1), ("relu(x)", 1.1, 2)])
def test_networks_of_equal_neurons_are_certified_near_their_limit(f: str, share: float, seed: int) -> None:
    """Products of differences, and of one-signed functions, certify what forms of single neurons leave undecided."""
    verdict = ps.certify(network(f, 8, share, seed))
    assert verdict.is_certified
    assert verdict.attempts[-1].what == HOW


@pytest.mark.parametrize("share", [1.02, 1.5])
def test_networks_beyond_the_linear_limit_are_not_certified(share: float) -> None:
    """Where the linearisation is unstable no fact helps."""
    assert not ps.certify(network("tanh(x)", 6, share, 3)).is_certified


def test_cross_products_of_relu_are_no_proof_where_three_points_rest() -> None:
    """x1' = -x1 - 2 relu(x2) + u1, and symmetric, passes about 0; the checker's claim is about u = 0 alone."""
    model = ps.PersidskiiModel(-np.eye(2), [("relu(x)", None, [[0.0, -2.0], [-2.0, 0.0]])], np.eye(2))
    assert ps.certify(model).is_certified
    assert not ps.certify(model, u_op=[3.0, 3.0]).is_certified


def test_a_speck_of_negative_damping_is_no_exception() -> None:
    """A spring with +7e-9 x2^3 in its damping runs away from far out: it is not certified, and nothing fails."""
    A = [[0.0, 0.0], [-1.0, 7e-9]]
    model = ps.PersidskiiModel([[0, 1], [-1, -0.5]], [("x**3", None, A)], [[0], [1]], b=[0.0, -0.0006])
    assert not ps.certify(model).is_certified


def test_numbers_that_floating_point_does_not_bear_end_without_a_proposal() -> None:
    """Exponentials far from the operating point overflow the search; the verdict is an answer, not an exception."""
    terms = [("exp(x)", [[-1.0, 0.0, 0.0], [1.0, 1.0, 0.0]], [[0.0, -1.5], [-0.9, 0.3], [-1.2, 0.0]])]
    A0 = [[-1.0, 0.7, -0.4], [0.7, -1.4, 0.1], [-0.1, 0.0, -0.9]]
    model = ps.PersidskiiModel(A0, terms, [[0.9], [0.7], [1.3]], [1.4, -1.3, 1.3])
    assert isinstance(ps.certify(model, time_limit=20), ps.Undecided)


def test_a_state_that_no_function_reads_stays_in_the_search() -> None:
    """An oscillator damped through one state alone is asked about without an exception."""
    model = ps.PersidskiiModel(
        [[0.0, 1.0], [-1.0, 0.0]], [("tanh(x)", None, [[-0.1, 0.0], [0.0, 0.0]])], [[1.0], [0.0]]
    )
    assert isinstance(ps.certify(model), ps.Undecided)
