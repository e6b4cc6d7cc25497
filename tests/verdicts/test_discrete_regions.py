"""Regions that the search chooses, and balls, in discrete time: models whose truth is known, and forged files."""

import json
from typing import Any

import numpy as np
import pytest

import persid as ps
from persid_check import Accepted, check, model_sha256

CUBE = ps.PersidskiiModel([[0.5]], [("x**3", None, [[-1.0]])], [[1.0]], time="discrete", dt=0.1)  # |x|^2 < 1.5 returns
LOGISTIC = ps.PersidskiiModel([[1.6]], [("x**2", None, [[-0.8]])], [[1.0]], time="discrete", dt=1.0)  # 0 < x < 2
PENDULUM = ps.PersidskiiModel(
    [[1.0, 0.1], [0.0, 0.9]], [("sin(x)", [[1.0, 0.0]], [[0.0], [-0.1]])], [[0.0], [0.1]], time="discrete", dt=0.1
)
WELL = ps.PersidskiiModel([[0.8]], [("tanh(x)", [[3.0]], [[0.3]])], [[1.0]], time="discrete", dt=0.1)
SPIRAL = ps.PersidskiiModel(
    [[0.5, 0.2], [-0.2, 0.5]], [("tanh(x)", [[3.0, 0.0]], [[0.4], [0.1]])], [[1.0], [0.0]], time="discrete", dt=0.1
)


def steps(model: ps.PersidskiiModel, x: np.ndarray, u: np.ndarray) -> np.ndarray:
    """All states of a run from x with inputs u, one a step."""
    found = [x]
    for v in u:
        found.append(np.asarray(model.rhs(found[-1], v)))
    return np.array(found)


def edge(certificate: ps.Certificate, direction: np.ndarray) -> np.ndarray:
    """Just inside the level set, from the operating point."""
    low, high, at = 0.0, 1e3, certificate.operating_point
    for _ in range(80):
        middle = (low + high) / 2
        inside = certificate.V((at + middle * direction)[None])[0] <= certificate.level
        low, high = (middle, high) if inside else (low, middle)
    return np.asarray(at + 0.999 * low * direction)


@pytest.mark.parametrize(
    ("model", "ends"), [(CUBE, (-np.sqrt(1.5), np.sqrt(1.5))), (LOGISTIC, (0.0, 2.0))], ids=["cube", "logistic"]
)
def test_a_region_reaches_nearly_where_runs_no_longer_return(
    model: ps.PersidskiiModel, ends: tuple[float, float]
) -> None:
    """Within 1 % of the nearer end of the basin, which is known, and never beyond it."""
    certificate = ps.certify(model, domain="auto").certificate
    assert certificate.claim == "region"
    assert "in discrete time" in certificate.statement
    at = certificate.operating_point[0]
    reach = [edge(certificate, np.array([sign]))[0] for sign in (-1.0, 1.0)]
    assert ends[0] < reach[0] < reach[1] < ends[1]
    nearer = min(at - ends[0], ends[1] - at)
    assert max(at - reach[0], reach[1] - at) > 0.98 * nearer


@pytest.mark.parametrize("model", [CUBE, LOGISTIC, PENDULUM], ids=["cube", "logistic", "pendulum"])
def test_runs_from_the_edge_of_a_chosen_region_stay_in_it(model: ps.PersidskiiModel) -> None:
    """With inputs as large as it allows, within its bound at every step."""
    certificate = ps.certify(model, domain="auto", rate=None).certificate
    rng = np.random.default_rng(0)
    for _ in range(8):
        d = rng.normal(size=model.n)
        x0 = edge(certificate, d / np.linalg.norm(d))
        u = certificate.input + certificate.input_bound * rng.choice([-1.0, 1.0], size=(200, 1))
        run = steps(model, x0, u)
        assert (certificate.V(run) <= certificate.level * (1 + 1e-6)).all()
        away = np.linalg.norm(run - certificate.operating_point, axis=1)
        t = np.arange(len(run)) * model.dt
        assert (away <= certificate.bound(x0, certificate.input_bound, t) * (1 + 1e-6)).all()


def test_where_all_states_are_certified_no_region_is_sought() -> None:
    """As in continuous time."""
    model = ps.PersidskiiModel([[0.5]], [("tanh(x)", None, [[0.2]])], [[1.0]], time="discrete", dt=0.1)
    assert ps.certify(model, domain="auto").certificate.scope == "global"


def test_a_rate_that_is_asked_for_in_a_region_is_kept() -> None:
    """At the rate of 1 1/s the region of the cube is smaller, and has that rate."""
    free, fast = (ps.certify(CUBE, domain="auto", rate=rate).certificate for rate in (None, 1.0))
    assert fast.rate >= 1.0
    assert edge(fast, np.ones(1))[0] < edge(free, np.ones(1))[0]


def test_about_an_unstable_fixed_point_there_is_no_region() -> None:
    """The reason is the linearisation."""
    model = ps.PersidskiiModel([[1.2]], [("x**3", None, [[0.1]])], [[1.0]], time="discrete", dt=0.1)
    verdict = ps.certify(model, domain="auto")
    assert isinstance(verdict, ps.Undecided)
    assert "not exponentially stable" in verdict.detail


@pytest.mark.parametrize(
    ("model", "least", "most"), [(WELL, 1.499, 1.95), (SPIRAL, 0.747, 1.05)], ids=["well", "spiral"]
)
def test_a_ball_holds_where_all_runs_end(model: ps.PersidskiiModel, least: float, most: float) -> None:
    """Several fixed points lie in it; runs with and without inputs keep the bound from everywhere, at every step."""
    assert isinstance(ps.certify(model), ps.Refuted)
    certificate = ps.certify(model, claim="practical").certificate
    assert certificate.claim == "practical"
    assert least <= certificate.spread <= most
    rng = np.random.default_rng(0)
    for size in (0.1, 1.0, 10.0, 100.0):
        x0, push = size * rng.normal(size=model.n), size * rng.uniform(-0.2, 0.2)
        run = steps(model, x0, np.full((120, 1), push))
        away = np.linalg.norm(run - model.x_ref, axis=1)
        assert (away <= certificate.bound(x0, abs(push), np.arange(len(run)) * model.dt)).all()


def test_what_escapes_in_steps_has_no_ball() -> None:
    """An unstable linear part that bounded functions do not hold, and an integrator."""
    for a in (1.1, 1.0):
        model = ps.PersidskiiModel([[a]], [("tanh(x)", None, [[-0.2]])], [[1.0]], time="discrete", dt=0.1)
        assert isinstance(ps.certify(model, claim="practical"), ps.Refuted)


@pytest.mark.long
def test_balls_of_random_steps_hold_their_runs() -> None:
    """Of models of one to three states with tanh of large gain that are not certified otherwise."""
    found = 0
    for seed in range(10):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 4))
        A = rng.normal(size=(n, n))
        A *= 0.6 / np.abs(np.linalg.eigvals(A)).max()
        term = ("tanh(x)", 3 * rng.normal(size=(1, n)), rng.normal(size=(n, 1)))
        model = ps.PersidskiiModel(A, [term], np.eye(n, 1), time="discrete", dt=1.0)
        verdict = ps.certify(model, claim="practical", time_limit=10)
        if not (verdict.is_certified and verdict.certificate.claim == "practical"):
            continue
        found += 1
        for _ in range(5):
            x0 = 10 * rng.normal(size=n)
            run = steps(model, x0, rng.uniform(-1, 1, (60, 1)))
            bound = verdict.certificate.bound(x0, 1.0, np.arange(61.0))
            assert (np.linalg.norm(run - model.x_ref, axis=1) <= bound).all(), seed
    assert found >= 3


FORGED: list[tuple[str, tuple[Any, ...], Any]] = [
    ("ball", ("kappa",), [1, 0]),
    ("ball", ("kappa",), [15, -4]),
    ("ball", ("p",), [1, 8]),
    ("ball", ("gamma",), [1, -20]),
    ("ball", ("facts", "constant"), []),
    ("ball", ("curves", 0, "products", 0, 2), [1, -30]),
    ("ball", ("claim",), "rate-and-gain"),
    ("ball", ("model", "A0", 0, 0), (0.99).hex()),
    ("region", ("kappa",), [15, -4]),
    ("region", ("level",), [3, 0]),
    ("region", ("input_bound",), [1, 0]),
    ("region", ("p",), [1, 8]),
    ("region", ("curves", 0, "domain"), [[-2, 0], [2, 0]]),
    ("region", ("curves", 0, "domain"), None),
    ("region", ("model", "terms", 0, "A", 0, 0), (-2.0).hex()),
    ("region", ("claim",), "rate-and-gain"),
]


@pytest.fixture(scope="module")
def contents() -> dict[str, str]:
    """The files of the well's ball and the cube's region."""
    ball, region = ps.certify(WELL, claim="practical"), ps.certify(CUBE, domain="auto")
    return {"ball": json.dumps(ball.certificate.content), "region": json.dumps(region.certificate.content)}


@pytest.mark.parametrize(("kind", "path", "value"), FORGED)
def test_a_forged_ball_or_region_of_steps_is_refused(
    contents: dict[str, str], kind: str, path: tuple[Any, ...], value: Any
) -> None:
    """Rates, levels, constants, domains and models that the proof does not hold for."""
    content = json.loads(contents[kind])
    at = content
    for key in path[:-1]:
        at = at[key]
    assert at[path[-1]] != value
    at[path[-1]] = value
    content["model_sha256"] = model_sha256(content["model"])
    assert not isinstance(check(json.dumps(content).encode()), Accepted)
