"""What the measurements say of the plant stands in the folder of a run."""

import json
from pathlib import Path

import numpy as np

import persid as ps
import persid_check
from persid.reports.comparison import of_plant
from persid.reports.folder import write_folder
from persid.reports.results import Results

PLANT = ps.PersidskiiModel([[-1.0]], B=[[1.0]])


def _data(samples: int) -> ps.Trajectories:
    rng = np.random.default_rng(7)
    u = np.repeat(rng.normal(0, 2, (samples // 20, 1)), 20, axis=0)
    run = PLANT.simulate([1.0], 0.05 * np.arange(len(u)), u)[0]
    return ps.Trajectories.from_arrays(run.x + 1e-3 * rng.normal(size=run.x.shape), run.u, t=run.t)


def test_the_models_that_data_allow_stand_in_the_folder(tmp_path: Path) -> None:
    """models.json is accepted and the report speaks of it; both go where nothing is said any more."""
    verdict = ps.certify(PLANT)
    write_folder(tmp_path, Results(PLANT, verdict, _data(1200), None))
    answer = persid_check.check(tmp_path / "models.json")
    assert isinstance(answer, persid_check.Accepted)
    assert "members" in answer.further
    assert json.loads((tmp_path / "models.json").read_text())["model_sha256"] == PLANT.sha256
    text = (tmp_path / "report.html").read_text()
    assert "Every model with coefficients that the data allow at about 95 % is certified" in text
    assert "proved in models.json" in text
    write_folder(tmp_path, Results(PLANT, verdict, None, None))
    assert not (tmp_path / "models.json").exists()
    assert "that the data allow" not in (tmp_path / "report.html").read_text()


def test_of_few_data_and_of_many_columns_nothing_is_said() -> None:
    """Too few windows are no error here, and large sets are left to --plant."""
    assert of_plant(ps.certify(PLANT), _data(40), "zoh", 60) is None
    wide = ps.PersidskiiModel(-np.eye(6), B=np.eye(6))
    assert of_plant(ps.certify(wide), _data(1200), "zoh", 60) is None


def test_the_search_for_the_set_of_models_ends_in_time() -> None:
    """Without time no set is sought; the band, which takes none, is there all the same."""
    verdict, data = ps.certify(PLANT), _data(1200)
    none, some = (of_plant(verdict, data, "zoh", seconds) for seconds in (0, 60))
    assert none is not None
    assert some is not None
    assert none.models is None
    assert some.models is not None
    assert none.epsilon == some.epsilon
