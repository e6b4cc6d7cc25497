"""The 39-bus part of the power study: ten machines, identified from synchrophasors and run freely beside the equations.

The records of the fit are load steps and the ring-downs of five short circuits; free runs are through load steps and
short circuits that it has not seen.
"""

from collections.abc import Sequence
from functools import partial

import numpy as np

import persid as ps
from persid.studies.grid import DAMPING, Grid
from persid.studies.new_england import CASE
from persid.studies.parts import Parts
from persid.studies.phasors import FRAMES, Record, identify, load_steps, ring_down
from persid.studies.power_cells import Fit
from persid.studies.scores import scored

GRID = Grid(CASE)
RECORDED, FORETOLD = (4, 16, 21, 25, 29), (15, 23, 26)  # buses of short circuits in the fit, and of new ones
AFTER = {"fit": 0.1, "new": 0.12}  # s, when they are cleared
SECONDS = 60.0  # of each record of load steps: four of them step every one of the 21 loads
IDENTIFIED, KNOWN = "39 buses, identified", "39 buses, equations known"


def fits(parts: Parts) -> dict[str, Fit]:
    """Return the identified model and the known equations with their free runs."""
    asked = {"seconds": SECONDS, "frames": FRAMES, "damping": DAMPING}
    return {
        IDENTIFIED: parts.part(IDENTIFIED, asked, lambda: _scored(identified())),
        KNOWN: parts.part(KNOWN, asked, partial(_scored, GRID.model())),
    }


def identified() -> ps.PersidskiiModel:
    """Return the model that four records of load steps and the ring-downs give."""
    random = np.random.default_rng(1)
    steps = [load_steps(GRID, SECONDS, random) for _ in range(4)]
    return identify(GRID, [*steps, *_rings(RECORDED, AFTER["fit"], 10.0)], np.random.default_rng(3))


def _scored(model: ps.PersidskiiModel) -> Fit:
    steps = load_steps(GRID, SECONDS, np.random.default_rng(2))
    return scored(GRID, model, [steps], _rings(FORETOLD, AFTER["new"], 5.0))


def _rings(buses: Sequence[int], cleared: float, seconds: float) -> list[Record]:
    return [ring_down(GRID, bus, cleared, seconds) for bus in buses]
