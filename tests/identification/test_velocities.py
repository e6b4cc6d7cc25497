"""Velocities: equations x1' = x2 that are known, whether x2 was measured or appended."""

import json
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from persid.commands import cli
from persid.identification.derivatives import embedded


def swinging() -> ps.Trajectories:
    """The angle alone of a damped pendulum under an input, with a little noise."""
    model = ps.PersidskiiModel(
        [[0, 1], [0, -0.4]], [("sin(x)", [[1, 0]], [[0], [-2.0]])], [[0], [1]], states=["phi", "omega"], inputs=["u"]
    )
    t = 0.05 * np.arange(1600)
    u = np.random.default_rng(3).choice([-1.0, 1.0], 80).repeat(20)[:, None]
    return model.simulate([0.5, 0.0], t, u)


@pytest.mark.parametrize("method", ["weak", "derivative", "edmd"])
def test_the_equation_of_a_velocity_is_known(method: str) -> None:
    """With velocities appended theta' = theta_dot holds exactly, by every method, and the other equation is fitted."""
    both = swinging()
    data = ps.Trajectories.from_arrays([both[0].x[:, :1]], t=[both[0].t], u=[both[0].u])
    model = (
        ps.PersidskiiIdentifier(["x", "sin(x)"], method=method, scale=1.0, x_ref=0.0, derivatives=1).fit(data).model_
    )
    assert model.states == ("x1", "x1_dot")
    assert model.A0[0].tolist() == [0.0, 1.0]
    assert model.b[0] == 0
    assert not model.B[0].any()
    assert all(not term.A[0].any() for term in model.terms)


def test_a_measured_velocity_is_named() -> None:
    """velocities= fixes the equation of a state whose derivative was measured, also about another reference point."""
    data = swinging()
    model = ps.PersidskiiIdentifier(["x", "sin(x)"], x_ref=[0.25, 0.5], velocities={"phi": "omega"}).fit(data).model_
    x = np.random.default_rng(0).normal(size=(20, 2))
    np.testing.assert_array_equal(model.rhs(x, np.ones((20, 1)))[:, 0], (x[:, 1] - 0.5) + 0.5)


@pytest.mark.long
def test_a_known_velocity_stays_under_the_certificate_and_under_refinement() -> None:
    """Neither a fit under the certificate nor refinement touches an equation that is known."""
    data = swinging()
    fit = ps.PersidskiiIdentifier(["x", "tanh(x)"], velocities={"phi": "omega"}, refine=True).fit(data)
    assert fit.model_.A0[0].tolist() == [0.0, 1.0]
    found = ps.CertifiedIdentifier(fit, time_limit=20).fit(data)
    if found.verdict_.is_certified:
        assert found.model_.A0[0].tolist() == [0.0, 1.0]
        assert all(not term.A[0].any() for term in found.model_.terms)


def spring() -> ps.Trajectories:
    """The position alone of a hardening spring under an input."""
    model = ps.PersidskiiModel([[0, 1], [-1, -0.5]], [("x**3", [[1, 0]], [[0], [-1.0]])], [[0], [1]])
    t, rng = 0.05 * np.arange(1200), np.random.default_rng(3)
    run = model.simulate([0.5, 0.0], t, rng.choice([-1.0, 1.0], 60).repeat(20)[:, None])[0]
    return ps.Trajectories.from_arrays([run.x[:, :1]], t=[t], u=[run.u])


@pytest.mark.long
def test_an_assumed_equation_is_fitted_where_no_certificate_keeps_it() -> None:
    """A hardening spring of which positions were measured gets its certified fit; its velocity then is fitted, too."""
    fit = ps.CertifiedIdentifier(ps.PersidskiiIdentifier(["x", "x**3"], derivatives=1), time_limit=40).fit(spring())
    assert fit.free_.model_.A0[0].tolist() == [0.0, 1.0]
    assert fit.verdict_.is_certified
    assert fit.model_.A0[0] == pytest.approx([0.0, 1.0], abs=0.2)


@pytest.mark.long
def test_the_command_line_assumes_the_equation_as_python_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`persid run --derivatives 1` gives the spring a global certificate, too, and scores the fit that it delivers."""
    monkeypatch.chdir(tmp_path)
    spring().to_dataframe().to_csv("spring.csv")
    words = ["run", "spring.csv", "--states", "x1", "--inputs", "u1", "--derivatives", "1", "--functions", "x,x**3"]
    assert cli.main([*words, "--time-limit", "40", "--json", "-o", "out"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["scope"] == "global"
    assert told["price"] < 2
    assert told["scores"]["rows"][told["scores"]["headline"]]["r2"] > 0.999
    assert ps.load_model("out/model.json").A0[0] == pytest.approx([0.0, 1.0], abs=0.2)


@pytest.mark.parametrize("velocities", ["auto", None])
def test_a_copy_for_appended_data_knows_the_same_equations(velocities: str | None) -> None:
    """Fitted to the appended states themselves, a copy of the estimator gives the model of the fit again."""
    fit = ps.PersidskiiIdentifier(["x", "x**3"], ridge=1e-3, derivatives=1, velocities=velocities).fit(spring())
    again = fit.on_appended().fit(embedded(spring(), derivatives=1))
    assert fit.velocities_ == ({"x1": "x1_dot"} if velocities else {})
    assert again.model_ == fit.model_


@pytest.mark.parametrize(
    ("functions", "velocities", "said"),
    [(["tanh(x)"], {"phi": "omega"}, "add x to functions="), (["x"], {"phi": "v"}, "v is no state")],
)
def test_a_velocity_that_cannot_be_known_is_refused(
    functions: list[str], velocities: dict[str, str], said: str
) -> None:
    """A velocity needs to be a state with a linear column; the error says what to do."""
    with pytest.raises(ps.DataError, match=said):
        ps.PersidskiiIdentifier(functions, velocities=velocities).fit(swinging())
