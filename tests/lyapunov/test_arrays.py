"""The interior-point method on arrays of other namespaces than NumPy's."""

from collections.abc import Callable
from dataclasses import replace

import array_api_strict
import numpy as np
import pytest
from scipy.linalg import LinAlgError

from persid.errors import ModelError
from persid.lyapunov.arrays import HOST, Arrays, Standard, Torch, arrays_on
from persid.lyapunov.interior_point import Solution, Status, solve
from persid.lyapunov.pairs import combine, lengths, pairings, sandwich, schur
from random_problems import random_assembly


def strict() -> Arrays:
    """Arrays that refuse whatever the standard does not promise."""
    return Standard(array_api_strict)


def torch() -> Arrays:
    """PyTorch on the processor, where it is installed."""
    pytest.importorskip("torch", reason="PyTorch is not installed")
    return Torch("cpu")


def cuda() -> Arrays:
    """PyTorch on a GPU, where there is one."""
    if not pytest.importorskip("torch", reason="PyTorch is not installed").cuda.is_available():
        pytest.skip("no GPU here")
    return arrays_on("cuda")


EVERYWHERE = pytest.mark.parametrize("made", [strict, torch, cuda])


@EVERYWHERE
def test_what_the_standard_lacks(made: Callable[[], Arrays]) -> None:
    """Factors, the smallest eigenvalue, solutions and diagonals are LAPACK's; what is not positive definite is said."""
    of, root = made(), np.random.default_rng(0).normal(size=(7, 7))
    M = root @ root.T + np.eye(7)
    np.testing.assert_allclose(of.get(of.half(of.put(M))), HOST.half(M), atol=1e-12)
    assert of.smallest(of.put(M)) == pytest.approx(HOST.smallest(M))
    assert of.is_positive(of.put(M))
    assert not of.is_positive(of.put(-M))
    with pytest.raises(LinAlgError):
        of.half(of.put(-M))
    lower, v = np.tril(M) + 100 * np.triu(np.ones((7, 7)), 1), root[:, :2]
    np.testing.assert_allclose(of.get(of.solver(of.put(lower))(of.put(v))), np.linalg.solve(M, v), atol=1e-12)
    np.testing.assert_allclose(of.get(of.add_to_diagonal(of.put(M), 2.0)), M + 2 * np.eye(7))
    np.testing.assert_allclose(of.get(of.add_to_diagonal(of.put(M), of.put(v[:, 0]))), M + np.diag(v[:, 0]))


@EVERYWHERE
@pytest.mark.parametrize("seed", [0, 2, 5])
def test_products_are_those_of_numpy(made: Callable[[], Arrays], seed: int) -> None:
    """Sums of pairs, pairings, lengths and the Schur complement do not depend on where the arrays live."""
    host = random_assembly(seed).problem
    there, rng = replace(host, arrays=made()), np.random.default_rng(seed)
    of, y, root = there.arrays, rng.normal(size=len(host.cost)), rng.normal(size=(host.order, host.order))
    M = root @ root.T + np.eye(host.order)
    np.testing.assert_allclose(of.get(combine(there, of.put(y))), combine(host, y), atol=1e-12)
    for made_of in (pairings, lengths, sandwich):
        np.testing.assert_allclose(of.get(made_of(there, of.put(M))), made_of(host, M), rtol=1e-12, atol=1e-10)
    lower = [p.arrays.get(schur(p, p.arrays.put(M), p.arrays.put(M))) for p in (there, host)]
    np.testing.assert_allclose(np.tril(lower[0]), np.tril(lower[1]), rtol=1e-10, atol=1e-8)


@EVERYWHERE
@pytest.mark.parametrize("seed", [0, 2, 4, 5])
def test_the_method_takes_the_same_steps(made: Callable[[], Arrays], seed: int) -> None:
    """The same problem is decided in as many steps, with the same unknowns, and nothing of it is NumPy's."""
    problem = random_assembly(seed).problem
    here, there = solve(problem), solve(replace(problem, arrays=made()))
    assert (there.status, there.steps) == (here.status, here.steps)
    assert there.status in (Status.FEASIBLE, Status.INFEASIBLE)
    np.testing.assert_allclose(there.y, here.y, rtol=1e-4, atol=1e-6 * np.abs(here.y).max())
    np.testing.assert_allclose(there.X, here.X, rtol=1e-4, atol=1e-6 * np.abs(here.X).max())
    assert not isinstance(there.last.X, np.ndarray)


@EVERYWHERE
def test_unknowns_join_on_other_arrays(made: Callable[[], Arrays]) -> None:
    """A run that goes on with more unknowns goes on where the arrays live."""
    from persid.lyapunov.inequality import assemble
    from persid.lyapunov.system import Family

    whole = random_assembly(3)
    few = assemble(whole.unknowns.system, [Family(f.forms, f.densities, ()) for f in whole.unknowns.families])
    places = whole.unknowns.places_in(few.unknowns)

    def ended(of: Arrays) -> Solution:
        rough = solve(replace(few.problem, arrays=of), fall=1e-2)
        return solve(replace(whole.problem, arrays=of), start=(rough, places))

    here, there = ended(HOST), ended(made())
    assert (there.status, there.steps) == (here.status, here.steps)


def test_devices_are_named() -> None:
    """The host is NumPy; other names are PyTorch's devices."""
    assert arrays_on("cpu") is HOST
    pytest.importorskip("torch", reason="PyTorch is not installed")
    with pytest.raises(ModelError, match="no device 'nonsense' here"):
        arrays_on("nonsense")
