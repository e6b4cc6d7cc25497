"""Claim L1 in the checker: cones, small files in fractions, large ones by bounded sums, and what must be refused."""

import json
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from scipy.optimize import nnls

from persid_check import Accepted, Malformed, Rejected, canonical_model, check, model_sha256
from persid_check.model import model_of
from persid_check.networks.cone import generators
from persid_check.networks.nodes import nodes_of
from persid_check.networks.table import doubtful, table_of


def dyadic(number: float) -> list[int]:
    """Return [m, e] with number = m 2^e."""
    top, bottom = float(number).as_integer_ratio()
    return [top, 1 - bottom.bit_length()]


def model(A0: Any, terms: Any = (), B: Any = None, b: Any = None) -> dict[str, Any]:
    """Return a model object; terms are (f, R, A)."""
    n = len(A0)
    return {
        "format": "persid-model-1",
        "states": [f"x{i + 1}" for i in range(n)],
        "inputs": [f"u{i + 1}" for i in range(len(B[0]) if B else 0)],
        "A0": A0,
        "terms": [{"f": f, "R": R, "A": A} for f, R, A in terms],
        "B": B,
        "b": b,
    }


def file(subject: dict[str, Any], kinds: Any, weights: Any, kappa: float, *, every: bool = True) -> dict[str, Any]:
    """Return the object of a certificate; `kinds` are ([(text, alpha)], forms)."""
    return {
        "format": "persid-certificate-1",
        "claim": "L1",
        "statement": "",
        "model_sha256": model_sha256(subject),
        "model": canonical_model(subject),
        "operating_point": "every" if every else "reference",
        "kinds": [
            {
                "functions": [[text, dyadic(alpha)] for text, alpha in functions],
                "forms": [[dyadic(c) for c in form] for form in forms],
            }
            for functions, forms in kinds
        ],
        "kappa": dyadic(kappa),
        "weights": [dyadic(w) for w in weights],
        "companion": None,
    }


def answer(content: dict[str, Any]) -> Any:
    """Return the checker's answer to an object."""
    return check(json.dumps(content).encode())


TANH = [("tanh(x)", 1.0)]
TANH_FORMS = [(1, 0), (0, 1), (1, -1)]


@pytest.mark.parametrize(("size", "count"), [(1, 1), (2, 3), (3, 6), (4, 2), (5, 9), (6, 5)])
def test_generators_span_the_cone(size: int, count: int) -> None:
    """Every generator satisfies all forms, and every random point that does is a nonnegative combination of them."""
    rng = np.random.default_rng(size)
    forms = rng.integers(-4, 9, (count, size))
    forms[forms.sum(axis=1) < 0] *= -1
    rays = np.array(generators([[Fraction(int(c)) for c in form] for form in forms], size), float)
    assert (forms @ rays.T >= 0).all()
    points = 1 + rng.normal(size=(2000, size))
    inside = points[(points @ forms.T >= 0).all(axis=1)]
    assert len(inside)
    unit = rays / np.abs(rays).max(axis=1, keepdims=True)
    assert max(nnls(unit.T, x)[1] for x in inside[:200]) < 1e-9


def test_a_small_network_is_accepted() -> None:
    """Two coupled nodes with tanh are accepted, with rate and gain in the sentence."""
    subject = model([[-2, 0.5], [0, -2]], [("tanh(x)", None, [[0, 1], [0.5, 0]])], B=[[1], [0]])
    result = answer(file(subject, [(TANH, TANH_FORMS)], (1, 1), 0.5))
    assert isinstance(result, Accepted), result
    assert "exp(-0.5 t)" in result.statement
    assert "2 sup|u1 - u1*|" in result.statement
    assert "exactly one equilibrium" in result.statement


def small() -> tuple[dict[str, Any], dict[str, Any]]:
    """Return a model of two nodes and an accepted certificate of it."""
    subject = model([[-2, 0.5], [0, -2]], [("tanh(x)", None, [[0, 1], [0.5, 0]])], B=[[1], [0]])
    return subject, file(subject, [(TANH, TANH_FORMS)], (1, 1), 0.5)


def test_the_rate_in_the_file_is_the_largest() -> None:
    """A rate a little above the largest one is rejected: node 2 decays at 2 - 1 - 0.5 with tanh(y) = y."""
    _, content = small()
    assert isinstance(answer({**content, "kappa": dyadic(0.5 + 2**-40)}), Rejected)


@pytest.mark.parametrize(
    ("change", "where"),
    [
        ({"kappa": [0, 0]}, "weights"),
        ({"kappa": [-1, 0]}, "weights"),
        ({"weights": [[1, 0], [0, 0]]}, "weights"),
        ({"weights": [[1, 0], [-1, 0]]}, "weights"),
        ({"weights": [[1, 0], [1, 3]]}, "weights"),
        ({"model_sha256": "0" * 64}, "model_sha256"),
    ],
    ids=["kappa 0", "kappa negative", "weight 0", "weight negative", "weights too different", "hash"],
)
def test_false_numbers_are_rejected(change: dict[str, Any], where: str) -> None:
    """A file with one false number is rejected, and the place is named."""
    _, content = small()
    result = answer({**content, **change})
    assert isinstance(result, Rejected), result
    assert result.where == where


@pytest.mark.parametrize(
    "change",
    [
        {"kappa": 0.5},
        {"weights": [[1, 0]]},
        {"weights": None},
        {"operating_point": None},
        {"kinds": []},
        {"companion": {"npz": "a.npz"}},
        {"companion": {"npz": "../a.npz", "sha256": "0" * 64}},
        {"companion": {"npz": "a.npz", "sha256": "0" * 64}},
        {"format": "persid-certificate-2"},
        {"more": 1},
    ],
    ids=str,
)
def test_what_is_not_specified_is_malformed(change: dict[str, Any]) -> None:
    """A missing, unknown or ill-typed field, or a companion that is not there, makes a file malformed."""
    _, content = small()
    assert isinstance(answer({**content, **change}), Malformed)


def test_kinds_are_those_of_the_nodes() -> None:
    """A kind that no node has, a kind twice, a wrong factor or a form of the wrong length is malformed."""
    subject, content = small()
    wrong = [(TANH, TANH_FORMS), ([("sinh(x)", 1.0)], [(0, 1)])]
    for kinds in (wrong, [(TANH, TANH_FORMS)] * 2, [([("tanh(x)", 2.0)], TANH_FORMS)], [(TANH, [(1, 0, 0)])]):
        assert isinstance(answer({**content, "kinds": file(subject, kinds, (1, 1), 0.5)["kinds"]}), Malformed)


@pytest.mark.parametrize("every", [True, False])
def test_rows_are_normalised(every: bool) -> None:
    """x' = 2x - 10 sinh(x/10) is unstable: the form sinh(y/10) - y is false, and the true one is not enough."""
    subject = model([[2]], [("sinh(x)", [[0.1]], [[-10]])])
    functions = [("sinh(x)", 0.1)]
    assert isinstance(answer(file(subject, [(functions, [(-1, 1), (0, 1)])], (1,), 0.5, every=every)), Rejected)
    assert isinstance(answer(file(subject, [(functions, [(-0.0999, 1), (0, 1)])], (1,), 0.5, every=every)), Rejected)


def test_lines_of_the_cone_count() -> None:
    """x' = x - 2 tanh(x) without any form: the cone holds both directions of tanh, and that is rejected."""
    assert isinstance(answer(file(model([[1]], [("tanh(x)", None, [[-2]])]), [(TANH, [])], (1,), 0.5)), Rejected)
    idle = model([[1]], [("tanh(x)", None, [[0]])])
    assert isinstance(answer(file(idle, [([], [])], (1,), 0.5)), Rejected)


def test_an_absent_function_helps_nobody() -> None:
    """x' = x + u with a sinh whose column is zero is rejected with every list of kinds."""
    subject = model([[1]], [("sinh(x)", None, [[0]])], B=[[1]])
    for kinds in ([([], [])], [([("sinh(x)", 1.0)], [(0, 1), (-1, 1)])]):
        assert isinstance(answer(file(subject, kinds, (1,), 0.5)), Rejected | Malformed)


@pytest.mark.parametrize("every", [True, False])
def test_the_size_of_the_state_is_in_the_cone(every: bool) -> None:
    """x' = -tanh x + u is not input-to-state stable, and is rejected with any rate."""
    subject = model([[0]], [("tanh(x)", None, [[-1]])], B=[[1]])
    for kappa in (0.5, 2.0**-60):
        assert isinstance(answer(file(subject, [(TANH, TANH_FORMS)], (1,), kappa, every=every)), Rejected)


def test_a_form_for_one_point_is_no_form_for_every_point() -> None:
    """sinh(y) - 0.371 y^3 is a sector form that falls somewhere: it serves about x_ref alone."""
    functions = [("sinh(x)", 1.0), ("x**3", 1.0)]
    forms = [(0, 1, 0), (0, 0, 1), (0, 1, -0.371)]
    subject = model([[-1]], [("sinh(x)", None, [[-1]]), ("x**3", None, [[0.3]])])
    assert isinstance(answer(file(subject, [(functions, forms)], (1,), 0.5, every=False)), Accepted)
    assert isinstance(answer(file(subject, [(functions, forms)], (1,), 0.5, every=True)), Rejected)


def test_the_constant_b_counts_as_an_input() -> None:
    """About x_ref a constant b is one more input, and the sentence says so; about every equilibrium it is none."""
    subject = model([[-1]], B=[[2]], b=[3])
    about = answer(file(subject, [([], [])], (1,), 1.0, every=False))
    assert isinstance(about, Accepted)
    assert "3 sup|v|" in about.statement
    assert "sup|v|" not in answer(file(subject, [([], [])], (1,), 1.0)).statement


def test_rows_of_several_states_are_refused() -> None:
    """Claim L1 needs argument rows that are positive multiples of unit vectors."""
    for row in ([1.0, 1.0], [-1.0, 0.0]):
        subject = model([[-2, 0], [0, -2]], [("tanh(x)", [row], [[0.5], [0.0]])])
        assert isinstance(answer(file(subject, [([], [])], (1, 1), 0.5)), Rejected)


def test_a_discontinuous_function_is_refused() -> None:
    """A function that is not continuous on R is refused even where its column is zero."""
    subject = model([[-1]], [("1/x", None, [[0]])])
    assert isinstance(answer(file(subject, [([], [])], (1,), 0.5)), Rejected)


def exact_decrease(nodes: Any, rays: Any, w: Any, kappa: Fraction, k: int) -> Fraction:
    """Return the largest sum of node k over the generators, by plain fractions."""
    column = nodes.column(k)
    largest = None
    for ray in rays:
        total = kappa * Fraction(w[k]) * ray[0]
        for i, slots in column.items():
            T = sum(a * v for a, v in zip(slots, ray, strict=True))
            total += Fraction(w[i]) * (T if i == k else abs(T))
        largest = total if largest is None else max(largest, total)
    return largest


def test_bounded_sums_never_prove_what_fractions_refute() -> None:
    """In random tables with margins of a few rounding errors, fractions confirm each node that binary64 proves."""
    rng = np.random.default_rng(7)
    proved = refuted = 0
    for trial in range(60):
        n = 4
        A = [rng.normal(size=(n, n)) * 10.0 ** rng.integers(-3, 4, (n, n)) for _ in range(3)]
        subject = model(A[0].tolist(), [("tanh(x)", None, A[1].tolist()), ("x**3", None, A[2].tolist())])
        nodes = nodes_of(model_of(canonical_model(subject)))
        rays = [(1, *rng.integers(-5, 6, 2).tolist())]
        w, kappa = 2.0 ** rng.integers(-3, 4, n), Fraction(1, 8)
        for k in range(n):  # move the diagonal so that the largest sum is zero up to a few units in the last place
            excess = exact_decrease(nodes, rays, w, kappa, k)
            A[0][k, k] -= float(excess / Fraction(w[k]))
            A[0][k, k] += (trial % 7 - 5) * np.spacing(np.abs(A[0]).max())
        nodes = nodes_of(model_of(canonical_model({**subject, "A0": A[0].tolist()})))
        left = set(doubtful(table_of(nodes), [rays], w, kappa).tolist())
        for k in set(range(n)) - left:
            assert exact_decrease(nodes, rays, w, kappa, k) <= 0
            proved += 1
        refuted += sum(exact_decrease(nodes, rays, w, kappa, k) > 0 for k in left)
    assert proved
    assert refuted


def test_coefficients_are_fractions_where_they_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of six nodes with two slots each, 72 coefficients, the nodes and their table make none, a column its twelve."""
    A = np.random.default_rng(0).normal(size=(6, 6))
    known = model_of(canonical_model(model(A.tolist(), [("tanh(x)", None, (2 * A).tolist())])))
    made: list[object] = []
    monkeypatch.setattr("persid_check.networks.nodes.Fraction", lambda value: made.append(value) or Fraction(value))
    nodes = nodes_of(known)
    table = table_of(nodes)
    assert len(made) <= len(known.channels)
    made.clear()
    assert nodes.column(2) == table.column(2) == {i: (Fraction(A[i, 2]), Fraction(2 * A[i, 2])) for i in range(6)}
    assert len(made) == 12
    assert nodes.entries == table.entries == 36
