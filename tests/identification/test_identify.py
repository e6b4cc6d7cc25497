"""Identification: models come back from their simulations, and what cannot be identified is refused or said."""

import pickle

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from persid.errors import DataError, UnderdeterminedError
from persid.identification.basis import make_basis
from persid.identification.free_runs import free_run_score
from persid.identification.identifier import PersidskiiIdentifier
from persid.measurements.readers import read_csv
from persid.measurements.trajectories import Trajectories
from persid.models.files import load_model
from persid.models.model import PersidskiiModel
from places import TRAFFIC

FUNCTIONS = ["x", "x**3", "tanh(x)"]


def stable_model(seed: int, n: int = 2, b: bool = True) -> PersidskiiModel:
    """Draw a model that is certified by construction: every matrix has a dominant negative diagonal."""
    rng = np.random.default_rng(seed)

    def matrix(size: float) -> np.ndarray:
        off = rng.uniform(-1, 1, (n, n)) * (1 - np.eye(n))
        return size * (0.3 * off / n - np.diag(rng.uniform(0.5, 1, n)))

    terms = [("x**3", None, matrix(0.5)), ("tanh(x)", None, matrix(0.8))]
    return PersidskiiModel(matrix(1.0), terms, rng.uniform(0.5, 1, (n, 1)), rng.uniform(-0.2, 0.2, n) * b)


def simulated(model: PersidskiiModel, runs: int = 6, count: int = 400, dt: float = 0.01, seed: int = 0) -> Trajectories:
    """Simulate from several starts with inputs that are held for 20 samples."""
    rng, t = np.random.default_rng(seed), np.arange(count) * dt
    found = []
    for _ in range(runs):
        u = np.repeat(rng.uniform(-3, 3, (count // 20, model.m)), 20, axis=0)
        found.append(model.simulate(rng.uniform(-2, 2, model.n), t, u, rtol=1e-10, atol=1e-12)[0])
    return Trajectories(tuple(found), model.states, model.inputs)


def traffic() -> Trajectories:
    return read_csv(TRAFFIC, states=["x1", "x2"], inputs=["u"])


def distance(found: PersidskiiModel, truth: PersidskiiModel, data: Trajectories) -> float:
    """Return the largest difference of the vector fields on the data, relative to the largest rate."""
    x, u = (np.concatenate([getattr(run, name) for run in data]) for name in ("x", "u"))
    rate = truth.rhs(x, u)
    return float(np.abs(found.rhs(x, u) - rate).max() / np.abs(rate).max())


@pytest.mark.long
@settings(max_examples=6, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.integers(0, 10_000), st.sampled_from([1, 2, 3]))
def test_identify_recovers_what_was_simulated(seed, n):
    """identify(simulate(model)) is the model: the vector field to 1e-3, and refined every coefficient to 1e-4."""
    truth = stable_model(seed, n)
    data = simulated(truth, seed=seed)
    options = {"ridge": 0.0, "x_ref": 0.0, "scale": 1.0, "window": 2, "holdout": 0.0}
    fit = PersidskiiIdentifier(FUNCTIONS, **options).fit(data)
    assert distance(fit.model_, truth, data) < 1e-3
    fine = PersidskiiIdentifier(FUNCTIONS, refine=True, **options).fit(data)
    theta = fine.basis_.coefficients(truth).T
    assert np.abs(fine.coef_ - theta).max() < 1e-4 * np.abs(theta).max()


@pytest.mark.parametrize("method", ["weak", "derivative"])
@pytest.mark.parametrize("scale", [1.0, "auto"])
def test_estimators_agree_on_clean_data(method, scale):
    """Every estimator, scaled or not, finds the vector field of noise-free data."""
    truth = stable_model(3)
    data = simulated(truth)
    fit = PersidskiiIdentifier(FUNCTIONS, method=method, ridge=0.0, x_ref=0.0, scale=scale, window="auto").fit(data)
    assert distance(fit.model_, truth, data) < (1e-3 if method == "weak" else 3e-2)


@pytest.mark.long
def test_refinement_reaches_the_truth_from_a_biased_fit():
    """Least squares through the differential equation takes the bias of a strong ridge away."""
    truth = stable_model(5)
    data = simulated(truth)
    rough = PersidskiiIdentifier(FUNCTIONS, ridge=1e-2, x_ref=0.0, scale=1.0).fit(data)
    fine = PersidskiiIdentifier(FUNCTIONS, ridge=1e-2, x_ref=0.0, scale=1.0, refine=True).fit(data)
    assert free_run_score(fine.model_, data).rmse < 0.5 * free_run_score(rough.model_, data).rmse


def test_irregular_sampling_needs_no_resampling():
    """The weak form takes unequal steps as they are."""
    truth = stable_model(7)
    rng = np.random.default_rng(0)
    runs = []
    for k in range(6):
        t = np.cumsum(rng.uniform(0.004, 0.016, 400))
        u = np.repeat(rng.uniform(-3, 3, (20, 1)), 20, axis=0)
        runs.append(truth.simulate(rng.uniform(-2, 2, 2) + 0 * k, t, u, rtol=1e-10, atol=1e-12)[0])
    data = Trajectories(tuple(runs), truth.states, truth.inputs)
    fit = PersidskiiIdentifier(FUNCTIONS, ridge=0.0, x_ref=0.0, scale=1.0, window=2).fit(data)
    assert distance(fit.model_, truth, data) < 2e-3


def test_runs_are_never_paired_across_their_ends():
    """Joining two runs to one changes the fit; giving them as two recovers the model."""
    truth = stable_model(9)
    data = simulated(truth, runs=2)
    options = {"functions": FUNCTIONS, "ridge": 0.0, "x_ref": 0.0, "scale": 1.0, "window": 2}
    apart = PersidskiiIdentifier(**options).fit(data)
    x, u = (np.concatenate([getattr(run, name) for run in data]) for name in ("x", "u"))
    joined = PersidskiiIdentifier(**options).fit(x, u=u, dt=0.01)
    assert distance(apart.model_, truth, data) < 1e-3
    assert distance(joined.model_, truth, data) > 1e-2


def test_arguments_of_functions_are_of_order_one():
    """Temperatures in kelvin get a reference point and scales that are powers of two."""
    rng = np.random.default_rng(0)
    x = 300 + np.cumsum(rng.normal(size=(500, 2)), axis=0)
    basis = make_basis(Trajectories.from_arrays(x, dt=1.0), ["x", "sinh(x)"])
    y = (x - basis.x_ref) / basis.scale
    assert 0.7 < np.abs(y).max() < 3
    assert (np.exp2(np.round(np.log2(basis.scale))) == basis.scale).all()
    assert (1 / (1 / basis.scale) == basis.scale).all()


def test_data_near_zero_keep_zero_as_reference():
    """Where the data come as near to 0 as they spread, functions are taken about 0."""
    assert make_basis(traffic(), ["x"]).x_ref.tolist() == [0, 0]
    assert make_basis(traffic(), ["x"], x_ref=[1.0, 2.0]).x_ref.tolist() == [1, 2]


def test_linear_parts_go_to_A0():
    """The model has no term with f = x."""
    model = PersidskiiIdentifier(ridge=0.02).fit(traffic()).model_
    assert [term.f[0].text for term in model.terms] == ["x**3", "sinh(x)", "tanh(x)"]
    assert np.abs(model.A0).max() > 0


def test_functions_may_differ_between_states():
    """One list a state gives each state its own functions."""
    fit = PersidskiiIdentifier([["x", "tanh(x)"], ["x", "x**3", "sin(x)"]], ridge=1e-3).fit(traffic())
    names = ["x1", "x2", "tanh(x1/2)", "(x2/2)**3", "sin(x2/2)", "u", "1"]
    assert list(fit.get_feature_names_out()) == names
    assert fit.model_.terms[0].R.tolist() == [[0.5, 0], [0, 0.5]]


def test_traffic_has_the_figures_of_the_study():
    """The ridge of 0.02 costs accuracy by a factor of six; a weak one follows the data to 0.007."""
    data = traffic()
    weak = PersidskiiIdentifier(ridge=1e-5, x_ref=0.0, scale=1.0).fit(data).model_
    strong = PersidskiiIdentifier(ridge=0.02, x_ref=0.0, scale=1.0).fit(data).model_
    assert free_run_score(weak, data).rmse == pytest.approx(0.0063, rel=0.25)
    assert free_run_score(strong, data).rmse == pytest.approx(0.0412, rel=0.15)


def test_the_constant_is_never_penalised():
    """An infinite ridge leaves the mean rate of every state."""
    data = traffic()
    theta = PersidskiiIdentifier(ridge=1e12, x_ref=0.0).fit(data).coef_
    run = data[0]
    assert np.allclose(theta[:, :-1], 0, atol=1e-6)
    assert np.allclose(theta[:, -1], (run.x[-1] - run.x[0]) / 30, atol=0.02)


def test_an_offset_of_the_data_moves_the_model_with_it():
    """Shifting the data by powers of two shifts x_ref and changes no coefficient."""
    data = traffic()
    moved = Trajectories.from_arrays(data[0].x + 1024, data[0].u, t=data[0].t)
    a = PersidskiiIdentifier(ridge=1e-3, x_ref=[2.0, 2.0]).fit(data)
    b = PersidskiiIdentifier(ridge=1e-3, x_ref=[1026.0, 1026.0]).fit(moved)
    assert np.allclose(a.coef_, b.coef_, rtol=1e-6, atol=1e-8)


def test_underdetermined_fits_are_refused_and_allowed_on_request():
    """Fewer samples than unknowns is an error that offers ways out; asked for, the smallest model is returned."""
    data = Trajectories.from_arrays(np.random.default_rng(0).normal(size=(30, 10)), dt=0.1)
    with pytest.raises(UnderdeterminedError, match="41 unknown"):
        PersidskiiIdentifier().fit(data)
    assert PersidskiiIdentifier(allow_underdetermined=True, ridge=0.0).fit(data).coef_.shape == (10, 41)


def test_a_pattern_keeps_others_out():
    """States that may not influence each other have coefficients of exactly zero."""
    pattern = np.array([[True, False, False], [True, True, False], [False, True, True]])
    data = simulated(stable_model(1, 3))
    fit = PersidskiiIdentifier(FUNCTIONS, pattern=pattern, ridge=1e-6).fit(data)
    for A in (fit.model_.A0, *(term.A for term in fit.model_.terms)):
        assert (A[~pattern] == 0).all()
        assert (A[pattern] != 0).all()
    with pytest.raises(DataError, match="boolean"):
        PersidskiiIdentifier(pattern=np.ones((2, 2))).fit(data)


def chain(n: int) -> PersidskiiModel:
    A = -1.2 * np.eye(n) + 0.5 * (np.eye(n, k=1) + np.eye(n, k=-1))
    return PersidskiiModel(A, [("tanh(x)", None, -0.4 * np.eye(n))], np.ones((n, 1)))


def test_a_chain_of_fifty_states_is_found_from_one_short_run():
    """With shared=True and a pattern, 50 states need no more samples than one."""
    n, t = 50, np.arange(60) * 0.05
    u = np.sin(2 * t)[:, None]
    start = np.random.default_rng(0).uniform(-2, 2, n)
    data = chain(n).simulate(start, t, u)
    near = np.abs(np.subtract.outer(np.arange(n), np.arange(n))) <= 1
    fit = PersidskiiIdentifier(["x", "tanh(x)"], pattern=near, shared=True, ridge=0.0, scale=1.0).fit(data)
    A = fit.model_.A0
    assert np.allclose(np.diag(A), A[0, 0])
    assert A[0, 0] == pytest.approx(-1.2, abs=0.03)
    assert A[0, 1] == pytest.approx(0.5, abs=0.03)
    assert np.diag(fit.model_.terms[0].A)[0] == pytest.approx(-0.4, abs=0.04)


def test_velocities_and_delays_are_appended_by_name():
    """derivatives=1 and delays=k enlarge the state, and the names say how."""
    data = traffic()
    fit = PersidskiiIdentifier(["x"], derivatives=1, delays=1, ridge=1e-3).fit(data)
    assert fit.model_.states == ("x1", "x2", "x1_dot", "x2_dot", "x1(t-1)", "x2(t-1)")
    oscillator = PersidskiiModel([[0, 1], [-4, -0.2]], states=["q", "v"])
    run = oscillator.simulate([1, 0], np.arange(800) * 0.02)[0]
    measured = Trajectories.from_arrays(run.x[:, :1], dt=0.02, states=["q"])
    found = PersidskiiIdentifier(["x"], derivatives=1, ridge=0.0).fit(measured).model_
    assert np.allclose(found.A0, oscillator.A0, atol=0.02)


def test_thresholds_remove_what_is_small_but_no_damping():
    """Sequential thresholding finds a sparse model and never drops a negative diagonal coefficient."""
    truth = PersidskiiModel([[-1, 0.5], [0, -1]], [("tanh(x)", None, [[-0.01, 0], [0, -0.5]])], [[1.0], [1.0]])
    fit = PersidskiiIdentifier(["x", "tanh(x)"], ridge=0.0, threshold=0.1, scale=1.0).fit(simulated(truth))
    assert fit.model_.A0[1, 0] == 0
    assert fit.model_.terms[0].A[0, 1] == 0
    assert fit.model_.terms[0].A[0, 0] == pytest.approx(-0.01, abs=0.005)


def test_derivatives_that_were_measured_are_used():
    """method="derivative" takes x' as y."""
    truth = stable_model(2)
    data = simulated(truth, runs=1)
    run = data[0]
    dot = truth.rhs(run.x, (run.u + np.vstack([run.u[:1], run.u[:-1]])) / 2)
    fit = PersidskiiIdentifier(FUNCTIONS, method="derivative", ridge=0.0, scale=1.0, x_ref=0.0).fit(data, dot)
    assert distance(fit.model_, truth, data) < 1e-6
    with pytest.raises(DataError, match="derivative x'"):
        PersidskiiIdentifier(FUNCTIONS, method="derivative").fit(data, dot[:-1])


def test_the_report_speaks():
    """The report holds the validation curve, conditioning, coverage and scores on unseen data."""
    report = PersidskiiIdentifier().fit(traffic()).report_
    assert report.curve is not None
    assert report.ridge in report.curve.strengths
    assert report.condition_raw > report.condition_scaled / 2 > 1e3
    assert report.collinear[0][2] > 0.99
    assert report.coverage[0] == pytest.approx((1.0, 3.27), abs=0.01)
    assert report.free_run.rmse < 0.05
    assert report.one_step.rmse < report.free_run.rmse
    assert "free run, held out" in str(report)


def test_an_input_that_never_varies_is_none():
    """A constant input is noted and no input of the model; data that hold it are scored all the same."""
    data = traffic()
    u = np.hstack([data[0].u, np.ones((1000, 1))])
    fit = PersidskiiIdentifier(ridge=1e-3).fit(data[0].x, u=u, t=data[0].t)
    assert "u2 never varies: no input of the model" in fit.report_.notes
    assert (fit.model_.inputs, fit.n_inputs_in_) == (("u1",), 2)
    assert fit.score(data[0].x, u=u, t=data[0].t) == PersidskiiIdentifier(ridge=1e-3).fit(data).score(data)


def swing() -> Trajectories:
    """A swing equation, x1'' = 1 - 4 sin(x1) - 0.3 x1', six runs of small angles."""
    model = PersidskiiModel([[0, 1], [0, -0.3]], [("sin(x)", [[1, 0]], [[0], [-4]])], b=[0, 1])
    starts = np.random.default_rng(1).uniform(-0.5, 0.5, (6, 2))
    runs = [model.simulate(start, 0.02 * np.arange(400))[0].x for start in starts]
    return Trajectories.from_arrays(runs, dt=0.02, states=["angle", "speed"])


def test_a_function_that_is_the_law_of_the_plant_keeps_its_scale():
    """Where sin(x) is exact, no sin(2x) takes its place, however small the angles are; elsewhere arguments are of
    order 1."""
    functions = [["x", "sin(x)"], ["x"]]
    fit = PersidskiiIdentifier(functions).fit(swing())
    assert (fit.basis_.scale == 1).all()
    assert fit.report_.free_run.rmse < 3e-6
    assert fit.model_.terms[0].A[1, 0] == pytest.approx(-4, rel=1e-3)
    assert not (make_basis(swing(), functions).scale == 1).all()
    other = PersidskiiIdentifier([["x", "tanh(x)"], ["x"]]).fit(swing())
    assert not (other.basis_.scale == 1).all()


def test_an_unstable_plant_that_is_foretold_is_not_warned_about():
    """Its long free run leaves the data however good the model; the warnings are about what can be foretold."""
    rng, x, u = np.random.default_rng(0), [0.1], []
    for _ in range(600):
        u.append(-2 * x[-1] + rng.choice([-1, 1]))
        x.append((x[-1] + u[-1]) * np.exp(0.05) - u[-1])
    measured = np.array(x[:-1]) + rng.normal(0, 0.01, 600)
    report = PersidskiiIdentifier(["x"]).fit(measured[:, None], u=np.array(u), dt=0.05).report_
    assert report.free_run.blow_ups or report.free_run.r2_mean < 0.9
    assert not any("free run" in text for text in report.warnings)


def test_least_squares_is_warned_about():
    """Without ridge the terms cancel, and the report says so."""
    report = PersidskiiIdentifier(ridge=0.0).fit(traffic()).report_
    assert any("cancel" in text for text in report.warnings)
    assert report.largest_coefficient > 20


def test_equations_are_text_latex_and_sympy():
    """The three forms hold the same numbers."""
    sympy = pytest.importorskip("sympy")
    fit = PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-3).fit(traffic())
    text = fit.equations().splitlines()
    assert text[0].startswith("d(x1)/dt = ")
    assert "tanh(x1/2)" in text[0]
    assert r"\dot{x_{1}}" in fit.equations("latex")
    equation = fit.equations("sympy")[0]
    values = {"x1": 0.3, "x2": -0.4, "u": 0.7}
    x = {f: values[f.func.__name__] for f in equation.rhs.atoms(sympy.Function) if f.func.__name__ in values}
    value = float(equation.rhs.subs(x).subs(sympy.Symbol("u"), 0.7))
    assert value == pytest.approx(float(fit.model_.rhs(np.array([0.3, -0.4]), np.array([0.7]))[0]), rel=1e-12)


def test_models_and_fits_are_saved_and_pickled(tmp_path):
    """JSON gives the same bits back; a pickled estimator predicts the same."""
    data = traffic()
    fit = PersidskiiIdentifier(ridge=1e-3).fit(data)
    fit.model_.save(tmp_path / "model.json")
    assert load_model(tmp_path / "model.json").to_dict() == fit.model_.to_dict()
    assert np.array_equal(pickle.loads(pickle.dumps(fit)).predict(data), fit.predict(data))


def test_dataframes_are_taken_with_their_names():
    """Names of columns become names of states and inputs, with an (episode, time) index too."""
    run = traffic()[0]
    frame = pd.DataFrame(run.x, columns=["left", "right"], index=pd.Index(run.t, name="t"))
    u = pd.DataFrame(run.u, columns=["gate"], index=frame.index)
    fit = PersidskiiIdentifier(ridge=1e-3).fit(frame, u=u)
    assert (fit.model_.states, fit.model_.inputs) == (("left", "right"), ("gate",))
    assert list(fit.feature_names_in_) == ["left", "right"]
    both = pd.concat([frame, frame], keys=["a", "b"], names=["episode", "t"])
    twice = PersidskiiIdentifier(ridge=1e-3).fit(both, u=pd.concat([u, u], keys=["a", "b"]))
    assert np.allclose(twice.coef_, fit.coef_)


def test_gram_data_reproduce_the_fit():
    """From gram_ alone the ridge solution, its residual and the model follow."""
    fit = PersidskiiIdentifier(ridge=1e-3).fit(traffic())
    gram = fit.gram_
    theta = gram.solve(1e-3)
    assert np.allclose(theta, fit.coef_.T, rtol=1e-9)
    normal = (gram.G / gram.rows + np.diag(1e-3 * gram.weights**2)) @ theta - gram.H / gram.rows
    assert np.abs(normal).max() < 1e-10
    assert np.array_equal(gram.basis.coefficients(fit.model_), fit.coef_.T)
    assert (gram.residual(theta) > 0).all()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"method": "magic"}, "derivative, edmd, weak"),
        ({"hold": "first"}, "zoh, paper"),
        ({"ridge": -1.0}, ">= 0"),
        ({"ridge": "strong"}, "auto"),
        ({"window": 3}, "even"),
        ({"functions": "x"}, "a list"),
        ({"functions": [["x"], ["x"], ["x"]]}, "2 states"),
        ({"scale": 0.0}, "positive"),
        ({"x_ref": [1.0, 2.0, 3.0]}, "x_ref"),
        ({"x_ref": "mean"}, "x_ref"),
        ({"holdout": 0.9}, "holdout"),
        ({"threshold": 2}, "threshold"),
        ({"lifting": ["x**2"]}, "edmd"),
        ({"gamma": "other"}, "literal"),
        ({"derivatives": 3}, "0 or 1"),
    ],
)
def test_wrong_options_are_refused(options, words):
    """Every option says what it takes."""
    with pytest.raises(DataError, match=words):
        PersidskiiIdentifier(**options).fit(traffic())


def test_inputs_that_do_not_fit_are_refused():
    """The message counts rows on both sides."""
    with pytest.raises(DataError, match="u has 999 rows but x has 1000"):
        PersidskiiIdentifier().fit(np.ones((1000, 2)), u=np.ones((999, 1)), dt=0.1)


@pytest.mark.long
def test_the_pendulum_and_the_rig_are_identified(measurements):
    """Free runs on held-out data follow the rig, and with velocities appended the pendulum's arm."""
    rig = read_csv(measurements / "faster" / "faster.csv", states=["y"], inputs=["r", "d"], dt=0.00775313)
    assert PersidskiiIdentifier().fit(rig).report_.free_run.r2_mean > 0.99
    files = sorted((measurements / "qube").glob("*.csv"))
    inputs = ["target_theta", "target_alpha", "feedforward"]
    qube = read_csv(files, states=["theta", "alpha"], inputs=inputs)
    report = PersidskiiIdentifier(derivatives=1).fit(qube).report_
    assert report.free_run.r2_states[0] > 0.95
    assert report.free_run.blow_ups == 0


@pytest.mark.parametrize(
    ("low", "high", "expected"), [(-1.0, 3.0, 0.0), (0.0, 2.0, 0.0), (1.0, 3.0, 2.0), (0.1, 0.3, 0.2)]
)
def test_the_nominal_input_is_one_that_occurs(low, high, expected):
    """It is 0 where the input takes values on both sides of 0, else the mean, however near 0 that is."""
    t = np.arange(101.0)
    u = np.linspace(low, high, 101)[:, None]
    data = Trajectories.from_arrays([np.sin(t)[:, None]], t=[t], u=[u])
    assert make_basis(data, ["x"]).u_ref == pytest.approx([expected])


@pytest.mark.long
def test_an_unstable_plant_under_feedback_keeps_its_fit() -> None:
    """Long free runs of an unstable plant say nothing about a ridge: the short ones choose a weak one."""
    rng, x, rows, h = np.random.default_rng(0), np.array([0.1, 0.0]), [], 0.02
    rise = expm(np.array([[0, 1, 0], [20, 0, -5], [0, 0, 0]]) * h)  # phi'' = 20 phi - 5 u, u held
    for _ in range(1500):
        u = 8 * x[0] + 2 * x[1] + 0.5 * rng.choice([-1, 1])
        rows.append((*x, u))
        x = (rise @ [*x, u])[:2]
    values = np.array(rows)
    fit = PersidskiiIdentifier().fit(Trajectories.from_arrays(values[:, :2], values[:, 2:], dt=h))
    assert fit.ridge_ < 1e-3
    assert fit.model_.jacobian(np.zeros(2))[1, 0] == pytest.approx(20, rel=0.05)
