"""Bounds between any two solutions, in continuous time, and gains and rates where facts and strips prove them."""

from pathlib import Path

import numpy as np
import pytest

import persid as ps
from persid.commands import cli
from published_problems import volume

BISTABLE = ps.PersidskiiModel([[1.0]], [("x**3", None, [[-1.0]])], [[1.0]])
HARDENS = ps.PersidskiiModel([[-1.0]], [("x**3", None, [[-1.0]])], [[1.0]])
SPRING = ps.PersidskiiModel([[0, 1], [-1, -0.5]], [("x**3", [[1, 0]], [[0], [-1.0]])], [[0.0, 0.0], [1.0, 0.01]])
PENDULUM = ps.PersidskiiModel([[0, 1], [0, -0.5]], [("sin(x)", [[1, 0]], [[0], [-1.0]])], [[0.0], [1.0]])


def drawn(seed: int) -> ps.PersidskiiModel:
    """A random model whose Jacobian has a symmetric part below -.2 wherever it is: it contracts in the norm of x."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 4))
    W, S = rng.normal(size=(2, n, n))
    A0 = S - S.T - (0.2 + np.linalg.norm(W, 2)) * np.eye(n)
    return ps.PersidskiiModel(A0, [("tanh(x)", None, W)], rng.normal(size=(n, 1)))


@pytest.mark.parametrize("seed", range(6))
def test_contracting_networks_forget_their_start(seed: int) -> None:
    """What contracts is certified between any two solutions, and no two runs leave the bound."""
    model = drawn(seed)
    verdict = ps.certify(model, claim="incremental")
    assert isinstance(verdict, ps.Certified)
    certificate = verdict.certificate
    assert certificate.is_incremental
    rng, t = np.random.default_rng(seed), np.linspace(0, 20, 401)
    starts, inputs = 3 * rng.normal(size=(2, model.n)), rng.normal(size=(2, len(t), 1))
    one, two = (model.simulate(x0, t, u)[0].x for x0, u in zip(starts, inputs, strict=True))
    d = starts[0] - starts[1]
    V = np.sqrt(d @ certificate.P @ d / float(certificate.stated.p))
    most = float(np.abs(inputs[0] - inputs[1]).max())
    bound = V * np.exp(-(certificate.rate or 0.0) * t) + (certificate.gain or 0.0) * most
    assert (np.linalg.norm(one - two, axis=1) <= bound * (1 + 1e-9)).all()


def test_a_hardening_function_is_certified_between_solutions() -> None:
    """x' = -x - x^3 + u needs a row that is exactly zero; the sentence speaks of x~."""
    verdict = ps.certify(HARDENS, claim="incremental")
    assert isinstance(verdict, ps.Certified)
    assert verdict.certificate.is_incremental
    assert "For any two solutions x, x~" in str(verdict)


def test_what_has_two_steady_responses_is_not_certified_between_solutions() -> None:
    """A hardening spring is input-to-state stable, and a periodic force may move it in two ways."""
    assert ps.certify(SPRING).is_certified
    assert not ps.certify(SPRING, claim="incremental").is_certified
    assert not ps.certify(BISTABLE, claim="incremental").is_certified


def test_a_claim_that_is_not_known_is_refused() -> None:
    """The claims are named in the error."""
    with pytest.raises(ps.PersidError, match="'strongest', 'incremental'"):
        ps.certify(HARDENS, claim="bounded")


def test_the_claim_is_asked_for_on_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`persid certify --claim incremental` writes such a certificate, and says so."""
    model, target = tmp_path / "model.json", tmp_path / "certificate.json"
    HARDENS.save(model)
    assert cli.main(["certify", str(model), "--claim", "incremental", "-o", str(target)]) == 0
    assert "between any two runs" in capsys.readouterr().out
    assert ps.load_certificate(target).is_incremental


def test_every_input_has_its_own_gain_where_rows_are_zero() -> None:
    """An input a hundred times weaker has a gain a hundred times smaller, in place of the joint one."""
    joint, each = (ps.certify(SPRING, gains=gains).certificate.gains for gains in ("joint", "each"))
    assert each[1] < 0.011 * joint[1]
    assert each[0] < 1.01 * joint[0]


@pytest.mark.long
def test_a_rate_that_is_asked_for_is_kept_by_strips() -> None:
    """The region is then smaller; where there is none at that rate, the largest one is given."""
    slow, fast, none = (ps.certify(PENDULUM, domain="auto", rate=rate).certificate for rate in (None, 0.2, 0.3))
    assert fast.rate >= 0.2
    assert 6 < volume(fast) < 0.6 * volume(slow)
    assert none.rate == slow.rate
