"""Products with sums of pairs of rows, against the same products of dense matrices."""

import numpy as np
import pytest
from numpy import ndarray

from persid.lyapunov import pairs, triangle
from persid.lyapunov.arrays import HOST
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.inequality import assemble
from persid.lyapunov.pairs import Problem, combine, lengths, pairings, sandwich, schur
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import Family, Target
from persid.models.model import PersidskiiModel
from random_problems import random_assembly

SEEDS = (0, 2, 4, 5)  # diagonal and full P, general rows, a dropped state
FORMED = pytest.mark.parametrize("formed", [0, pairs.FORMED])  # as the pairs of large problems, and as small matrices


def _positive(order: int, seed: int) -> ndarray:
    half = np.random.default_rng(seed).normal(size=(order, order))
    return half @ half.T + np.eye(order)


def _dense(problem: Problem) -> list[ndarray]:
    D = np.vstack([problem.S.toarray(), problem.H])
    tie = np.eye(len(problem.p)) if problem.tie is None else problem.tie.toarray()
    single = [np.outer(D[p], D[q]) + np.outer(D[q], D[p]) for p, q in zip(problem.p, problem.q, strict=True)]
    return list(np.tensordot(tie.T, np.array(single), axes=1))


@FORMED
@pytest.mark.parametrize("seed", SEEDS)
def test_products_with_one_matrix(seed: int, formed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sums, pairings and D M D' are what the dense matrices give, and no pairing exceeds its lengths."""
    monkeypatch.setattr(pairs, "FORMED", formed)
    problem = random_assembly(seed).problem
    F, M = _dense(problem), _positive(problem.order, seed)
    y = np.random.default_rng(seed).normal(size=len(F))
    np.testing.assert_allclose(combine(problem, y), np.tensordot(y, F, axes=1), atol=1e-12)
    np.testing.assert_allclose(pairings(problem, M), [np.vdot(f, M) for f in F], rtol=1e-9, atol=1e-12)
    D = np.vstack([problem.S.toarray(), problem.H])
    np.testing.assert_allclose(sandwich(problem, M), D @ M @ D.T, atol=1e-10)
    assert (np.abs(pairings(problem, M)) <= (1 + 1e-9) * lengths(problem, M)).all()


@FORMED
@pytest.mark.parametrize("seed", SEEDS)
def test_schur_complement(seed: int, formed: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The lower triangle of the Schur complement is tr(F_k X F_l V), for the pairs and for the entries of P."""
    monkeypatch.setattr(pairs, "FORMED", formed)
    problem = random_assembly(seed).problem
    F, X, V = _dense(problem), _positive(problem.order, 1), _positive(problem.order, 2)
    wanted = [[np.trace(f @ X @ g @ V) for g in F] for f in F]
    made = schur(problem, X, V)
    np.testing.assert_allclose(np.tril(made), np.tril(wanted), rtol=1e-8, atol=1e-8)
    assert (problem._formed is not None) == bool(formed)
    monkeypatch.setattr(triangle, "FORMED", formed)
    of = triangle.Triangle(problem.symmetric, HOST)
    E = [of.matrix(unit) for unit in np.eye(problem.free)]
    U, W = _positive(problem.symmetric, 3), _positive(problem.symmetric, 4)
    wanted = np.array([[np.trace(e @ U @ f @ W) for f in E] for e in E]).reshape(len(E), len(E))
    np.testing.assert_allclose(of.schur(U, W), wanted)
    np.testing.assert_allclose(of.pairings(U), [np.vdot(e, U) for e in E])
    np.testing.assert_allclose(of.dual(of.pairings(U)), U)
    np.testing.assert_allclose(of.matrix(of.entries(U)), U)


def test_schur_complement_of_unknowns_of_many_pairs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Unknowns of several pairs with any weights, before the others and after, are the sums of theirs."""
    monkeypatch.setattr(pairs, "FORMED", 0)
    model = PersidskiiModel([[-1.0, 0.3], [0.2, -2.0]], [("tanh(x)", None, -np.eye(2))], [[1.0], [0.5]])
    setting = Setting.of(model, None)
    deviation = Deviation.of_residual(np.ones(2), np.array([True, False]), 0.1, 5)
    target = Target(0.5, 3.0, deviations=(deviation,))
    families = [Family.full(setting.pools[group.curve][:3]) for group in setting.found]
    problem = assemble(setting.system, families, full_P=True, target=target).problem
    assert problem.tie is not None
    F, X, V = _dense(problem), _positive(problem.order, 1), _positive(problem.order, 2)
    wanted = [[np.trace(f @ X @ g @ V) for g in F] for f in F]
    np.testing.assert_allclose(np.tril(schur(problem, X, V)), np.tril(wanted), rtol=1e-8, atol=1e-8)
