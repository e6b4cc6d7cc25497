"""Identification of models with algebraic variables that are measured: known models come back, and are certified."""

from functools import cache

import numpy as np
import pytest

import persid as ps
from descriptors import circuit


@cache
def ran() -> ps.Trajectories:
    """A run of the circuit with a current that jumps each second."""
    t = np.linspace(0, 16, 801)
    u = np.repeat(np.random.default_rng(1).uniform(-1, 3, 17), 50)[:801, None]
    return circuit().simulate([0.0], t, u)


def measured(noise: float) -> ps.Trajectories:
    """The same with noise on every sample."""
    run, rng = ran(), np.random.default_rng(0)
    t, u, x = run[0].t, run[0].u, run[0].x + noise * rng.normal(size=run[0].x.shape)
    return ps.Trajectories((ps.Trajectory(t, x, u),), run.states, run.inputs)


def fitted(data: ps.Trajectories) -> ps.DescriptorIdentifier:
    """The fit with the circuit's topology, an exponential of the node's voltage, and nothing else."""
    known = {"x_ref": [0, 0, 0], "scale": [1, 1, 1], "pattern": [[1, 1, 0], [1, 0, 1], [0, 1, 0]]}
    functions = [["x"], ["x", "expm1(x)"], ["x"]]
    return ps.DescriptorIdentifier(["node", "diode"], functions, ridge=1e-6, **known).fit(data)


def test_a_circuit_comes_back_from_samples_without_noise() -> None:
    """Its equations number for number; free runs over unseen samples miss by less than 1e-4."""
    fit = fitted(measured(0.0))
    model, true = fit.model_, circuit()
    assert max(fit.scores_.values()) < 1e-4
    z = np.array([0.3, 0.2, 0.1])
    np.testing.assert_allclose(model.rows.rhs(z)[1:], true.rows.rhs(z)[1:], atol=1e-4)


def test_noise_of_1_percent_is_foretold_to_the_noise() -> None:
    """Free runs over noisy unseen samples miss them by about the noise itself."""
    assert max(fitted(measured(0.01)).scores_.values()) < 0.015


@pytest.mark.long
def test_a_circuit_that_was_identified_is_certified() -> None:
    """What noise does to its numbers does no harm."""
    assert ps.certify(fitted(measured(0.01)).model_).is_certified


def test_an_order_of_columns_is_no_matter() -> None:
    """Algebraic variables may stand anywhere in the data; in the model they come last."""
    data = measured(0.0)
    turned = ps.Trajectories(
        tuple(ps.Trajectory(run.t, run.x[:, ::-1], run.u) for run in data), data.states[::-1], data.inputs
    )
    known = {"x_ref": [0, 0, 0], "scale": [1, 1, 1], "pattern": [[0, 1, 0], [1, 0, 1], [0, 1, 1]]}
    fit = ps.DescriptorIdentifier(["node", "diode"], [["x"], ["x", "expm1(x)"], ["x"]], ridge=1e-6, **known).fit(turned)
    assert fit.model_.variables == ("v", "node", "diode")
    z = np.array([0.3, 0.2, 0.1])
    np.testing.assert_allclose(fit.model_.rows.rhs(z), fitted(data).model_.rows.rhs(z), atol=1e-6)


@pytest.mark.parametrize("names", [[], ["current"], ["v", "node", "diode"]])
def test_algebraic_variables_are_columns_but_not_all(names: list[str]) -> None:
    """With the columns that there are."""
    with pytest.raises(ps.DataError, match="needed are some of"):
        ps.DescriptorIdentifier(names, ["x"]).fit(measured(0.0))


def test_a_share_to_hold_out_is_a_share() -> None:
    """From 0 to below 1."""
    with pytest.raises(ps.DataError, match="holdout"):
        ps.DescriptorIdentifier(["node"], ["x"], holdout=1).fit(measured(0.0))
