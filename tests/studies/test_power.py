"""The power study: certified clearing times are safe ones, and its page shows what was recorded."""

import json
import re
from pathlib import Path

import numpy as np
import pytest

import persid as ps
from persid.studies import phasors, power, power_pages, scores, ten_machines
from persid.studies.grid import Condition
from persid.studies.nine_bus import CASE
from persid.studies.parts import Parts
from places import ROOT

EXPECTED = json.loads(Path(power.__file__).with_name("expected").joinpath("power.json").read_text("utf-8"))


@pytest.mark.long
def test_a_certified_clearing_time_is_one() -> None:
    """The state at the certified time is proved to lie in the region, which is before the grid would lose its step."""
    between, rest = phasors.relative(power.GRID.model()), power.GRID.rest[:4]
    certificate = scores.with_region(ps.certify(between, operating_point=rest, domain=power._box(rest, power.NARROW)))
    assert certificate is not None
    fault = scores.cleared(power.GRID, certificate, 9, power.NORMAL)
    assert 0 < fault["certified"] < fault["critical"]
    assert fault["keeps_step"]
    x = power.GRID.simulate(power.GRID.rest, np.array([0.0, fault["certified"]]), Condition(fault=9))
    assert certificate.overshoot(x[-1, :4]) > 0


def test_the_page_shows_what_was_recorded() -> None:
    """Every clearing time and every admitted load in docs/power.md is the recorded one."""
    page, figures = (ROOT / "docs" / "power.md").read_text("utf-8"), EXPECTED["full"]["figures"]
    rows = re.findall(r"^\| (\d) \| (\d+) ms \| (\d+) ms \|", page, re.MULTILINE)
    assert len(rows) == 6
    for bus, *times in rows:
        name = f"identified, short circuit at bus {bus}"
        recorded = [figures[f"{name}: {kind}, s"] for kind in ("simulated", "certified")]
        assert [f"{1e3 * seconds:.0f}" for seconds in recorded] == times
    for load in CASE.loads:
        assert f"±{figures[f'load {load}: admitted, MW']:.1f} MW" in page


@pytest.mark.long
def test_ten_machines_are_foretold(tmp_path: Path) -> None:
    """On records that it has not seen the model of ten machines errs as was recorded, and known equations err less."""
    found = ten_machines.fits(Parts.below(tmp_path, power, lambda line: None))
    recorded, page = EXPECTED["full"]["figures"], (ROOT / "docs" / "power.md").read_text("utf-8")
    for kind, words in power_pages.KINDS.items():
        errors = [found[label]["runs"][kind]["errors"] for label in (ten_machines.IDENTIFIED, ten_machines.KNOWN)]
        for k, unit in enumerate(("degrees", "mHz")):
            assert errors[0][k] == pytest.approx(recorded[f"{ten_machines.IDENTIFIED}, {words}: {unit}"], rel=0.1)
            assert errors[1][k] < errors[0][k] < 0.2 * found[ten_machines.KNOWN]["runs"][kind]["size"][k]
    for row in power_pages._run_rows(found):
        assert f"| {' | '.join(row)} |" in page
