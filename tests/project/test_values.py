"""Values come back from what they are written as: a class with `to_dict` has `from_dict`, which is the way back."""

import ast
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import persid as ps
from persid.lyapunov.operating_points import OperatingPoint
from persid.plants.alarms import Alarm
from persid.plants.members import CertifiedModels
from persid.reports.output_runs import OutputScores
from persid.studies.tables import Table
from persid.verdicts.evidence import Evidence
from persid.verdicts.summary import Summary, summarize
from persid.verdicts.verdict import Attempt

SOURCE = Path(ps.__file__).parent


def without_a_way_back(text: str) -> list[str]:
    """Return the classes of a module that have `to_dict` and no `from_dict`."""
    classes = [node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.ClassDef)]
    methods = {one.name: {part.name for part in one.body if isinstance(part, ast.FunctionDef)} for one in classes}
    return [name for name, found in methods.items() if "to_dict" in found and "from_dict" not in found]


def test_every_value_has_a_way_back() -> None:
    """No class of persid writes itself as an object that it cannot read."""
    assert [name for path in SOURCE.rglob("*.py") for name in without_a_way_back(path.read_text())] == []
    assert without_a_way_back("class A:\n def to_dict(self): ...") == ["A"]


@pytest.mark.parametrize(
    "value",
    [
        Attempt("a look", "stalled", 0.5),
        Evidence(8, 1, (1.0, -2.5), 3.25, 2),
        Summary("certified", "gain", "global", [0.0, 1.5], None, 0.5, 2.0, 1.25, output_gains={"y": 2.0}),
        Table("errors", "Free runs", ("model", "RMSE"), (("full", "0.1"), ("shared", "0.2"))),
    ],
    ids=lambda value: type(value).__name__,
)
def test_values_of_plain_numbers_come_back(value: Any) -> None:
    """What JSON made of a value is read as that value."""
    assert type(value).from_dict(json.loads(json.dumps(value.to_dict()))) == value


def test_a_summary_of_a_verdict_comes_back() -> None:
    """What `--json` prints of a verdict is read as its summary."""
    brief = summarize(ps.certify(ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])))
    assert Summary.from_dict(json.loads(json.dumps(brief.to_dict()))) == brief


def test_an_operating_point_comes_back_exactly() -> None:
    """Numbers of 53 bits of any size are written as integers and come back as they were."""
    point = OperatingPoint(np.array([0.1, -1e-300, 3e200]), 2.0**-40, np.array([1 / 3]))
    again = OperatingPoint.from_dict(json.loads(json.dumps(point.to_dict())))
    assert again.x.tolist() == point.x.tolist()
    assert (again.radius, again.u.tolist()) == (point.radius, point.u.tolist())


def test_a_plant_margin_comes_back_with_its_certificate() -> None:
    """The certificate is a file of its own; all else is in the object."""
    certificate = ps.certify(ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])).certificate
    for kept in (certificate, None):
        models = None if kept is None else CertifiedModels(1.5, kept)
        alarms = (Alarm("hold", "try the other one"),)
        margin = ps.PlantMargin(0.25, 0.5, 0.95, kept, 12, 0.75, alarms, "random", models)
        again = ps.PlantMargin.from_dict(json.loads(json.dumps(margin.to_dict())), kept, kept)
        assert again.to_dict() == margin.to_dict()
        assert str(again) == str(margin)
        assert again.certificate is kept


def test_scores_of_outputs_come_back() -> None:
    """Finite scores are the same again; what was not finite is no number."""
    scores = OutputScores(("y", "z"), np.array([0.1, 0.2]), np.array([1.0, np.inf]), np.array([0.9, -np.inf]))
    again = OutputScores.from_dict(json.loads(json.dumps(scores.to_dict())))
    assert again.outputs == scores.outputs
    assert again.rmse.tolist() == [0.1, 0.2]
    assert again.percent[0] == 1.0
    assert np.isnan([again.percent[1], again.r2[1]]).all()
