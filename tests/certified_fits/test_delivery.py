"""Which model a run hands over: a certified substitute is no answer where the free fit foretells better."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy import ndarray
from scipy.integrate import solve_ivp

import persid as ps
from persid.certified_fits.delivery import Delivery, deliver, trial
from persid.identification.scores import Record, Scores, held_out_scores, hold_out
from persid.reports.comparison import scored


def simulated(rhs: Callable, starts: list, inputs: Callable, h: float, count: int, seed: int = 0) -> ps.Trajectories:
    """Return runs of x' = rhs(x, u) with the input of feedback and noise held from sample to sample."""
    rng, runs, controls, t = np.random.default_rng(seed), [], [], h * np.arange(count)
    for start in starts:
        x, u = [np.array(start, float)], []
        for _ in range(count):
            u.append(np.atleast_1d(inputs(x[-1], rng)))
            step = solve_ivp(lambda _, z, v=u[-1]: rhs(z, v), (0, h), x[-1], rtol=1e-9, atol=1e-11)
            x.append(step.y[:, -1])
        runs.append(np.array(x[:-1]))
        controls.append(np.array(u))
    return ps.Trajectories.from_arrays(runs, t=[t] * len(runs), u=controls)


def handed_over(data: ps.Trajectories, **how: object) -> Delivery:
    """Fit, certify and deliver as a run does."""
    fit = ps.PersidskiiIdentifier(**how).fit(data)
    return deliver(fit, ps.certify(fit.model_, time_limit=20), data, time_limit=20)


def unstable() -> ps.Trajectories:
    """x' = x + u under the feedback u = -2 x ± 1."""
    return simulated(lambda x, u: x + u, [[0.1]], lambda x, rng: -2 * x + rng.choice([-1, 1]), 0.05, 600)


def pendulum(x: ndarray, u: ndarray) -> ndarray:
    """A pendulum with little damping."""
    return np.array([x[1], -np.sin(x[0]) - 0.3 * x[1] + u[0]])


@pytest.mark.long
def test_an_unstable_plant_under_feedback_is_refuted_and_its_substitute_kept_beside() -> None:
    """The free model is delivered as not stable, though a certified fit exists; that one stands beside it, priced."""
    made = handed_over(unstable())
    assert isinstance(made.verdict, ps.Refuted)
    assert made.alternative is not None
    assert made.alternative.price is not None
    assert made.alternative.price > 2
    assert made.scores is made.free_scores
    assert made.scores is not None
    assert made.scores.headline.r2_mean > 0.99


@pytest.mark.long
def test_a_price_that_is_allowed_delivers_the_certified_fit() -> None:
    """Whoever allows any price gets the certified model, with its own scores."""
    data = unstable()
    fit = ps.PersidskiiIdentifier().fit(data)
    made = deliver(fit, ps.certify(fit.model_, time_limit=20), data, time_limit=20, price=1e9)
    assert isinstance(made.verdict, ps.Certified)
    assert made.alternative is None
    assert made.scores is not None
    assert made.free_scores is not None
    assert made.scores.headline.error > 2 * made.free_scores.headline.error


@pytest.mark.long
def test_several_equilibria_leave_the_region_of_the_named_one() -> None:
    """A pendulum is not stable from everywhere: the free model is certified in the region about its named point."""
    data = simulated(pendulum, [[2.5, 0], [-1, 1.5], [1, -0.5]], lambda x, rng: rng.uniform(-0.2, 0.2), 0.1, 150)
    made = handed_over(data, functions=["x", "sin(x)"], scale=1.0)
    assert isinstance(made.verdict, ps.Certified)
    assert made.verdict.certificate.scope == "regional"
    assert made.scores is not None
    assert made.scores.headline.r2_mean > 0.99


@pytest.mark.long
def test_a_swing_equation_is_judged_about_its_named_equilibrium() -> None:
    """Its exact model is delivered with a proof of the region about the named equilibrium, and no substitute."""
    rhs = lambda x, u: np.array([x[1], 1 - 4 * np.sin(x[0]) - 0.3 * x[1]])  # noqa: E731
    starts = np.random.default_rng(1).uniform(-0.5, 0.5, (6, 2)).tolist()
    data = simulated(rhs, starts, lambda x, rng: np.zeros(0), 0.02, 400)
    made = handed_over(data, functions=[["x", "sin(x)"], ["x"]])
    assert made.alternative is not None
    assert isinstance(made.verdict, ps.Certified)
    assert made.verdict.certificate.scope == "regional"
    assert made.verdict.certificate.operating_point[0] == pytest.approx(np.arcsin(0.25), abs=1e-4)
    assert made.scores is not None
    assert made.scores.headline.rmse[0] < 3e-6


def test_an_input_that_moves_in_the_held_out_part_only_is_scored() -> None:
    """A step of the input behind the part that is fitted leaves that fit without this input, and there is a score."""
    data = simulated(lambda x, u: -x + u[:1], [[0.1]], lambda x, rng: rng.choice([-1, 1]), 0.05, 600)
    late = np.where(np.arange(600) < 550, 0.0, 1.0)
    both = ps.Trajectories.from_arrays(data[0].x, np.column_stack([data[0].u, late]), dt=0.05)
    fit = ps.PersidskiiIdentifier(["x"]).fit(both)
    assert fit.model_.m == 2
    assert trial(fit, None, both).free.headline.r2_mean > 0.99


def test_short_runs_are_held_out_whole() -> None:
    """Of many runs too short for a tail some are held out whole, so that there is a score."""
    data = simulated(lambda x, u: -x + u, [[v] for v in np.linspace(-2, 2, 20)], lambda x, rng: rng.normal(), 0.1, 20)
    parts = hold_out(data)
    assert parts is not None
    assert (len(parts.held), len(parts.train)) == (4, 16)
    assert trial(ps.PersidskiiIdentifier(["x"]).fit(data), None, data).free.unseen


def test_a_tail_at_rest_is_scored_by_the_spread_of_the_record() -> None:
    """Noise over noise says nothing: a decay that has settled before its tail begins is foretold well."""
    rng, t = np.random.default_rng(0), 0.05 * np.arange(400)
    data = ps.Trajectories.from_arrays((2 * np.exp(-t) + 1e-3 * rng.normal(size=400))[:, None], t=t)
    scores = trial(ps.PersidskiiIdentifier(["x"]).fit(data), None, data).free
    assert scores.headline.r2_mean > 0.99
    assert scores.doubts == ()


@pytest.mark.parametrize(("rate", "worse"), [(-1.0, False), (-30.0, True)])
def test_a_model_that_foretells_less_than_no_model_is_doubted(rate: float, worse: bool) -> None:
    """A model with the wrong rate is worse than a forecast without one, and its scores say so."""
    data = simulated(lambda x, u: -x + u, [[0.0]], lambda x, rng: rng.choice([-1, 1]), 0.1, 400)
    model = ps.PersidskiiModel(A0=[[rate]], B=[[1.0]])
    parts = hold_out(data)
    assert parts is not None
    scores = held_out_scores(model, parts.held, Record.of(data), before=parts.before)
    assert bool(scores.doubts) is worse


def test_a_model_is_no_worse_than_the_mean_where_the_mean_is_as_bad() -> None:
    """Where what is held out lies far from the record's mean, its R2 is negative, too, and stands beside."""
    x = np.concatenate([np.sin(np.arange(320) / 5.0), 3 + np.sin(np.arange(80) / 5.0)])
    data = ps.Trajectories.from_arrays(x[:, None], dt=0.1)
    parts = hold_out(data)
    assert parts is not None
    record = Record.of(data)

    def scored_to(level: float) -> Scores:
        held = ps.PersidskiiModel(A0=[[-50.0]], b=[50.0 * level])  # at `level` at once
        return held_out_scores(held, parts.held, record, before=parts.before)

    mean = float(record.moments.mean[0])
    near, far = scored_to(mean + 0.2), scored_to(mean - 0.2)
    assert near.headline.r2_mean < 0
    assert "the mean has R2 -" in scored(near)
    assert not any("the mean" in doubt for doubt in near.doubts)
    assert any("worse than the mean" in doubt or "less than the mean" in doubt for doubt in far.doubts)
