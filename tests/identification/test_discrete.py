"""Models in discrete time straight from samples: what they recover, how steps are chosen, what is refused."""

import numpy as np
import pytest
from sklearn.base import clone

import persid as ps
from persid.errors import DataError, GeneratorError
from persid.identification.recursion import STRIDES
from persid.measurements.strides import at_steps, strided

TRUTH = ps.PersidskiiModel(
    [[0.5, 0.2], [-0.1, 0.6]], [("tanh(x)", None, [[0.25, 0], [0, -0.2]])], [[1.0], [0.3]], time="discrete", dt=0.1
)


def _runs(model: ps.PersidskiiModel, count: int = 400, seed: int = 0) -> ps.Trajectories:
    u = np.random.default_rng(seed).normal(size=(count, model.m))
    return model.simulate(np.ones(model.n), model.dt * np.arange(count), u)


def test_a_recursion_is_recovered() -> None:
    """Samples of a recursion give its coefficients back, at the step of the samples and in its own functions."""
    fit = ps.PersidskiiIdentifier(["x", "tanh(x)"], time="discrete").fit(_runs(TRUTH))
    assert (fit.stride_, fit.model_.time, fit.model_.dt) == (1, "discrete", pytest.approx(0.1))
    for found, true in ((fit.model_.A0, TRUTH.A0), (fit.model_.terms[0].A, TRUTH.terms[0].A), (fit.model_.B, TRUTH.B)):
        assert np.allclose(found, true, atol=1e-4)
    assert fit.report_.method == "one-step"
    assert fit.report_.free_run.r2 > 0.999999
    assert np.allclose(fit.basis_.coefficients(fit.model_), fit.coef_.T)


def test_states_without_a_linear_part_are_fitted() -> None:
    """Where x itself is no function, as in a network of neurons, A0 is zero and the rest is recovered."""
    rng = np.random.default_rng(3)
    truth = ps.PersidskiiModel(
        np.zeros((2, 2)), [("tanh(x)", None, 0.5 * rng.normal(size=(2, 2)))], [[1.0], [0.5]], time="discrete", dt=1.0
    )
    fit = ps.PersidskiiIdentifier(["tanh(x)"], time="discrete", stride=1).fit(_runs(truth))
    assert not fit.model_.A0.any()
    assert np.allclose(fit.model_.terms[0].A, truth.terms[0].A, atol=1e-4)


def test_the_logarithm_that_does_not_exist_is_not_needed() -> None:
    """Of a map with an eigenvalue of -.6 EDMD has no logarithm and says what to do; discrete time certifies it."""
    truth = ps.PersidskiiModel([[-0.6]], [("tanh(x)", None, [[-0.2]])], [[1.0]], time="discrete", dt=0.1)
    data = _runs(truth)
    with pytest.raises(GeneratorError, match='time="discrete"'):
        ps.PersidskiiIdentifier(["x", "tanh(x)"], method="edmd").fit(data)
    fit = ps.PersidskiiIdentifier(["x", "tanh(x)"], time="discrete").fit(data)
    assert fit.model_.A0[0, 0] == pytest.approx(-0.6, abs=1e-3)
    assert ps.certify(fit.model_).is_certified


def test_noise_pulls_short_steps_and_longer_ones_are_chosen() -> None:
    """Of a slow plant with noise a step of one sample errs by far; "auto" takes more, and foretells better."""
    t = 0.01 * np.arange(3000)
    plant = ps.PersidskiiModel([[-1.0, 1.0], [-1.0, -1.0]], (), [[0.0], [1.0]])
    u = np.repeat(np.random.default_rng(1).normal(size=(60, 1)), 50, axis=0)
    clean = plant.simulate([1.0, 0.0], t, u)[0]
    noisy = clean.x + 0.02 * np.random.default_rng(2).normal(size=clean.x.shape)
    data = ps.Trajectories.from_arrays(noisy, u, t=t)
    short, auto = (ps.PersidskiiIdentifier(["x"], time="discrete", stride=s).fit(data) for s in (1, "auto"))
    assert auto.stride_ in STRIDES[2:]
    assert auto.report_.free_run.rmse < 0.6 * short.report_.free_run.rmse
    assert f"{auto.stride_} sample(s)" in auto.report_.notes[-1]


def test_a_stride_is_a_step_of_the_model_and_wastes_no_sample() -> None:
    """With five samples a step the model's dt is five times theirs, and every sample begins a row."""
    data = _runs(TRUTH, 403)
    fit = ps.PersidskiiIdentifier(["x"], time="discrete", stride=5).fit(data)
    assert fit.model_.dt == pytest.approx(0.5)
    assert fit.gram_.rows > 380
    assert len(fit.predict(data)) == len(strided(data, 5)[0]) == 81
    assert fit.score(data) > 0.2  # what inputs do within a step is lost
    assert fit.report_.coverage[0][0] >= data[0].x[:, 0].min()


def test_inputs_of_a_step_are_means() -> None:
    """The input of a step is the mean of its samples, of fewer at the end."""
    data = ps.Trajectories.from_arrays(np.zeros((7, 1)), np.arange(7.0), dt=0.5)
    run = strided(data, 3)[0]
    assert run.u[:, 0].tolist() == [1.0, 4.0, 6.0]
    assert run.t.tolist() == [0.0, 1.5, 3.0]


def test_samples_that_fit_no_step_are_refused() -> None:
    """Measurements are brought to the steps of a model, or refused where a step is no whole number of samples."""
    data = ps.Trajectories.from_arrays(np.zeros((40, 1)), dt=0.1)
    assert len(at_steps(data, 0.5)[0]) == 8
    with pytest.raises(DataError, match="whole number"):
        at_steps(data, 0.25)
    with pytest.raises(DataError, match="more than 50 samples"):
        strided(data, 50)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"time": "sampled"}, "continuous, discrete"),
        ({"time": "discrete", "stride": 0}, "from 1 on"),
        ({"time": "discrete", "stride": "all"}, "from 1 on"),
        ({"stride": 5}, 'add time="discrete"'),
        ({"time": "discrete", "method": "edmd"}, "continuous time"),
        ({"time": "discrete", "hold": "paper"}, "continuous time"),
        ({"time": "discrete", "refine": True}, "continuous time"),
        ({"time": "discrete", "velocities": {"x1": "x2"}}, "continuous time"),
    ],
)
def test_options_that_do_not_go_together_are_refused(options, words: str) -> None:
    """What has no meaning in discrete time is refused by name, and a stride needs discrete time."""
    with pytest.raises(DataError, match=words):
        ps.PersidskiiIdentifier(["x"], **options).fit(_runs(TRUTH, 60))


def test_a_fit_in_steps_is_a_scikit_learn_estimator() -> None:
    """A clone has the same options, and fits of it under a certificate are refused by name."""
    fit = ps.PersidskiiIdentifier(["x"], time="discrete", stride=2)
    assert clone(fit).get_params() == fit.get_params()
    with pytest.raises(DataError, match="continuous time"):
        ps.CertifiedIdentifier(fit).fit(_runs(TRUTH, 60))


def test_the_past_may_be_appended() -> None:
    """Delayed states stand in the recursion as states of their own."""
    fit = ps.PersidskiiIdentifier(["x"], time="discrete", delays=1, stride=1).fit(_runs(TRUTH, 200))
    assert fit.model_.n == 4
    assert fit.report_.free_run.r2 > 0.9
