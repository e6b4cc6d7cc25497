"""PersidskiiModel: its right side, Jacobian, file and simulation."""

import copy
import json
import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import scipy.integrate
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from persid._files import readable
from persid.errors import ModelError
from persid.models import integration
from persid.models.equations import equations
from persid.models.files import load_model
from persid.models.model import PersidskiiModel

A0 = np.array([[-0.1, 0.05], [0.05, -0.15]])
SMALL = PersidskiiModel(
    A0,
    [("tanh(x)", None, [[-1, 0], [0, -1]]), (["x**3", "sinh(x)"], [[0.5, 0], [1, -1]], [[-0.2, -0.1], [0, 0.1]])],
    [[0.5], [0.3]],
    [0.1, 0.0],
    x_ref=[1.0, -1.0],
    u_ref=[0.2],
)
T = np.arange(200) * 0.05


def test_the_right_side_is_the_formula():
    """rhs evaluates A0 dx + sum A f(R dx) + B du + b."""
    x, u = np.array([0.3, 0.8]), np.array([1.5])
    d = x - [1.0, -1.0]
    expected = A0 @ d + [0.1, 0] + np.array([0.5, 0.3]) * 1.3 - np.tanh(d)
    y = np.array([0.5 * d[0], d[0] - d[1]])
    expected += np.array([[-0.2, -0.1], [0, 0.1]]) @ [y[0] ** 3, np.sinh(y[1])]
    assert np.allclose(SMALL.rhs(x, u), expected, rtol=1e-14)
    assert np.allclose(SMALL.rhs(np.stack([x, x]), np.stack([u, u])), expected)


def test_the_jacobian_agrees_with_differences():
    """The Jacobian is the derivative of the right side."""
    x, h = np.array([0.3, 0.8]), 1e-6
    columns = [(SMALL.rhs(x + h * e) - SMALL.rhs(x - h * e)) / (2 * h) for e in np.eye(2)]
    assert np.allclose(SMALL.jacobian(x), np.transpose(columns), rtol=1e-8)


def test_linear_terms_are_merged_exactly():
    """A term with f = x becomes part of A0 in the channels."""
    model = PersidskiiModel(A0, [(["x", "tanh(x)"], None, [[1, 2], [3, 4]])])
    assert np.array_equal(model.channels.A0, A0 + np.array([[1, 0], [3, 0]]))
    assert [f.text for f in model.channels.functions] == ["tanh(x)"]


numbers = st.floats(allow_nan=False, allow_infinity=False)


@settings(max_examples=50, deadline=None)
@given(st.lists(numbers, min_size=9, max_size=9))
def test_a_file_gives_the_same_bits_back(tmp_path_factory, values):
    """Every binary64 survives saving and loading."""
    a = np.array(values)
    model = PersidskiiModel(a[:4].reshape(2, 2), [("tanh(x)", None, a[1:5].reshape(2, 2))], a[5:7, None], a[7:])
    path = tmp_path_factory.mktemp("model") / "model.json"
    model.save(path)
    again = load_model(path)
    assert again.to_dict() == model.to_dict()
    assert again.A0.tobytes() == model.A0.tobytes()


def test_models_are_equal_where_their_numbers_are(tmp_path):
    """A model that was saved and loaded is the same one, whatever its provenance; another number makes another one."""
    model = PersidskiiModel([[-1.0]], [("x**3", None, [[-0.1]])], [[0.5]], provenance={"method": "weak"})
    model.save(tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert again == model
    assert len({again, model}) == 1
    assert model != PersidskiiModel([[-1.0]], [("x**3", None, [[-0.2]])], [[0.5]])
    assert model != "model"


def test_several_initial_states_are_several_runs():
    """Rows of x0 are simulated one by one under the same input, and a flat list of the wrong length is refused."""
    model = PersidskiiModel([[-1.0]], B=[[1.0]])
    t = np.linspace(0, 1, 11)
    runs = model.simulate([[1.0], [2.0]], t, np.ones(11))
    assert [len(run) for run in runs] == [11, 11]
    assert np.array_equal(runs[1].x, model.simulate([2.0], t, np.ones(11))[0].x)
    for wrong in ([1.0, 2.0], np.zeros((0, 1))):
        with pytest.raises(ModelError, match="x0"):
            model.simulate(wrong, t)


def test_models_can_be_pickled():
    """A pickled model is the same model."""
    assert pickle.loads(pickle.dumps(SMALL)).to_dict() == SMALL.to_dict()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"A0": [[1.0, 0.0, 0.0]]}, "shape"),
        ({"format": "other"}, "format"),
        ({"colour": 1}, "colour"),
        ({"b": [1.0, None]}, "b"),
        ({"states": ["a", "a"]}, "names"),
        ({"terms": [{"f": "open('x')", "R": None, "A": [[1, 0], [0, 1]]}]}, "open"),
        ({"terms": [{"f": ["x", "x", "x"], "R": None, "A": [[1, 0], [0, 1]]}]}, "3 functions"),
    ],
)
def test_broken_model_files_are_refused(tmp_path, change, word):
    """A file that is no model names its fault."""
    path = tmp_path / "model.json"
    path.write_text(json.dumps(SMALL.to_dict() | change))
    with pytest.raises(ModelError, match=word):
        load_model(path)


def test_nan_in_a_file_is_refused(tmp_path):
    """JSON's NaN is not a number a model may hold."""
    path = tmp_path / "model.json"
    path.write_text(json.dumps(SMALL.to_dict() | {"b": [float("nan"), 0]}))
    with pytest.raises(ModelError, match="NaN"):
        load_model(path)


def test_a_linear_model_follows_the_matrix_exponential():
    """With held inputs the simulation agrees with the exact solution."""
    model = PersidskiiModel(A0, B=[[0.5], [0.3]])
    u = np.random.default_rng(0).normal(size=(len(T), 1))
    x, found = np.array([1.0, 3.0]), model.simulate([1.0, 3.0], T, u)[0].x
    block = np.block([[A0, np.array([[0.5], [0.3]])], [np.zeros((1, 3))]])
    for k in range(len(T) - 1):
        x = (expm(block * (T[k + 1] - T[k])) @ np.append(x, u[k]))[:2]
    assert np.allclose(found[-1], x, rtol=1e-7)


@pytest.mark.parametrize("kind", ["held", "steps", "function", "none"])
def test_simulations_agree_with_a_fine_integration(kind):
    """Every form of input gives the solution of the differential equation."""
    held = np.random.default_rng(1).normal(size=(len(T), 1))
    steps = np.sign(np.sin(2 * T))[:, None]
    u = {"held": held, "steps": steps, "function": lambda s: np.array([np.sin(3 * s)]), "none": None}[kind]
    x = np.array([1.0, 3.0])
    for k in range(len(T) - 1):
        at = u if callable(u) else (lambda s, k=k: None if u is None else u[k])
        x = solve_ivp(lambda s, y, at=at: SMALL.rhs(y, at(s)), T[k : k + 2], x, rtol=1e-11, atol=1e-12).y[:, -1]
    assert np.allclose(SMALL.simulate([1.0, 3.0], T, u)[0].x[-1], x, rtol=1e-6)


@pytest.mark.parametrize("u", [None, np.zeros((200, 1)), np.random.default_rng(0).normal(size=(200, 1)) * 1e-3])
def test_a_blow_up_ends_the_run_and_names_its_time(u):
    """x' = x + x^3 from 1 blows up at ln(2)/2 s, without a warning and without NaN."""
    run = PersidskiiModel([[1.0]], [("x**3", None, [[1.0]])], [[1.0]]).simulate([1.0], T, u)[0]
    assert run.diverged_at == pytest.approx(np.log(2) / 2, rel=2e-3)
    assert len(run) == 7
    assert np.isfinite(run.x).all()


def test_stiff_models_are_simulated():
    """A rate of 1e5 1/s beside one of 1 1/s takes no 1e5 steps a second."""
    model = PersidskiiModel([[-1e5, 0], [0, -1]], B=[[1.0], [1.0]])
    u = np.sin(T)[:, None]
    run = model.simulate([1.0, 1.0], T, u)[0]
    assert run.diverged_at is None
    assert run.x[-1, 0] == pytest.approx(u[-2, 0] / 1e5, rel=1e-3)


@pytest.mark.long
def test_ten_thousand_held_samples_are_fast(monkeypatch):
    """A new input at every sample costs seven right sides, one explicit step and its restart, and no other solver."""
    looks, drift = [], integration._Solver.drift
    monkeypatch.setattr(integration._Solver, "drift", lambda solver, x: looks.append(None) or drift(solver, x))
    monkeypatch.setattr(scipy.integrate, "LSODA", None)
    t = np.arange(10_000) * 0.01
    u = np.random.default_rng(0).normal(size=(len(t), 1))
    SMALL.simulate([1.0, 3.0], t, u)
    assert len(looks) <= 7 * len(t)


def test_wrong_inputs_are_named():
    """Shapes that do not fit are refused."""
    with pytest.raises(ModelError, match="u has shape"):
        SMALL.simulate([1.0, 3.0], T, np.zeros((3, 1)))
    with pytest.raises(ModelError, match="increasing"):
        SMALL.simulate([1.0, 3.0], T[::-1], None)


JUNK = (None, True, 1.5, "", "x", [], {}, ["x"], [[]], [[1, 2], [3]], [[1, 2], [3, "a"]], {"shape": [2, 2]}, 10**400)


def _places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    yield path
    entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, entry in entries:
        yield from _places(entry, (*path, key))


def test_a_malformed_file_is_a_model_error(tmp_path: Path) -> None:
    """Whatever stands at any place of model.json, it is read or refused as a ModelError."""
    model = PersidskiiModel(-np.eye(2), [(["x**3"], [[1.0, -1.0]], [[-0.5], [0.5]])], [[1.0], [1.0]]).to_dict()
    path, refused = tmp_path / "model.json", 0
    for place in _places(model):
        for junk in JUNK:
            content = copy.deepcopy(model)
            target: Any = content
            for key in place[:-1]:
                target = target[key]
            if place:
                target[place[-1]] = junk
            path.write_text(json.dumps(content if place else junk))
            try:
                load_model(path)
            except ModelError:
                refused += 1
    assert refused > 300


def test_a_sum_is_set_in_brackets() -> None:
    """A factor before a function that is a sum belongs to all of it: -(tanh(x) - 0.5), as text and in LaTeX."""
    model = PersidskiiModel(A0=[[-1.0]], terms=[("tanh(x)-0.5", None, [[-1.0]])], B=[[1.0]])
    assert equations(model) == "d(x1)/dt = -1 x1 - 1 (tanh(x1)-0.5) + 1 u1"
    assert r"- 1 \left(\tanh \left(x_{1}\right) - 0.5\right) + 1 u_{1}" in equations(model, "latex")
    one = PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])])
    assert equations(one) == "d(x1)/dt = -1 x1 - 1 x1**3"


def test_a_row_of_a_matrix_is_a_line_of_the_file(tmp_path: Path) -> None:
    """What is written is read again as the same model; NaN is refused."""
    model = PersidskiiModel([[-1.0, 0.5], [0.1, -2.0]], [("x**3", None, -np.eye(2))], np.eye(2), provenance={"a": {}})
    model.save(tmp_path / "model.json")
    lines = [line.strip(" ,") for line in (tmp_path / "model.json").read_text(encoding="utf-8").splitlines()]
    assert lines.count("[-1.0, 0.5]") == 1
    assert lines.count("[-1.0, -0.0]") == 1
    assert load_model(tmp_path / "model.json") == model
    with pytest.raises(ValueError, match="not JSON compliant"):
        readable({"a": [[1.0], [np.nan]]})
