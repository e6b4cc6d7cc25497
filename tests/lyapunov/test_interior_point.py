"""The interior-point method against a library solver, and the two answers it may give."""

from dataclasses import replace

import numpy as np
import pytest
from numpy import ndarray
from scipy import sparse

from persid.certificates.stability import prove
from persid.errors import RejectedError, RoundingError
from persid.lyapunov import iterate
from persid.lyapunov.arrays import HOST
from persid.lyapunov.inequality import Assembly, assemble
from persid.lyapunov.interior_point import Solution, Status, solve
from persid.lyapunov.multipliers import choose
from persid.lyapunov.pairs import Problem, combine, pairings
from persid.lyapunov.system import Family
from random_problems import random_assembly, random_model

NEAR_ZERO = 1e-6  # of the scale of the problem: below, a library solver's sign means nothing


def generators(problem: Problem) -> list[ndarray]:
    """Return every F_k as a dense matrix, made the slow way."""
    return [combine(problem, unit) for unit in np.eye(len(problem.cost))]


def by_library(problem: Problem) -> float:
    """Return the optimal margin of the whitened problem from Clarabel through CVXPY."""
    import cvxpy as cp

    white = problem.whitened()
    F = generators(white)
    size = [np.linalg.norm(f) for f in F]
    y, t = cp.Variable(len(F)), cp.Variable()
    inequality = -sum(y[k] * (f / s) for k, (f, s) in enumerate(zip(F, size, strict=True))) - t * np.eye(white.order)
    constraints = [0.5 * (inequality + inequality.T) >> 0, y[white.free :] >= 0, (white.cost / size) @ y == 1]
    if white.symmetric:
        E = [white.triangle.matrix(unit[: white.free]) / s for unit, s in zip(np.eye(len(F)), size, strict=True)]
        constraints.append(sum(y[k] * e for k, e in enumerate(E[: white.free])) >> 0)
    program = cp.Problem(cp.Maximize(t), constraints)
    program.solve(solver=cp.CLARABEL)
    return float(program.value)


def disagreement(assembly: Assembly) -> str | None:
    """Return what the library's optimum contradicts in our answer, or None."""
    solution = solve(assembly.problem)
    optimum = by_library(assembly.problem)
    scale = NEAR_ZERO * max(1.0, abs(solution.lower), abs(solution.upper))
    inside = solution.lower - scale <= optimum <= solution.upper + scale
    allowed = {Status.FEASIBLE: optimum > -scale, Status.INFEASIBLE: optimum < scale}
    if inside and allowed.get(solution.status, abs(optimum) < scale):
        return None
    return f"{solution.status.name} [{solution.lower}, {solution.upper}], library {optimum}"


@pytest.mark.parametrize("first", [0, 12])
@pytest.mark.filterwarnings("ignore::UserWarning:cvxpy", "ignore:.*sol.*accurate.*:UserWarning")
def test_sign_of_margin_agrees_with_clarabel(first: int) -> None:
    """On random problems the sign of the optimal margin is Clarabel's, whatever the rows and the kind of P."""
    pytest.importorskip("clarabel")
    found = {seed: disagreement(random_assembly(seed)) for seed in range(first, first + 12)}
    assert not {seed: what for seed, what in found.items() if what}


def confirmed(seed: int) -> bool | None:
    """Return whether the exact check accepts a feasible answer; None where there is none or a form is not proved."""
    assembly = random_assembly(seed)
    solution = solve(assembly.problem)
    if solution.status is not Status.FEASIBLE:
        return None
    try:
        lyapunov = choose(assembly, solution.y)
        parts = zip(lyapunov.system.groups, lyapunov.chosen, strict=True)
        if not all(group.curve.proves(form) for group, part in parts for form in part.forms):
            return None
        return prove(random_model(seed), lyapunov).claim == "iss"
    except (RejectedError, RoundingError) as error:
        if "span" in str(error):  # claim M asks more of the functions than the inequality does
            return None
        return False


@pytest.mark.filterwarnings("ignore::UserWarning:cvxpy", "ignore:.*sol.*accurate.*:UserWarning")
@pytest.mark.parametrize(
    "count", [pytest.param(100, marks=pytest.mark.long), pytest.param(1000, marks=pytest.mark.slow)]
)
def test_signs_agree_with_clarabel_and_the_exact_check(count: int) -> None:
    """On many random problems the sign of the margin is Clarabel's, and the checker accepts what is feasible."""
    pytest.importorskip("clarabel")
    found = {seed: disagreement(random_assembly(seed)) for seed in range(count)}
    assert not {seed: what for seed, what in found.items() if what}
    answers = [confirmed(seed) for seed in range(count)]
    assert False not in answers
    assert answers.count(True) > count / 10


def test_exact_check_accepts_feasible_answers() -> None:
    """What the method calls feasible becomes a certificate that the checker accepts."""
    answers = [confirmed(seed) for seed in range(8)]
    assert False not in answers
    assert True in answers


def check_dual(problem: Problem, solution: Solution) -> None:
    """Fail unless X proves that the margin is at most m: X > 0 and <F_k, X> + m c_k >= 0, in P's case as a matrix."""
    X, m = solution.X, solution.upper
    assert np.linalg.eigvalsh(X)[0] > 0
    slack = pairings(problem, X) + m * problem.cost
    size = np.array([np.linalg.norm(f) for f in generators(problem)]) * np.trace(X)
    assert (slack[problem.free :] >= -1e-9 * size[problem.free :]).all()
    if problem.free:
        W = np.zeros((problem.symmetric,) * 2)
        W[np.triu_indices(problem.symmetric)] = slack[: problem.free] / 2
        W = W + np.triu(W, 1).T
        assert np.linalg.eigvalsh(W)[0] >= -1e-9 * size[: problem.free].max()


def test_both_answers_carry_their_proof() -> None:
    """A feasible answer satisfies the inequalities, an infeasible one brings a dual matrix with a negative bound."""
    seen = set()
    for seed in range(30):
        problem = random_assembly(seed).problem
        solution = solve(problem)
        seen.add(solution.status)
        assert solution.lower <= solution.upper
        assert (solution.y[problem.free :] >= 0).all()
        np.testing.assert_allclose(problem.cost @ solution.y, 1.0, rtol=1e-8)
        if solution.status is Status.FEASIBLE:
            assert np.linalg.eigvalsh(-combine(problem, solution.y))[0] > 0
            assert (
                not problem.symmetric or np.linalg.eigvalsh(problem.triangle.matrix(solution.y[: problem.free]))[0] > 0
            )
        if solution.status is Status.INFEASIBLE:
            assert solution.upper < 0
            check_dual(problem, solution)
    assert {Status.FEASIBLE, Status.INFEASIBLE} <= seen


def test_same_answer_twice() -> None:
    """The method is deterministic to the last bit."""
    first, second = (solve(random_assembly(7).problem) for _ in range(2))
    np.testing.assert_array_equal(first.y, second.y)
    assert first.log == second.log


def test_dual_matrix_of_a_rough_stop_bounds_the_margin() -> None:
    """A rough stop gives bounds on both sides that the full run respects."""
    problem = random_assembly(3).problem
    rough, exact = solve(problem, gap=0.5), solve(problem, quality=0.9)
    assert len(rough.log) < len(exact.log)
    assert rough.lower <= exact.lower <= exact.upper <= rough.upper
    check_dual(problem, rough)


def test_time_limit_keeps_the_best_so_far() -> None:
    """Without time left the first iterate is returned, and it satisfies its constraints."""
    problem = random_assembly(1).problem
    solution = solve(problem, time_limit=0.0)
    assert solution.status is Status.TIME
    assert len(solution.log) == 1
    assert (solution.y[problem.free :] > 0).all()


def test_interrupt_keeps_the_best_so_far(monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C ends the run with the iterate reached, not with an exception."""
    from persid.lyapunov import interior_point

    steps, taken = [], interior_point.step

    def interrupted(state: object, limit: object) -> object:
        steps.append(state)
        if len(steps) == 3:
            raise KeyboardInterrupt
        return taken(state)

    monkeypatch.setattr(interior_point, "step", interrupted)
    solution = solve(random_assembly(3).problem, quality=0.99)
    assert solution.status in (Status.INTERRUPTED, Status.FEASIBLE)
    assert len(solution.log) == 3
    assert solution.lower == steps[-1].t


def test_interrupted_answer_is_feasible_only_where_the_point_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """After Ctrl-C a positive t counts as a margin only if the point meets its inequalities."""
    from persid.lyapunov import interior_point

    def interrupted(state: object, limit: object) -> object:
        raise KeyboardInterrupt

    problem = random_assembly(1).problem
    feasible = solve(problem)
    assert feasible.status is Status.FEASIBLE
    monkeypatch.setattr(interior_point, "step", interrupted)
    for change, is_feasible in (({}, True), ({"t": 10.0 * feasible.upper}, False), ({"y": -feasible.y}, False)):
        claimed = replace(feasible.last, **change)
        monkeypatch.setattr(interior_point, "first_iterate", lambda white, least, claimed=claimed: claimed)
        assert (solve(problem, quality=100.0).status is Status.FEASIBLE) is is_feasible


def test_goes_on_where_it_was_when_unknowns_join() -> None:
    """A run that is continued with unknowns that joined it answers as a run from the beginning does."""
    for seed in (0, 1, 2, 5, 6, 10):
        whole = random_assembly(seed)
        first = [Family(f.forms, f.densities[:1], f.products[:1]) for f in whole.unknowns.families]
        few = assemble(whole.unknowns.system, first, full_P=whole.problem.symmetric > 0)
        rough = solve(few.problem, fall=0.3)
        assert rough.status is Status.ROUGH
        places = whole.unknowns.places_in(few.unknowns)
        assert (places < 0).any()
        resumed, cold = solve(whole.problem, start=(rough, places)), solve(whole.problem)
        assert resumed.status is cold.status
        assert resumed.lower > 0 or resumed.upper < 0


def test_bound_is_infinite_until_the_dual_equalities_are_met() -> None:
    """A price that is negative when its unknown joins leaves no upper bound before the steps have met it."""
    whole = random_assembly(3)
    few = assemble(whole.unknowns.system, [Family(f.forms, f.densities, ()) for f in whole.unknowns.families])
    rough = solve(few.problem, fall=1e-2)
    assert np.isfinite(rough.upper)
    places = whole.unknowns.places_in(few.unknowns)
    assert (pairings(whole.problem, rough.X)[places < 0] < 0).any(), "the example must have a product that helps"
    assert solve(whole.problem, start=(rough, places), iterations=1).upper == np.inf


@pytest.mark.filterwarnings("error")
def test_products_that_vanish_start_without_a_division_by_zero() -> None:
    """Two one-sided forms with disjoint entries price a multiple of I at zero; the start is interior all the same."""
    problem = random_assembly(2).problem
    S = problem.S.tolil()
    line = int(problem.p[-1]), int(problem.q[-1])
    S[line[0], :], S[line[1], :] = 0.0, 0.0
    S[line[0], 0], S[line[1], 1] = 1.0, 1.0
    changed = replace(problem, S=sparse.csr_array(S.tocsr()), C=sparse.csr_array(sparse.eye_array(problem.order)))
    assert pairings(changed, changed.X)[-1] == 0
    assert solve(changed, iterations=3).log


@pytest.mark.parametrize("order", [5, 100])
def test_way_to_the_boundary(order: int) -> None:
    """The way is that of the smallest eigenvalue, a few percent short at most, and has no end without a direction."""
    rng = np.random.default_rng(order)
    root = rng.normal(size=(order, order))
    M, dM = root @ root.T + np.eye(order), rng.normal(size=(order, order))
    half = HOST.half(M)
    np.testing.assert_allclose(half @ M @ half.T, np.eye(order), atol=1e-8)
    assert iterate._to_boundary(HOST, half, np.zeros_like(M)) == np.inf
    assert iterate._to_boundary(HOST, half, 3 * M) == np.inf
    for change in (dM + dM.T, -np.outer(dM[0], dM[0]), -M):
        a = iterate._to_boundary(HOST, half, change)
        exact = -1 / np.linalg.eigvalsh(half @ change @ half.T)[0]
        assert 0.95 * exact <= a <= 1.0001 * exact
