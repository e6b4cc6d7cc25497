"""A model and its twins have the same verdict, rate and gain; odd but valid models have a verdict and no exception."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import persid as ps
from persid_check.expression import FUNCTIONS

A0 = np.array([[0.0, 1.0], [-1.0, -1.0]])
R, A, B = np.array([[1.0, 0.0]]), np.array([[0.0], [-1.0]]), np.array([[0.0], [1.0]])
COUPLED = np.array([[-2.0, 0.5], [0.25, -1.0]])


def twin(name: str, A0: Any, R: Any, A: Any, B: Any) -> ps.PersidskiiModel:
    """The model with an odd function in other signs, another order, or other units of its states."""
    if name == "sign":
        R, A = -R, -A
    elif name == "order":
        A0, R, A, B = A0[::-1, ::-1], R[:, ::-1], A[::-1], B[::-1]
    elif name == "scale":  # x = 8 x^ for all states, and u = 8 u^
        R, A = 8 * R, A / 8
    elif name == "turn":  # x^ = T x
        T = np.array([[np.cos(1.2), -np.sin(1.2)], [np.sin(1.2), np.cos(1.2)]])
        A0, R, A, B = T @ A0 @ T.T, R @ T.T, T @ A, T @ B
    return ps.PersidskiiModel(A0=A0, terms=[("tanh(x)", R, A)], B=B)


@pytest.mark.parametrize("name", ["sign", "order", "scale", "turn"])
@pytest.mark.parametrize("A0", [A0, COUPLED], ids=["oscillator", "coupled"])
def test_twins_have_the_same_rate_and_gain(name: str, A0: Any) -> None:
    """Signs of argument rows, the order of states, powers of two as units, and turned axes change no number by 1 %."""
    one, other = (ps.certify(twin(n, A0, R, A, B)) for n in ("itself", name))
    assert isinstance(one, ps.Certified), one
    assert isinstance(other, ps.Certified), other
    assert other.certificate.claim == one.certificate.claim == "rate-and-gain"
    assert other.certificate.rate == pytest.approx(one.certificate.rate, rel=0.01)
    assert other.certificate.gain == pytest.approx(one.certificate.gain, rel=0.01)


def test_a_negative_row_of_one_state_keeps_its_rate() -> None:
    """x' = -x + tanh(-x) is x' = -x - tanh x: certified with a rate."""
    verdict = ps.certify(ps.PersidskiiModel(A0=[[-1.0]], terms=[("tanh(x)", [[-1.0]], [[1.0]])], B=[[1.0]]))
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.rate == pytest.approx(0.4866, rel=0.02)


@pytest.mark.parametrize("row", [1.0, -1.0])
def test_functions_of_opposite_arguments_are_seen_together(row: float) -> None:
    """softplus(y) - softplus(-y) is y, whichever way the rows look: x' = -2 x + 1.9 y has the rate .1."""
    terms = [("softplus(x)", [[row]], [[1.9 * row]]), ("softplus(x)", [[-row]], [[-1.9 * row]])]
    verdict = ps.certify(ps.PersidskiiModel([[-2.0]], terms, [[1.0]]))
    assert isinstance(verdict, ps.Certified)
    assert 0.09 < (verdict.best_rate or 0.0) <= 0.1


@pytest.mark.parametrize("f", ["tanh(x)", "cos(x)"])
@pytest.mark.long
def test_a_row_of_zeros_is_a_constant(f: str) -> None:
    """A function of nothing is certified beside a stable linear part."""
    model = ps.PersidskiiModel(A0=-np.eye(2), terms=[(f, [[0.0, 0.0]], [[0.0], [1.0]])], B=[[0.0], [1.0]])
    assert isinstance(ps.certify(model), ps.Certified)
    assert isinstance(ps.certify(model, domain=[[-1.0, 1.0], [-2.0, 2.0]]), ps.Certified)


def test_a_first_dual_matrix_is_not_pulled_onto_the_edge() -> None:
    """Where hardly anything lies between two bounds the matrix between them is singular in rounding: none is taken."""
    terms = [
        ("x**3", [[0.0], [1.4472238376431215]], [[-0.17643211338018733, 0.0]]),
        ("relu(x)", [[-0.303257560736273], [0.303257560736273]], [[-0.31848768370741, -0.5493088152464176]]),
    ]
    more = {"x_ref": [0.5573773855248043], "domain": [[-2.0, 2.0]]}
    model = ps.PersidskiiModel([[-2.0899743826428705]], terms, [[1.1015083279090478]], **more)
    assert ps.certify(model).is_certified


@pytest.mark.parametrize("time", [{}, {"time": "discrete", "dt": 0.1}])
def test_a_model_without_inputs_has_a_rate_and_no_gain(time: dict[str, Any]) -> None:
    """Where nothing acts there is no gain to make small; the rate is that of a model with inputs."""
    alone = ps.PersidskiiModel([[-0.5]], [("tanh(x)", None, [[-0.1]])], **time)
    driven = ps.PersidskiiModel([[-0.5]], [("tanh(x)", None, [[-0.1]])], [[1.0]], **time)
    verdicts = [ps.certify(model) for model in (alone, driven)]
    assert all(isinstance(verdict, ps.Certified) for verdict in verdicts)
    assert verdicts[0].best_rate == pytest.approx(verdicts[1].best_rate, rel=0.02)


def test_a_function_that_is_tiny_at_the_operating_point_is_no_exception() -> None:
    """About x = -370, softplus(2 x) is of the size 1e-321: units do not overflow."""
    terms = [("softplus(x)", [[2.0]], [[-0.5]]), ("deadzone(x)", [[0.5]], [[0.5]])]
    model = ps.PersidskiiModel(A0=[[-0.2513522383181544]], terms=terms, B=[[1.0]], b=[-1.0])
    assert isinstance(ps.certify(model, time_limit=10), ps.Certified | ps.Undecided)


def test_the_reason_is_that_of_the_equilibrium_asked_about() -> None:
    """x' = -x + x^3 on [-1.1, 1.1] is stable at 0; that +-1 are unstable is no reason, and runs start in the box."""
    model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[1.0]])], B=[[1.0]])
    verdict = ps.certify(model, domain=[[-1.1, 1.1]])
    assert isinstance(verdict, ps.Undecided)
    assert "not exponentially stable" not in str(verdict)
    assert "smaller box" in verdict.detail
    assert verdict.evidence is not None
    assert verdict.evidence.x0 is not None
    assert abs(verdict.evidence.x0[0]) <= 1.1


def test_missing_growth_is_named() -> None:
    """x' = -tanh x without inputs lacks growth at infinity, not accuracy."""
    verdict = ps.certify(ps.PersidskiiModel(A0=[[0.0]], terms=[("tanh(x)", None, [[-1.0]])], B=np.zeros((1, 0))))
    assert isinstance(verdict, ps.Undecided)
    assert "grow without bound" in verdict.detail


NUMBERS = st.sampled_from([0.0, 1.0, -1.0, -2.5, 0.3, 1e-9, 1e9])
TEXTS = st.sampled_from([*(f"{name}(x)" for name in sorted(FUNCTIONS)), "x**3", "x**2.5", "x**-1", "0*x", "1", "x"])


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.data(), st.integers(1, 2))
@pytest.mark.long
def test_a_valid_model_has_a_verdict(draw: st.DataObject, n: int) -> None:
    """Whatever the functions, rows and numbers, certify returns a verdict."""

    def table(rows: int, columns: int) -> list[list[float]]:
        return draw.draw(st.lists(st.lists(NUMBERS, min_size=columns, max_size=columns), min_size=rows, max_size=rows))

    terms = [(draw.draw(TEXTS), table(k, n), table(n, k)) for k in draw.draw(st.lists(st.integers(1, 2), max_size=2))]
    A0 = np.array(table(n, n)) - 3 * np.eye(n) * draw.draw(st.booleans())
    model = ps.PersidskiiModel(A0=A0, terms=terms, B=table(n, 1), b=table(1, n)[0])
    domain = draw.draw(st.sampled_from(["global", [[-1.5, 1.2]] * n]))
    assert isinstance(ps.certify(model, domain=domain, time_limit=0.5), ps.Certified | ps.Refuted | ps.Undecided)
