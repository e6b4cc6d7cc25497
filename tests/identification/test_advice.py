"""Diagnosis: what ails the measurements is found by trying the cure, and a fit that is well is left alone."""

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from ailing import AILMENTS, diagnosed, first_order, oscillator, recorded, sound, steps


@pytest.mark.long
@pytest.mark.xdist_group("ailments")
@pytest.mark.parametrize("name", AILMENTS)
def test_what_ails_the_data_is_found(name: str) -> None:
    """The cure of a small system of known ailment is among what is advised, and what was measured is better."""
    ailment = AILMENTS[name]
    found = diagnosed(name)
    advice = next(one for one in (*found.remedies, *found.findings) if one.kind == ailment.kind)
    assert found.error is not None
    assert found.error > 0.1
    if ailment.option is not None:
        assert ailment.option in advice.options
        assert advice.call
    if advice.error is not None:
        assert advice.error < 0.7 * found.error or advice.kind == "missing"
    assert [one.error for one in found.remedies] == sorted(one.error or 0.0 for one in found.remedies)
    assert advice.what in str(found)


@pytest.mark.long
@pytest.mark.xdist_group("ailments")
@pytest.mark.parametrize(
    ("name", "r2"), [("position", 0.999), ("fast", 0.99), ("dead time", 0.999), ("codes", 0.999), ("third order", 0.99)]
)
def test_the_best_remedy_cures(name: str, r2: float) -> None:
    """The first remedy is the one that is right, and its score says that it cures."""
    best = diagnosed(name).remedies[0]
    assert best.kind == AILMENTS[name].kind
    assert best.r2 is not None
    assert best.r2 > r2


def test_a_good_fit_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the held-out part is foretold there is no advice, and nothing more is fitted."""
    noisy = recorded(first_order(steps()) + 0.02 * np.random.default_rng(0).normal(size=(1000, 1)), steps())
    for data in (sound(), noisy):
        fit = ps.PersidskiiIdentifier(["x"]).fit(data)
        with monkeypatch.context() as patched:
            patched.setattr(ps.PersidskiiIdentifier, "fit", None)
            found = ps.advise(fit, data)
        assert (found.remedies, found.findings, found.tried) == ((), (), 0)
        assert str(found).startswith("nothing to mend")


@pytest.mark.parametrize(("truth", "right"), [(lambda x: -x, "x"), (lambda x: -x - x**3, "x,x**3")])
def test_fewer_functions_that_do_as_well_are_named(truth: Callable[[float], float], right: str) -> None:
    """Of a good fit with four functions those are named that made the data; one that has no others is left alone."""
    u, x = steps(), np.zeros((1000, 1))
    for k in range(999):
        x[k + 1] = x[k] + 0.05 * (truth(x[k, 0] + 0.025 * (truth(x[k, 0]) + 2 * u[k, 0])) + 2 * u[k, 0])
    data = recorded(x + 1e-3 * np.random.default_rng(1).normal(size=x.shape), u)
    found = ps.advise(ps.PersidskiiIdentifier(["x", "x**3", "sinh(x)", "tanh(x)"]).fit(data), data)
    assert [one.options for one in found.findings] == [(("--functions", right),)]
    assert found.r2 is None
    assert not ps.advise(ps.PersidskiiIdentifier(right.split(",")).fit(data), data).findings


def test_files_that_were_kept_judge_the_remedies() -> None:
    """With `test` remedies are fitted to all of the data and scored on what was kept from the fit."""
    data = AILMENTS["position"].make()
    other = recorded(oscillator(steps(5))[:, :1], steps(5))
    fit = ps.PersidskiiIdentifier(["x"]).fit(data)
    found = ps.advise(fit, data, test=other)
    assert found.remedies[0].kind == "velocity"
    assert found.remedies[0].r2 is not None
    assert found.remedies[0].r2 > 0.99
    noise = recorded(np.random.default_rng(0).normal(size=(1000, 1)), steps(5))
    judged = ps.advise(fit, data, test=noise)
    assert judged.tried
    assert not judged.remedies


def test_hidden_states_are_tried() -> None:
    """Where a part of the state is hidden, a small linear model with hidden states is fitted, and its score is told."""
    found = diagnosed("hidden")
    advice = next(one for one in found.findings if one.kind == "outputs")
    assert advice.r2 is not None
    assert advice.r2 > 0.999
    assert "of order 3, run freely over the last quarter" in advice.what


def test_a_product_is_measured() -> None:
    """What a product would explain stands in numbers, from a regression."""
    ailment = AILMENTS["product"]
    data = ailment.make()
    found = ps.advise(ps.PersidskiiIdentifier(list(ailment.functions)).fit(data), data)
    said = next(one.what for one in found.findings if one.kind == "product")
    left, without = (float(part) for part in re.findall(r"([\d.e-]+) % (?:stay with|without)", said))
    assert left < 0.5 * without


def test_what_is_read_chunk_by_chunk_is_diagnosed_too(tmp_path: Path) -> None:
    """The beginnings of recordings are tried on, as those of data in memory are."""
    data = AILMENTS["position"].make()
    data.to_dataframe().reset_index()[["t", "a", "u"]].to_csv(tmp_path / "a.csv", index=False)
    there = ps.open_recordings(str(tmp_path / "a.csv"), states=["a"], inputs=["u"])
    found = ps.advise(ps.PersidskiiIdentifier(["x"]).fit(there), there)
    assert found.remedies[0].kind == "velocity"


def test_delayed_inputs_stand_beside_later_states() -> None:
    """Every run loses its beginning, and the note says so; a fit then finds the plant."""
    data = AILMENTS["dead time"].make()
    late = data.delayed({"u": 2.0})
    assert late.samples == data.samples - 40
    np.testing.assert_array_equal(late[0].u, data[0].u[:-40])
    np.testing.assert_array_equal(late[0].x, data[0].x[40:])
    assert "u 2 s" in late.notes[-1]
    assert ps.PersidskiiIdentifier(["x"], ridge=1e-8).fit(late).model_.A0[0, 0] == pytest.approx(-1, rel=1e-3)
    assert data.delayed({"u": 0.0}).samples == data.samples


@pytest.mark.parametrize(
    ("delay", "message"), [({"v": 1.0}, "the inputs are"), ({"u": -1.0}, "0 or more"), ({"u": 1e4}, "no run is longer")]
)
def test_delays_that_cannot_be_are_refused(delay: dict, message: str) -> None:
    """An unknown input, a negative delay and one longer than every run are errors that say what is there."""
    with pytest.raises(ps.DataError, match=message):
        sound().delayed(delay)


def test_dead_times_are_an_option_of_every_reader(tmp_path: Path) -> None:
    """Files and frames take delay=; chunk by chunk it is refused with the reason."""
    data = AILMENTS["dead time"].make()
    frame = data.to_dataframe().reset_index()[["t", "a", "u"]]
    frame.to_csv(tmp_path / "a.csv", index=False)
    how = {"states": ["a"], "inputs": ["u"], "delay": {"u": 2.0}}
    for found in (ps.read_csv(tmp_path / "a.csv", **how), ps.Trajectories.from_dataframe(frame, **how)):
        np.testing.assert_allclose(found[0].u, data.delayed({"u": 2.0})[0].u)
    with pytest.raises(ps.DataError, match="needs the data in memory"):
        ps.open_recordings(str(tmp_path / "a.csv"), **how)
