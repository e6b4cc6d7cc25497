"""Verdicts on models with algebraic variables: what is certified keeps its promise, several solutions never are."""

import numpy as np
import pytest

import persid as ps
from descriptors import FOLD, bus, diode, drawn, equilibrium_network, fold, loop, network
from persid.lyapunov.operating_points import find_operating_point


def keeps_its_bound(model: ps.DescriptorModel, certificate: ps.Certificate, seed: int = 0) -> bool:
    """Whether runs from random starts with random held inputs stay within the bound of the state."""
    rng, t = np.random.default_rng(seed), np.linspace(0, 4, 9)
    for size in (0.3, 3.0):
        x0, u = size * rng.normal(size=model.n), np.repeat(size * rng.normal(size=(3, model.m)), 3, axis=0)
        run = model.simulate(x0, t, u)[0]
        away = np.linalg.norm(run.x[:, : model.n] - certificate.operating_point, axis=1)
        most = float(np.linalg.norm(u - certificate.input, axis=1).max())
        if run.diverged_at is not None or (away > certificate.bound(x0, most, run.t)).any():
            return False
    return True


@pytest.mark.parametrize("gain", [-5.0, 0.99])
def test_a_loop_of_gain_below_1_is_certified(gain: float) -> None:
    """With what holds between any two solutions and about every equilibrium, and runs keep the bound."""
    verdict = ps.certify(loop(gain))
    assert verdict.is_certified, verdict
    assert set(verdict.certificate.further) == {"incremental", "everywhere"}
    assert keeps_its_bound(loop(gain), verdict.certificate)


@pytest.mark.parametrize(("f", "gain"), [("tanh(x)", 1.01), ("tanh(x)", 2.0), ("sat(x)", 1.01)])
def test_a_loop_of_gain_above_1_is_refused(f: str, gain: float) -> None:
    """Its equations have three solutions, or it runs away on one branch of them; one of these refutes it."""
    verdict = ps.certify(loop(gain, f))
    assert isinstance(verdict, ps.Refuted)
    assert verdict.witness.is_about_equations is (gain == 2)
    assert len({round(float(loop(2.0, f).solve([0.0], near=[w])[0]), 6) for w in (-2.0, 0.0, 2.0)}) == 3


def test_a_saturation_in_a_loop_of_gain_2_is_refuted_with_its_witness() -> None:
    """With w = sat(x + 2w) and x' = -x - w it rests at x = -s, w = s for every s from -1 to 1."""
    verdict = ps.certify(loop(2.0, "sat(x)"))
    assert isinstance(verdict, ps.Refuted)
    assert verdict.witness.kind == "two-equilibria"


def test_a_saturation_in_a_loop_of_gain_below_1_is_certified() -> None:
    """A kink is no obstacle."""
    assert ps.certify(loop(0.75, "sat(x)")).is_certified


def test_a_diode_with_a_leak_is_certified_and_one_without_is_not() -> None:
    """Without the leak a constant current out of the capacitor drives its voltage to minus infinity."""
    verdict = ps.certify(diode())
    assert verdict.is_certified
    assert keeps_its_bound(diode(), verdict.certificate)
    assert not ps.certify(diode(0.0)).is_certified
    assert diode(0.0).simulate([0.0], np.linspace(0, 50, 11), np.full((11, 1), -1.0))[0].x[-1, 0] < -30


def test_the_operating_point_belongs_to_its_input() -> None:
    """At another input the equilibrium is found and proved with all variables; the certificate is about its state."""
    model = diode()
    verdict = ps.certify(model, u_op=[0.5])
    assert verdict.is_certified
    x = verdict.certificate.operating_point
    assert x.shape == (1,)
    assert abs(model.rhs(x, np.array([0.5]))).max() < 1e-9
    assert keeps_its_bound(model, verdict.certificate)


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.long)])
def test_networks_of_loops_are_certified(seed: int) -> None:
    """Layers of tanh that feed back on themselves: recurrent equilibrium networks, solvable by their norm."""
    model = network(2, 3, seed)
    verdict = ps.certify(model)
    assert verdict.is_certified
    assert keeps_its_bound(model, verdict.certificate)


def certified_truly(seed: int) -> bool:
    """Whether a random model is certified; then it has one solution from every start of Newton's method, and bounds."""
    model, rng = drawn(seed), np.random.default_rng(seed)
    verdict = ps.certify(model)
    if not verdict.is_certified:
        return False
    x = rng.normal(size=model.n)
    found = [model.solve(x, near=4 * rng.normal(size=len(model.algebraic))) for _ in range(4)]
    assert np.ptp(found, axis=0).max() < 1e-6
    assert keeps_its_bound(model, verdict.certificate, seed)
    return True


def test_only_what_is_true_of_some_random_models_is_certified() -> None:
    """One solution, and bounds that runs keep."""
    assert all(map(certified_truly, (2, 4)))


@pytest.mark.long
def test_only_what_is_true_of_random_models_is_certified() -> None:
    """The same of more of them."""
    assert sum(map(certified_truly, range(5, 25))) >= 5


def stays(model: ps.DescriptorModel, certificate: ps.Certificate, seed: int, runs: int = 6) -> bool:
    """Whether runs from the edge of the region, with inputs as large as it allows, stay in it and on their branch."""
    rng, t = np.random.default_rng(seed), np.linspace(0, 20, 81)
    content = certificate.content
    domains = [(p["row"], content["curves"][p["curve"]]["domain"]) for p in content["points"]]
    domains = [(row, domain) for row, domain in domains if domain] + [(row, ends) for row, *ends in content["strips"]]
    rows = np.zeros((len(domains), model.rows.n))
    for line, (row, _) in zip(rows, domains, strict=True):
        line[[i for i, _ in row]] = [m * 2.0**e for _, (m, e) in row]
    ends = [[m * 2.0**e for m, e in domain] for _, domain in domains]
    rest = np.concatenate([certificate.operating_point, model.solve(certificate.operating_point, certificate.input)])
    for _ in range(runs):
        direction = rng.normal(size=model.n)
        x0 = certificate.operating_point + edge(certificate, direction / np.linalg.norm(direction))
        v = rng.choice([-1.0, 1.0], size=(9, model.m)) * certificate.input_bound / np.sqrt(model.m)
        u = certificate.input + np.repeat(v, 9, axis=0)
        run = model.simulate(x0, t, u, near=followed(model, rest, x0, u[0]))[0]
        args = (run.x - rest) @ rows.T
        inside = all((lo <= y).all() and (y <= hi).all() for y, (lo, hi) in zip(args.T, ends, strict=True))
        V = certificate.V(run.x[:, : model.n])
        away = np.linalg.norm(run.x[:, : model.n] - certificate.operating_point, axis=1)
        bounded = (away <= certificate.bound(x0, certificate.input_bound, run.t) * (1 + 1e-6)).all()
        if len(run) < len(t) or (certificate.level * (1 + 1e-6) < V).any() or not (inside and bounded):
            return False
    return True


def followed(model: ps.DescriptorModel, rest: np.ndarray, x0: np.ndarray, u: np.ndarray) -> np.ndarray:
    """The algebraic variables at x0 on the branch of the rest, which one step of Newton from there may leave."""
    w = rest[model.n :]
    for share in np.linspace(0, 1, 51):
        w = model.solve(rest[: model.n] + share * (x0 - rest[: model.n]), u, near=w)
    return w


def edge(certificate: ps.Certificate, direction: np.ndarray) -> np.ndarray:
    """Where V reaches the level, just inside."""
    low, high = 0.0, 1.0
    while certificate.V((certificate.operating_point + high * direction)[None])[0] < certificate.level:
        low, high = high, 2 * high
    for _ in range(50):
        middle = (low + high) / 2
        inside = certificate.V((certificate.operating_point + middle * direction)[None])[0] < certificate.level
        low, high = (middle, high) if inside else (low, middle)
    return 0.999 * low * direction


def test_a_region_ends_before_its_branch_does() -> None:
    """Of a fold nearly all up to where the equation loses its solution is certified, and nothing beyond."""
    assert not ps.certify(fold(), time_limit=5).is_certified
    certificate = ps.certify(fold(), domain="auto", rate=0.25).certificate
    assert certificate.claim == "region"
    right = edge(certificate, np.array([1.0]))[0]
    assert 0.95 * FOLD < right < FOLD
    assert stays(fold(), certificate, seed=0)


@pytest.mark.parametrize("box", [[[-2, 2], [-0.5, 0.5]], [[-0.1, 0.3], [-0.5, 0.5]]])
def test_a_region_in_a_box_keeps_to_every_side_of_it(box: list[list[float]]) -> None:
    """Sides of x and of w, and runs from its edge stay within them; the checker's sentence names both."""
    certificate = ps.certify(fold(), domain=box, rate=0.25).certificate
    assert certificate.scope == "regional"
    assert stays(fold(), certificate, seed=0)
    assert "-0.5 <= ('w' - 'w'*) <= 0.5" in certificate.statement
    for sign in (-1.0, 1.0):
        assert box[0][0] <= edge(certificate, np.array([sign]))[0] <= box[0][1]


@pytest.mark.long
def test_a_side_of_a_variable_that_no_function_reads_alone_is_kept() -> None:
    """The sine reads x - w; with |w| <= 0.4 as a side of the box the runs keep it, and a wider box allows more."""
    x, w = _bus_at_rest(1)
    small, large = (
        ps.certify(bus(1), domain=[[x - 1, x + 1], [w - side, w + side]]).certificate for side in (0.1, 0.8)
    )
    assert small.level < large.level or edge(small, np.ones(1))[0] < edge(large, np.ones(1))[0]
    assert stays(bus(1), small, seed=0)
    assert stays(bus(1), large, seed=1)


def _bus_at_rest(seed: int) -> np.ndarray:
    return np.asarray(find_operating_point(bus(seed).rows, np.zeros(1))[0].x)


def test_a_box_of_the_states_alone_leaves_functions_of_algebraic_variables_on_all_of_R() -> None:
    """The diode's equation has one solution everywhere; that of the fold has not, and the verdict says so."""
    certificate = ps.certify(diode(), domain=[[-2.0, 2.0]]).certificate
    assert certificate.claim == "region"
    assert edge(certificate, np.ones(1))[0] <= 2
    verdict = ps.certify(fold(), domain=[[-1.0, 1.0]])
    assert isinstance(verdict, ps.Undecided)
    assert "in the whole box" in verdict.detail


def test_where_all_states_are_undecided_the_box_of_the_data_is_tried() -> None:
    """As of other models; `domain="data"` asks for nothing else. A tank whose outflow w is a root of its level."""
    outflow, box = ("sqrt(1 + x) - 1", [[1.0, 0.0]], [[0.0], [1.0]]), [[-0.5, 1.0], [-0.5, 0.5]]
    tank = ps.DescriptorModel([[0.0, -1.0], [0.0, -1.0]], [outflow], [[1.0], [0.0]], algebraic=["w"], domain=box)
    for domain in ("global", "data"):
        assert ps.certify(tank, domain=domain).certificate.claim == "region"
    assert isinstance(ps.certify(tank, claim="incremental"), ps.Undecided)


def test_equations_without_a_linear_part_in_their_variable_are_searched_with() -> None:
    """0 = x - sinh(w) does not give w linearly: its multipliers stay unknowns of the search."""
    model = ps.DescriptorModel(
        [[-1.0, -0.1], [1.0, 0.0]], [("sinh(x)", [[0.0, 1.0]], [[0.0], [-1.0]])], [[1.0], [0.0]], algebraic=["w"]
    )
    assert ps.certify(model).is_certified


def test_no_region_is_certified_in_a_box_without_an_equilibrium() -> None:
    """The verdict says that there is none."""
    verdict = ps.certify(fold(), domain=[[0.5, 1.0], [-0.5, 0.5]])
    assert "inside the box" in str(verdict.detail)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_runs_from_the_edge_of_random_boxes_stay(seed: int) -> None:
    """Of buses without inertia in random boxes about their rest: the inputs, the strips and the bound hold."""
    at, sides = _bus_at_rest(seed), np.random.default_rng(seed).uniform(0.2, 1.0, (2, 2))
    verdict = ps.certify(bus(seed), domain=np.stack([at - sides[0], at + sides[1]], axis=1))
    assert verdict.is_certified
    assert stays(bus(seed), verdict.certificate, seed)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(4))
def test_runs_from_the_edge_of_random_regions_stay(seed: int) -> None:
    """Buses without inertia behind sines: runs with the largest inputs keep to the region, its strips and its bound."""
    certificate = ps.certify(bus(seed), domain="auto").certificate
    assert stays(bus(seed), certificate, seed)


def test_a_region_is_about_a_stable_point_that_exists() -> None:
    """Where the states run away, nothing is certified, and the reason is the linearisation."""
    model = ps.DescriptorModel([[1.0, -0.5], [0.3, -1.0]], [("x**3", [[0.0, 1.0]], [[0.0], [1.0]])], algebraic=["w"])
    verdict = ps.certify(model, domain="auto")
    assert isinstance(verdict, ps.Undecided)
    assert "not exponentially stable" in verdict.detail


def test_a_question_that_does_not_fit_is_refused() -> None:
    """A box is of the states or of all variables; an operating point is a state, or all variables."""
    for domain in (3 * [[-1.0, 1.0]], [[1.0, -1.0]], "near", "data"):
        with pytest.raises(ps.ModelError, match=r"box|domain"):
            ps.certify(loop(0.5), domain=domain)
    with pytest.raises(ps.ModelError, match="operating_point"):
        ps.certify(loop(0.5), operating_point=[1.0, 2.0, 3.0])


@pytest.mark.parametrize("seed", range(12))
def test_linear_models_are_refuted_just_where_an_eigenvalue_is_positive(seed: int) -> None:
    """With 1 to 3 states and 1 to 3 equations: that of the states once the equations are solved."""
    rng = np.random.default_rng(seed)
    n, k = rng.integers(1, 4, 2)
    A = rng.normal(size=(n + k, n + k))
    reduced = A[:n, :n] - A[:n, n:] @ np.linalg.solve(A[n:, n:], A[n:, :n])
    largest = 0.3 * (-1) ** seed  # real part that the states' matrix is shifted to
    A[:n, :n] += (largest - np.linalg.eigvals(reduced).real.max()) * np.eye(n)
    verdict = ps.certify(ps.DescriptorModel(A, [], np.eye(n + k, n), algebraic=int(k)))
    assert isinstance(verdict, ps.Refuted if largest > 0 else ps.Certified), verdict


@pytest.mark.long
def test_what_is_refuted_of_random_models_is_true() -> None:
    """Runs from beside an unstable equilibrium leave it, and two solutions solve the equations."""
    kinds = set()
    for seed in range(60):
        model = drawn(seed)
        verdict = ps.certify(model, time_limit=5)
        if isinstance(verdict, ps.Refuted):
            kinds.add(verdict.witness.kind)
            assert _is_true(model, verdict.witness)
    assert kinds >= {"unstable-equilibrium", "two-solutions", "two-equilibria"}


def _is_true(model: ps.DescriptorModel, witness: ps.Witness) -> bool:
    said = witness.content["witness"]
    points = [np.array([m * 2.0**e for m, e in p["x"]]) for p in said.get("points", [said.get("point")])]
    n, zero = model.n, np.zeros(model.m)
    if witness.kind == "two-solutions":
        return max(np.abs(model.rows.rhs(z, zero)[n:]).max() for z in points) < 1e-9
    if witness.kind == "two-equilibria":
        return max(np.abs(model.rows.rhs(z, zero)).max() for z in points) < 1e-9
    e = np.array([m * 2.0**e for m, e in said["direction"]])
    x0 = points[0][:n] + 1e-4 * e / np.linalg.norm(e)
    run = model.simulate(x0, np.linspace(0, 400, 2001), near=points[0][n:])[0]
    away = np.linalg.norm(run.x[:, :n] - points[0][:n], axis=1).max()
    return run.diverged_at is not None or run.stopped_at is not None or away > 1e-2


def test_equations_that_do_not_change_with_a_variable_are_refuted() -> None:
    """0 = x + u says nothing of w; the verdict names w."""
    model = ps.DescriptorModel([[-1.0, 1.0], [1.0, 0.0]], [], [[0.0], [1.0]], algebraic=["w"])
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Refuted)
    assert verdict.witness.kind == "free-direction"


def _latch(gain: float, slope: float) -> ps.DescriptorModel:
    """x' = -x + w + u, w = gain tanh(slope x): three equilibria where gain slope > 1, else one."""
    return ps.DescriptorModel(
        [[-1.0, 1.0], [0.0, -1.0]], [("tanh(x)", [[slope, 0.0]], [[0.0], [gain]])], [[1.0], [0.0]], algebraic=["w"]
    )


def test_two_states_of_rest_refute_a_model_with_equations() -> None:
    """A latch rests at two states: the checker accepts the witness, for this model alone, and it may be saved."""
    model = _latch(2.0, 1.0)
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Refuted)
    assert verdict.witness.kind == "two-equilibria"
    assert isinstance(ps.check(verdict.witness, model), ps.Accepted)
    assert not isinstance(ps.check(verdict.witness, _latch(2.0, 0.5)), ps.Accepted)
    x = np.array([point["x"][0][0] * 2.0 ** point["x"][0][1] for point in verdict.witness.content["witness"]["points"]])
    for start in x:
        run = model.simulate([start], np.linspace(0, 1, 5))[0]
        assert np.abs(run.x[:, 0] - start).max() < 1e-6


def test_a_latch_is_refuted_where_it_has_three_equilibria_and_never_else() -> None:
    """Of random latches those of a loop gain above 1 are refuted, and those below it are certified."""
    rng = np.random.default_rng(0)
    for _ in range(6):
        gain, slope = rng.uniform(0.3, 3, 2)
        verdict = ps.certify(_latch(gain, slope))
        assert isinstance(verdict, ps.Refuted if gain * slope > 1 else ps.Certified), (gain, slope)


def test_a_region_of_a_latch_is_still_certified() -> None:
    """Where all states are refuted a region that is asked for may be certified."""
    assert ps.certify(_latch(2.0, 1.0), domain="auto").is_certified


@pytest.mark.long
@pytest.mark.parametrize(("n", "q"), [(4, 10), (8, 12)])
def test_equilibrium_networks_are_certified(n: int, q: int) -> None:
    """Loops and layers of many neurons: what equations give linearly costs no unknowns."""
    verdict = ps.certify(equilibrium_network(n, q, 0))
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.claim == "rate-and-gain"
