"""A fit and a verdict take each thing they need once: a range is counted, and a model written out, no second time."""

from collections import Counter
from typing import Any

import numpy as np
import pytest

import persid as ps
from persid.measurements import trajectories
from persid.models import model
from persid.reports.verdict_files import read_verdict, write_verdict


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Count what is called from now on."""
    found: Counter[str] = Counter()

    def counted(owner: Any, name: str) -> None:
        original = getattr(owner, name)

        def call(*given: Any, **more: Any) -> Any:
            found[name] += 1
            return original(*given, **more)

        monkeypatch.setattr(owner, name, call)

    counted(trajectories, "run_moments")
    counted(ps.PersidskiiModel, "to_dict")
    counted(model, "canonical_model")
    return found


def measured() -> ps.Trajectories:
    t = np.arange(400) * 0.05
    truth = ps.PersidskiiModel(
        A0=[[-1, 0.3], [0, -1]], terms=[("x**3", None, [[-1, 0], [0, -1]])], B=[[1], [0.5]], inputs=["u"]
    )
    starts = ([1.0, -1.0], [-1.0, 0.5])
    runs = [truth.simulate(x0, t, np.sin((k + 1) * t)[:, None])[0] for k, x0 in enumerate(starts)]
    return ps.Trajectories(tuple(runs), ("x1", "x2"), ("u",))


def test_range_once(calls: Counter[str]) -> None:
    """A fit counts the range of its data once, and once that of the tails on which it is scored."""
    ps.PersidskiiIdentifier(functions=["x", "x**3"]).fit(measured())
    assert calls == {"run_moments": 2}


def test_model_once(calls: Counter[str]) -> None:
    """A verdict on two states writes its model out once, in the form that proofs hold, and hashes it from there."""
    model = ps.PersidskiiModel(A0=[[-1, 0.3], [0, -1]], terms=[("tanh(x)", None, -np.eye(2))], B=[[1], [0.5]])
    assert ps.certify(model).is_certified
    assert len(model.sha256) == 64
    assert calls == {"to_dict": 1, "canonical_model": 1}


def test_undecided_comes_back(tmp_path: Any) -> None:
    """An undecided verdict is read back from its file as the value that was written."""
    model = ps.PersidskiiModel(A0=[[-1.0]], terms=[("x**3", None, [[-1.0]])], B=[[1.0]])
    verdict = ps.certify(model, time_limit=0)
    write_verdict(tmp_path, verdict, model)
    again = read_verdict(tmp_path, model, ())
    assert isinstance(verdict, ps.Undecided)
    assert isinstance(again, ps.Undecided)
    assert again.to_dict() == verdict.to_dict()
    assert str(again) == str(verdict)
