"""The trade of a rate against a gain: the best proved rate, the rate of the certificate, and one that is asked for."""

import json
from itertools import pairwise
from pathlib import Path

import pytest

import persid as ps
from command_line import MODEL
from persid.commands import cli
from persid.errors import FolderError, ModelError
from persid.reports.layout import FASTEST
from persid.reports.verdict_files import read_verdict, write_verdict


@pytest.fixture(scope="module")
def model() -> ps.PersidskiiModel:
    """x' = -x + u: rate 1 at most, and gain 1 at half of it."""
    return ps.PersidskiiModel([[-1.0]], [], [[1.0]])


@pytest.fixture(scope="module")
def usual(model: ps.PersidskiiModel) -> ps.Certified:
    """The verdict with no rate asked for."""
    found = ps.certify(model)
    assert isinstance(found, ps.Certified)
    return found


def test_the_best_rate_is_proved_beside_the_smallest_gain(usual: ps.Certified) -> None:
    """x' = -x + u has nearly rate 1 by one accepted proof and gain 1 by another."""
    assert usual.certificate.rate == pytest.approx(0.5, rel=0.1)
    assert usual.certificate.gain == pytest.approx(1, rel=0.02)
    assert usual.fastest is not None
    assert isinstance(ps.check(usual.fastest), ps.Accepted)
    assert usual.fastest.model == usual.certificate.model
    assert 0.9 <= usual.best_rate == usual.fastest.rate <= 1
    assert usual.fastest.gain > usual.certificate.gain


@pytest.mark.parametrize("rate", [0.8, 0.2])
def test_a_rate_that_is_asked_for_is_proved(model: ps.PersidskiiModel, usual: ps.Certified, rate: float) -> None:
    """The certificate has at least that rate, and the gain 1/sqrt(kappa (2 - kappa)), kappa/2 being at least 1/2."""
    found = ps.certify(model, rate=rate)
    kappa = 2 * max(rate, usual.certificate.rate)
    assert found.certificate.rate >= rate
    assert found.certificate.gain == pytest.approx((kappa * (2 - kappa)) ** -0.5, rel=0.05)
    assert found.best_rate >= found.certificate.rate


def test_a_rate_beyond_the_best_one_leaves_the_best_one(model: ps.PersidskiiModel) -> None:
    """What is not proved is not claimed: the certificate then has the best proved rate, and stands alone."""
    found = ps.certify(model, rate=5)
    assert 0.9 <= found.certificate.rate == found.best_rate <= 1
    assert found.fastest is None


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), float("inf")])
def test_a_rate_is_a_positive_number(model: ps.PersidskiiModel, rate: float) -> None:
    """Anything else is refused in words."""
    with pytest.raises(ModelError, match=r"rate is .*; needed is a number of 1/s above 0"):
        ps.certify(model, rate=rate)


def test_a_region_has_a_best_rate_too() -> None:
    """In a box the rate is asked for in the same way."""
    model = ps.PersidskiiModel([[-1.0]], [("x**3", None, [[0.1]])], [[1.0]])
    found = ps.certify(model, domain=[[-1.0, 1.0]], rate=0.6)
    assert found.certificate.scope == "regional"
    assert found.best_rate >= found.certificate.rate >= 0.6


def test_both_proofs_are_written_and_read_back(tmp_path: Path, model: ps.PersidskiiModel, usual: ps.Certified) -> None:
    """The folder of a run keeps both, each is checked again, and a changed one is refused by its name."""
    write_verdict(tmp_path, usual, model)
    found = read_verdict(tmp_path, model, ())
    assert isinstance(found, ps.Certified)
    assert (found.best_rate, found.certificate.gain) == (usual.best_rate, usual.certificate.gain)
    content = json.loads((tmp_path / FASTEST).read_bytes())
    content["kappa"] = [content["kappa"][0], content["kappa"][1] + 4]
    (tmp_path / FASTEST).write_text(json.dumps(content))
    with pytest.raises(FolderError, match=r"fastest\.json"):
        read_verdict(tmp_path, model, ())


def test_the_command_line_tells_both_rates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """--rate is read in the unit of time of the command; rows and --json tell both rates, and what is not proved."""
    monkeypatch.chdir(tmp_path)
    Path("m.json").write_text(json.dumps(MODEL))
    asked = ["certify", "m.json", "-o", "c.json", "--rate"]
    assert cli.main([*asked, "40", "--time-unit", "min"]) == 0
    shown = capsys.readouterr().out
    assert "rate 40 1/min" in shown
    assert "best proved rate 4" in shown
    assert cli.main([*asked, "0.7", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert 0.7 <= told["rate"] < told["best_rate"]
    assert cli.main([*asked, "9"]) == 0
    assert "a rate of 9 1/s was asked for; the best proved rate is 0.7" in capsys.readouterr().out


def test_a_curve_of_rates_and_gains_rises(model: ps.PersidskiiModel) -> None:
    """Of x' = -x + u every certificate of the curve lies on kappa (2 - kappa) = 1/gain^2, from gain 1 on."""
    curve = ps.rates_and_gains(model, count=4)
    assert len(curve) == 4
    assert all(a.rate < b.rate and a.gain < b.gain for a, b in pairwise(curve))
    for each in curve[:-1]:  # that of the best rate is not sought for its gain
        assert each.gain == pytest.approx((4 * each.rate * (1 - each.rate)) ** -0.5, rel=0.05)
        assert isinstance(ps.check(each), ps.Accepted)


def test_a_model_without_a_rate_has_no_curve() -> None:
    """Of what is refuted, and of what is stable without a rate, nothing is returned; one rate is no curve."""
    assert ps.rates_and_gains(ps.PersidskiiModel([[1.0]], [], [[1.0]])) == ()
    assert ps.rates_and_gains(ps.PersidskiiModel([[0.0]], [("x**3", None, [[-1.0]])], [[1.0]])) == ()
    with pytest.raises(ModelError, match="2 rates at least"):
        ps.rates_and_gains(ps.PersidskiiModel([[-1.0]], [], [[1.0]]), count=1)
