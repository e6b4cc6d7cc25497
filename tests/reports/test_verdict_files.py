"""The file of a verdict is read back as the verdict, proofs checked again."""

from pathlib import Path

import pytest

import persid as ps
from persid.errors import FolderError
from persid.networks.certificate import NetworkObstruction, certify_network
from persid.reports.layout import INFEASIBLE
from persid.reports.verdict_files import read_verdict, write_verdict
from persid.verdicts.evidence import Evidence
from persid.verdicts.verdict import Reason, Undecided


@pytest.fixture
def undecided() -> tuple[ps.PersidskiiModel, Undecided]:
    """Return a growing model with the proof that no weights serve."""
    model = ps.PersidskiiModel([[1.0]], [("tanh(x)", None, [[-0.5]])], [[1.0]])
    found = certify_network(model, True, lambda line: None)
    assert isinstance(found, NetworkObstruction)
    return model, Undecided(Reason.INFEASIBLE, "Try.", (), found, Evidence(8, 1, (0.5,), 3.0))


def test_an_obstruction_of_weights_is_read_back(
    tmp_path: Path, undecided: tuple[ps.PersidskiiModel, Undecided]
) -> None:
    """What proves that no weights serve comes back with its bytes, beside the reason and the evidence."""
    model, verdict = undecided
    write_verdict(tmp_path, verdict, model)
    found = read_verdict(tmp_path, model, ())
    assert isinstance(found, Undecided)
    assert isinstance(found.obstruction, NetworkObstruction)
    assert verdict.obstruction is not None
    assert found.obstruction.data == verdict.obstruction.data
    assert (found.reason, found.evidence) == (verdict.reason, verdict.evidence)


def test_a_changed_obstruction_is_refused(tmp_path: Path, undecided: tuple[ps.PersidskiiModel, Undecided]) -> None:
    """A proof whose bytes no longer hold is refused, and its file is named."""
    model, verdict = undecided
    write_verdict(tmp_path, verdict, model)
    path = tmp_path / INFEASIBLE
    path.write_text(
        path.read_text().replace('"rays": [[[1, 0]', '"rays": [[[-1, 0]').replace('"z": [[1, 0]', '"z": [[0, 0]')
    )
    with pytest.raises(FolderError, match=r"infeasible\.json: the checker does not accept it"):
        read_verdict(tmp_path, model, ())
