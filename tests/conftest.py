"""Tests run on one thread, by a clock that counts; with CHECK_SHAPES=1 calls are held to the shapes in signatures."""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import counting_clock
import pytest

from places import SHARED, TRAFFIC

if TYPE_CHECKING:
    from persid.verdicts.verdict import Undecided

if os.environ.get("CHECK_SHAPES") == "1":  # which takes twice the time
    from jaxtyping import install_import_hook

    install_import_hook(["persid"], "beartype.beartype")
os.environ.setdefault("OMP_NUM_THREADS", "1")  # the suite takes a process a core
counting_clock.install()

_DATA = SHARED / "data"


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int | None:
    """Take a process a core for the whole suite, and none for single files, which would wait for them in vain."""
    return None if config.args_source is config.ArgsSource.TESTPATHS else 0


@pytest.fixture(scope="session")
def measurements() -> Path:
    """The folder of real measurements beside the project; tests that need it skip where it is absent."""
    if not _DATA.is_dir():
        pytest.skip("the real measurements (../shared/data) are not on this machine")
    return _DATA


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder to work in, with a short file of measurements and two models."""
    from command_line import MODEL, UNSTABLE

    monkeypatch.chdir(tmp_path)
    rows = TRAFFIC.read_text().splitlines()[:301]
    (tmp_path / "data.csv").write_text("\n".join(rows) + "\n")
    (tmp_path / "model.json").write_text(json.dumps(MODEL))
    (tmp_path / "unstable.json").write_text(json.dumps(UNSTABLE))
    return tmp_path


@pytest.fixture
def undecided(monkeypatch: pytest.MonkeyPatch) -> "Undecided":
    """Certification that is quick and always undecided, for a fit under the certificate too."""
    from command_line import free_fit_only
    from persid.verdicts.verdict import Attempt, Reason, Undecided

    verdict = Undecided(Reason.STALLED, "Try more ridge.", (Attempt("a look", "stalled", 0.5),))
    monkeypatch.setattr(sys.modules["persid.verdicts.certify"], "certify", lambda model, **how: verdict)
    monkeypatch.setattr("persid.certified_fits.delivery.deliver", free_fit_only)
    return verdict


@pytest.fixture
def plain_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """A report without figures, where a test is about something else."""
    monkeypatch.setattr(
        "persid.reports.folder.write_report", lambda results, stage: (stage / "report.html").write_text("page")
    )
