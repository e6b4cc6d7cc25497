"""The commands run and report: what they deliver, and that they deliver all of it or nothing."""

import json
import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import persid as ps
from command_line import MODEL, RUN, files, free_fit_only, raising
from persid.commands import cli
from persid.commands import identify as fit_commands
from persid.models.arguments import plain_model
from persid.reports.delivery import delivery
from persid.reports.results import read_results
from persid.verdicts.verdict import Certified, Reason, Refuted, Undecided
from places import VALID


def test_run_certifies_and_delivers(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run on measurements ends with the verdict and the paths of the report and the checked certificate."""
    assert cli.main([*RUN, "--ridge", "0.05", "--functions", "x,tanh(x)", "--time-limit", "5"]) == 0
    lines = capsys.readouterr().out.splitlines()
    names = [line.split()[0] for line in lines if not line.startswith(" ")]
    told = [name for name in names[names.index("verdict") :] if name != "but"]
    assert told == ["verdict", "plants", "of", "report", "certificate"]
    assert "but" in names, "its free run is worse than the mean"
    assert any("the proof is about the model, not about the plant" in line for line in lines)
    assert {"model.json", "certificate.json", "report.html", "run.json", "figures/free-run-1.png"} <= files(
        here / "out"
    )
    assert ps.check("out/certificate.json", "out/model.json") == ps.check(ps.load_certificate("out/certificate.json"))
    assert isinstance(ps.check("out/certificate.json"), ps.Accepted)


@pytest.mark.long
def test_run_undecided_says_why(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """An undecided run exits with 3, leaves obstruction.json with the attempts, and removes a stale certificate."""
    (here / "out" / "figures").mkdir(parents=True)
    (here / "out" / "certificate.json").write_text("stale")
    (here / "out" / "figures" / "level-sets-1-2.png").write_text("stale")
    (here / "out" / "mine.txt").write_text("mine")
    assert cli.main(RUN) == 3
    assert "undecided: The solver stalled" in capsys.readouterr().out
    found = files(here / "out")
    assert "certificate.json" not in found
    assert "figures/level-sets-1-2.png" not in found
    assert {"mine.txt", "obstruction.json"} <= found
    content = json.loads((here / "out" / "obstruction.json").read_text())
    assert content["reason"] == "STALLED"
    assert content["attempts"] == [{"what": "a look", "outcome": "stalled", "seconds": 0.5}]
    assert content["model_sha256"] == ps.load_model("out/model.json").sha256


@pytest.mark.usefixtures("plain_page")
def test_run_json_is_one_object(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """--json prints exactly one object on stdout, with the keys that were promised."""
    assert cli.main([*RUN, "--json"]) == 3
    content = json.loads(capsys.readouterr().out)
    keys = {"verdict", "claim", "scope", "operating_point", "reason", "rate", "gain", "seconds"}
    assert keys <= set(content)
    assert content["verdict"] == "undecided"
    assert Path(content["files"]["report"]).is_file()


@pytest.mark.usefixtures("plain_page")
def test_quiet_prints_nothing(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """--quiet leaves stdout and stderr empty; the exit code speaks."""
    assert cli.main([*RUN, "--quiet"]) == 3
    assert capsys.readouterr() == ("", "")


@pytest.mark.long
def test_report_is_rebuilt(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """persid report builds the same page again from the files of a run."""
    cli.main(RUN)
    page = (here / "out" / "report.html").read_text()
    (here / "out" / "report.html").unlink()
    assert cli.main(["report", "out"]) == 0
    assert (here / "out" / "report.html").read_text() == page


@pytest.mark.long
def test_report_without_measurements(here: Path, undecided: Undecided) -> None:
    """Where the measurements have changed since, the report is rebuilt without them and says so."""
    cli.main(RUN)
    (here / "data.csv").write_text("t,x1\n0,1\n")
    assert cli.main(["report", "out"]) == 0
    assert "no longer where they were, or have changed" in (here / "out" / "report.html").read_text()


@pytest.mark.usefixtures("plain_page")
def test_report_refuses_a_foreign_model(here: Path, undecided: Undecided, capsys: pytest.CaptureFixture[str]) -> None:
    """A folder whose files speak of different models is refused."""
    cli.main(RUN)
    (here / "out" / "model.json").write_text(json.dumps(MODEL))
    assert cli.main(["report", "out"]) == 2
    assert "another model" in capsys.readouterr().err


def test_certificate_of_run_is_checked_again(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """persid report refuses a folder whose certificate has been tampered with."""
    source = json.loads((VALID / "g_full.json").read_text())
    (here / "out").mkdir()
    certificate = ps.load_certificate(VALID / "g_full.json")
    certificate.model.save(here / "out" / "model.json")
    (here / "out" / "certificate.json").write_text(json.dumps(source | {"gamma": [1, -60]}))
    assert cli.main(["report", "out"]) == 2
    assert "does not accept" in capsys.readouterr().err
    (here / "out" / "certificate.json").write_bytes(certificate.data)
    assert cli.main(["report", "out"]) == 0


def test_run_refuted(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A refuted run leaves witness.json and a report that shows the checker's words; it can be rebuilt."""
    verdict = ps.certify(ps.load_model("unstable.json"))
    assert isinstance(verdict, Refuted)
    monkeypatch.setattr(sys.modules["persid.verdicts.certify"], "certify", lambda model, **how: verdict)
    monkeypatch.setattr("persid.certified_fits.delivery.deliver", free_fit_only)
    monkeypatch.setattr(fit_commands, "_identify", _identified("unstable.json"))
    assert cli.main(RUN) == 1
    assert "witness.json" in files(here / "out")
    assert "is not input-to-state stable" in (here / "out" / "report.html").read_text()
    assert cli.main(["report", "out"]) == 0


def _identified(path: str) -> Callable[..., Any]:
    def identify(measured: ps.Trajectories, **how: Any) -> Any:
        fit = ps.PersidskiiIdentifier(functions=how["functions"], ridge=0.01).fit(measured)
        fit.model_ = ps.load_model(path)
        return fit

    return identify


@pytest.mark.long
def test_run_obstructed(here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Where no certificate of the family exists, the proof of that is delivered, checked, and shown again."""
    data = (VALID / "infeasible_full.json").read_bytes()
    form = json.loads(data)["model"]
    (here / "m.json").write_text(json.dumps(plain_model(form)))
    obstruction = ps.Obstruction(data, ps.check(VALID / "infeasible_full.json").statement)  # type: ignore[union-attr]
    verdict = Undecided(Reason.INFEASIBLE, "", (), obstruction)
    monkeypatch.setattr(sys.modules["persid.verdicts.certify"], "certify", lambda model, **how: verdict)
    monkeypatch.setattr("persid.certified_fits.delivery.deliver", free_fit_only)
    monkeypatch.setattr(fit_commands, "_identify", _identified("m.json"))
    (here / "data.csv").write_text((here / "data.csv").read_text().replace("x1", "a").replace("u", "u1"))
    words = ["run", "data.csv", "--states", "a", "--inputs", "u1", "-o", "out"]
    assert cli.main(words) == 3
    assert cli.main(["check", "out/infeasible.json"]) == 3
    assert "python -m persid_check infeasible.json" in (here / "out" / "report.html").read_text()
    assert cli.main(["report", "out"]) == 0


def test_undecided_keeps_only_a_certificate_of_this_model(here: Path, undecided: Undecided) -> None:
    """An undecided certify removes a certificate of another model under its name, and keeps one of this model."""
    (here / "c.json").write_bytes((VALID / "g_full.json").read_bytes())
    assert cli.main(["certify", "model.json", "-o", "c.json"]) == 3
    assert not (here / "c.json").exists()
    (here / "c.json").write_text(json.dumps({"model_sha256": ps.load_model("model.json").sha256}))
    assert cli.main(["certify", "model.json", "-o", "c.json"]) == 3
    assert (here / "c.json").exists()


@pytest.mark.usefixtures("plain_page")
def test_full_disk(here: Path, undecided: Undecided, monkeypatch: pytest.MonkeyPatch) -> None:
    """A disk that is full while the results are written leaves the older results as they were."""
    cli.main(RUN)
    before = {name: (here / "out" / name).read_bytes() for name in files(here / "out")}
    monkeypatch.setattr(
        "persid.reports.objects.write_atomically", raising(OSError(28, "No space left on device", "out"))
    )
    assert cli.main(RUN) == 2
    assert {name: (here / "out" / name).read_bytes() for name in files(here / "out")} == before


def _cut(path: Path) -> None:
    """Deliver half of the files, then fail."""
    with delivery(path, ["*.json"]) as stage:
        (stage / "new.json").write_text("half")
        raise RuntimeError


def test_delivery_is_all_or_nothing(tmp_path: Path) -> None:
    """A delivery that fails leaves an existing folder as it was, and creates none."""
    (tmp_path / "old.json").write_text("old")
    with pytest.raises(RuntimeError):
        _cut(tmp_path)
    assert files(tmp_path) == {"old.json"}
    with pytest.raises(RuntimeError):
        _cut(tmp_path / "a" / "b")
    assert not (tmp_path / "a").exists()
    with delivery(tmp_path, ["*.json"]) as stage:
        (stage / "new.json").write_text("new")
    assert files(tmp_path) == {"new.json"}


@pytest.mark.usefixtures("plain_page")
def test_record_keeps_odd_numbers(here: Path, undecided: Undecided) -> None:
    """The record of a run reads back as it was written, infinite figures included."""
    cli.main(RUN)
    path = here / "out" / "run.json"
    content = json.loads(path.read_text())
    content["fit"]["condition_raw"] = {"float": "inf"}
    path.write_text(json.dumps(content))
    record = read_results(here / "out").record
    assert record is not None
    assert record.fit is not None
    assert record.fit.condition_raw == float("inf")
    record.save(here)
    assert json.loads((here / "run.json").read_text()) == content


def test_summary_of_rates() -> None:
    """The brief of claim E names the rate and the gain that the checker states."""
    from persid.verdicts.summary import summarize

    brief = summarize(Certified(ps.load_certificate(VALID / "e_mixed_pair.json")))
    assert brief.rate == 0.25
    assert brief.gain == pytest.approx(2.13472, rel=1e-5)


@pytest.mark.parametrize(
    ("number", "low", "high"), [(0.157451, "0.1574", "0.1575"), (2.0, "2", "2"), (0.125, "0.125", "0.125")]
)
def test_shown_bounds_are_rounded_outwards(number: float, low: str, high: str) -> None:
    """A shown rate is rounded down, a shown gain up; exact numbers stay."""
    from persid._text import above, below

    assert float(below(number)) <= number <= float(above(number))
    assert float(below(number)) == pytest.approx(float(low), rel=1e-9)
    assert float(above(number)) == pytest.approx(float(high), rel=1e-3)


@pytest.mark.long
def test_run_of_an_unstable_plant_under_feedback(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The verdict, exit code and scores are the free model's; the certified substitute lies beside, priced."""
    rng, x, rows = np.random.default_rng(0), 0.1, ["t,x,u"]
    for k in range(600):
        u = -2 * x + rng.choice([-1, 1])
        rows.append(f"{k * 0.05},{x},{u}")
        x = (x + u) * math.exp(0.05) - u
    monkeypatch.chdir(tmp_path)
    Path("data.csv").write_text("\n".join(rows) + "\n")
    words = ["run", "data.csv", "--time", "t", "--states", "x", "--inputs", "u", "-o", "out", "--json"]
    assert cli.main(words) == 1
    found = json.loads(capsys.readouterr().out)
    assert (found["verdict"], found["scores"]["unseen"]) == ("refuted", True)
    assert found["scores"]["rows"][found["scores"]["headline"]]["r2"] > 0.99
    assert found["price"] > 2
    assert {"model.json", "witness.json", "alternative/model.json", "alternative/certificate.json"} <= files(
        Path("out")
    )
    assert cli.main(["check", "out/alternative/certificate.json"]) == 0
    assert "the certified one is kept beside it" in Path("out/report.html").read_text()
    assert cli.main(["report", "out"]) == 0


@pytest.mark.usefixtures("plain_page")
@pytest.mark.parametrize("engine", ["memory", "chunks"])
def test_a_constant_input_is_no_input(here: Path, engine: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A column that never varies is noted, in memory and chunk by chunk, and no claim names it."""
    rows = (here / "data.csv").read_text().splitlines()
    (here / "data.csv").write_text("\n".join([f"{rows[0]},v", *(f"{row},0.7" for row in rows[1:])]) + "\n")
    words = ["data.csv", "--states", "x1,x2", "--inputs", "v,u", "--functions", "x", "--ridge", "0.05"]
    assert cli.main(["identify", *words, "--engine", engine, "-o", "m.json", "--json"]) == 0
    assert "v never varies: no input of the model" in json.loads(capsys.readouterr().out)["notes"]
    assert ps.load_model("m.json").inputs == ("u",)
    if engine == "memory":
        cli.main(["run", *words, "-o", "out"])
        assert ps.load_model("out/model.json").inputs == ("u",)
        assert cli.main(["report", "out"]) == 0
