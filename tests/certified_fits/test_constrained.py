"""Fitting under the certificate."""

import json
import re
import sys
from functools import cache

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.base import clone

import persid_check
from persid._dyadics import value
from persid.certified_fits.barrier import State, derivatives
from persid.certified_fits.bilinear import Point
from persid.certified_fits.candidates import Candidate, Choice, ranked, rescaled, shown, trials
from persid.certified_fits.delivery import deliver
from persid.certified_fits.descent import Stop, descend
from persid.certified_fits.identifier import CertifiedIdentifier
from persid.certified_fits.joint_problem import Demand, Frame
from persid.certified_fits.multistart import damped_linear
from persid.certified_fits.polish import polish
from persid.commands import cli
from persid.errors import DataError
from persid.identification.free_runs import free_run_score
from persid.identification.identifier import PersidskiiIdentifier
from persid.identification.refinement import Pieces
from persid.lyapunov.multipliers import lyapunov_function
from persid.measurements.readers import read_csv
from persid.measurements.trajectories import Trajectories
from persid.models.functions import scalar_function
from persid.models.model import PersidskiiModel
from persid.verdicts.verdict import Attempt, Reason, Undecided
from places import TRAFFIC

T = np.linspace(0, 20, 600)
U = np.sin(T)[:, None] + 0.5 * np.sign(np.sin(0.7 * T))[:, None]
STABLE = PersidskiiModel(
    [[-1.0, 2.0], [-1.5, -0.5]],
    [("x**3", None, [[-0.3, 0.0], [0.1, -0.2]]), ("tanh(x)", None, [[0.5, -0.4], [0.2, -0.3]])],
    [[1.0], [0.5]], [0.3, -0.2],
)  # fmt: skip
UNSTABLE = PersidskiiModel([[0.4]], [("x**3", None, [[-0.5]])], [[0.3]])  # two stable equilibria: never certified


@cache
def runs(model: PersidskiiModel = STABLE, noise: float = 0.01, seed: int = 0, count: int = 2) -> Trajectories:
    """Return noisy runs of a model from random initial states."""
    rng = np.random.default_rng(seed)
    found = [model.simulate(rng.normal(size=model.n), T, U)[0] for _ in range(count)]
    x = [run.x + noise * rng.normal(size=run.x.shape) for run in found]
    return Trajectories.from_arrays(x, [U] * count, t=[T] * count)


@cache
def usual() -> CertifiedIdentifier:
    """Return the fit that several tests look at."""
    return CertifiedIdentifier(PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-5), ridge=1e-5).fit(runs())


def frame_of(ridge: float = 1e-6, *, full_P: bool = True, anchor: object = None, demand: Demand | None = None) -> Frame:
    """Return the frame of a fit with cubic and tanh functions."""
    fit = PersidskiiIdentifier(["x", "x**3", "tanh(x)"], ridge=ridge).fit(runs())
    fixed = np.full(fit.gram_.H.shape, np.nan)
    return Frame(fit.gram_, ridge, fixed, full_P, demand or Demand(), anchor)


def accepted(fit: CertifiedIdentifier) -> bool:
    """Whether the checker accepts the certificate for the very model that is returned."""
    answer = persid_check.check(fit.certificate_.data)
    same = fit.certificate_.content["model_sha256"] == fit.model_.sha256
    return isinstance(answer, persid_check.Accepted) and same


def test_a_certifiable_fit_is_kept():
    """Where the free fit satisfies the inequality, the constrained fit is the free fit."""
    fit = CertifiedIdentifier(PersidskiiIdentifier(["x", "x**3", "tanh(x)"], ridge=1e-4), ridge=1e-4).fit(runs())
    assert accepted(fit)
    assert fit.report_.excess < 0.02
    assert fit.report_.price < 1.05


@pytest.mark.long
def test_a_fit_that_is_not_stable_is_made_so():
    """Data of a system with two stable equilibria still give a certified model, and the report states the price."""
    free = PersidskiiIdentifier(["x", "x**3"], ridge=1e-6)
    fit = CertifiedIdentifier(free, ridge=1e-6, time_limit=5).fit(runs(UNSTABLE))
    assert accepted(fit)
    assert not np.allclose(fit.model_.A0, fit.free_.model_.A0)
    assert fit.model_.jacobian(fit.certificate_.operating_point)[0, 0] < 0
    assert fit.report_.excess > 0
    assert "certified" in str(fit.report_)


@pytest.mark.long
@settings(max_examples=4, deadline=None)
@given(
    st.integers(0, 10_000), st.sampled_from([["x", "tanh(x)"], ["x", "x**3"], ["x", "sinh(x)", "tanh(x)"], ["x**3"]])
)
def test_certified_or_plainly_not(seed, functions):
    """Whatever is returned is accepted by the checker, or the result says plainly that none was found."""
    rng = np.random.default_rng(seed)
    x = np.cumsum(rng.normal(size=(120, 2)) * 0.1, axis=0)
    data = Trajectories.from_arrays(x, rng.normal(size=(120, 1)), dt=0.1)
    fit = CertifiedIdentifier(PersidskiiIdentifier(functions, ridge=1e-3), ridge=1e-3, time_limit=2).fit(data)
    if fit.verdict_.is_certified:
        assert accepted(fit)
    else:
        assert fit.certificate_ is None
        assert "No certified model was found" in str(fit.verdict_)


@pytest.mark.long
def test_saved_floats_are_those_that_were_certified(tmp_path):
    """The model that is read back from its file is the model of the certificate."""
    fit = usual()
    fit.model_.save(tmp_path / "model.json")
    fit.certificate_.save(tmp_path / "certificate.json")
    answer = persid_check.check(str(tmp_path / "certificate.json"), str(tmp_path / "model.json"))
    assert isinstance(answer, persid_check.Accepted)


@pytest.mark.long
def test_rates_are_certified():
    """A rate that is asked for stands in the certificate, and one that the data contradict costs accuracy."""
    free = PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-5)
    easy, hard = (CertifiedIdentifier(free, ridge=1e-5, min_rate=rate, time_limit=5).fit(runs()) for rate in (0.1, 1.5))
    for fit, rate in ((easy, 0.1), (hard, 1.5)):
        assert accepted(fit)
        assert value(fit.certificate_.content["kappa"]) / 2 >= rate
    assert hard.report_.excess > 10 * max(easy.report_.excess, 1e-3)


@pytest.mark.long
def test_gains_are_certified():
    """A gain that is asked for is the certificate's bound or larger."""
    fit = CertifiedIdentifier(PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-5), ridge=1e-5, max_gain=5.0).fit(runs())
    assert accepted(fit)
    kappa, gamma, p = (value(fit.certificate_.content[name]) for name in ("kappa", "gamma", "p"))
    assert np.sqrt(gamma / (kappa * p)) <= 5.0


PENDULUM = PersidskiiModel(
    [[0.0, 1.0], [0.0, -0.5]], [("sin(x)", [[1.0, 0.0]], [[0.0], [-2.0]])], [[0.0], [1.0]],
    states=["angle", "speed"], inputs=["torque"],
)  # fmt: skip


@pytest.mark.long
def test_regions_are_certified():
    """With scope="regional" the claim is about the box of the data: with scaled rows, inputs and a rate; it holds."""
    u = 0.4 * np.repeat(np.random.default_rng(0).normal(size=30), 20)[:, None]
    found = [PENDULUM.simulate(x0, T, u)[0] for x0 in ([1.2, 0.0], [-1.5, 0.5])]
    x = [run.x + 0.01 * np.random.default_rng(1).normal(size=run.x.shape) for run in found]
    data = Trajectories.from_arrays(x, [u, u], t=[T, T], states=PENDULUM.states, inputs=PENDULUM.inputs)
    free = PersidskiiIdentifier(["x", "sin(x)"], ridge=1e-4, scale=2.0)
    fit = CertifiedIdentifier(free, ridge=1e-4, scope="regional").fit(data)
    certificate = fit.certificate_
    assert accepted(fit)
    assert certificate.claim == "region"
    assert fit.model_.terms[0].R[0, 0] == 0.5
    assert min(fit.report_.certified.r2_states) > 0.99
    assert value(certificate.content["kappa"]) > 0.01
    level, bound = (value(certificate.content[name]) for name in ("level", "input_bound"))
    ray = certificate.operating_point + np.outer(np.linspace(0, 1, 101), [1.0, 0.5])
    start = ray[np.flatnonzero(certificate.V(ray) < level)[-1]]
    V = certificate.V(fit.simulate(start, T, np.full_like(u, bound))[0].x)
    assert V[0] > 0.8 * level
    assert V.max() <= level


@pytest.mark.long
def test_fixed_coefficients_stay():
    """A known coefficient is exactly the number that was given, in a certified model."""
    fit = CertifiedIdentifier(
        PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-5), ridge=1e-5, fixed={("x1", "x2"): 2.0, ("x2", "u1"): 0.5}
    ).fit(runs())
    assert accepted(fit)
    assert (fit.model_.A0[0, 1], fit.model_.B[1, 0]) == (2.0, 0.5)
    with pytest.raises(DataError, match="columns"):
        CertifiedIdentifier(PersidskiiIdentifier(), fixed={("x1", "nothing"): 1.0}).fit(runs())


TRIANGULAR = np.array([[True, True], [False, True]])


@pytest.mark.long
@pytest.mark.parametrize("options", [{"pattern": TRIANGULAR}, {"shared": True}, {"constant": False}])
def test_structure_is_kept(options):
    """Patterns, shared coefficients and a missing constant hold in the certified model as in the free one."""
    fit = CertifiedIdentifier(PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-4, **options), ridge=1e-4).fit(runs())
    assert accepted(fit)
    if "pattern" in options:
        assert fit.model_.A0[1, 0] == 0
        assert fit.model_.terms[0].A[1, 0] == 0
    if "shared" in options:
        assert fit.model_.A0[0, 0] == fit.model_.A0[1, 1]
    if "constant" in options:
        assert not fit.model_.b.any()


@pytest.mark.long
@pytest.mark.parametrize("method", ["derivative", "edmd"])
def test_every_estimator_will_do(method):
    """All estimators end in a Gram matrix, and that is all that is needed."""
    fit = CertifiedIdentifier(PersidskiiIdentifier(["x", "tanh(x)"], method=method, ridge=1e-4), ridge=1e-4).fit(
        runs(noise=0.0)
    )
    assert accepted(fit)


@pytest.mark.long
def test_functions_are_selected():
    """select="auto" finds that data of a linear system need no function, and lists what was tried."""
    linear = PersidskiiModel([[-1.0, 2.0], [-1.5, -0.5]], B=[[1.0], [0.5]])
    free = PersidskiiIdentifier(["x", "x**3", "tanh(x)"], ridge=1e-6)
    fit = CertifiedIdentifier(free, ridge=1e-6, select="auto").fit(runs(linear))
    assert accepted(fit)
    assert not fit.model_.terms
    assert [row.names for row in fit.table_[:2]] == [("x", "x**3", "tanh(x)"), ("x",)]
    assert fit.table_[0].certified
    assert all(0.5 < row.r2 <= 1 for row in fit.table_)


@pytest.mark.long
def test_a_function_is_learned_where_none_that_is_given_fits():
    """select="auto" tries learned functions, too: of a saturation seen through cubes one is learned, and certified."""
    rng = np.random.default_rng(0)
    u = np.repeat(rng.uniform(-1.5, 1.5, 80), 20)[:, None]
    truth = PersidskiiModel([[-0.3]], [("sat(2*x)", None, [[-1.0]])], [[1.0]])
    x = truth.simulate([0.0], 0.05 * np.arange(len(u)), u)[0].x
    data = Trajectories.from_arrays(x + 0.01 * np.ptp(x) * rng.normal(size=x.shape), u, dt=0.05)
    fit = CertifiedIdentifier(PersidskiiIdentifier(["x", "x**3"], ridge=1e-4), ridge=1e-4, select="auto").fit(data)
    assert fit.functions_ == (("x", "pwl"),)
    assert accepted(fit)
    y = np.linspace(*np.quantile(x, [0.01, 0.99]), 200)[:, None]
    found, wanted = (model.rhs(y, np.zeros((200, 1))) for model in (fit.model_, truth))
    assert np.sqrt(((found - wanted) ** 2).mean()) < 0.03 * np.ptp(wanted)


def row(functions: tuple[tuple[str, ...], ...], error: float, ridge: float = 1.0, **changed: object) -> Candidate:
    """Return a candidate with an error."""
    usual = {"feasible": True, "certified": None, "r2": 0.0, "excess": 0.0, "seconds": 0.0}
    return Candidate(functions, shown(functions, ("a", "b")), ridge, error=error, **{**usual, **changed})


def test_candidates_are_ranked_by_error_and_size():
    """Of candidates within 2 % the smallest comes first; those without proof or with a blow-up take no part."""
    full, lean = (("x", "tanh(x)"),) * 2, (("x",), ("x", "tanh(x)"))
    table = [row(full, 0.100), row(lean, 0.101), row(full, 0.05, certified=False), row(full, np.inf)]
    assert [choice.functions for choice in ranked(table, 1.0)] == [lean, full]
    assert ranked(table[2:], 3.0) == [Choice(None, 3.0)]
    assert table[1].names == ("x", "tanh(x) in b")


def test_candidates_follow_what_was_good():
    """After ridges come smaller sets and learned functions; then scales, and the best so far without one function."""
    full, table = (("x", "x**3", "tanh(x)"),) * 2, []
    best = (("x", "tanh(x)"),) * 2
    tried = []
    for choice in trials(full, [1.0, 0.1], table, select=True):
        tried.append(choice)
        table.append(row(choice.functions, 0.1 if choice.functions == best else 0.2, choice.ridge))
    assert [choice.functions for choice in tried[:5]] == [full, full, (("x",),) * 2, (("x", "x**3"),) * 2, best]
    assert [choice.functions for choice in tried[5:]] == [
        (("x", "pwl"),) * 2, (("x", "tanh(2*x)"),) * 2, (("x", "tanh(0.5*x)"),) * 2,
        (("x",), best[1]), (best[0], ("x",)),
    ]  # fmt: skip
    assert [choice.ridge for choice in trials(full, [1.0, 0.1], [], select=False)] == [1.0, 0.1]


@pytest.mark.parametrize("name", ["tanh(x)", "x/sqrt(1+x**2)", "exp(x)-1"])
def test_rescaled_functions(name):
    """The text of a rescaled function means f(2 x)."""
    y = np.linspace(-1, 1, 7)
    assert scalar_function(rescaled(name, 2.0)).value(y) == pytest.approx(scalar_function(name).value(2 * y))


def test_polishing_lowers_the_free_run_error_under_the_certificate():
    """Every polished point satisfies the inequality strictly, and the errors of its free runs fall."""
    data, frame = runs(noise=0.05), frame_of(ridge=1e-2)
    start = descend(frame.inequality, frame.fit, frame.start(frame.gram.solve(1e-2))).point
    pieces = Pieces.of(data, "zoh")
    points = [*polish(frame, start, pieces, lambda: 10.0), start]
    errors = [float((pieces.errors(frame.gram.basis, frame.theta(point.w)) ** 2).sum()) for point in points]
    assert len(points) > 2
    assert (np.diff(errors) > 0).all()
    assert errors[0] < 0.95 * errors[-1]
    assert all(State.at(frame.inequality, point) is not None and point.slack == 0 for point in points)


@pytest.mark.long
def test_a_biased_regression_is_mended():
    """Where noisy velocities and the ridge ruin the free fit, the certified model's free runs follow the data."""
    t = 0.01 * np.arange(1000)
    r = np.sin(t) + np.sin(0.37 * t + 1)
    lag = PersidskiiModel([[0.0, 1.0], [-400.0, -30.0]], B=[[0.0], [400.0]])
    y = lag.simulate([0.0, 0.0], t, r[:, None])[0].x[:, :1] + 0.002 * np.random.default_rng(0).normal(size=(1000, 1))
    data = Trajectories.from_arrays(y, r[:, None], dt=0.01)
    fit = CertifiedIdentifier(PersidskiiIdentifier(["x"], derivatives=1, ridge=0.01), ridge=0.01).fit(data)
    assert accepted(fit)
    assert fit.report_.certified.r2_states[0] > 0.999
    assert fit.report_.free.r2_states[0] < 0.9


@pytest.mark.long
def test_delivered_fits_have_a_rate():
    """What a run delivers after a fit under the certificate shows a rate and a gain."""
    free = PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-4)
    data = runs(count=1)
    made = deliver(free.fit(data), Undecided(Reason.STALLED), data, time_limit=20.0)
    assert made.verdict.certificate.claim == "rate-and-gain"
    assert made.verdict.certificate.content["model_sha256"] == made.model.sha256
    assert [fit["verdict"] for fit in made.comparison["fits"]] == ["undecided", "certified"]
    assert made.comparison["free_model"] == free.model_.to_dict() != made.model.to_dict()


@pytest.mark.long
def test_starts_from_afar():
    """The damped linear fit is feasible from the start, whatever the functions."""
    for full in (True, False):
        frame = frame_of(full_P=full, anchor=np.zeros(2))
        point = frame.start(damped_linear(frame))
        assert descend(frame.inequality, frame.fit, point).point is not None


@pytest.mark.long
def test_the_descent_is_monotone():
    """The centres' fits fall from one to the next, and the end is strictly feasible."""
    frame = frame_of(anchor=np.zeros(2))
    descent = descend(frame.inequality, frame.fit, frame.start(damped_linear(frame)))
    fits = [float(line.split("fit")[1].split()[0]) for line in descent.log if "beta" in line and "slack 0.0" in line]
    assert descent.stop in (Stop.OPTIMAL, Stop.STALLED)
    assert (np.diff(fits) < 1e-6).all()
    D = frame.inequality.rows(frame.inequality.flows(descent.point.w), frame.inequality.slopes(descent.point.y))
    assert np.linalg.eigvalsh(frame.inequality.matrix(D, descent.point.y))[0] > 0


@pytest.mark.parametrize("full_P", [False, True])
@pytest.mark.parametrize("demand", [Demand(), Demand(kappa=0.05, ratio=4.0)], ids=["decrease", "gain"])
def test_unknowns_of_a_fit_are_those_of_a_proof(full_P: bool, demand: Demand) -> None:
    """Multipliers of a fit's unknowns are the same unknowns again, and Z is the decrease of their V in its units."""
    frame = frame_of(full_P=full_P, demand=demand)
    theta = damped_linear(frame)
    unknowns, inequality = frame._assembled[0], frame.inequality
    y = np.random.default_rng(0).uniform(0.5, 1.5, len(inequality.cost))
    np.testing.assert_allclose(unknowns.values(unknowns.multipliers(y)), y)
    D = inequality.rows(inequality.flows(frame.unknowns(theta)), inequality.slopes(y))
    Z = inequality.matrix(D, y) + inequality.delta * np.eye(len(D.T))
    N = frame.pattern.entries
    decrease = lyapunov_function(unknowns, y, frame.system(theta)).decrease
    scaled = decrease * frame.units.entries * frame.units.entries[:, None]
    np.testing.assert_allclose(Z[:N, :N], scaled, atol=1e-8 * np.abs(Z).max())


@pytest.mark.parametrize("demand", [Demand(), Demand(kappa=0.2), Demand(kappa=0.2, ratio=50.0)])
@pytest.mark.parametrize("full_P", [True, False])
def test_derivatives_of_the_barrier(demand, full_P):
    """Gradient and Hessian agree with differences of the barrier along random directions."""
    frame = frame_of(full_P=full_P, anchor=np.zeros(2), demand=demand)
    inequality = frame.inequality
    start = frame.start(damped_linear(frame))
    point = Point(start.w, start.y, start.slack + 1.0)
    rng = np.random.default_rng(0)
    K = len(point.w)
    d = np.concatenate([rng.normal(size=K), rng.normal(size=len(point.y)) * np.abs(point.y)])
    g, H, C = derivatives(inequality, State.at(inequality, point))
    H[:K, K:] += C
    H[K:, :K] += C.T
    h = 1e-5
    ahead, behind = (
        State.at(inequality, Point(point.w + s * d[:K], point.y + s * d[K:], point.slack)) for s in (h, -h)
    )
    assert (ahead.barrier - behind.barrier) / (2 * h) == pytest.approx(g @ d, rel=1e-5)
    change = (derivatives(inequality, ahead)[0] - derivatives(inequality, behind)[0]) / (2 * h)
    assert change == pytest.approx(H @ d, rel=1e-4, abs=1e-5 * np.abs(H @ d).max())


@pytest.mark.long
def test_the_convex_step_against_a_library():
    """With (P, mu) held the fit is a semidefinite program; Clarabel finds nothing better than the descent."""
    cvxpy = pytest.importorskip("cvxpy")
    frame = frame_of(full_P=False, anchor=np.zeros(2))
    inequality, fit = frame.inequality, frame.fit
    descent = descend(inequality, fit, frame.start(damped_linear(frame)))
    for _ in range(4):  # from this start the last steps are more than one descent has patience for
        descent = descent if descent.stop is Stop.OPTIMAL else descend(inequality, fit, descent.point)
    end = descent.point
    assert descent.stop is Stop.OPTIMAL
    w, tau = cvxpy.Variable(len(end.w)), cvxpy.Variable(len(inequality.product.p), nonneg=True)
    E, flow = inequality.slopes(end.y), inequality.flow
    F = cvxpy.Constant(inequality.base)
    for k, c, i, weight in zip(flow.owner, flow.p, flow.q, flow.weight, strict=True):
        unit = np.zeros(inequality.base.shape)
        unit[i, c] = weight
        F = F + w[int(k)] * unit
    S, pairs = inequality.S, inequality.product
    products = [
        t * (np.outer(S[a], S[b]) + np.outer(S[b], S[a])) for t, a, b in zip(tau, pairs.p, pairs.q, strict=True)
    ]
    Q = E @ F + (E @ F).T + sum(products)
    root = np.linalg.cholesky(fit.M + 1e-12 * np.eye(len(fit.M)) * np.trace(fit.M)).T
    problem = cvxpy.Problem(
        cvxpy.Minimize(0.5 * cvxpy.sum_squares(root @ (w - fit.w0))),
        [-(Q + Q.T) / 2 >> inequality.delta * np.eye(len(S.T))],
    )
    problem.solve(solver="CLARABEL")
    assert fit(end.w) == pytest.approx(problem.value, abs=2e-3)


def test_clones_and_parameters():
    """clone keeps the options; wrong ones are refused in words."""
    estimator = CertifiedIdentifier(PersidskiiIdentifier(["x"]), min_rate=0.1, select="auto")
    assert clone(estimator).min_rate == 0.1
    for wrong in ({"scope": "local"}, {"margin": 0.0}, {"select": "all"}, {"max_gain": -1.0}, {"ridge": "much"}):
        with pytest.raises(DataError, match=next(iter(wrong))):
            CertifiedIdentifier(PersidskiiIdentifier(["x"]), **wrong).fit(runs())


def test_scores_and_simulations_are_those_of_the_certified_model():
    """predict, simulate and score speak of model_."""
    data, fit = runs(), usual()
    assert fit.score(data) == pytest.approx(free_run_score(fit.model_, data).r2_mean)
    assert fit.predict(data).shape == (1200, 2)
    assert fit.simulate([1.0, 1.0], T, U)[0].diverged_at is None


@pytest.mark.long
def test_a_run_delivers_both_fits_side_by_side(tmp_path, monkeypatch, capsys):
    """persid run fits again where the free fit is not certified, and table, page and run.json show both."""
    verdict = Undecided(Reason.STALLED, "Try more ridge.", (Attempt("a look", "stalled", 0.5),))
    monkeypatch.setattr(sys.modules["persid.verdicts.certify"], "certify", lambda model, **how: verdict)
    data = runs(count=1)[0]
    table = pd.DataFrame({"t": data.t, "x1": data.x[:, 0], "x2": data.x[:, 1], "u": data.u[:, 0]})
    table.to_csv(tmp_path / "data.csv", index=False)
    words = [
        "--states",
        "x1,x2",
        "--inputs",
        "u",
        "--functions",
        "x,tanh(x)",
        "--ridge",
        "1e-4",
        "-o",
        str(tmp_path / "out"),
    ]
    assert cli.main(["run", str(tmp_path / "data.csv"), *words]) == 0
    shown = capsys.readouterr().out
    assert re.search(r"certified model: free-run error [\d.]+; uncertified[a-z, ]* [\d.]+", shown)
    assert "price" in shown
    assert "Free fit and fit under the certificate" in (tmp_path / "out" / "report.html").read_text()
    kept = json.loads((tmp_path / "out" / "run.json").read_text())["comparison"]
    assert [fit["verdict"] for fit in kept["fits"]] == ["undecided", "certified"]
    answer = persid_check.check(tmp_path / "out" / "certificate.json", tmp_path / "out" / "model.json")
    assert isinstance(answer, persid_check.Accepted)


def test_functions_that_end_need_a_region() -> None:
    """A square root has no global certificate: that is said at once, without a search or a warning."""
    t = np.linspace(0, 10, 200)
    model = PersidskiiModel([[-1.0]], [("sqrt(x)", None, [[-0.5]])], [[1.0]])
    data = model.simulate([2.0], t, 2 + np.sin(t)[:, None])
    fit = CertifiedIdentifier(PersidskiiIdentifier(["x", "sqrt(x)"])).fit(data)
    assert isinstance(fit.verdict_, Undecided)
    assert fit.verdict_.reason is Reason.OUTSIDE
    assert "sqrt(x)" in fit.stop_
    assert 'scope="regional"' in fit.stop_
    assert not fit.history_


@pytest.mark.long
def test_a_fit_that_explains_its_samples_is_polished_too() -> None:
    """EDMD with x alone leaves no residual in its generator; its free runs become better under the certificate."""
    data = read_csv(TRAFFIC, states=["x1", "x2"], inputs=["u"])
    fit = CertifiedIdentifier(PersidskiiIdentifier(["x"], method="edmd")).fit(data)
    assert fit.certificate_ is not None
    assert 1 - fit.score(data) < 0.75 * (1 - fit.free_.score(data))
