"""Instruments: earlier windows in place of the one that is fitted, against the bias of noise."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from benchmarks.plants import measured, plant

import persid as ps
from persid.commands import cli
from persid.commands.words import spoken
from persid.errors import DataError, UnderdeterminedError
from persid.identification.basis import make_basis
from persid.identification.estimators.weak import instrumented_rows
from persid.identification.gram import accumulate, triangle, weighted, with_root
from persid.identification.structure import make_structure

HOW = {"functions": ["x", "tanh(x)"], "ridge": 0.0, "x_ref": 0.0, "scale": 1.0}


@cache
def _noisy() -> list[ps.Trajectories]:
    return measured(6, process=0.3)


def _fit(data: ps.Trajectories, *, instruments: bool, **how: object) -> ps.PersidskiiIdentifier:
    return ps.PersidskiiIdentifier(**HOW, instruments=instruments, **how).fit(data)


def _errors(fits: list[ps.PersidskiiIdentifier]) -> tuple[float, float]:
    """Mean squared error of x', and of the damping -trace(dF/dx) at 0, which is 3."""
    F, damping = [], []
    for fit, data in zip(fits, _noisy(), strict=True):
        x, u = data[0].x, data[0].u
        F.append(((fit.model_.rhs(x, u) - plant(x, u)) ** 2).mean())
        damping.append((np.trace(fit.model_.jacobian(np.zeros(2))) + 3) ** 2)
    return float(np.mean(F)), float(np.mean(damping))


def test_the_bias_of_noise_on_the_plant_falls() -> None:
    """With instruments x' and the damping are several times closer to a plant that noise acts on, window for window."""
    plain, mine = ([_fit(data, instruments=with_z, window=2) for data in _noisy()] for with_z in (False, True))
    (f0, d0), (f1, d1) = _errors(plain), _errors(mine)
    assert f1 < 0.4 * f0
    assert d1 < 0.2 * d0


def test_without_noise_nothing_changes() -> None:
    """On exact data both ways give the same x', to the error of the quadrature."""
    (data,) = measured(1)
    x, u = data[0].x, data[0].u
    plain, mine = (_fit(data, instruments=with_z, window=2).model_.rhs(x, u) for with_z in (False, True))
    assert np.abs(plain - mine).max() < 0.01 * np.abs(plain).max()
    assert np.abs(mine - plant(x, u)).max() < 0.02 * np.abs(plain).max()


def test_least_squares_says_where_instruments_are_needed() -> None:
    """Noise on the plant is said, with its size and what to do; a quiet record, and a fit with instruments, are not."""
    (quiet,) = measured(1, noise=0.005)
    noisy = _noisy()[0]
    said = [text for text in _fit(noisy, instruments=False).report_.warnings if "instruments=True" in text]
    assert len(said) == 1
    assert "noise that acts on the plant" in said[0]
    for fit in (_fit(quiet, instruments=False), _fit(noisy, instruments=True)):
        assert not any("instruments=True" in text for text in fit.report_.warnings)


def test_sums_of_blocks_are_two_stage_least_squares() -> None:
    """Gram matrices of blocks add up to the textbook's two stages, and so does the triangular factor."""
    (data,) = measured(1, process=0.1)
    run = data[0][:200]
    basis = make_basis(ps.Trajectories((run,), data.states, data.inputs), ["x", "tanh(x)"], 0.0, 1.0)
    structure = make_structure(basis)
    Z, X, y = next(instrumented_rows(run, None, basis, 2, "zoh"))
    projected = Z @ np.linalg.lstsq(Z, X, rcond=None)[0]
    expected = np.linalg.lstsq(projected, y, rcond=None)[0]
    parts = [accumulate([(Z[k::3], X[k::3], y[k::3])], basis, structure) for k in range(3)]
    empty = accumulate(instrumented_rows(run[:4], None, basis, 2, "zoh"), basis, structure)
    for gram in (parts[0] + parts[1] + empty + parts[2], weighted([*parts, parts[0]], [1, 1, 1, 0])):
        assert np.allclose(gram.solve(0.0), expected, rtol=1e-6, atol=1e-8)
    assert np.allclose((parts[0] + parts[1] - parts[1]).G, parts[0].G)
    rooted = with_root(
        parts[0] + parts[1] + parts[2], triangle(iter([(Z[:50], X[:50], y[:50]), (Z[50:], X[50:], y[50:])]))
    )
    assert rooted.root is not None
    assert np.allclose(rooted.solve(0.0), expected, rtol=1e-6, atol=1e-8)


def test_where_runs_are_cut_does_not_matter(tmp_path: Path) -> None:
    """Read chunk by chunk a record gives the coefficients that it gives in memory."""
    (data,) = measured(1, process=0.1)
    for k, rows in enumerate((slice(0, 1100), slice(1100, 2000))):
        table = np.column_stack([data[0].t[rows], data[0].x[rows], data[0].u[rows]])
        np.savetxt(tmp_path / f"{k}.csv", table, delimiter=",", header="t,x1,x2,u1", comments="", fmt="%.17g")
    how = {"states": ["x1", "x2"], "inputs": ["u1"], "time": "t"}
    recorded = ps.open_recordings([tmp_path / "0.csv", tmp_path / "1.csv"], **how)
    whole = ps.read_csv([tmp_path / "0.csv", tmp_path / "1.csv"], **how)
    a, b = (_fit(given, instruments=True, window=2) for given in (recorded, whole))
    assert np.allclose(a.coef_, b.coef_, rtol=1e-8, atol=1e-10)


def test_ridge_bootstrap_and_certificate_work_on_them() -> None:
    """Validation chooses a ridge, blocks are drawn again, and the fit under the certificate starts from instruments."""
    data = _noisy()[0]
    fit = ps.PersidskiiIdentifier(["x", "tanh(x)"], instruments=True).fit(data)
    assert fit.report_.curve is not None
    spread = ps.bootstrap(fit, 20, time_limit=1.0).deviation
    assert (spread > 0).any()
    best = ps.CertifiedIdentifier(fit, time_limit=20).fit(data)
    assert best.verdict_.is_certified
    F, damping = (best.model_.rhs(data[0].x, data[0].u), plant(data[0].x, data[0].u))
    assert np.sqrt(((F - damping) ** 2).mean() / (damping**2).mean()) < 0.2


def test_wrong_use_is_refused() -> None:
    """Instruments go with windows, in continuous time, and with runs that hold three windows."""
    (data,) = measured(1)
    with pytest.raises(DataError, match='method="weak"'):
        ps.PersidskiiIdentifier(method="edmd", instruments=True).fit(data)
    with pytest.raises(DataError, match="instruments=True goes with continuous time"):
        ps.PersidskiiIdentifier(time="discrete", instruments=True).fit(data)
    short = ps.Trajectories((data[0][:20],), data.states, data.inputs)
    with pytest.raises(UnderdeterminedError, match="two before it for instruments"):
        ps.PersidskiiIdentifier(["x"], instruments=True, window=8).fit(short)


def test_the_command_line_speaks_of_its_option(tmp_path: Path) -> None:
    """`persid identify --instruments` writes the model that Python finds, and the warning names that option."""
    data = ps.Trajectories((_noisy()[0][0][:300],), ("x1", "x2"), ("u1",))
    table = np.column_stack([data[0].t, data[0].x, data[0].u])
    np.savetxt(tmp_path / "run.csv", table, delimiter=",", header="t,x1,x2,u1", comments="", fmt="%.17g")
    words = ["identify", str(tmp_path / "run.csv"), "--states", "x1,x2", "--inputs", "u1", "--functions", "x,tanh(x)"]
    assert cli.main([*words, "--ridge", "0.01", "--instruments", "-o", str(tmp_path / "m.json")]) == 0
    model = ps.PersidskiiIdentifier(["x", "tanh(x)"], ridge=0.01, instruments=True).fit(data).model_
    assert ps.load_model(tmp_path / "m.json").sha256 == model.sha256
    assert spoken("fit with instruments=True") == "fit with --instruments"
