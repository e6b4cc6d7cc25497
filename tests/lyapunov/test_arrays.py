"""The interior-point method on arrays of other namespaces than NumPy's."""

import tracemalloc
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import array_api_strict
import numpy as np
import pytest
from scipy.linalg import LinAlgError

from persid.errors import ModelError
from persid.lyapunov.arrays import HOST, Array, Arrays, Standard, Torch, arrays_on
from persid.lyapunov.inequality import assemble, corollary_1
from persid.lyapunov.interior_point import Solution, Status, solve
from persid.lyapunov.iterate import LANCZOS_ORDER, first_iterate, step
from persid.lyapunov.pairs import Problem, combine, lengths, pairings, sandwich, schur
from persid.lyapunov.search import PoolFence, search
from persid.lyapunov.sectors import groups
from persid.lyapunov.shifted_model import Setting
from persid.lyapunov.system import Family, system
from persid.models.model import PersidskiiModel
from random_problems import random_assembly, random_model

HERE, THERE = array_api_strict.Device("CPU_DEVICE"), array_api_strict.Device("device1")
READS = 60  # numbers that a step may wait for: of six matrices the way to the boundary, twice, and forty others


class Elsewhere(Standard):
    """Arrays that refuse those of the host and what the standard does not promise; what is moved is written down."""

    def __init__(self) -> None:
        super().__init__(array_api_strict, THERE)
        self.moved: list[int] = []

    def put(self, a: np.ndarray) -> Array:
        self.moved.append(a.size)
        return super().put(a)

    def get(self, a: Array) -> np.ndarray:
        self.moved.append(int(np.prod(a.shape)))
        return np.asarray(a.to_device(HERE))


def strict() -> Arrays:
    """Arrays of another device, as strict as the standard allows."""
    return Elsewhere()


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


def _of_order(order: int) -> Problem:
    """Return the problem of a dense model with the paper's multipliers, four entries of the inequality a state."""
    n, rng = order // 4, np.random.default_rng(0)
    functions = ("x**3", "sinh(x)", "tanh(x)")
    terms = [(f, None, rng.normal(size=(n, n)) / 4 / n - np.eye(n)) for f in functions]
    model = PersidskiiModel(rng.normal(size=(n, n)) / 4 / n - np.eye(n), terms, np.ones((n, 1)))
    found = groups(model.channels)
    about = system(model, found, {g.curve: np.eye(g.curve.size) for g in found}, shifted=False)
    return assemble(about, corollary_1(about)).problem


@pytest.mark.parametrize("order", [LANCZOS_ORDER + 16, 2 * LANCZOS_ORDER])
def test_a_step_reads_few_numbers_and_moves_no_matrix(order: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """A step waits for a device a few dozen times whatever the order, and moves vectors at most."""
    reads, kind = list[str](), type(array_api_strict.zeros(1))
    for name in ("__float__", "__bool__", "__int__", "__index__"):
        usual = getattr(kind, name)
        monkeypatch.setattr(kind, name, lambda a, usual=usual, name=name: reads.append(name) or usual(a))
    there = Elsewhere()
    state = first_iterate(replace(_of_order(order), arrays=there).whitened())
    for count in range(3):
        reads.clear(), there.moved.clear()
        taken = step(state)
        assert taken is not None
        state = taken.state
        assert len(reads) + len(there.moved) <= READS
        assert not count or max(there.moved) <= order  # the first step also moves the data of the problem


def test_a_solution_holds_as_much_as_the_page_says() -> None:
    """At most 26 matrices of the order are held at once, and the room of the Schur complement is given back."""
    problem = _of_order(4 * LANCZOS_ORDER)
    tracemalloc.start()
    solution = solve(problem, iterations=3)
    peak = tracemalloc.get_traced_memory()[1] / problem.order**2 / 8
    tracemalloc.stop()
    assert 12 < peak < 26
    assert "_square" not in vars(solution.last.problem)


def test_pytorch_waits_for_its_device_as_seldom() -> None:
    """PyTorch's own account of a step: few numbers read, and no loop of elements."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")
    from torch.utils._python_dispatch import TorchDispatchMode

    class Account(TorchDispatchMode):
        def __init__(self) -> None:
            super().__init__()
            self.called: list[str] = []

        def __torch_dispatch__(self, call: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
            self.called.append(str(call))
            return call(*args, **kwargs or {})

    state = first_iterate(replace(_of_order(2 * LANCZOS_ORDER), arrays=Torch("cpu")).whitened())
    step(state)  # the data of the problem are moved here
    with torch.no_grad(), Account() as account:
        assert step(state) is not None
    assert sum("_local_scalar_dense" in name or "_to_copy" in name for name in account.called) <= READS
    assert len(account.called) < 2500


@EVERYWHERE
def test_a_fenced_search_takes_the_same_steps(made: Callable[[], Arrays], monkeypatch: pytest.MonkeyPatch) -> None:
    """Prices, and the fence that they are, are found where the arrays live, and unknowns join as on the host."""
    monkeypatch.setattr("persid.lyapunov.search.FREE_STEPS", 1)
    setting, asked = Setting.of(random_model(9), None), list[int]()
    share = PoolFence.share
    monkeypatch.setattr(PoolFence, "share", lambda fence, *ends: asked.append(1) or share(fence, *ends))
    here, there = (search(replace(setting.system, arrays=of), setting.pools) for of in (HOST, made()))
    assert (there.status, there.rounds, there.steps) == (here.status, here.rounds, here.steps)
    assert len(asked) > there.rounds
    np.testing.assert_allclose(there.solution.X, here.solution.X, rtol=1e-4, atol=1e-6 * np.abs(here.solution.X).max())


@EVERYWHERE
def test_what_is_not_finite_has_no_factor(made: Callable[[], Arrays]) -> None:
    """Where numbers have overflown no factor and no eigenvalue is returned, whatever a device's library says."""
    of, M = made(), np.diag([1.0, np.nan, 2.0])
    assert not of.is_positive(of.put(M))
    with pytest.raises(LinAlgError):
        of.half(of.put(M))
    with pytest.raises(LinAlgError):
        of.solver(of.put(M))


@EVERYWHERE
def test_unknowns_join_on_other_arrays(made: Callable[[], Arrays]) -> None:
    """A run that goes on with more unknowns goes on where the arrays live."""
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


def test_a_device_without_double_precision_is_none(monkeypatch: pytest.MonkeyPatch) -> None:
    """Some devices hold no binary64: that is said before anything is solved."""
    torch = pytest.importorskip("torch", reason="PyTorch is not installed")

    def refuses(*_: object, **options: object) -> None:
        if options.get("dtype") is torch.float64:
            raise TypeError("this framework doesn't support float64")

    monkeypatch.setattr(torch, "zeros", refuses)
    with pytest.raises(ModelError, match="no device 'mps' here: this framework doesn't support float64"):
        arrays_on("mps")
