"""The matrix inequality: the paper's Theorem 1 and its reduced form, and that blocks mean what they say."""

from typing import Any

import numpy as np
import pytest
from numpy import ndarray

from persid.lyapunov.inequality import Catalogue, assemble, corollary_1, reduced_theorem_1, theorem_1
from persid.lyapunov.pairs import combine, pairings
from persid.lyapunov.sectors import groups, pool
from persid.lyapunov.system import Family, system
from persid.models.model import PersidskiiModel
from random_problems import random_assembly, random_model


def _numbers(seed: int, n: int = 2, M: int = 3) -> dict[str, Any]:
    """Return random data of Theorem 1: nonnegative multipliers, any Gamma."""
    rng = np.random.default_rng(seed)
    return {
        "Gamma": [rng.normal(size=(n, n)) - 2 * np.eye(n) for _ in range(M)],
        "Lambda": [rng.uniform(0, 1, n) for _ in range(M)],
        "Xi": [rng.uniform(0, 1, n) for _ in range(M)],
        "Upsilon": {(s, z): rng.uniform(0, 1, n) for s in range(M + 1) for z in range(s + 1, M + 1)},
    }


def _printed(data: dict[str, Any], P: ndarray) -> ndarray:
    n = len(P)
    return theorem_1(P=P, Phi=np.eye(n), **data)


@pytest.mark.parametrize("seed", range(5))
def test_reduced_form_is_the_middle_of_the_printed_one(seed: int) -> None:
    """With P = 0 and Upsilon_0j = 0 the blocks of f_1 … f_M in Theorem 1 are the reduced form."""
    data = _numbers(seed)
    data["Upsilon"] = {k: (0 * v if k[0] == 0 else v) for k, v in data["Upsilon"].items()}
    Q = _printed(data, np.zeros((2, 2)))
    np.testing.assert_allclose(Q[2:-2, 2:-2], reduced_theorem_1(**data))
    assert not Q[:2].any()


@pytest.mark.parametrize("seed", range(5))
def test_printed_theorem_forces_P_to_vanish(seed: int) -> None:
    """Its first diagonal block is zero, so any P or Upsilon_0j other than 0 gives Q a positive eigenvalue."""
    rng, data = np.random.default_rng(seed), _numbers(seed)
    root = rng.normal(size=(2, 2))
    for P, first in ((root @ root.T, 0.0), (np.zeros((2, 2)), 1.0), (1e-6 * np.eye(2), 0.0)):
        data["Upsilon"] = {k: (first * v if k[0] == 0 else v) for k, v in _numbers(seed)["Upsilon"].items()}
        Q = _printed(data, P)
        assert not Q[:2, :2].any()
        assert np.abs(Q[:2]).max() > 0
        assert np.linalg.eigvalsh(Q)[-1] > 0


@pytest.mark.filterwarnings("ignore:.*sol.*accurate.*:UserWarning")
def test_library_solver_finds_no_P_in_the_printed_theorem() -> None:
    """Maximising tr P + sum Upsilon_0j under the printed inequality gives zero."""
    cp = pytest.importorskip("cvxpy")
    pytest.importorskip("clarabel")
    n = 2
    Gamma = [np.array([[-2.0, 0.3], [0.1, -1.5]]), np.array([[-1.0, 0.2], [-0.3, -2.0]])]
    P = cp.Variable((n, n), PSD=True)
    L, Xi, U0 = (cp.Variable((2, n), nonneg=True) for _ in range(3))
    U12 = cp.Variable(n, nonneg=True)
    zero = np.zeros((n, n))
    first = [P @ Gamma[j] + cp.diag(U0[j]) for j in range(2)]
    own = [Gamma[j].T @ cp.diag(L[j]) + cp.diag(L[j]) @ Gamma[j] + cp.diag(Xi[j]) for j in range(2)]
    cross = Gamma[0].T @ cp.diag(L[1]) + cp.diag(L[0]) @ Gamma[1] + cp.diag(U12)
    Q = cp.bmat(
        [
            [zero, first[0], first[1], P],
            [first[0].T, own[0], cross, cp.diag(L[0])],
            [first[1].T, cross.T, own[1], cp.diag(L[1])],
            [P, cp.diag(L[0]), cp.diag(L[1]), -np.eye(n)],
        ]
    )
    program = cp.Problem(cp.Maximize(cp.trace(P) + cp.sum(U0)), [Q << 0, cp.trace(P) + cp.sum(L) <= 1])
    program.solve(solver=cp.CLARABEL)
    assert abs(program.value) < 1e-3  # no interior: solvers call far larger numbers than their tolerance optimal


def test_corollary_1_has_the_paper_forms_only() -> None:
    """Corollary 1's families hold y and every f_j, all of them in V, with all products inside a group."""
    model = random_model(1)
    found = groups(model.channels)
    pools = {g.curve: np.eye(g.curve.size) for g in found}
    for group, family in zip(found, corollary_1(system(model, found, pools, shifted=False)), strict=True):
        np.testing.assert_array_equal(family.forms, np.eye(group.curve.size))
        assert len(family.products) == group.curve.size * (group.curve.size - 1) // 2


@pytest.mark.parametrize("seed", [0, 1, 2, 3, 5, 6, 7])
def test_inequality_bounds_the_derivative_of_V(seed: int) -> None:
    """-z'Qz is at most -V' plus products that are not negative, for the unknowns of any point, feasible or not."""
    assembly, model = random_assembly(seed), random_model(seed)
    about, numbers = assembly.unknowns.system, assembly.unknowns.multipliers(np.ones(len(assembly.problem.cost)))
    rng = np.random.default_rng(seed)
    Q = combine(assembly.problem, np.ones(len(assembly.problem.cost)))
    for _ in range(5):
        x = rng.normal(size=model.n)
        z, products, gradient = np.zeros(about.entries), 0.0, numbers.P @ x
        z[: len(about.states)] = x[list(about.states)]
        for group, family, mu, tau in zip(
            about.groups, assembly.unknowns.families, numbers.mu, numbers.tau, strict=True
        ):
            phi = group.curve.values(np.array([group.row @ x]))[0]
            z[[about.places[c] for c in group.channels]] = phi[1:]
            value = family.forms @ phi
            gradient = gradient + group.row * float(mu @ value)
            products += sum(2 * t * value[k] * value[j] for t, (k, j) in zip(tau, family.products, strict=True))
        w = z / assembly.unknowns.units.entries
        np.testing.assert_allclose(w @ Q @ w, 2 * gradient @ model.rhs(x) + products, rtol=1e-9, atol=1e-9)


def test_multipliers_of_rows_of_either_sign_are_nonnegative() -> None:
    """A group whose row is a negative multiple of a unit vector gets multipliers of the right sign."""
    model = PersidskiiModel([[-2.0]], [("tanh(x)", [[-0.7]], [[1.0]])], [[1.0]])
    found = groups(model.channels)
    pools = {g.curve: np.array(pool(g.curve)) for g in found}
    about = system(model, found, pools, shifted=False)
    assembly = assemble(about, corollary_1(about))
    numbers = assembly.unknowns.multipliers(np.ones(len(assembly.problem.cost)))
    assert all((mu >= 0).all() for mu in numbers.mu)
    assert (np.diag(numbers.P) >= 0).all()


@pytest.mark.parametrize("seed", [0, 2, 4])
def test_prices_are_those_of_the_unknowns_of_a_problem(seed: int) -> None:
    """A catalogue prices every density and product as the problem with all of them would."""
    assembly = random_assembly(seed)
    about, families = assembly.unknowns.system, [Family.full(family.forms) for family in assembly.unknowns.families]
    catalogue = Catalogue(about, families, full_P=assembly.problem.symmetric > 0)
    half = np.random.default_rng(seed).normal(size=(assembly.problem.order,) * 2)
    X = half @ half.T
    whole = catalogue.assembly(families)
    price = dict(zip(whole.unknowns.labels, pairings(whole.problem, X), strict=True))
    for g, (products, densities) in enumerate(catalogue.prices(X)):
        np.testing.assert_allclose(densities, [price["mu", g, k] for k in families[g].densities], rtol=1e-9)
        np.testing.assert_allclose(
            [products[pair] for pair in families[g].products],
            [price["tau", g, *pair] for pair in families[g].products],
            rtol=1e-9,
            atol=1e-12,
        )


def test_smaller_problem_finds_its_unknowns_in_a_larger_one() -> None:
    """The place of an unknown in another problem is that of the same label, -1 where it is not there."""
    whole = random_assembly(1)
    few = assemble(
        whole.unknowns.system, [Family(f.forms, f.densities[:1], f.products[1:2]) for f in whole.unknowns.families]
    )
    assert [whole.unknowns.labels[j] for j in few.unknowns.places_in(whole.unknowns)] == few.unknowns.labels
    assert set(np.flatnonzero(whole.unknowns.places_in(few.unknowns) < 0)) == {
        j for j, label in enumerate(whole.unknowns.labels) if label not in few.unknowns.labels
    }


def test_first_dual_matrix_is_strictly_inside_the_cone_of_all_products(monkeypatch: pytest.MonkeyPatch) -> None:
    """A first dual matrix regularised out of the sector cone is pulled back into it."""
    from persid.lyapunov import dual_start

    def least(catalogue: Catalogue) -> float:
        X = catalogue.assembly(catalogue.families).problem.X
        return min(float(products[np.triu_indices(len(products), 1)].min()) for products, _ in catalogue.prices(X))

    whole = random_assembly(2)
    mean = dual_start._mean
    monkeypatch.setattr(dual_start, "_mean", lambda *given: mean(*given) + 0.5 * np.eye(len(given[2])) * len(given[2]))
    assert least(Catalogue(whole.unknowns.system, whole.unknowns.families)) > 0
    monkeypatch.setattr(dual_start, "_inward", lambda X, forms: X)
    assert least(Catalogue(whole.unknowns.system, whole.unknowns.families)) < 0, "the example must violate a product"
