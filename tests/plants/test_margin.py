"""From measurements to a sentence about the plant: what is proved, what is estimated, what is refused."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sp

import persid as ps
from persid.commands import cli
from persid.errors import DataError, PersidError
from persid.plants.margin import Reading, margin_of

PLANT = ps.PersidskiiModel([[-1.0, 0.3], [-0.3, -1.0]], B=[[1.0], [0.5]])
PUSHED = ps.PersidskiiModel([[-1.0, 0.3], [-0.3, -1.0]], B=[[1.0], [0.5]], b=[0.5, 0.0], domain=[[-3.0, 3.0]] * 2)


@cache
def _data() -> ps.Trajectories:
    rng = np.random.default_rng(3)
    t = 0.05 * np.arange(1200)
    clean = PLANT.simulate([1.0, -1.0], t, np.repeat(rng.normal(0, 2, (60, 1)), 20, axis=0))[0]
    return ps.Trajectories.from_arrays(clean.x + 1e-3 * rng.normal(size=clean.x.shape), clean.u, t=t)


@cache
def _fit() -> ps.PersidskiiIdentifier:
    return ps.PersidskiiIdentifier(["x"], ridge=0.0).fit(_data())


@cache
def _verdict() -> ps.Certified:
    verdict = ps.certify(_fit().model_)
    assert isinstance(verdict, ps.Certified)
    return verdict


def test_the_plant_behind_the_data_is_one_of_those_certified() -> None:
    """The known plant obeys the estimated bound between the samples, and the certificate of that bound is accepted."""
    found = ps.plant_margin(_fit(), _verdict(), _data())
    margin, x, u = _verdict().margin, _data()[0].x, _data()[0].u
    g = np.linalg.norm((PLANT.rhs(x, u) - _fit().model_.rhs(x, u)) / margin.width, axis=1)
    away = np.linalg.norm((x - margin.certificate.operating_point) / margin.width, axis=1)
    assert (g**2 <= (found.delta * away) ** 2 + found.epsilon**2).all()
    assert found.epsilon < 0.2
    assert isinstance(ps.check(found.certificate, _fit().model_), ps.Accepted)
    assert found.certificate.spread == found.spread
    assert "is an estimate" in str(found)
    assert "is not proved" in str(found)


def test_what_the_data_contradict_needs_a_larger_constant_part() -> None:
    """Of a model with a push of its own the data ask for an epsilon about as large, and the state may stay away."""
    other = ps.certify(PUSHED)
    mine = ps.plant_margin(_fit(), _verdict(), _data())
    theirs = margin_of(other, _data(), Reading())
    assert theirs.share < 1
    assert 0.5 / 3 * 0.5 < theirs.epsilon < 0.5
    assert mine.epsilon < theirs.epsilon
    assert theirs.certificate.spread == theirs.spread > 0


def test_every_model_that_the_data_allow_is_certified() -> None:
    """The coefficients of the known plant lie in the set, rho is above 1, and the checker speaks of every member."""
    found = ps.plant_margin(_fit(), _verdict(), _data())
    model, certificate = _fit().model_, found.models.certificate
    assert found.models.rho > 1
    assert "for every constant input it has exactly one equilibrium" in certificate.statement
    assert f"all within {found.models.rho:.3g} times that set" in str(found)
    assert isinstance(ps.check(certificate, model), ps.Accepted)
    off = np.hstack([PLANT.A0 - model.A0, PLANT.B - model.B])
    for d, deviation in zip(off, certificate.stated.deviations, strict=True):
        C = np.array([[float(row.get(i, 0)) for i in range(3)] for row in deviation.C])
        h = np.linalg.lstsq(C.T, d, rcond=None)[0]  # d = C'h, |h| <= 1
        assert np.allclose(C.T @ h, d)
        assert np.linalg.norm(h) <= 1 / found.models.rho


def test_where_data_leave_coefficients_open_no_set_is_certified() -> None:
    """An input that is held for the whole record is not told from a constant: any B explains it."""
    t = 0.05 * np.arange(800)
    rng = np.random.default_rng(2)
    x = PLANT.simulate([3.0, -2.0], t, np.ones((800, 1)))[0].x + 1e-3 * rng.normal(size=(800, 2))
    data = ps.Trajectories.from_arrays(x, np.ones((800, 1)), t=t)
    assert margin_of(ps.certify(PLANT), data, Reading()).models is None


def test_a_linear_term_is_no_column_of_its_own() -> None:
    """A model that writes a part of A0 as a term with f = x has the same estimate."""
    terms = [("x", None, np.diag([-0.5, -0.5]))]
    written = ps.PersidskiiModel(PLANT.A0 + np.diag([0.5, 0.5]), terms, PLANT.B)
    assert margin_of(ps.certify(written), _data(), Reading()).share == 1


def test_of_what_cannot_be_told_apart_a_part_is_certified() -> None:
    """Without a push of the input x and tanh x are all but one column: rho is below 1, and the sentence says so."""
    rng = np.random.default_rng(5)
    plant = ps.PersidskiiModel([[-1.0]], B=[[1.0]])
    clean = plant.simulate([1.0], 0.05 * np.arange(400), 0.2 * rng.normal(size=(400, 1)))[0]
    data = ps.Trajectories.from_arrays(clean.x + 1e-2 * rng.normal(size=clean.x.shape), clean.u, t=clean.t)
    fit = ps.PersidskiiIdentifier(["x", "tanh(x)"], ridge=1e-2).fit(data)
    found = ps.plant_margin(fit, ps.certify(fit.model_), data)
    assert 0 < found.models.rho < 1
    assert "only those within" in str(found)


def test_bounded_noise_needs_no_statistics() -> None:
    """With bounded noise the known plant obeys what the linear programmes leave, which shrinks with the bound."""
    wide, narrow = (
        ps.plant_margin(_fit(), _verdict(), _data(), noise="bounded", bound=bound) for bound in (0.03, 0.005)
    )
    assert 0 <= narrow.epsilon < wide.epsilon
    assert "noise within the given bounds" in str(wide)
    assert wide.alarms == ()
    assert 0.9 < wide.share < 1  # of the places that were looked at: the others count for nothing
    with pytest.raises(DataError, match="raise bound="):
        ps.plant_margin(_fit(), _verdict(), _data(), noise="bounded", bound=1e-6)


def test_data_of_a_network_certify_a_set() -> None:
    """Of a sparse model, which a weighted l1 norm certifies, rho is found, and no residual margin."""
    rng, n = np.random.default_rng(1), 4
    ring = np.roll(np.eye(n), 1, axis=0)
    parts = (-2 * np.eye(n) + 0.4 * (ring + ring.T), 0.3 * ring - np.eye(n), np.eye(n)[:, :2])
    plant = ps.PersidskiiModel(parts[0], [("tanh(x)", None, parts[1])], parts[2])
    model = ps.PersidskiiModel(
        sp.csc_array(parts[0]), [("tanh(x)", None, sp.csc_array(parts[1]))], sp.csc_array(parts[2])
    )
    u = np.repeat(rng.normal(0, 2, (300, 2)), 10, axis=0)
    x = plant.simulate(np.zeros(n), 0.05 * np.arange(3000), u)[0].x + 1e-3 * rng.normal(size=(3000, n))
    found = margin_of(ps.certify(model), ps.Trajectories.from_arrays(x, u, dt=0.05), Reading())
    assert found.certificate is None
    assert found.models.certificate.claim == "L1"
    assert found.models.rho > 0
    assert "a weighted l1 norm has no residual margin" in str(found)


def test_wrong_use_is_refused() -> None:
    """A verdict without margin, an unknown noise, and a bound that is none are named."""
    undecided = ps.certify(_fit().model_, time_limit=0)
    with pytest.raises(PersidError, match="residual margin"):
        ps.plant_margin(_fit(), undecided, _data())
    with pytest.raises(DataError, match='"random" or "bounded"'):
        ps.plant_margin(_fit(), _verdict(), _data(), noise="pink")
    with pytest.raises(DataError, match="bound="):
        ps.plant_margin(_fit(), _verdict(), _data(), noise="bounded")


def test_the_command_line_takes_bounds_of_the_noise(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`persid certify --plant` says what the data say, with statistics or, with --bound, from linear programmes."""
    run = _data()[0]
    table = np.column_stack([run.t, run.x, run.u])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t,x1,x2,u1", comments="")
    _fit().model_.save(tmp_path / "m.json")
    words = ["certify", str(tmp_path / "m.json"), "-o", str(tmp_path / "c.json"), "--json"]
    said = {}
    models = tmp_path / "models.json"
    for noise, more in (("random", []), ("bounded", ["--bound", "0.03,0.03"])):
        assert cli.main([*words, "--plant", str(tmp_path / "run.csv"), "--models", str(models), *more]) == 0
        said[noise] = json.loads(capsys.readouterr().out)["plant"]
        assert said[noise]["noise"] == noise
        assert models.is_file() == (noise == "random")
        assert (said[noise]["models_file"] is None) == (noise == "bounded")
    assert said["random"]["epsilon"] < said["bounded"]["epsilon"]
    assert said["random"]["models"]["rho"] > 1
