"""Certified models of inputs and outputs: systems of known truth, and data that cannot be used."""

import numpy as np
import pytest

import persid as ps
from persid.certified_fits.outputs import OutputIdentifier
from persid.errors import DataError


def runs(model, C, dt, N, m, seed=0, count=1, x0=None):
    rng, found = np.random.default_rng(seed), []
    for _ in range(count):
        u, t = np.repeat(rng.normal(size=(N // 4 + 1, m)), 4, 0)[:N], dt * np.arange(N)
        x = model.simulate(np.zeros(model.n) if x0 is None else x0, t, u if m else None)[0].x
        found.append((x @ np.asarray(C).T, u))
    return ps.Trajectories.from_arrays([y for y, _ in found], [u for _, u in found] if m else None, dt=dt)


def test_a_linear_system_is_recovered_and_certified():
    """The poles of a linear system are found to 1e-3, and the model is certified."""
    A = np.array([[-0.5, 2.0], [-2.0, -0.5]])
    data = runs(ps.PersidskiiModel(A, [], [[1.0], [0.5]]), [[1.0, 0.0]], 0.1, 400, 1)
    fit = OutputIdentifier(order=2, neurons=0, time_limit=0).fit(data)
    found = np.sort_complex(np.linalg.eigvals(fit.fit_.A))
    np.testing.assert_allclose(found, np.sort_complex(np.linalg.eigvals(A)), rtol=1e-3)
    assert fit.verdict_.is_certified
    assert fit.score(data) > 0.999


@pytest.mark.long
def test_a_nonlinear_system_with_two_inputs_and_three_outputs_is_foretold():
    """A saturating system of two inputs and three outputs is certified and foretells a run it has not seen."""
    model = ps.PersidskiiModel(
        [[-0.3, 1.0], [-1.0, -0.2]], [("tanh(x)", [[2.0, 0.0]], [[-1.0], [0.0]])], [[1.0, 0.0], [0.0, 1.0]]
    )
    C = [[1.0, 0.0], [0.0, 1.0], [1.0, -1.0]]
    fit = OutputIdentifier(order=2, neurons=2, feedthrough=False, seeds=2, time_limit=0).fit(
        runs(model, C, 0.2, 300, 2)
    )
    assert fit.verdict_.is_certified
    assert fit.score(runs(model, C, 0.2, 200, 2, seed=5)) > 0.995
    assert fit.report_.held_out < 0.5 * fit.report_.linear


def test_a_system_without_inputs_is_certified():
    """A decaying oscillation without inputs, in two records of different starts, is certified and foretold."""
    model = ps.PersidskiiModel([[-0.2, 2.0], [-2.0, -0.2]], [], np.zeros((2, 0)))
    parts = [runs(model, [[1.0, 0.0]], 0.1, 120, 0, x0=x0)[0].x for x0 in ([1.0, 0.0], [0.0, 2.0])]
    fit = OutputIdentifier(order=2, neurons=0, time_limit=0).fit(parts, dt=0.1)
    assert fit.verdict_.is_certified
    assert fit.score(parts, dt=0.1) > 0.999


@pytest.mark.parametrize(
    ("y", "options", "message"),
    [
        (np.ones((100, 1)), {}, "output y1 is constant"),
        (np.arange(12.0)[:, None] % 5, {"order": 4}, "cannot tell"),
        (np.arange(60.0)[:, None] % 7, {"order": 2, "neurons": 30}, "cannot tell"),
        (np.arange(60.0)[:, None] % 7, {"order": 0}, "order is 0"),
        (np.arange(60.0)[:, None] % 7, {"seeds": 0}, "seeds is 0"),
        (np.arange(60.0)[:, None] % 7, {"functions": ["relu"]}, "functions is \\['relu'\\]"),
        (np.arange(60.0)[:, None] % 7, {"output": "square"}, "output is 'square'"),
        (np.arange(60.0)[:, None] % 7, {"min_rate": 0}, "min_rate=0 is not positive"),
        (np.arange(60.0)[:, None] % 7, {"max_output_gain": [1, 2]}, "one for each of the outputs"),
    ],
)
def test_data_and_options_that_cannot_be_used_are_named(y, options, message):
    """Constant outputs, records too short for the order or the neurons, and wrong options are refused in words."""
    with pytest.raises(DataError, match=message):
        OutputIdentifier(**options).fit(y, u=np.sin(np.arange(len(y)))[:, None], dt=0.1)


def test_uneven_samples_are_refused():
    """Sampling times that vary are named with their range."""
    t = np.cumsum(np.linspace(0.1, 0.2, 80))
    with pytest.raises(DataError, match="resample"):
        OutputIdentifier().fit(np.sin(t)[:, None], u=np.cos(t)[:, None], t=t)


@pytest.mark.parametrize("D", [0.0, 0.5])
def test_feedthrough_is_kept_where_the_outputs_show_it(D):
    """An output that follows the input at once gets D, and one that does not gets none."""
    data = runs(ps.PersidskiiModel([[-0.5]], [], [[1.0]]), [[1.0]], 0.2, 200, 1)[0]
    noisy = data.x + D * data.u + 0.02 * np.random.default_rng(1).normal(size=data.x.shape)
    fit = OutputIdentifier(order=1, neurons=0, time_limit=0).fit(noisy, u=data.u, dt=0.2)
    assert fit.report_.chosen.feedthrough == (D > 0)
    np.testing.assert_allclose(fit.fit_.D, D, atol=0.02)
    assert fit.verdict_.is_certified


def test_an_interrupt_keeps_the_best_so_far():
    """Ctrl-C during the search delivers the best model so far, with its proof."""
    data = runs(ps.PersidskiiModel([[-0.5]], [("tanh(x)", [[1.0]], [[-1.0]])], [[1.0]]), [[1.0]], 0.1, 300, 1)

    def interrupt(line: str) -> None:
        raise KeyboardInterrupt

    fit = OutputIdentifier(order=1, neurons=2, seeds=1, time_limit=0).fit(data, progress=interrupt)
    assert fit.report_.interrupted
    assert fit.verdict_.is_certified


def test_an_unstable_plant_is_named_and_refuted():
    """Records of an unstable plant give the unstable model, which is refuted, and say why there is no certificate."""
    data = runs(ps.PersidskiiModel([[0.2]], [], [[1.0]]), [[1.0]], 0.1, 150, 1, x0=[0.1])
    fit = OutputIdentifier(order=1, neurons=0, feedthrough=False, time_limit=2).fit(data)
    assert isinstance(fit.verdict_, ps.Refuted)
    assert fit.fit_.A[0, 0] == pytest.approx(0.2, rel=1e-3)
    assert "is unstable" in fit.report_.remarks[0]


def test_an_integrating_output_is_named():
    """The position of a motor driven open loop is named as integrating: a certificate speaks of the leak alone."""
    motor = ps.PersidskiiModel([[0.0, 1.0], [0.0, -1.0]], [], [[0.0], [1.0]])
    fit = OutputIdentifier(order=2, neurons=0, feedthrough=False, time_limit=0).fit(
        runs(motor, [[1.0, 0.0], [0.0, 1.0]], 0.1, 200, 1)
    )
    (said,) = fit.report_.remarks
    assert said.startswith("y1 integrates: ")
    assert "not input-to-state stable" in said


def test_an_integrating_output_with_a_constant_push_is_foretold():
    """A cart kept in place by feedback, pushed by a constant force that is no input, is foretold and certified."""
    dt, rng, x = 0.1, np.random.default_rng(0), np.zeros(2)
    goal, U, Y = np.repeat(rng.normal(size=20), 30), np.zeros(600), np.zeros(600)
    for k in range(600):
        U[k], Y[k] = 2 * (goal[k] - x[0]) - 2 * x[1] + 0.3 * rng.normal(), x[0]
        for _ in range(10):
            x = x + dt / 10 * np.array([x[1], U[k] - 0.2 * x[1] + 0.5])
    data = ps.Trajectories.from_arrays([Y[:, None] + 0.001 * rng.normal(size=(600, 1))], [U[:, None]], dt=dt)
    fit = OutputIdentifier(order=2, neurons=0, feedthrough=False, time_limit=0).fit(data)
    assert fit.report_.error < 0.01
    assert fit.report_.remarks[0].startswith("y1 integrates: ")
    assert fit.verdict_.is_certified
    assert fit.set_params(warm_start=True).fit(data).report_.error < 0.01


def test_a_rate_and_a_gain_are_certified_together():
    """A rate above the plant's own and a gain below the free fit's are both certified, at a price in accuracy."""
    data = runs(ps.PersidskiiModel([[-0.5]], [], [[1.0]]), [[1.0]], 0.1, 200, 1)
    plain = OutputIdentifier(order=1, neurons=0, feedthrough=False, time_limit=0).fit(data)
    options = {"min_rate": 0.6, "max_output_gain": 0.5 * float(plain.certificate_.output_gains[0])}
    fit = OutputIdentifier(order=1, neurons=0, feedthrough=False, time_limit=0, **options).fit(data)
    assert fit.certificate_.rate >= 0.6
    assert fit.certificate_.output_gains[0] <= options["max_output_gain"]
    assert [remark.split(":")[0] for remark in fit.report_.remarks] == ["the gains asked for are kept"]
    assert plain.report_.error < fit.report_.error < 1


def test_a_gain_that_is_asked_for_is_kept_inside_the_fit():
    """A fit below half of its free gain is nearer to the data than the free fit with its output scaled."""
    data = runs(ps.PersidskiiModel([[-0.5]], [], [[1.0]]), [[1.0]], 0.1, 200, 1)
    plain = OutputIdentifier(order=1, neurons=0, feedthrough=False, time_limit=0).fit(data)
    gain = float(plain.certificate_.output_gains[0])
    fit = OutputIdentifier(order=1, neurons=0, feedthrough=False, time_limit=0, max_output_gain=0.5 * gain).fit(data)
    assert fit.certificate_.output_gains[0] <= 0.5 * gain
    y = data[0].x
    scaled = np.sqrt(np.mean((0.5 * (y - y.mean())) ** 2)) / y.std()
    assert fit.report_.error < 0.8 * scaled


def test_an_interrupt_of_the_linear_start_keeps_it():
    """Ctrl-C before there are candidates delivers the best linear model so far, certified."""
    data = runs(ps.PersidskiiModel([[-0.5]], [("tanh(x)", [[1.0]], [[-1.0]])], [[1.0]]), [[1.0]], 0.1, 200, 1)
    lines: list[str] = []

    def interrupt(line: str) -> None:
        lines.append(line)
        raise KeyboardInterrupt

    fit = OutputIdentifier(seeds=1, time_limit=0).fit(data, progress=interrupt)
    assert lines[0].startswith("linear models")
    assert fit.report_.interrupted
    assert fit.report_.chosen.neurons == 0
    assert fit.verdict_.is_certified


@pytest.mark.long
def test_an_interrupt_of_the_final_fit_keeps_it():
    """Ctrl-C while the chosen candidate is fitted to all data delivers it as good as it has become."""
    data = runs(ps.PersidskiiModel([[-0.5]], [("tanh(x)", [[1.0]], [[-1.0]])], [[1.0]]), [[1.0]], 0.1, 200, 1)

    def interrupt(line: str) -> None:
        if line.startswith("all data"):
            raise KeyboardInterrupt

    fit = OutputIdentifier(order=1, neurons=1, seeds=1, time_limit=0).fit(data, progress=interrupt)
    assert fit.report_.interrupted
    assert fit.report_.chosen.neurons == 1
    assert fit.verdict_.is_certified
    assert fit.score(data) > 0.99


@pytest.mark.long
@pytest.mark.parametrize(("function", "hold"), [("arctan", "foh"), ("softsign", "zoh"), ("pwl", "foh")])
def test_other_functions_and_holds_are_certified(function, hold):
    """Every function and hold is fitted, proved by the fit's own multipliers, and foretells the record."""
    data = runs(ps.PersidskiiModel([[-0.5]], [("tanh(x)", [[1.0]], [[-1.0]])], [[1.0]]), [[1.0]], 0.1, 200, 1)
    options = {"functions": [function], "hold": hold, "feedthrough": hold == "foh"}
    fit = OutputIdentifier(order=1, neurons=1, seeds=1, time_limit=0, **options).fit(data)
    assert [attempt.outcome[:9] for attempt in fit.verdict_.attempts] == ["certified"]
    assert fit.model_.hold == hold
    assert fit.score(data) > 0.99


@pytest.mark.long
@pytest.mark.parametrize(
    ("seeds", "stiffness", "options"),
    [
        (1, 1.0, {}),
        (1, -0.5, {}),  # hardens
        (1, 1.0, {"max_output_gain": 0.3}),
        pytest.param(10, 1.0, {}, marks=pytest.mark.slow),
        pytest.param(10, -0.5, {}, marks=pytest.mark.slow),
        pytest.param(3, 1.0, {"output": "abs"}, marks=pytest.mark.slow),
        pytest.param(3, 1.0, {"max_output_gain": 0.3}, marks=pytest.mark.slow),
        pytest.param(3, -0.5, {"min_rate": 0.3, "max_output_gain": 0.5}, marks=pytest.mark.slow),
        (1, 1.0, {"functions": ["pwl"]}),
        (1, -0.5, {"functions": ["pwl"], "one_curve": True}),
        pytest.param(10, 1.0, {"functions": ["pwl"], "one_curve": True}, marks=pytest.mark.slow),
        pytest.param(3, -0.5, {"measured": ["y1"], "feedthrough": "auto"}, marks=pytest.mark.slow),
    ],
)
def test_every_seed_and_every_refit_is_certified_by_its_own_proof(seeds, stiffness, options):
    """Random starts, and a warm start from each on other records, need no search for their certificates."""
    plant = ps.PersidskiiModel([[-1.0]], [("tanh(x)", [[1.0]], [[-stiffness]])], [[2.0]])
    first, then = (runs(plant, [[1.0]], 0.1, 80, 1, seed=seed) for seed in (0, 1))
    if "output" in options:
        first, then = (ps.Trajectories.from_arrays([abs(run.x)], [run.u], dt=0.1) for (run,) in (first, then))
    for seed in range(seeds):
        given = {"feedthrough": False, "seeds": 1, "time_limit": 0, "random_state": seed, **options}
        fit = OutputIdentifier(order=1, neurons=2, **given).fit(first)
        again = OutputIdentifier(warm_start=fit.model_, **given).fit(then)
        for one in (fit, again):
            assert [attempt.outcome[:9] for attempt in one.verdict_.attempts] == ["certified"]
            assert not [said for said in one.report_.remarks if "asked for" in said and "kept" not in said]


@pytest.mark.long
def test_a_warm_start_continues_from_the_fit_before():
    """A warm start keeps order, neurons and proof, tells the earlier model's error on new records, and lowers it."""
    spring = [("tanh(x)", [[1.0]], [[-1.0]])]
    before, after = (ps.PersidskiiModel([[-a]], spring, [[1.0]]) for a in (0.5, 0.7))
    fit = OutputIdentifier(order=1, neurons=1, seeds=1, feedthrough=False, warm_start=True, time_limit=0)
    fit.fit(runs(before, [[1.0]], 0.1, 200, 1))
    first, new = fit.fit_, runs(after, [[2.0]], 0.2, 150, 1, seed=3)
    fit.fit(new)
    assert len(fit.report_.candidates) == 1
    assert fit.fit_.A1.shape == first.A1.shape
    assert fit.report_.error < 0.1 * fit.report_.held_out
    assert fit.verdict_.is_certified
    assert fit.score(new) > 0.999
    with pytest.raises(DataError, match="order= is 2 and was 1 in the earlier fit"):
        fit.set_params(order=2).fit(new)


@pytest.mark.parametrize("hardening", [False, True])
def test_a_warm_start_goes_on_from_a_saved_model(tmp_path, hardening):
    """A model read from its file continues with its multipliers, in measured coordinates and hardening too."""
    spring, slope = [("tanh(x)", [[1.0]], [[0.5 if hardening else -1.0]])], -1.0 if hardening else -0.5
    data = runs(ps.PersidskiiModel([[slope]], spring, [[2.0]]), [[1.0]], 0.1, 200, 1)
    options = {"measured": ["y1"], "seeds": 1, "time_limit": 0}
    fit = OutputIdentifier(order=1, neurons=1, **options).fit(data)
    fit.model_.save(tmp_path / "model.json")
    path = tmp_path / "model.json"
    again = OutputIdentifier(warm_start=path, **options).fit(data)
    assert len(again.report_.candidates) == 1
    assert again.report_.held_out < 2 * fit.report_.error + 1e-4
    assert again.verdict_.is_certified
    assert OutputIdentifier(warm_start=ps.load_model(path), **options).fit(data).verdict_.is_certified
    with pytest.raises(DataError, match="was 1 in the earlier fit"):
        OutputIdentifier(order=2, warm_start=path, **options).fit(data)


def test_a_model_that_no_fit_made_is_no_warm_start(tmp_path):
    """A model of states and one written by hand are refused, each in its own words."""
    plant = ps.PersidskiiModel([[-0.5]], [], [[1.0]])
    data = runs(plant, [[1.0]], 0.1, 100, 1)
    plant.save(tmp_path / "states.json")
    other = ps.OutputModel(plant, [[1.0]])
    for start, message in (
        (tmp_path / "states.json", "is a model of states"),
        (other, "was not made by a fit"),
    ):
        with pytest.raises(DataError, match=message):
            OutputIdentifier(warm_start=start, time_limit=0).fit(data)


@pytest.mark.long
def test_a_refit_of_the_same_records_changes_nothing():
    """From its own records a warm start begins where the fit before ended: the proof of that model is recovered."""
    spring = [("tanh(x)", [[1.0]], [[-1.0]])]
    data = runs(ps.PersidskiiModel([[-0.5]], spring, [[1.0]]), [[1.0]], 0.1, 200, 1)
    fit = OutputIdentifier(order=1, neurons=2, seeds=1, feedthrough=False, warm_start=True, time_limit=0).fit(data)
    error = fit.report_.error
    fit.fit(data)
    assert fit.report_.held_out < 2 * error + 1e-4
    assert fit.report_.error <= 1.01 * error
    assert fit.verdict_.is_certified


def test_measured_outputs_are_states_beside_latent_ones():
    """A measured position is the first state in its own unit, beside a latent one; the fit's own proof goes along."""
    plant = ps.PersidskiiModel([[0.0, 1.0], [-2.0, -1.0]], [], [[0.0], [1.0]])
    data = runs(plant, [[100.0, 0.0]], 0.1, 200, 1)
    fit = OutputIdentifier(order=2, neurons=0, measured=["y1"], time_limit=0).fit(data)
    assert fit.model_.dynamics.states == ("x_y1", "z1")
    assert fit.model_.C.tolist() == [[1.0, 0.0]]
    run = fit.model_.dynamics.simulate(fit.fit_.x0[0], data[0].t, data[0].u)[0]
    np.testing.assert_allclose(run.x[:, 0], data[0].x[:, 0], atol=1e-3 * np.ptp(data[0].x))
    assert fit.verdict_.is_certified
    assert fit.set_params(warm_start=True).fit(data).verdict_.is_certified
    with pytest.raises(DataError, match="without feedthrough="):
        OutputIdentifier(measured=["y1"], feedthrough=True).fit(data)
    with pytest.raises(DataError, match="none of the outputs"):
        fit.set_params(measured=["angle"]).fit(data)


@pytest.mark.parametrize("neurons", [0, 1])
def test_what_is_known_of_measured_states_is_exactly_in_the_model(neurons):
    """A position whose rate is the measured velocity is so in the certified model, to the last bit."""
    plant = ps.PersidskiiModel([[0.0, 1.0], [-2.0, -1.0]], [], [[0.0], [1.0]])
    data = runs(plant, [[100.0, 0.0], [0.0, 100.0]], 0.1, 200, 1)
    rate = {("y1", "y1"): 0, ("y1", "y2"): 1.0, ("y1", "u1"): 0.0, ("y1", "f"): 0}
    fit = OutputIdentifier(order=2, neurons=neurons, seeds=1, measured=["y1", "y2"], fixed=rate, time_limit=0).fit(data)
    model = fit.model_.dynamics
    assert model.A0[0].tolist() == [0.0, 1.0]
    assert model.B[0].tolist() == [0.0]
    assert all(not term.A[0].any() for term in model.terms)
    np.testing.assert_allclose(model.A0[1], [-2.0, -1.0], atol=0.05)
    assert fit.verdict_.is_certified
    assert "what is known is kept" in fit.report_.remarks[-1]


def test_an_input_that_is_known_not_to_act_on_a_measured_state_does_not():
    """A position that is measured alone has a rate that a latent state makes, without the input."""
    plant = ps.PersidskiiModel([[0.0, 1.0], [-2.0, -1.0]], [], [[0.0], [1.0]])
    data = runs(plant, [[100.0, 0.0]], 0.1, 200, 1)
    fit = OutputIdentifier(order=2, neurons=0, measured=["y1"], fixed={("y1", "u1"): 0.0}, time_limit=0).fit(data)
    assert fit.model_.dynamics.B[0].tolist() == [0.0]
    np.testing.assert_allclose(np.linalg.eigvals(fit.model_.dynamics.A0), np.roots([1.0, 1.0, 2.0]), rtol=1e-3)
    assert fit.verdict_.is_certified


def test_what_cannot_be_known_is_refused():
    """States that are not measured, columns that do not exist and neurons that add something are named."""
    data = runs(ps.PersidskiiModel([[-1.0]], [], [[1.0]]), [[1.0]], 0.1, 50, 1)
    for fixed, words in (
        ({("y2", "u1"): 0.0}, "states are those of measured="),
        ({("y1", "speed"): 0.0}, "columns y1, u1, f"),
        ({("y1", "f"): 1.0}, "can only be 0"),
    ):
        with pytest.raises(DataError, match=words):
            OutputIdentifier(order=1, neurons=0, measured=["y1"], fixed=fixed).fit(data)


@pytest.mark.long
def test_a_pendulum_is_foretold_from_its_positions_alone(measurements):
    """Two angles and three references of two experiments foretell the third, certified."""
    files = sorted((measurements / "qube").glob("*.csv"))
    data = ps.read_csv(files, states=["theta", "alpha"], inputs=["target_theta", "target_alpha", "feedforward"])
    every = 5  # samples, 10 ms
    angles = [run.x[::every] for run in data]
    inputs = [run.u.reshape(-1, every, 3).mean(1) for run in data]
    fit = OutputIdentifier(order=4, neurons=4, feedthrough=False, seeds=1, time_limit=0).fit(
        angles[:2], u=inputs[:2], dt=every * 0.002
    )
    assert fit.verdict_.is_certified
    assert fit.score(angles[2], u=inputs[2], dt=every * 0.002) > 0.85


@pytest.mark.slow
def test_a_pendulum_is_foretold_from_its_positions_with_nothing_said_by_hand(measurements):
    """At 500 Hz, on defaults, two experiments foretell arm and pendulum of the third, certified."""
    files = sorted((measurements / "qube").glob("*.csv"))
    data = ps.read_csv(files, states=["theta", "alpha"], inputs=["target_theta", "target_alpha", "feedforward"])
    fit = OutputIdentifier(time_limit=0).fit(data[:2])
    assert fit.verdict_.is_certified
    run, start = data[2], 50
    free = fit.model_.simulate(run.t, run.u, y_init=run.x[:start])[0].x
    gap, spread = (free - run.x)[start:], (run.x - run.x[start:].mean(0))[start:]
    R2 = 1 - (gap**2).sum(0) / (spread**2).sum(0)
    assert R2[0] > 0.96
    assert R2[1] > 0.92


def two_tanks(seed, N=600, dt=4.0):
    """Levels of the lower of two tanks whose outflow is .1 sqrt(level) each, with noise, and the inflow."""
    rng, x, substeps = np.random.default_rng(seed), np.array([4.0, 4.0]), 20
    u, y = np.repeat(rng.uniform(1.0, 3.0, N // 20), 20), np.empty(N)
    for k in range(N):
        y[k] = x[1]
        for _ in range(substeps):
            q = 0.1 * np.sqrt(np.maximum(x, 0.0))
            x = x + dt / substeps * np.array([0.1 * u[k] - q[0], q[0] - q[1]])
    return y[:, None] + 0.02 * rng.normal(size=(N, 1)), u[:, None]


@pytest.mark.long
def test_the_outflow_of_two_tanks_is_learnt_from_the_lower_level_alone():
    """One learned curve foretells two tanks, certified, and levels at rest follow the square of the inflow to 3 %."""
    (y, u), (unseen, inflow) = two_tanks(0), two_tanks(1)
    options = {"order": 2, "neurons": 2, "feedthrough": False, "time_limit": 0}
    fit = OutputIdentifier(functions=["pwl"], one_curve=True, **options).fit(y, u=u, dt=4.0)
    assert fit.fit_.activation == "pwl"
    assert [attempt.outcome[:9] for attempt in fit.verdict_.attempts] == ["certified"]
    assert (fit.fit_.F[0] == fit.fit_.F[1]).all()
    assert fit.score(unseen, u=inflow, dt=4.0) > 0.99
    low, high = np.quantile(y, [0.1, 0.9])
    held = np.sqrt(np.linspace(low, high, 9))  # the outflow at rest is the inflow
    t = 4.0 * np.arange(400)
    rest = [fit.simulate(t, np.full((400, 1), one), x0=fit.fit_.x_mean)[0].x[-1, 0] for one in held]
    np.testing.assert_allclose(rest, held**2, atol=0.03 * np.ptp(y))
