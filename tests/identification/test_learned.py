"""Functions that are learned with the model: curves of known truth come back, whatever machinery fits them."""

import numpy as np
import pytest
from jaxtyping import Float
from numpy import ndarray

import persid as ps
from persid.errors import DataError
from persid.identification.learned import knots, ramps, simplest, with_ramps
from persid.models.functions import scalar_function
from persid.plots.characteristics import effect
from persid.reports.folder import write_folder
from persid.reports.results import Results

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


ROW = np.array([[-1.0, 0.0, 0.0], [1.0, -0.7, 0.0], [0.0, 0.7, -0.5]])  # three tanks: what each outflow adds where
SHARED = {
    "outflow": lambda x: np.sign(x) * (np.sqrt(np.abs(x) + 0.02) - np.sqrt(0.02)),
    "dead zone": lambda x: 0.3 * x + np.sign(x) * np.maximum(np.abs(x) - 0.5, 0),
    "saturation": lambda x: 0.3 * x + 2 * np.clip(x, -0.5, 0.5),
}


def in_a_row(curve, seed: int = 0, noise: float = NOISE) -> ps.Trajectories:
    """2,000 samples of x' = ROW f(x) + (u, 0, 0)', u in random steps of 1 s, with noise of 1 % of the range."""
    rng = np.random.default_rng(seed)
    u = np.repeat(rng.uniform(-1.5, 1.5, SAMPLES // 20), 20)
    x = np.zeros((SAMPLES, 3))
    for k in range(SAMPLES - 1):
        y, first = x[k], np.array([u[k], 0.0, 0.0])
        for _ in range(4):  # the midpoint rule
            half = y + STEP / 8 * (ROW @ curve(y) + first)
            y = y + STEP / 4 * (ROW @ curve(half) + first)
        x[k + 1] = y
    return ps.Trajectories.from_arrays(x + noise * np.ptp(x, axis=0) * rng.normal(size=x.shape), u=u[:, None], dt=STEP)


@pytest.mark.long
@pytest.mark.parametrize("name", SHARED)
def test_one_curve_of_three_tanks_comes_back(name: str) -> None:
    """Within 3 % of its range wherever it stands, with its factors; the model has it once a state, and is certified."""
    curve, data = SHARED[name], in_a_row(SHARED[name])
    fit = ps.PersidskiiIdentifier(["pwl"], one_curve=True, pattern=ROW != 0).fit(data)
    model = fit.model_
    assert ps.plots.tabulated(model) == [(0, 0), (1, 0), (1, 1), (2, 1), (2, 2)]
    assert len({f.text for f in model.channels.functions}) == 1
    assert len(model.channels.functions) == 3
    for i, j in ps.plots.tabulated(model):
        x = middle(data, j)
        found, truth = effect(model, i, j, x)[0], ROW[i, j] * curve(x)
        assert miss(found - found.mean(), truth - truth.mean()) < 0.03
    assert ps.certify(model, time_limit=30).is_certified


def test_one_curve_without_noise_is_found_with_its_factors() -> None:
    """With knots of its own at no corner a straight curve comes back to rounding, all factors and slopes."""
    data = in_a_row(lambda x: x, noise=0.0)
    fit = ps.PersidskiiIdentifier(["pwl"], one_curve=True, knots=3, ridge=0.0, pattern=ROW != 0).fit(data)
    at = np.linspace(-1, 1, 21)
    for i, j in ps.plots.tabulated(fit.model_):
        assert np.allclose(effect(fit.model_, i, j, at)[0], ROW[i, j] * at, atol=5e-3)


def test_one_curve_is_less_uncertain_than_curves_of_their_own() -> None:
    """All places tell of it: with noise of 5 % it misses less than what each place tells alone."""
    curve, data = SHARED["dead zone"], in_a_row(SHARED["dead zone"], noise=0.05)
    missed = []
    for one_curve in (True, False):
        how = {"one_curve": one_curve, "knots": 6, "ridge": 1e-6, "pattern": ROW != 0}
        model = ps.PersidskiiIdentifier(["pwl"], **how).fit(data).model_
        x = [middle(data, j) for j in range(3)]
        found = [(effect(model, i, j, x[j])[0], ROW[i, j] * curve(x[j])) for i, j in ps.plots.tabulated(model)]
        missed.append(np.mean([miss(a - a.mean(), b - b.mean()) for a, b in found]))
    assert missed[0] < 0.9 * missed[1]


def test_one_curve_stands_beside_other_functions() -> None:
    """Of some states only, beside x and beside a table that is given: these keep coefficients of their own."""
    data = in_a_row(SHARED["saturation"])
    given = "pwl(x; -1: 0, 1: 0, 2: 1)"
    fit = ps.PersidskiiIdentifier([["x", "pwl"], ["x", "pwl", given], ["x"]], one_curve=True, knots=3).fit(data)
    texts = {f.text for f in fit.model_.channels.functions}
    assert len(texts) == 2
    assert fit.basis_.scale[0] == fit.basis_.scale[1]
    assert np.linalg.matrix_rank(fit.model_.A0) == 3


@pytest.mark.long
def test_one_curve_is_learned_in_discrete_time_under_the_certificate_and_drawn(tmp_path) -> None:
    """What takes given functions takes the learned curve: steps, joint fits, bootstrap and the report."""
    data = in_a_row(SHARED["outflow"])
    stepped = ps.PersidskiiIdentifier(["x", "pwl"], one_curve=True, knots=3, time="discrete").fit(data)
    assert stepped.report_.free_run.r2_mean > 0.95
    free = ps.PersidskiiIdentifier(["pwl"], one_curve=True, knots=3, pattern=ROW != 0)
    best = ps.CertifiedIdentifier(free, min_rate=0.3, time_limit=40).fit(data)
    assert best.verdict_.is_certified
    texts = [{f.text for f in model.channels.functions} for model in (best.model_, free.fit(data).model_)]
    assert texts[0] == texts[1]
    assert len(ps.bootstrap(free, 3).models) == 3
    write_folder(tmp_path, Results(best.model_, best.verdict_, data, None))
    assert "Piecewise linear curves" in (tmp_path / "report.html").read_text()


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
        ({"functions": ["x"], "one_curve": True}, 'add "pwl"'),
        ({"monotone": True, "one_curve": True}, "monotone does not go"),
        ({"shared": True, "one_curve": True}, "shared does not go"),
        ({"method": "edmd", "one_curve": True}, "method='edmd' does not go"),
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
