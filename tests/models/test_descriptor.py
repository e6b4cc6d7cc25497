"""Models with algebraic variables: their files, what is solved for, runs, and what is refused."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import persid as ps
from descriptors import diode, loop, network


def test_a_file_gives_the_same_model_back(tmp_path: Path) -> None:
    """Number for number, names included, and its hash is that of the checker."""
    for model in (loop(0.1), diode(), network(2, 3, 0)):
        model.save(tmp_path / "m.json")
        again = ps.load_model(tmp_path / "m.json")
        assert isinstance(again, ps.DescriptorModel)
        assert again == model
        assert (again.states, again.algebraic) == (model.states, model.algebraic)


def test_equations_are_solved_along_a_run() -> None:
    """A run of a model whose equations are linear is that of the model with the variables eliminated."""
    rng = np.random.default_rng(0)
    n, k = 2, 2
    A0 = rng.normal(size=(n + k, n + k)) - 3 * np.eye(n + k)
    model = ps.DescriptorModel(A0, [], np.vstack([np.eye(n), rng.normal(size=(k, n))]), algebraic=k)
    J, D = model.jacobian(np.zeros(n + k)), np.linalg.inv(A0[n:, n:])
    plain = ps.PersidskiiModel(J, [], np.eye(n) - A0[:n, n:] @ D @ model.rows.B[n:])
    t, u = np.linspace(0, 3, 31), rng.normal(size=(31, n))
    found, expected = model.simulate([1.0, -1.0], t, u)[0], plain.simulate([1.0, -1.0], t, u)[0]
    np.testing.assert_allclose(found.x[:, :n], expected.x, atol=1e-6)
    assert np.abs(model.rows.rhs(found.x, found.u)[:-1, n:]).max() < 1e-9


def test_inputs_that_jump_move_algebraic_variables_at_once() -> None:
    """In the sample where the input jumps the equations hold for the new input."""
    model = ps.DescriptorModel([[-1.0, 1.0], [1.0, -1.0]], [("tanh(x)", [[0.0, 1.0]], [[0.0], [-1.0]])],
                               [[0.0], [1.0]], algebraic=1)  # fmt: skip
    t = np.linspace(0, 1, 11)
    run = model.simulate([1.0], t, np.where(t < 0.5, 0.0, 3.0)[:, None])[0]
    assert run.x[5, 1] - run.x[4, 1] > 1
    assert np.abs(model.rows.rhs(run.x, run.u)[:, 1]).max() < 1e-8


def test_a_run_ends_where_the_equations_end() -> None:
    """x' = 1 with w**2 = 4 - x has no solution after x = 4: the run is stopped before, within a step, and not bent."""
    model = ps.DescriptorModel([[0.0, 0.0], [-1.0, 0.0]], [("x**2", [[0.0, 1.0]], [[0.0], [-1.0]])],
                               b=[1.0, 4.0], algebraic=["w"])  # fmt: skip
    run = model.simulate([0.0], np.linspace(0, 6, 61), near=[2.0])[0]
    assert run.stopped_at is not None
    assert 3.0 < run.stopped_at < 4.0
    assert np.abs(run.x[:, 1] ** 2 - (4 - run.x[:, 0])).max() < 1e-8
    with pytest.raises(ps.ModelError, match="no solution of the equations"):
        model.simulate([5.0], np.linspace(0, 1, 11))


def test_a_step_down_a_growing_model_diverges() -> None:
    """A state that leaves all bounds is said to diverge."""
    model = ps.DescriptorModel([[1.0, 1.0], [1.0, -1.0]], algebraic=1)
    assert model.simulate([1.0], np.linspace(0, 50, 51))[0].diverged_at is not None


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"algebraic": 0}, "needed is at least one"),
        ({"algebraic": 2}, "and one state"),
        ({"algebraic": ["x1"]}, "different names"),
        ({"algebraic": 1, "time": "discrete", "dt": 1.0}, "continuous time"),
    ],
)
def test_what_is_no_such_model_is_refused(more: dict[str, Any], message: str) -> None:
    """With what is needed."""
    with pytest.raises(ps.ModelError, match=message):
        ps.DescriptorModel([[-1.0, 0.0], [0.0, -1.0]], **more)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"algebraic": []}, "at least one"),
        ({"algebraic": ["x1"]}, "different names"),
        ({"algebraic": "w"}, "lists of names"),
        ({"time": "discrete", "dt": 1.0}, "continuous time"),
        ({"masses": 1}, "unknown field"),
        ({"A0": [[1.0]]}, "shape"),
    ],
)
def test_a_file_that_is_none_is_refused(tmp_path: Path, change: dict[str, Any], message: str) -> None:
    """With its name and what is needed."""
    path = tmp_path / "m.json"
    path.write_text(json.dumps({**loop(0.5).to_dict(), **change}))
    with pytest.raises(ps.ModelError, match=f"(?s)m.json.*{message}"):
        ps.load_model(path)


def test_equations_are_written() -> None:
    """As text, 0 = … for an algebraic variable; other forms are refused."""
    assert ps.equations(loop(0.5)).splitlines()[1].startswith("0 = ")
    assert ps.equations(loop(0.5)).splitlines()[0].startswith("d(x1)/dt = ")
    with pytest.raises(ps.DataError, match="text"):
        ps.equations(loop(0.5), "latex")
