"""Verdicts on models in discrete time: what is certified holds along runs, what is refuted has a witness."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import persid as ps
from persid.errors import PersidError
from persid_check import check


def _model(A0: object, terms: object = (), B: object = None, **more: object) -> ps.PersidskiiModel:
    return ps.PersidskiiModel(A0, terms, B, time="discrete", dt=0.1, **more)


def _network(share: float, n: int = 3, seed: int = 1) -> ps.PersidskiiModel:
    """x+ = W tanh(x) + u, the spectral radius of W a share of 1."""
    W = np.random.default_rng(seed).normal(size=(n, n))
    W *= share / np.abs(np.linalg.eigvals(W)).max()
    return _model(np.zeros((n, n)), [("tanh(x)", None, W)], np.eye(n))


def test_the_gain_of_one_state_is_nearly_the_least() -> None:
    """Of x+ = x/2 + tanh(x)/4 + u the gain is 4 at least, and within 3 % of that; a step leaves less than 1."""
    certificate = ps.certify(_model([[0.5]], [("tanh(x)", None, [[0.25]])], [[1.0]])).certificate
    assert 4 <= certificate.gain < 4.12
    assert 0.75 <= certificate.contraction < 0.9
    assert certificate.rate == pytest.approx(-np.log(certificate.contraction) / 0.1, rel=1e-9)
    assert certificate.is_incremental
    assert json.loads(certificate.data)["format"] == "persid-certificate-2"


def test_the_best_rate_is_nearly_that_of_the_linearisation() -> None:
    """A rate that is asked for close to the eigenvalue's is proved, and told as the best one."""
    model = _model([[0.5, 0.2], [-0.2, 0.5]], (), [[1.0], [0.0]])
    limit = -np.log(np.hypot(0.5, 0.2)) / 0.1
    verdict = ps.certify(model, rate=0.9 * limit)
    assert 0.9 * limit <= verdict.certificate.rate <= limit


@pytest.mark.parametrize("gains", ["joint", "each"])
def test_bounds_hold_along_runs(gains: str) -> None:
    """|x_k - x*| stays below the certificate's bound in each step of runs with inputs of the size that it names."""
    model, rng = _network(0.8), np.random.default_rng(2)
    certificate = ps.certify(model, gains=gains).certificate
    t = 0.1 * np.arange(60)
    for size in (0.0, 0.5, 3.0):
        x0 = 4 * rng.normal(size=3)
        u = size * rng.choice([-1.0, 1.0], (60, 3)) / np.sqrt(3)
        run = model.simulate(x0, t, u)[0]
        sizes = np.full(3, size / np.sqrt(3)) if gains == "each" else size
        assert (np.linalg.norm(run.x, axis=1) <= certificate.bound(x0, sizes, t) * (1 + 1e-12)).all()


def test_any_two_runs_come_together() -> None:
    """Where the certificate is incremental, V of the difference of two runs falls by the share that it states."""
    model, rng = _network(0.8), np.random.default_rng(5)
    certificate = ps.certify(model).certificate
    assert certificate.is_incremental
    t, u = 0.1 * np.arange(30), rng.normal(size=(30, 3))
    d = np.subtract(*(model.simulate(5 * rng.normal(size=3), t, u)[0].x for _ in range(2)))
    V = np.einsum("ki,ij,kj->k", d, certificate.P, d)
    assert (V[1:] <= certificate.contraction**2 * V[:-1] * (1 + 1e-12)).all()


def test_a_region_in_a_box() -> None:
    """x+ = x/2 + x^2/2 is certified on a part of a box; runs from there stay, and its bound holds."""
    model = _model([[0.5]], [("x**2", None, [[0.5]])], [[1.0]])
    assert isinstance(ps.certify(model), ps.Refuted)  # it rests at 1, too
    certificate = ps.certify(model, domain=[[-0.8, 0.8]]).certificate
    assert certificate.claim == "region"
    reach = float(np.sqrt(certificate.level / certificate.P[0, 0]))
    assert 0.6 < reach < 0.8
    t, u = 0.1 * np.arange(40), np.full((40, 1), certificate.input_bound)
    for start in (-0.99 * reach, 0.99 * reach):
        run = model.simulate([start], t, u)[0]
        assert np.abs(run.x).max() <= reach
        assert (np.abs(run.x[:, 0]) <= certificate.bound([start], certificate.input_bound, t)).all()
    with pytest.raises(PersidError, match="region"):
        certificate.bound([0.9], 0.0, [0.0])


def test_an_operating_point_elsewhere() -> None:
    """About the fixed point of another constant input the certificate is about that point, and the bound holds."""
    model = _model([[0.5]], [("tanh(x)", None, [[0.25]])], [[1.0]], b=[0.25])
    certificate = ps.certify(model, u_op=[1.0]).certificate
    x = certificate.operating_point
    assert np.allclose(model.rhs(x, np.array([1.0])), x, atol=1e-12)
    t = 0.1 * np.arange(40)
    run = model.simulate([7.0], t, np.ones((40, 1)))[0]
    assert (np.abs(run.x[:, 0] - x[0]) <= certificate.bound([7.0], 0.0, t)).all()


@pytest.mark.parametrize(
    ("model", "kind"),
    [
        (_model([[0.5]], [("tanh(x)", None, [[1.0]])], [[1.0]]), "two-equilibria"),
        (_model([[-1.1]], [("x**3", None, [[0.0]])], [[1.0]]), "unstable-equilibrium"),
        (_model([[0.0, 1.2], [-1.2, 0.0]], (), [[1.0], [0.0]]), "unstable-equilibrium"),
        (_model([[0.5]], [("tanh(x)", None, [[-1.6]])], [[1.0]]), "unstable-equilibrium"),
        (_model([[1.0]], [("tanh(x)", None, [[-0.5]])], [[1.0]]), "marginal-direction"),
        (_model(np.diag([-1.25, 0.5]), [("tanh(x)", None, np.diag([0.5, 0.0]))], np.eye(2)), "unstable-linear-part"),
    ],
    ids=["bistable", "alternating", "turning", "flipping", "integrator", "far out"],
)  # fmt: skip
def test_what_is_not_stable_is_refuted(model: ps.PersidskiiModel, kind: str) -> None:
    """Several fixed points, unstable ones, integrators that saturate and growth from far out each have a witness."""
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Refuted), verdict
    assert verdict.witness.kind == kind


def test_an_undecided_model_has_evidence() -> None:
    """x+ = x/2 - x^3/4 diverges from far out: no kind of witness says so, simulated steps do."""
    verdict = ps.certify(_model([[0.5]], [("x**3", None, [[-0.25]])], [[1.0]], domain=[[-1.5, 1.5]]))
    assert verdict.is_certified  # in a region, since it has a box of data
    verdict = ps.certify(_model([[0.5]], [("x**3", None, [[-0.25]])], [[1.0]]))
    assert isinstance(verdict, ps.Undecided)
    assert verdict.evidence.diverged > 0
    assert verdict.evidence.time == pytest.approx(0.1 * round(verdict.evidence.time / 0.1))


@pytest.mark.long
@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.3, 1.4))
def test_linear_models_are_decided_by_their_eigenvalues(seed: int, radius: float) -> None:
    """A random linear model is certified where all eigenvalues lie inside the circle and refuted where one is out."""
    A = np.random.default_rng(seed).normal(size=(3, 3))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    if abs(radius - 1) < 0.02:
        return
    verdict = ps.certify(_model(A, (), np.eye(3)))
    assert isinstance(verdict, ps.Certified if radius < 1 else ps.Refuted), (radius, verdict)


def test_terms_without_effect_are_no_obstacle() -> None:
    """A function whose column is zero takes no part, here as in continuous time."""
    model = _model([[0.5]], [("x**3", None, [[0.0]]), ("tanh(x)", None, [[0.25]])], [[1.0]])
    assert ps.certify(model).certificate.gain < 4.2


def test_steps_are_not_rates() -> None:
    """A stable field read as a recursion is not certified because the field is, nor the reverse."""
    terms = [("tanh(x)", None, [[-1.0]])]
    assert ps.certify(ps.PersidskiiModel([[-2.0]], terms, [[1.0]])).is_certified
    assert isinstance(ps.certify(_model([[-2.0]], terms, [[1.0]])), ps.Refuted)
    assert ps.certify(_model([[0.5]], (), [[1.0]])).is_certified
    assert isinstance(ps.certify(ps.PersidskiiModel([[0.5]], (), [[1.0]])), ps.Refuted)


@pytest.mark.parametrize("share", [0.8, 0.95])
def test_products_across_neurons_certify_a_network_that_forms_of_each_leave_undecided(share: float) -> None:
    """A network of four neurons has no V by sectors and slopes of each alone; differences of two give one."""
    model = _network(share, n=4, seed=3)
    verdict = ps.certify(model)
    assert verdict.is_certified
    assert [a.outcome for a in verdict.attempts if a.what.startswith("global Lyapunov function")] == [
        "not_found",
        "not_found",
    ]
    content = json.loads(verdict.certificate.data)
    assert content["facts"]["difference"]
    alone = content["facts"] | {"difference": []}
    assert isinstance(check(json.dumps(content | {"facts": alone}).encode()), ps.Rejected)
    assert verdict.best_rate <= -np.log(share) / 0.1
    t, rng = 0.1 * np.arange(100), np.random.default_rng(0)
    for size in (0.0, 1.0):
        x0, u = 4 * rng.normal(size=4), size * rng.choice([-0.5, 0.5], (100, 4))
        run = model.simulate(x0, t, u)[0]
        assert (np.linalg.norm(run.x, axis=1) <= verdict.certificate.bound(x0, size, t) * (1 + 1e-12)).all()


def _growth(W: np.ndarray) -> float:
    """The largest growth a step of x+ = W relu(x), which is homogeneous, in long runs."""
    x, total = np.random.default_rng(1).normal(size=(2000, len(W))), np.zeros(2000)
    for _ in range(300):
        x = np.maximum(x, 0) @ W.T
        size = np.linalg.norm(x, axis=1) + 1e-300
        x, total = x / size[:, None], total + np.log(size)
    return float(np.exp(total.max() / 300))


@pytest.mark.parametrize("f", ["tanh(x)", "relu(x)"])
@pytest.mark.long
def test_networks_of_equal_neurons_are_certified_near_their_limit(f: str) -> None:
    """Of eight neurons at .95 of the spectral radius 1; none is where the rest state is unstable, or relu grows."""
    for seed in range(3):
        W = np.random.default_rng(seed).normal(size=(8, 8))
        W /= np.abs(np.linalg.eigvals(W)).max()
        limit = 1.0 if f == "tanh(x)" else 1 / _growth(W)
        inside, outside = (_model(np.zeros((8, 8)), [(f, None, g * W)], np.eye(8)) for g in (0.95, 1.03 * limit))
        assert ps.certify(inside).is_certified
        assert not ps.certify(outside).is_certified


def test_a_rate_that_is_asked_for_is_proved_across_neurons() -> None:
    """Rates and gains for each input come from products across neurons, too."""
    model = _network(0.95, n=4, seed=3)
    verdict = ps.certify(model, rate=0.4, gains="each")
    assert 0.4 <= verdict.certificate.rate <= -np.log(0.95) / 0.1
    assert len(verdict.certificate.gains) == 4


def test_strips_are_chosen_in_steps() -> None:
    """x+ = x/2 + x^3 rests at x^2 = 1/2: nearly all between is certified, and runs from the edge come to rest."""
    model = ps.PersidskiiModel([[0.5]], [("x**3", None, [[1.0]])], [[1.0]], time="discrete", dt=1.0)
    found = ps.certify(model, domain="auto").certificate
    edge = float(np.sqrt(found.level / found.P[0, 0]))
    assert (found.claim, 0.99 * 0.5**0.5 < edge < 0.5**0.5) == ("region", True)
    run = model.simulate([0.999 * edge], np.arange(400.0))[0]
    assert (np.abs(run.x[:, 0]) <= found.bound([0.999 * edge], 0.0, run.t)).all()
    assert abs(run.x[-1, 0]) < 1e-6


@pytest.mark.long
def test_runs_stay_in_a_region_of_steps_that_saturate() -> None:
    """Runs from the edge, with the largest inputs that the region allows, stay in it; beyond it some diverge."""
    model = ps.PersidskiiModel([[0.8, 0.5], [-0.4, 1.2]], [("sat(x)", [[0.2888, -0.835]], [[0.0], [1.0]])],
                               [[0.0], [1.0]], time="discrete", dt=1.0)  # fmt: skip
    found, rng = ps.certify(model, domain="auto").certificate, np.random.default_rng(0)
    d = rng.normal(size=(40, 2))
    starts = d * np.sqrt(found.level / found.V(d))[:, None]
    t, u = np.arange(60.0), found.input_bound * rng.choice([-1.0, 1.0], (60, 1))
    runs = model.simulate(0.999 * starts, t, u)
    assert all((found.V(run.x) <= found.level).all() for run in runs)
    assert any(run.diverged_at is not None for run in model.simulate(4 * starts, np.arange(300.0)))
