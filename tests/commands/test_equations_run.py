"""`persid run --algebraic`: from measurements to a model with equations, its verdict and its page."""

import html
import json
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from descriptors import circuit, loop
from persid.commands import cli
from persid.reports.folder import write_folder
from persid.reports.results import Results

FIT = [
    "--states", "v", "--algebraic", "node,diode", "--inputs", "i", "--functions", "x; x, expm1(x); x",
    "--pattern", "1,1,1; 1,1,1; 0,1,0", "--x-ref", "0,0,0", "--scale", "1,1,1",
]  # fmt: skip


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Two records of a circuit: the node's voltage and the diode's current measured, too."""
    monkeypatch.chdir(tmp_path)
    rng, t = np.random.default_rng(0), np.linspace(0, 16, 801)
    for name in ("one", "two"):
        run = circuit().simulate([0.0], t, np.repeat(rng.uniform(-1, 2, 33), 25)[:801, None])[0]
        rows = np.column_stack([t, run.x + 0.01 * rng.normal(size=run.x.shape), run.u])
        np.savetxt(f"{name}.csv", rows, delimiter=",", header="t,v,node,diode,i", comments="", fmt="%.9g")
    return tmp_path


def test_a_circuit_is_certified_and_foretells_its_node(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The folder holds a model with equations, a certificate that the checker accepts, and a page with both scores."""
    assert cli.main(["run", "one.csv", "--test", "two.csv", *FIT, "-o", "out", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert said["verdict"] == "certified"
    assert said["held_out"]["test"] is True
    assert max(said["held_out"]["errors"].values()) < 0.02  # of which noise is .01
    model = ps.load_model("out/model.json")
    assert isinstance(model, ps.DescriptorModel)
    assert model.algebraic == ("node", "diode")
    assert isinstance(ps.check("out/certificate.json", "out/model.json"), ps.Accepted)
    page = (folder / "out" / "report.html").read_text()
    assert "Proved stable, and it foretells" in page
    assert "its equations have exactly one solution" in page
    (folder / "out" / "report.html").unlink()
    assert cli.main(["report", "out"]) == 0
    assert (folder / "out" / "report.html").read_text() == page


def test_a_region_in_the_box_of_the_data_is_certified_and_reported(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """With --domain data, by `run` and by `certify`: the page says so and names the sides."""
    assert cli.main(["run", "one.csv", *FIT, "--domain", "data", "-o", "out", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scope"] == "regional"
    page = (folder / "out" / "report.html").read_text()
    assert "Proved stable in a region" in page
    assert "Of solutions of the equations outside the strips" in page
    certificate = ps.load_certificate("out/certificate.json")
    assert len(certificate.content["strips"]) + len(certificate.content["points"]) >= 3  # one of each variable
    assert cli.main(["certify", "out/model.json", "--domain", "data", "-o", "again.json", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["scope"] == "regional"
    assert isinstance(ps.check("again.json", "out/model.json"), ps.Accepted)


@pytest.mark.parametrize(("gain", "title"), [(1.01, "Proved not stable"), (2.0, "Proved not well-posed")])
def test_the_page_of_a_refuted_model_says_so(
    gain: float, title: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """That it runs away, or is not well-posed, in the words of the checker; the exit code is that of a refutation."""
    model = loop(gain)
    verdict = ps.certify(model)
    assert isinstance(verdict, ps.Refuted)
    write_folder(tmp_path / "out", Results(model, verdict, None, None))
    page = html.unescape((tmp_path / "out" / "report.html").read_text())
    assert title in page
    assert verdict.witness.statement in page
    assert "witness.json" in page
    assert cli.main(["certify", str(tmp_path / "out" / "model.json"), "-o", str(tmp_path / "w.json"), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["verdict"] == "refuted"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--method", "sindy"], "sindy"),
        (["--refine"], "--refine does not go with --algebraic"),
        (["--time", "discrete"], "--time discrete does not go with --algebraic"),
        (["--algebraic", "v"], "name a column twice"),
        (["--algebraic", "nodes"], "did you mean 'node'"),
        (["--domain", "-1,1"], "domain"),
    ],
)
def test_what_does_not_go_with_equations_is_named(
    folder: Path, capsys: pytest.CaptureFixture[str], words: list[str], said: str
) -> None:
    """An option that a fit with equations does not have, or a wrong name, is an error, and nothing is written."""
    assert cli.main(["run", "one.csv", *FIT, "-o", "out", *words]) == 2
    assert said in capsys.readouterr().err
    assert not (folder / "out" / "model.json").exists()
