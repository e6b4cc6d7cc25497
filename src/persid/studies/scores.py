"""Scores of a model of a grid: its free runs, and the clearing times that a certificate of it gives."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from numpy import ndarray

import persid as ps
from persid.studies.grid import Condition, Grid
from persid.studies.phasors import FRAMES, FreeRun, Record, rms, to_shown
from persid.studies.power_cells import Fault, Fit, FreeRuns
from persid.verdicts.verdict import Verdict

DRAWN = 20  # s of a free run
HALVED = slice(0, DRAWN * FRAMES, 2)  # every other frame of it


def scored(grid: Grid, model: ps.PersidskiiModel, steps: Sequence[Record], rings: Sequence[Record]) -> Fit:
    """Return a model with its free runs on new records: load steps, and what follows short circuits."""
    runs = {"steps": free_runs(grid, model, steps), "rings": free_runs(grid, model, rings)}
    return {"model": model.to_dict(), "runs": runs}


def free_runs(grid: Grid, model: ps.PersidskiiModel, records: Sequence[Record]) -> FreeRuns:
    """Return the errors of free runs; none where one falls out of step or blows up."""
    runs = [FreeRun.of(grid, model, record) for record in records]
    errors, shown = rms(grid, np.vstack([each.errors for each in runs])), to_shown(grid).T
    lost = errors[0] > 180.0 or any(len(each.x) < len(each.record.t) for each in runs)
    return {
        "errors": None if lost else list(errors),
        "size": list(rms(grid, np.vstack([(record.x - grid.rest) @ shown for record in records]))),
        "run": np.round(runs[0].x[HALVED] @ shown, 4).tolist(),
        "true": np.round(records[0].x[HALVED] @ shown, 4).tolist(),
    }


def cleared(grid: Grid, certificate: ps.Certificate | None, bus: int, after: Condition) -> Fault:
    """Return the critical clearing time by simulation and by a certificate, and the largest angles at these times."""
    critical = grid.critical_clearing(bus, after)
    t = np.arange(0, critical + 5e-4, 1e-3)
    x = grid.simulate(grid.rest, t, Condition(fault=bus))
    inside = None if certificate is None else last_inside(certificate, x[:, : grid.between])
    angles = grid.apart(x)
    return {
        "critical": critical,
        "certified": None if inside is None else float(t[inside]),
        "angles": [None if k is None else float(angles[k]) for k in (len(t) - 1, inside)],
        "keeps_step": inside is not None and bool(grid.keeps_step(x[inside], after)),
        "path": np.round(x[:, :2], 3).tolist(),
    }


def last_inside(certificate: ps.Certificate, x: Float[ndarray, "N n"]) -> int | None:
    """Return the last of states along a path, all of which until then lie in the region; the last one by proof."""
    outside = np.flatnonzero(certificate.V(x) > (certificate.level or 0.0))
    for k in range(int(outside[0]) - 1 if len(outside) else len(x) - 1, -1, -1):
        try:
            certificate.overshoot(x[k])
        except ps.PersidError:
            continue
        return k
    return None


def with_region(verdict: Verdict) -> ps.Certificate | None:
    """Return the certificate of a verdict, if there is one with a region."""
    found = verdict.certificate if isinstance(verdict, ps.Certified) else None
    return found if isinstance(found, ps.Certificate) else None
