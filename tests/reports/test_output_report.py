"""The report of an output model: its first screen, its figures, and its folder."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from persid.commands.cli import main
from persid.reports.output_runs import output_runs
from persid.reports.page import write_report
from persid.reports.record import Record, sources, versions
from persid.reports.results import Results, read_results
from persid.reports.verdict_files import write_verdict
from persid.verdicts.outputs import certify_fit
from stable_fits import random_fit

T = np.arange(300) * 0.1
READING = {"states": ["y1", "y2"], "inputs": ["u1"], "time": "t"}


@pytest.fixture
def results(tmp_path: Path) -> Results:
    """A model of known truth, its measurements in a file, and its verdict."""
    fit = random_fit(3, n=2, q=2, outputs=2)
    model, rng = ps.OutputModel.from_fit(fit), np.random.default_rng(0)
    u = np.repeat(rng.normal(size=30), 10)[:, None]
    y = model.simulate(T, u, x0=[1.0, -1.0])[0].x + 0.01 * rng.normal(size=(300, 2))
    path = tmp_path / "run.csv"
    np.savetxt(path, np.column_stack([T, y, u]), delimiter=",", header="t,y1,y2,u1", comments="")
    data = ps.read_csv(path, **READING)
    verdict = certify_fit(fit, model, time_limit=0.0)
    rows = [{"order": 2, "neurons": 2, "held_out": 0.01}]
    facts = (verdict.attempts, versions(), {"candidates": rows, "notes": ["one remark"], "unseen": True})
    return Results(model, verdict, data, Record("persid run", sources([path]), READING, None, *facts))


def delivered(results: Results, folder: Path) -> Path:
    """The folder that `persid run` would leave."""
    folder.mkdir()
    results.model.save(folder / "model.json")
    write_verdict(folder, results.verdict, results.model)
    assert results.record is not None
    results.record.save(folder)
    write_report(results, folder)
    return folder


def test_the_first_screen_shows_the_free_run_and_the_proof(results: Results, tmp_path: Path) -> None:
    """The picture comes before the words of the checker; gains of outputs are there, and no latent one."""
    page = (delivered(results, tmp_path / "out") / "report.html").read_text()
    assert page.index("<svg") < page.index("<blockquote>")
    assert "by proof, in the long run within" in page
    assert "The outputs keep to |&#39;y1&#39; - y*|" in page
    assert "|x(t) - x*|" not in page
    assert "kept from the fit" in page
    assert "one remark" in page
    assert len(list((tmp_path / "out" / "figures").glob("*.png"))) == 2


def test_the_report_is_made_again_from_its_folder(results: Results, tmp_path: Path) -> None:
    """persid report reads model, certificate and record again, and the page is the same."""
    folder = delivered(results, tmp_path / "out")
    before = (folder / "report.html").read_text()
    again = read_results(folder)
    assert again.model == results.model
    assert main(["report", str(folder), "--quiet"]) == 0
    assert (folder / "report.html").read_text() == before


def test_a_free_run_keeps_to_its_bound_and_foretells(results: Results) -> None:
    """On data of its own model R2 is nearly 1, and the run stays within what is proved."""
    assert isinstance(results.model, ps.OutputModel)
    assert results.data is not None
    run = output_runs(results.model, results.data, results.verdict)[0]
    assert (run.r2 > 0.98).all()
    assert run.bound is not None
    assert run.rest is not None
    assert (np.abs(run.simulated.x - run.rest) <= run.bound).all()
    assert run.steady is not None
    assert (run.steady <= run.bound[-1]).all()


def spoiled(results: Results, **compared: object) -> Results:
    """The same results with measurements that are no answer to their inputs, or with another comparison."""
    assert results.record is not None
    assert results.data is not None
    told = {**(results.record.comparison or {}), **compared}
    record = replace(results.record, comparison=told)
    if compared:
        return replace(results, record=record)
    run, rng = results.data[0], np.random.default_rng(1)
    x = np.cumsum(rng.normal(size=run.x.shape), axis=0)
    data = ps.Trajectories.from_arrays([x], t=[run.t], u=[run.u], states=results.data.states, inputs=("u1",))
    return replace(results, data=data, record=record)


def test_the_page_is_green_only_where_it_foretells(results: Results, tmp_path: Path) -> None:
    """A certified output model that foretells less than a forecast without one is amber, and its head says why."""
    good = (delivered(results, tmp_path / "good") / "report.html").read_text()
    assert 'class="verdict certified"' in good
    assert "Proved stable, and it foretells" in good
    poor = (delivered(spoiled(results), tmp_path / "poor") / "report.html").read_text()
    assert 'class="verdict certified doubtful"' in poor
    assert "Proved stable, but doubtful" in poor
    assert "the proof is about the model, not about the plant" in poor


def test_a_fit_that_missed_its_held_out_part_is_amber(results: Results, tmp_path: Path) -> None:
    """Where all records were fitted, the error on the part that the fit was chosen by counts."""
    rows = [{"order": 2, "neurons": 2, "held_out": 1.3}]
    page = (delivered(spoiled(results, candidates=rows, unseen=False), tmp_path / "out") / "report.html").read_text()
    assert 'class="verdict certified doubtful"' in page
    assert "n the part that was held out it is off by 1.3 of the outputs&#39; spread" in page
