"""Output models: their formula, file, simulation, start from measured outputs, and exports."""

import json
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import persid as ps
from persid.errors import ModelError
from persid.models.functions import scalar_function, shifted

T = np.arange(60) * 0.1
U = np.column_stack([np.sin(T), np.sign(np.cos(3 * T))])
NEURONS = [shifted("tanh", 0.3), shifted("tanh", -1.25), shifted("softsign", 1e-7)]


def latent(**more) -> ps.PersidskiiModel:
    """A stable model of two states with three neurons, each with a shift of its own."""
    rows, columns = [[1.0, 0.5], [-0.4, 1.0], [0.7, 0.7]], [[-0.5, 0.2, 0.1], [0.1, -0.6, 0.3]]
    A0, B = [[-1.0, 2.0], [-2.0, -0.5]], [[1.0, 0.0], [0.2, 1.0]]
    terms = [(NEURONS, rows, columns)]
    return ps.PersidskiiModel(A0, terms, B, [0.1, 0.0], [0.2, 0.0], [0.5, 0.1], inputs=["u", "w"], **more)


def seen(**more) -> ps.OutputModel:
    """Two outputs of it."""
    C, D = [[1.0, 0.3], [-0.2, 1.0]], [[0.1, 0.0], [0.0, -0.4]]
    return ps.OutputModel(latent(), C, D, [2.0, -1.0], outputs=["level", "flow"], **more)


def test_the_output_is_the_formula():
    """y = h(C (x - x_ref) + D (u - u_ref) + d), for one state or many."""
    model, x, u = seen(output_map=["abs(x)", "x"]), np.array([0.4, -1.0]), np.array([1.0, 2.0])
    y = model.C @ (x - [0.2, 0]) + model.D @ (u - [0.5, 0.1]) + [2.0, -1.0]
    assert np.allclose(model.output(x, u), [abs(y[0]), y[1]], rtol=1e-15)
    assert np.allclose(model.output(np.stack([x, x]), np.stack([u, u])), [[abs(y[0]), y[1]]] * 2)
    assert np.allclose(seen().output(x), model.C @ (x - [0.2, 0]) + [2.0, -1.0])


def test_the_state_runs_as_in_the_dynamics():
    """A simulation from x0 is that of the dynamics, seen through the output."""
    model, x0 = seen(), np.array([1.0, -0.5])
    run, states = model.simulate(T, U, x0=x0), model.dynamics.simulate(x0, T, U)
    assert run.states == ("level", "flow")
    assert np.allclose(run[0].x, model.output(states[0].x, U), atol=1e-6)


def test_straight_inputs_differ_from_held_ones():
    """With hold="foh" inputs run in straight lines, and finer samples of the same lines change nothing."""
    model, x0 = seen(hold="foh"), np.zeros(2)
    fine = np.linspace(T[0], T[-1], 2 * len(T) - 1)
    lines = np.column_stack([np.interp(fine, T, column) for column in U.T])
    coarse = model.simulate(T, U, x0=x0)[0].x
    assert np.allclose(coarse, model.simulate(fine, lines, x0=x0)[0].x[::2], atol=1e-6)
    assert np.abs(coarse - seen().simulate(T, U, x0=x0)[0].x).max() > 1e-2


@pytest.mark.long
def test_long_runs_agree_with_an_adaptive_solver():
    """Pieces stepped side by side give the run of a solver that controls its error, held inputs or straight ones."""
    t, u, x0 = np.arange(400) * 0.2, np.random.default_rng(0).normal(size=(400, 2)), np.array([3.0, -3.0])
    for hold in ("zoh", "foh"):
        model = seen(hold=hold)
        given = u if hold == "zoh" else (lambda s: np.array([np.interp(s, t, column) for column in u.T]))
        slow = model.dynamics.simulate(x0, t, given)[0].x
        assert np.allclose(model.simulate(t, u, x0=x0)[0].x, model.output(slow, u), atol=2e-5)


def test_a_run_that_leaves_all_bounds_says_when():
    """An unstable output model's run ends where its states diverge."""
    model = ps.OutputModel(ps.PersidskiiModel([[0.5]], [("x**3", None, [[1.0]])], [[1.0]]), [[1.0]])
    run = model.simulate(np.arange(100) * 0.1, np.ones((100, 1)), x0=[1.0])[0]
    assert run.diverged_at is not None
    assert len(run) < 100


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_the_first_outputs_give_the_state(hold):
    """A state is recovered from the first outputs that it gives."""
    model, x0 = seen(hold=hold, noise=[1e-4, 1e-4]), np.array([1.5, -0.8])
    y = model.simulate(T, U, x0=x0)[0].x
    assert np.allclose(model.estimate_state(T, U, y[:8]), x0, atol=1e-4)
    assert np.allclose(model.simulate(T, U, y_init=y[:8])[0].x, y, atol=1e-4)


def test_one_sample_and_the_spread_give_a_state():
    """With fewer numbers than states their spread decides the rest; where nothing is known of it, that is refused."""
    model = ps.OutputModel(latent(), [[1.0, 0.0]], noise=[1e-6], x_mean=[0, 2], x_cov=[[9, 0], [0, 1]])
    assert np.allclose(model.estimate_state(T, U, [1.0]), [1.2, 2.0], atol=1e-3)
    with pytest.raises(ModelError, match="holds 1 numbers and the model has 2 latent states"):
        ps.OutputModel(latent(), [[1.0, 0.0]]).estimate_state(T, U, [1.0])


def test_a_hidden_sign_is_found():
    """Behind y = |x1| the first outputs still give a state that goes on as measured."""
    spread = {"x_mean": [0, 0], "x_cov": [[2, 1], [1, 2]]}
    model = ps.OutputModel(latent(), [[1.0, 0.0]], output_map="abs(x)", noise=[1e-5], **spread)
    y = model.simulate(T, U, x0=[-2.0, 0.5])[0].x
    assert np.allclose(model.simulate(T, U, y_init=y[:12])[0].x, y, atol=1e-3)


def test_noise_is_not_taken_for_the_state():
    """What is measured with noise leaves the estimate within a few standard errors of the truth."""
    model, x0, rng = seen(noise=[0.05, 0.05]), np.array([1.5, -0.8]), np.random.default_rng(0)
    y = model.simulate(T, U, x0=x0)[0].x + 0.05 * rng.normal(size=(len(T), 2))
    assert np.allclose(model.estimate_state(T, U, y[:20]), x0, atol=0.08)


numbers = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=30, deadline=None)
@given(st.lists(numbers, min_size=6, max_size=6))
def test_a_file_gives_the_same_model_back(tmp_path_factory, values):
    """Every binary64 survives saving and loading, and `load_model` knows which kind of model it reads."""
    model = ps.OutputModel(latent(), [values[:2]], [values[2:4]], values[4:5], output_map="abs(x)", hold="foh")
    path = tmp_path_factory.mktemp("model") / "model.json"
    model.save(path)
    again = ps.load_model(path)
    assert isinstance(again, ps.OutputModel)
    assert again == model
    assert again.C.tobytes() == model.C.tobytes()
    assert pickle.loads(pickle.dumps(model)) == model
    assert hash(again) == hash(model)


def test_another_number_makes_another_model():
    """Equality sees every number, name and map."""
    assert seen() == seen()
    assert seen() != seen(output_map="abs(x)")
    assert seen() != seen(noise=[1.0, 1.0])
    assert seen() != ps.OutputModel(seen().dynamics, seen().C, seen().D, [2.0, -1.5], outputs=["level", "flow"])


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"format": "persid-model-1"}, "the field 'B' is missing|unknown field"),
        ({"C": [[1.0]]}, "C has shape"),
        ({"C": [[1.0, float("inf")]] * 2}, "not finite|not a number"),
        ({"D": [[1.0]]}, "D has shape"),
        ({"d": [1.0]}, "d has shape"),
        ({"outputs": ["y"]}, "outputs needs 2 different names"),
        ({"outputs": ["y", "u"]}, "'u' is the name of an output and of a state or input"),
        ({"outputs": [1, 2]}, "a list of names"),
        ({"output_map": ["wobble(x)", "x"]}, "wobble"),
        ({"output_map": ["abs(x)"]}, "output_map has 1 functions"),
        ({"hold": "spline"}, "hold is 'spline'"),
        ({"noise": [1.0]}, "noise has shape"),
        ({"x_mean": [1.0]}, "x_mean has shape"),
        ({"x_cov": [[1.0]]}, "x_cov has shape"),
        ({"provenance": 3}, "provenance is no object"),
        ({"gain": 3}, "unknown field 'gain'"),
        ({"dynamics": None}, '"format": "persid-model-1"'),
    ],
)
def test_a_bad_file_is_refused_by_name(tmp_path, change, word):
    """What is wrong with the file of an output model is named."""
    path = tmp_path / "model.json"
    path.write_text(json.dumps(seen().to_dict() | change))
    with pytest.raises(ModelError, match=word):
        ps.load_model(path)


def test_a_run_needs_one_start():
    """Neither or both of x0 and y_init are refused, and so are outputs that do not fit."""
    for start in ({}, {"x0": [0, 0], "y_init": np.zeros((3, 2))}):
        with pytest.raises(ModelError, match="give x0"):
            seen().simulate(T, U, **start)
    with pytest.raises(ModelError, match=r"y_init has shape \(3, 1\)"):
        seen().simulate(T, U, y_init=np.zeros((3, 1)))


def test_shifted_functions_are_one_call():
    """A shifted function is known by its kind and its shift, and gives the bits that it gives alone."""
    y = np.linspace(-2, 2, 7)
    for name, by in (("tanh", 0.3), ("tanh", -1.25), ("relu", 0.1), ("arctan", 1e-9)):
        f = scalar_function(shifted(name, by))
        assert f.unshifted == (scalar_function(f"{name}(x)"), by)
        assert np.array_equal(f.value(y), f.unshifted[0].value(y + by))
    for text in ("tanh(2*x)", "x + 1", "tanh(x)", "tanh(1 + x)"):
        assert scalar_function(text).unshifted == (scalar_function(text), 0.0)
    term = latent().terms[0]
    dx = np.array([0.3, -0.7])
    each = [f.derivative(v) for f, v in zip(term.f, term.R @ dx, strict=True)]
    assert np.allclose(term.derivatives(dx), each, rtol=1e-15)
    values = [f.value(v) for f, v in zip(term.f, term.R @ dx, strict=True)]
    assert np.array_equal(term.values(dx), values)


def test_the_neighbours_get_the_same_model():
    """python-control, CasADi, SymPy and the plain callables give the model's x' and y."""
    model, x, u = seen(output_map=["abs(x)", "tanh(x)"]), np.array([0.4, -1.0]), np.array([1.0, 2.0])
    rate, y = model.dynamics.rhs(x, u), model.output(x, u)
    rhs, output = model.to_callable()
    assert np.allclose(rhs(0.0, x, u), rate)
    assert np.allclose(output(x, u), y)
    sympy = pytest.importorskip("sympy")
    dot, out = model.to_sympy()
    at = {sympy.Symbol(n): v for n, v in zip([*model.dynamics.states, "u", "w"], [*x, *u], strict=True)}
    assert np.allclose(np.array(dot.subs(at).evalf(), float)[:, 0], rate)
    assert np.allclose(np.array(out.subs(at).evalf(), float)[:, 0], y)
    casadi = pytest.importorskip("casadi")
    found = model.to_casadi()(casadi.DM(x), casadi.DM(u))
    assert np.allclose(np.array(found[0])[:, 0], rate)
    assert np.allclose(np.array(found[1])[:, 0], y)


def test_control_gets_inputs_states_and_outputs():
    """The python-control system carries the names and gives x' and y."""
    pytest.importorskip("control")
    model, x, u = seen(), np.array([0.4, -1.0]), np.array([1.0, 2.0])
    system = model.to_control("tank")
    assert system.output_labels == ["level", "flow"]
    assert np.allclose(system.output(0, x, u), model.output(x, u))
    assert np.allclose(system.dynamics(0, x, u), model.dynamics.rhs(x, u))


def test_equations_show_the_outputs():
    """One line a state and one an output; a neuron's shift is rounded to be read."""
    model = ps.OutputModel(
        ps.PersidskiiModel([[-1.0]], [(shifted("tanh", 0.123456789012), [[2.0]], [[0.5]])], [[1.0]]),
        [[3.0]], [[0.25]], [1.5], output_map="abs(x)", outputs=["y"],
    )  # fmt: skip
    assert ps.equations(model) == "d(x1)/dt = -1 x1 + 0.5 tanh((2*x1) + 0.1235) + 1 u1\ny = abs(3 x1 + 0.25 u1 + 1.5)"
    assert r"y &= \left|3 x_{1} + 0.25 u_{1} + 1.5\right|" in model.to_latex()
    sympy = pytest.importorskip("sympy")
    t = sympy.Symbol("t")
    last = ps.equations(model, "sympy")[-1]
    assert float(last.rhs.subs({sympy.Function("x1")(t): -1, sympy.Symbol("u1"): 0})) == 1.5


def test_a_notebook_shows_outputs_and_dynamics():
    """The HTML holds the rows of C and the equations of the states."""
    page = seen()._repr_html_()
    assert "2 outputs of 2 latent states" in page
    assert "level" in page
    assert "d(x1)/dt" in page
    assert repr(seen()).startswith("OutputModel(2 outputs ('level', 'flow')")
