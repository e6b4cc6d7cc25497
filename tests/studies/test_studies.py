"""The paper's experiments: figures stay what was recorded, proofs check, interrupted studies go on."""

import json
from collections.abc import Callable
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np
import pytest

import persid as ps
from persid.commands import cli
from persid.studies import STUDIES, bases, recorded, run_study, traffic, wave
from persid.studies.parts import Parts
from persid.studies.tables import Study, Table, number, spread

pytestmark = pytest.mark.xdist_group("studies")  # one process runs each study once for all of them
QUICKEST = [name if name == "bases" else pytest.param(name, marks=pytest.mark.long) for name in STUDIES]
MADE: dict[str, tuple[Study, Path]] = {}


@pytest.fixture(scope="session")
def quick(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], tuple[Study, Path]]:
    """A study at quick sizes with its folder, run once for all tests."""

    def run(name: str) -> tuple[Study, Path]:
        if name not in MADE:
            folder = tmp_path_factory.mktemp(name)
            MADE[name] = (run_study(name, folder, quick=True), folder)
        return MADE[name]

    return run


def parts_in(folder: Path) -> Parts:
    """Return the parts of a study that does not exist."""
    return Parts.below(folder, ModuleWithRevision, lambda line: None)


ModuleWithRevision = ModuleType("nothing")
ModuleWithRevision.REVISION = 1  # type: ignore[attr-defined]


@pytest.mark.parametrize("name", QUICKEST)
def test_figures_are_what_was_recorded(quick: Callable, name: str) -> None:
    """The quick version of a study finds what was recorded, errors within 10 % and verdicts exactly."""
    assert recorded.differences(quick(name)[0]) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", STUDIES)
def test_full_figures_are_what_was_recorded(tmp_path: Path, name: str) -> None:
    """The full study finds what was recorded, errors within 10 % and verdicts exactly."""
    assert recorded.differences(run_study(name, tmp_path)) == []


@pytest.mark.parametrize("name", STUDIES)
def test_every_size_was_recorded_with_versions(name: str) -> None:
    """What is expected says which versions it came from, and errors are compared to 10 % at most."""
    content = json.loads(Path(recorded.__file__).with_name("expected").joinpath(f"{name}.json").read_text("utf-8"))
    assert content["tolerance"] <= 0.1
    assert all("numpy" in content[size]["versions"] for size in ("quick", "full"))


@pytest.mark.parametrize("name", QUICKEST)
def test_files_of_a_study(quick: Callable, name: str) -> None:
    """A study leaves tables, a page that loads nothing, and each figure as PNG and SVG."""
    study, folder = quick(name)
    page = (folder / "report.html").read_text("utf-8")
    assert study.title in page
    assert "src=" not in page
    assert all(table.caption in (folder / "tables.md").read_text("utf-8") for table in study.tables)
    assert {path.name for path in (folder / "figures").iterdir()} == {
        f"{drawing.name}.{kind}" for drawing in study.drawings for kind in ("png", "svg")
    }


@pytest.mark.long
def test_every_proof_of_the_traffic_study_checks(quick: Callable) -> None:
    """The checker accepts every certificate and witness in the folder, and there is one for every decided verdict."""
    folder = quick("traffic")[1]
    answers = [ps.check(path) for path in sorted((folder / "proofs").glob("*.json"))]
    assert len(answers) >= 8
    assert all(isinstance(answer, ps.Accepted) for answer in answers)


def test_true_traffic_system_is_not_stable(tmp_path: Path) -> None:
    """The true system is refuted by two equilibria on the plane and certified in a box about one of them."""
    found = traffic._truth_verdicts(parts_in(tmp_path))["verdicts"]
    assert (found["global"]["verdict"], found["global"]["why"]) == ("refuted", "two-equilibria")
    assert (found["regional"]["verdict"], found["regional"]["scope"]) == ("certified", "regional")
    assert all(isinstance(ps.check(path), ps.Accepted) for path in (tmp_path / "proofs").iterdir())


def test_true_model_is_the_system() -> None:
    """The model of the true system has the right-hand side that the data come from."""
    x = np.array([0.7, -1.3])
    assert traffic.true_model().rhs(x, np.array([np.sin(2.0)])) == pytest.approx(traffic.true_rate(2.0, x, np.zeros(2)))


@pytest.mark.slow
def test_the_papers_pattern_is_the_estimators(quick: Callable) -> None:
    """At ridge 0.02 the model of d1 is certified globally and that of d4 is not, as in the paper."""
    figures = quick("traffic")[0].figures
    assert figures["weak form, ridge 0.02, d1: verdict"] == "certified"
    assert figures["weak form, ridge 0.02, d4: verdict"] != "certified"


def test_split_is_worse_than_in_sample(quick: Callable) -> None:
    """Every combination of functions is at least three times as wrong on what the fit has not seen."""
    figures = quick("bases")[0].figures
    for name in bases.COMBINATIONS:
        label = f"combination {name}, f of the state, step 1"
        assert figures[f"{label}, split: RMSE"] > 3 * figures[f"{label}, in sample: RMSE"]


def test_wave_runs_solve_the_equation() -> None:
    """Halving the steps of the integration changes the paper's run by less than 1e-6."""
    y, t = np.linspace(0, 3 * np.pi, 30), np.arange(wave.STEPS) * wave.DT
    u = lambda s: np.array([np.sin(s) + 0.5 * np.cos(2 * s)])  # noqa: E731
    first = wave.paper_run(30)[0].x
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wave, "SUBSTEPS", 2 * wave.SUBSTEPS)
        second = wave._integrate(y, t, np.sin(y)[None], u)[0].x
    assert np.abs(first - second).max() < 1e-6


def test_parts_are_reused(tmp_path: Path) -> None:
    """A finished part is read again, and computed again when its parameters or its files change."""
    calls: list[int] = []

    def compute() -> dict[str, Any]:
        calls.append(1)
        (tmp_path / "proof.json").write_text("{}")
        return {"value": float("nan"), "verdict": {"files": ["proof.json"]}}

    assert parts_in(tmp_path).part("a, b", {"k": 1}, compute)["value"] is None
    parts_in(tmp_path).part("a, b", {"k": 1}, compute)
    assert len(calls) == 1
    parts_in(tmp_path).part("a, b", {"k": 2}, compute)
    assert len(calls) == 2
    (tmp_path / "proof.json").unlink()
    parts_in(tmp_path).part("a, b", {"k": 2}, compute)
    assert len(calls) == 3


def test_a_broken_part_is_computed_again(tmp_path: Path) -> None:
    """A file that is no part, cut short for example, is replaced."""
    parts_in(tmp_path)
    (tmp_path / "parts" / "a.json").write_text('{"key": "')
    assert parts_in(tmp_path).part("a", {}, lambda: {"value": 1}) == {"value": 1}


def test_a_rerun_changes_nothing(quick: Callable) -> None:
    """A second run computes no part again and finds the same figures."""
    study, folder = quick("bases")
    before = {path: path.stat().st_mtime_ns for path in (folder / "parts").iterdir()}
    assert dict(run_study("bases", folder, quick=True).figures) == dict(study.figures)
    assert {path: path.stat().st_mtime_ns for path in (folder / "parts").iterdir()} == before


def test_interruption_keeps_finished_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C ends the command with 130 and says that finished parts are kept."""
    compute, done = bases._compute, []

    def second_is_interrupted(*arguments: Any) -> dict[str, Any]:
        if done:
            raise KeyboardInterrupt
        done.append(arguments)
        return compute(*arguments)

    monkeypatch.setattr(bases, "_compute", second_is_interrupted)
    assert cli.main(["study", "bases", "-o", str(tmp_path / "out"), "--quick"]) == 130
    assert "finished parts are kept" in capsys.readouterr().err
    assert len(list((tmp_path / "out" / "parts").iterdir())) == 1


def test_the_command_prints_one_object(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With --json the figures and files of a study are one object on stdout."""
    found = SimpleNamespace(title="Bases", seconds=1.0, figures={"a": 0.5})
    monkeypatch.setattr("persid.studies.run_study", lambda name, folder, **how: found)
    assert cli.main(["study", "bases", "-o", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["figures"] == {"a": 0.5}


def test_unknown_studies_are_refused(tmp_path: Path) -> None:
    """A study that does not exist is wrong use."""
    with pytest.raises(KeyError, match="choose one of traffic, bases, wave"):
        run_study("nonsense", tmp_path)
    assert cli.main(["study", "nonsense", "-o", str(tmp_path)]) == 2


@pytest.mark.long
def test_progress_shows_a_bar_of_the_parts(tmp_path: Path) -> None:
    """Each line of progress stands behind a bar with the parts done and meant, the lines inside a part too."""
    lines: list[str] = []
    run_study("bases", tmp_path, quick=True, progress=lines.append)
    assert [line.split("/4 ")[0][-1] for line in lines] == ["0", "1", "2", "3"]
    parts = Parts.below(tmp_path, ModuleWithRevision, lines.append).of(2)
    parts.part("first", {}, lambda: parts.within("first")("half way") or {})
    assert "0/2 " in lines[-1]
    assert lines[-1].endswith("first: half way")


@pytest.mark.parametrize(
    ("found", "before", "same"),
    [(1.05, 1.0, True), (1.2, 1.0, False), (1e-4, 2e-4, True), (2, 3, True), (2, 4, False), (None, 1.0, False),
     ("refuted", "refuted", True), ("refuted", "certified", False), (None, None, True)],
)  # fmt: skip
def test_agreement_of_figures(found: recorded.Figure, before: recorded.Figure, same: bool) -> None:
    """Words agree exactly, counts to one, numbers to 10 %, and a blow-up only with a blow-up."""
    assert recorded.agree(found, before) is same


def test_differences_name_what_moved() -> None:
    """A figure that moved, one that is missing and one that is new are each named."""
    figures = {"combination 1, f of the state, step 1, split: RMSE": 99.0, "something else": 1.0}
    study = Study("bases", "", "", (), (), figures, (), 0.0, True)
    lines = recorded.differences(study)
    assert sum("is not there any more" in line for line in lines) >= 7
    assert [line for line in lines if "99.0" in line]
    assert "something else: was never recorded" in lines


def test_recording_keeps_the_other_size(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Recording the quick figures of a study leaves its full figures as they are."""
    monkeypatch.setattr(recorded, "__file__", str(tmp_path / "recorded.py"))
    (tmp_path / "expected").mkdir()
    for quick_size, value in ((True, 1.0), (False, 2.0), (True, 3.0)):
        content = {"study": "a", "quick": quick_size, "seconds": 1.0, "versions": {}, "figures": {"x": value}}
        (tmp_path / "tables.json").write_text(json.dumps(content))
        path = recorded.record(tmp_path)
    found = json.loads(path.read_text())
    assert (found["quick"]["figures"], found["full"]["figures"]) == ({"x": 3.0}, {"x": 2.0})


def test_tables_in_markdown() -> None:
    """A table in Markdown has its caption, a head, a rule and its rows."""
    table = Table("t", "Caption", ("a", "b"), (("1", "2"),))
    assert table.markdown() == "Caption\n\n| a | b |\n| --- | --- |\n| 1 | 2 |\n"


def test_spread_counts_blow_ups_as_infinite() -> None:
    """Median and range of errors put a blow-up above every number."""
    assert spread([0.2, None, 0.1]) == "0.200 (0.100 … ∞)"
    assert spread([0.5]) == "0.500"
    assert number(None) == "—"
