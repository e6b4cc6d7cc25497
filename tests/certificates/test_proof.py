"""Rounding a solution and writing it: what is written is sound, small and accepted; what is not sound is refused."""

import json

import numpy as np
import pytest

from persid._dyadics import dyadic, dyadics, rounded, value
from persid.certificates.certificate import Certificate
from persid.certificates.encoding import factor, root
from persid.certificates.ledger import definite
from persid.certificates.stability import prove
from persid.errors import RejectedError, RoundingError
from persid.lyapunov.interior_point import Status, solve
from persid.lyapunov.multipliers import Lyapunov, choose
from persid.lyapunov.search import search
from persid.lyapunov.shifted_model import Setting
from persid.models.model import PersidskiiModel
from persid.verdicts.checking import load_certificate
from persid_check.definite import is_positive_definite
from persid_check.exact import matrix
from problems import BY_NAME
from random_problems import random_assembly


def _found(name: str) -> tuple[PersidskiiModel, Lyapunov]:
    model = BY_NAME[name].build()
    setting = Setting.of(model, None)
    outcome = search(setting.system, setting.pools)
    return model, choose(outcome.assembly, outcome.solution.y)


def test_written_file_is_accepted_and_read_back(tmp_path: object) -> None:
    """A certificate that was saved is loaded with the same bytes and the same P."""
    model, lyapunov = _found("damped tanh")
    certificate = prove(model, lyapunov)
    path = f"{tmp_path}/one.json"
    certificate.save(path)
    assert load_certificate(path).data == certificate.data
    np.testing.assert_array_equal(certificate.P, lyapunov.P)
    assert certificate.model.sha256 == model.sha256


def test_V_falls_along_solutions() -> None:
    """The V of a certificate is positive and decreases along a solution at the nominal input."""
    model, lyapunov = _found("skew cubes")
    certificate = prove(model, lyapunov)
    run = model.simulate([1.5, -1.0], np.linspace(0, 5, 101))
    V = certificate.V(np.asarray(run[0].x))
    assert (V > 0).all()
    assert (np.diff(V) < 0).all()


def test_what_is_infeasible_is_refused() -> None:
    """The unknowns of an infeasible answer are no certificate: rounding them says so."""
    for seed in range(30):
        assembly = random_assembly(seed)
        solution = solve(assembly.problem)
        if solution.status is Status.INFEASIBLE:
            with pytest.raises(RoundingError):
                choose(assembly, solution.y)


def test_tampered_number_is_rejected() -> None:
    """A certificate with P made zero, or with a multiplier made negative, is refused with the checker's reason."""
    model, lyapunov = _found("damped tanh")
    content = prove(model, lyapunov).content
    with pytest.raises(RejectedError, match="checker"):
        Certificate.accept(json.dumps(content | {"P": {"diagonal": [[0, 0], [0, 0]]}}).encode())
    content["gamma"] = [-1, 0]
    with pytest.raises(RejectedError, match="checker"):
        Certificate.accept(json.dumps(content).encode())


@pytest.mark.parametrize("number", [0.0, 1.0, -3.5, 1e-300, 0.1, 2.0**60])
def test_dyadics_are_exact(number: float) -> None:
    """A float written as a dyadic reads back as the same float."""
    assert value(dyadic(number)) == number


def test_rounding_keeps_forty_bits() -> None:
    """Rounding changes a number by at most 2^-40 of itself, and dyadics of rounded numbers are short."""
    numbers = np.random.default_rng(0).normal(size=100)
    near = rounded(numbers)
    assert (np.abs(near - numbers) <= 2.0**-40 * np.abs(numbers)).all()
    assert all(abs(mantissa) <= 2**40 for mantissa, _ in dyadics(near))


def test_factor_nearly_diagonalises() -> None:
    """T M T' is nearly diagonal for a badly scaled M, and a matrix that is not positive is refused."""
    rng = np.random.default_rng(1)
    root, units = rng.normal(size=(6, 9)), np.exp2(rng.integers(-20, 20, 6))
    M = (root @ root.T) * units * units[:, None]
    T = np.zeros((6, 6))
    for i, row in enumerate(factor(M)):
        T[i, : i + 1] = row
    product = T @ M @ T.T
    scale = 1 / np.sqrt(np.diag(product))
    np.testing.assert_allclose(product * scale * scale[:, None], np.eye(6), atol=1e-2)
    with pytest.raises(RoundingError):
        factor(np.diag([1.0, -1.0]))


def test_a_large_matrix_has_a_factor_where_it_has_no_root() -> None:
    """With an eigenvalue of 1e-13 a matrix of 70 rows has no root of short numbers; its factor proves it."""
    rng, eigenvalues = np.random.default_rng(0), np.array([1e-13] + [1.0] * 69)
    Q = np.linalg.qr(rng.normal(size=(70, 70)))[0]
    M = (Q * eigenvalues) @ Q.T + Q @ (eigenvalues[:, None] * Q.T)
    with pytest.raises(RoundingError):
        root(M)
    proof = definite(matrix(M.tolist(), 70))
    assert isinstance(proof, list)
    assert is_positive_definite(M.tolist(), proof)
    assert isinstance(definite(matrix((M + np.eye(70)).tolist(), 70)), dict)
