"""Functions that are learned with the model: curves of known truth come back, whatever machinery fits them."""

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

import persid as ps
from persid.errors import DataError
from persid.identification.learned import knots, ramps, simplest, with_ramps
from persid.models.functions import scalar_function

Array = Float[ndarray, " N"]
STEP, SAMPLES, NOISE = 0.05, 2000, 0.01


def outflow(x: ndarray) -> ndarray:
    """A level that runs out as the square root does, on both sides."""
    return np.asarray(-np.sign(x) * np.sqrt(np.abs(x)))


CURVES = {
    "outflow": (outflow, 1.5),
    "dead zone": (lambda x: -0.5 * x - 2 * np.sign(x) * np.maximum(np.abs(x) - 0.5, 0), 2.0),
    "saturation": (lambda x: -0.3 * x - 2 * np.clip(x, -0.5, 0.5), 1.5),
    "friction": (lambda x: -0.5 * x - 0.5 * np.tanh(8 * x), 1.5),
}


def measured(curve, size: float, seed: int = 0, n: int = 1) -> ps.Trajectories:
    """2,000 samples of x' = f(x) + u, u in random steps of 1 s, with noise of 1 % of the range.

    With two states the first one's outflow -f(x1) is the second one's inflow.
    """
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-size, size, SAMPLES // 20), 20)

    def slope(x: ndarray, v: float) -> ndarray:
        f = curve(x)
        return f + np.array([v, *(-f[:-1])])

    x = np.zeros((SAMPLES, n))
    for k in range(SAMPLES - 1):
        y = x[k]
        for _ in range(4):  # the midpoint rule
            y = y + STEP / 4 * slope(y + STEP / 8 * slope(y, u[k]), u[k])
        x[k + 1] = y
    noise = NOISE * np.ptp(x, axis=0) * rng.normal(size=x.shape)
    return ps.Trajectories.from_arrays(x + noise, u=u[:, None], dt=STEP)


def along(model: ps.PersidskiiModel, x: Array, state: int = 0) -> Array:
    """The right side of one equation where one state is x and the others, and the inputs, are 0."""
    points = np.zeros((len(x), model.n))
    points[:, state] = x
    return np.asarray(model.rhs(points, np.zeros((len(x), model.m)))[:, state])


def miss(found: Array, truth: Array) -> float:
    """The root mean square of what is missed, in shares of the true curve's range."""
    return float(np.sqrt(np.mean((found - truth) ** 2)) / np.ptp(truth))


def middle(data: ps.Trajectories, state: int = 0) -> Array:
    """Places all along the data, one in a hundred left out at either end."""
    return np.linspace(*np.quantile(data[0].x[:, state], [0.01, 0.99]), 400)


@pytest.mark.long
@pytest.mark.parametrize("name", CURVES)
def test_a_curve_comes_back(name: str) -> None:
    """From 2,000 noisy samples each curve is learned within 3 % of its range, and what is learned is certified."""
    curve, size = CURVES[name]
    data = measured(curve, size)
    fit = ps.PersidskiiIdentifier(functions=["x", "pwl"]).fit(data)
    x = middle(data)
    assert miss(along(fit.model_, x), curve(x)) < 0.03
    best_line = ps.PersidskiiIdentifier(functions=["x"]).fit(data).model_
    assert miss(along(best_line, x), curve(x)) > 0.04
    assert f"{fit.knots_} knots a state" in " ".join(fit.report_.notes)
    assert ps.certify(fit.model_, time_limit=30).is_certified


def test_a_monotone_curve_has_slopes_of_one_sign() -> None:
    """Where noise makes a learned curve turn back, the monotone fit does not, and costs little."""
    data = measured(lambda x: -np.clip(x, -0.3, 0.3), 0.5, seed=1)
    data = ps.Trajectories.from_arrays(
        data[0].x + 0.05 * np.random.default_rng(2).normal(size=(SAMPLES, 1)), u=data[0].u, dt=STEP
    )
    x = np.linspace(-3, 3, 1500)
    free, one = (
        ps.PersidskiiIdentifier(["x", "pwl"], knots=9, ridge=1e-6, holdout=0.0, monotone=monotone).fit(data)
        for monotone in (False, True)
    )
    assert np.diff(along(free.model_, x)).max() > 1e-4
    assert np.diff(along(one.model_, x)).max() <= 1e-9
    residuals = [fit.gram_.residual(fit.coef_.T)[0] for fit in (free, one)]
    assert residuals[0] <= residuals[1] * (1 + 1e-9) < 1.2 * residuals[0]


def test_a_condition_that_holds_changes_nothing() -> None:
    """Where all slopes have one sign anyway the monotone fit is the free one."""
    data = measured(*CURVES["outflow"])
    free, one = (
        ps.PersidskiiIdentifier(["x", "pwl"], knots=3, ridge=1e-4, holdout=0.0, monotone=monotone).fit(data)
        for monotone in (False, True)
    )
    assert np.allclose(free.coef_, one.coef_, rtol=1e-6, atol=1e-8)


@pytest.mark.long
def test_without_x_the_ramps_hold_the_linear_part() -> None:
    """A learned function alone, in one list a state, is the same set of curves as x and a learned function."""
    data = measured(*CURVES["saturation"])
    alone, both = (
        ps.PersidskiiIdentifier(functions, knots=6, ridge=0.0).fit(data) for functions in ([["pwl"]], ["x", "pwl"])
    )
    x = middle(data)
    assert np.allclose(along(alone.model_, x), along(both.model_, x), rtol=1e-6, atol=1e-8)
    assert not alone.model_.A0.any()


def test_ramps_add_up_to_x() -> None:
    """The ramps between knots are 0 at 0 and add up to x; beside x the one about 0 is missing."""
    y, at = np.linspace(-5, 5, 401), np.array([-1.5, -0.25, 0.5, 2.0])
    every, beside = (ramps(at, beside_x=beside_x) for beside_x in (False, True))
    values = np.array([scalar_function(text).value(y) for text in every])
    assert np.allclose(values.sum(axis=0), y)
    assert all(scalar_function(text).value(0.0) == 0 for text in every)
    assert all(set(np.round(np.diff(v) / np.diff(y), 9)) >= {0.0, 1.0} for v in values)
    assert len(every) == 5
    assert [text for text in every if text not in beside] == [every[2]]


@pytest.mark.parametrize("at", [[0.0], [0.0, 1.0], [-1.0, 0.0], [0.5, 1.0], [-1.0, -0.5]])
def test_ramps_whose_knots_lie_on_one_side_or_at_zero(at: list[float]) -> None:
    """A knot at 0, or none on one side of it, makes no difference."""
    y = np.linspace(-3, 3, 301)
    values = [scalar_function(text).value(y) for text in ramps(np.array(at), beside_x=False)]
    assert np.allclose(sum(values), y)
    assert len(ramps(np.array(at), beside_x=True)) == len(values) - 1


def test_knots_stand_where_the_data_are() -> None:
    """Knots are quantiles, each once; of data that rest there is one."""
    assert np.allclose(knots(np.linspace(0, 1, 1001), 3), [0.25, 0.5, 0.75])
    assert knots(np.full(10, 0.3), 6).tolist() == [77 / 256]
    assert with_ramps(["x", "tanh(x)"], np.zeros(3), 4) == ["x", "tanh(x)"]
    assert simplest([0.104, 0.1, 0.2]) == 0
    assert simplest([0.106, 0.1, 0.1]) == 1


@pytest.mark.long
def test_shared_curves_are_the_same_in_all_states() -> None:
    """With shared=True two tanks have one outflow, learned from the levels of both."""
    data = measured(outflow, 1.5, n=2)
    fit = ps.PersidskiiIdentifier(["x", "pwl"], knots=6, x_ref=0.0, scale=0.5, shared=True, ridge=1e-4).fit(data)
    x = middle(data)
    assert np.allclose(along(fit.model_, x, 0) - fit.model_.b[0], along(fit.model_, x, 1) - fit.model_.b[1])
    first, second = (along(fit.model_, x, state) - fit.model_.b[state] for state in (0, 1))
    assert np.allclose(first, second)
    assert miss(first, outflow(x)) < 0.05


@pytest.mark.long
def test_curves_of_two_states_are_learned_from_their_equations() -> None:
    """In two tanks in a row each equation has the curves of both levels, and learns its own."""
    data = measured(outflow, 1.5, n=2)
    model = ps.PersidskiiIdentifier(["x", "pwl"], knots=6).fit(data).model_
    for state in (0, 1):
        x = middle(data, state)
        assert miss(along(model, x, state) - along(model, np.zeros(1), state), outflow(x)) < 0.04


@pytest.mark.long
def test_discrete_time_and_koopman_learn_too() -> None:
    """The other ways to a regression take learned functions without a word of their own."""
    data = measured(*CURVES["saturation"])
    for how in ({"time": "discrete"}, {"method": "edmd"}):
        fit = ps.PersidskiiIdentifier(["x", "pwl"], knots=3, **how).fit(data)
        assert fit.knots_ == 3
        assert fit.report_.free_run.r2_mean > 0.98
    assert ps.PersidskiiIdentifier(["x", "pwl"], method="edmd").fit(data).knots_ == 6


@pytest.mark.long
def test_data_out_of_memory_learn_too(tmp_path) -> None:
    """Read chunk by chunk, the same functions are learned."""
    data = measured(*CURVES["saturation"])
    path = tmp_path / "long.csv"
    rows = np.column_stack([data[0].t, data[0].x, data[0].u])
    np.savetxt(path, rows, delimiter=",", header="t,x1,u1", comments="")
    opened = ps.open_recordings(path, time="t", states=["x1"], inputs=["u1"])
    near, far = (ps.PersidskiiIdentifier(["x", "pwl"], knots=3, ridge=1e-4).fit(one) for one in (data, opened))
    x = middle(data)
    assert miss(along(far.model_, x), along(near.model_, x)) < 1e-3


@pytest.mark.parametrize(
    ("more", "what"),
    [
        ({"knots": 0}, "knots=0"),
        ({"knots": 61}, "1 to 60"),
        ({"knots": "many"}, "'many'"),
        ({"functions": ["x"], "monotone": True}, 'add "pwl"'),
        ({"shared": True, "monotone": True}, "shared="),
        ({"refine": True, "monotone": True}, "refine="),
        ({"threshold": 0.1, "monotone": True}, "threshold="),
        ({"instruments": True, "monotone": True}, "instruments="),
    ],
)
def test_options_that_cannot_be_kept_are_refused(more, what) -> None:
    """Numbers of knots that are none, and conditions that a later step would break, are named."""
    with pytest.raises(DataError, match=what):
        ps.PersidskiiIdentifier(**({"functions": ["x", "pwl"]} | more)).fit(measured(*CURVES["saturation"]))


def test_a_fit_under_the_certificate_refuses_what_it_does_not_keep() -> None:
    """A monotone estimator is not fitted under the certificate as if it were none."""
    with pytest.raises(DataError, match="does not keep monotone"):
        ps.CertifiedIdentifier(ps.PersidskiiIdentifier(["x", "pwl"], monotone=True)).fit(
            measured(*CURVES["saturation"])
        )


@pytest.mark.long
def test_a_fit_under_the_certificate_learns_too() -> None:
    """The slopes of ramps are unknowns of the joint problem like other coefficients; the result is certified."""
    data = measured(outflow, 1.5, n=2)
    free = ps.PersidskiiIdentifier(["x", "pwl"], knots=3, ridge=1e-4)
    best = ps.CertifiedIdentifier(free, ridge=1e-4, min_rate=0.5, time_limit=40).fit(data)
    assert best.verdict_.is_certified
    assert best.certificate_.rate >= 0.5
    x = middle(data)
    assert miss(along(best.model_, x), outflow(x)) < 0.06
