"""Models in discrete time: their file and hash, runs, fixed points, equations and exports; what is refused."""

import json

import numpy as np
import pytest
from scipy.sparse import csc_array

import persid as ps
import persid_check
from persid.errors import ModelError
from persid.measurements.trajectory import Trajectory


def _model(**more: object) -> ps.PersidskiiModel:
    """x+ - 1 = (x - 1)/2 + tanh(x - 1)/4 + u, in steps of .1 s."""
    terms = [("tanh(x)", None, [[0.25]])]
    return ps.PersidskiiModel([[0.5]], terms, [[1.0]], x_ref=[1.0], time="discrete", dt=0.1, **more)


def _twin() -> ps.PersidskiiModel:
    return ps.PersidskiiModel([[0.5]], [("tanh(x)", None, [[0.25]])], [[1.0]], x_ref=[1.0])


def test_the_file_gives_the_same_model_back(tmp_path) -> None:
    """A saved model in discrete time is read back equal, with its step, and its canonical form gives it back, too."""
    model = _model(provenance={"by": "hand"})
    model.save(tmp_path / "model.json")
    found = ps.load_model(tmp_path / "model.json")
    assert found == model
    assert (found.time, found.dt, found.provenance) == ("discrete", 0.1, {"by": "hand"})
    assert ps.PersidskiiModel.from_canonical(model.canonical) == model
    assert json.loads((tmp_path / "model.json").read_text())["format"] == "persid-model-1"


def test_continuous_models_keep_their_form_and_hash() -> None:
    """The file of a model in continuous time has no field of steps; the same numbers in steps are another model."""
    assert {"time", "dt"}.isdisjoint(_twin().to_dict())
    assert {"time", "dt"}.isdisjoint(_twin().canonical)
    assert persid_check.model_sha256(_twin().to_dict() | {"time": "continuous"}) == _twin().sha256
    slower = ps.PersidskiiModel.from_dict(_model().to_dict() | {"dt": 0.2})
    assert len({_model().sha256, _twin().sha256, slower.sha256}) == 3


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ({"time": "discrete"}, "length of its step"),
        ({"time": "discrete", "dt": 0.0}, "above 0"),
        ({"time": "discrete", "dt": True}, "length of its step"),
        ({"time": "discrete", "dt": np.inf}, "above 0"),
        ({"dt": 0.1}, 'time="discrete"'),
        ({"time": "sampled", "dt": 0.1}, "continuous"),
    ],
)
def test_a_step_that_is_none_is_refused(more, words: str) -> None:
    """A model in discrete time needs a step, one in continuous time has none, and the error says what to give."""
    with pytest.raises(ModelError, match=words):
        ps.PersidskiiModel([[0.5]], **more)


def test_sparse_matrices_are_refused() -> None:
    """A sparse matrix in discrete time is refused by name."""
    with pytest.raises(ModelError, match="sparse"):
        ps.PersidskiiModel(csc_array(0.5 * np.eye(3)), time="discrete", dt=1.0)


def test_runs_are_the_recursion() -> None:
    """Every sample of a run is the right side at the sample before, for held, called and absent inputs alike."""
    model, t = _model(), 3.0 + 0.1 * np.arange(30)
    u = np.random.default_rng(0).normal(size=(30, 1))
    found = model.simulate([[4.0], [-3.0]], t, u)
    for run in found:
        assert np.allclose(run.x[1:], model.rhs(run.x[:-1], u[:-1]), rtol=1e-15, atol=1e-15)
    called = model.simulate([4.0], t, lambda s: [u[round((s - 3.0) / 0.1), 0]])[0]
    assert np.array_equal(called.x, found[0].x)
    assert np.allclose(model.simulate([4.0], t)[0].x[-1], 1.0, atol=1e-3)


def test_other_steps_are_refused() -> None:
    """Times that are not one step apart are refused with both steps."""
    with pytest.raises(ModelError, match=r"goes in steps of 0\.1 s"):
        _model().simulate([1.0], np.linspace(0, 1, 30))


def test_a_run_that_diverges_ends() -> None:
    """A run that leaves every bound ends there, with the time in `diverged_at`."""
    model = ps.PersidskiiModel([[3.0]], time="discrete", dt=0.5)
    run = model.simulate([1.0], 0.5 * np.arange(100))[0]
    assert isinstance(run, Trajectory)
    assert run.diverged_at == pytest.approx(0.5 * len(run))
    assert len(run) < 20


def test_fixed_points_are_found_and_proved() -> None:
    """Equilibria are fixed points: all three of a bistable recursion, each with its ball, and none that is x' = 0."""
    model = ps.PersidskiiModel([[0.5]], [("tanh(x)", None, [[1.0]])], [[1.0]], time="discrete", dt=1.0)
    points = ps.find_operating_point(model)
    assert len(points) == 3
    for point in points:
        assert np.allclose(model.rhs(point.x, point.u), point.x, atol=1e-12)
    (one,) = ps.find_operating_point(_model(), [2.0])
    assert np.allclose(_model().rhs(one.x, one.u), one.x)


def test_equations_are_those_of_a_step() -> None:
    """Text, LaTeX, MathML and SymPy name the state one step later, and their constant holds x_ref."""
    assert ps.equations(_model()) == "x1[k+1] = 0.5 (x1 - 1) + 0.25 tanh((x1 - 1)) + 1 u1 + 1"
    assert ps.equations(_model(), "latex").startswith("x_{1}[k+1] = ")
    assert "x1[k+1]" in _model()._repr_html_()
    from persid.models.mathml import counts, equation

    left, terms = equation(_model(), 0)
    assert "<mi>k</mi><mo>+</mo><mn>1</mn>" in left
    assert counts(_model()).tolist() == [len(terms)] == [4]
    pytest.importorskip("sympy")
    (line,) = ps.equations(_model(), "sympy")
    assert str(line.lhs) == "x1(k + 1)"


def test_exports_take_a_step() -> None:
    """python-control, CasADi, SymPy and the plain function give the state after a step, in discrete time."""
    x, u, model = np.array([2.0]), np.array([0.3]), _model()
    after = model.rhs(x, u)
    assert np.allclose(model.to_callable()(0.0, x, u), after)
    control = pytest.importorskip("control")
    system = model.to_control()
    assert system.dt == 0.1
    assert np.allclose(system.dynamics(0.0, x, u), after)
    t = 0.1 * np.arange(20)
    response = control.input_output_response(system, t, np.ones((1, 20)), x)
    assert np.allclose(response.states.T, model.simulate(x, t, np.ones((20, 1)))[0].x)
    pytest.importorskip("casadi")
    function = model.to_casadi()
    assert function.name_out() == ["x_next"]
    assert np.allclose(np.array(function(x, u)).ravel(), after)
    pytest.importorskip("sympy")
    assert float(model.to_sympy().subs({"x1": 2.0, "u1": 0.3})[0]) == pytest.approx(after[0])


def test_output_models_are_refused() -> None:
    """An output model has no dynamics in discrete time."""
    with pytest.raises(ModelError, match="continuous time"):
        ps.OutputModel(_model(), C=[[1.0]])
