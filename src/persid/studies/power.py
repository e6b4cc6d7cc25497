"""The power study: what a grid operator may conclude from a model that synchrophasors give.

The grid is the classical nine-bus, three-machine one. A model is identified from load steps of up to 25 % and from
what follows three short circuits. It is run freely through load steps and short circuits that
the fit has not seen; regions about its operating point are certified; and the times in which a short circuit must be
cleared, and the sizes of load variations, that follow from the certificates are compared with simulations of the grid.
The 39-bus, ten-machine grid of New England is identified and run freely in the same way.
"""

from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial

import numpy as np
from jaxtyping import Float
from numpy import ndarray

import persid as ps
from persid.reports.record import versions
from persid.studies import power_pages as pages
from persid.studies import ten_machines
from persid.studies.grid import DAMPING, NORMAL, Condition, Grid
from persid.studies.nine_bus import CASE
from persid.studies.parts import Parts
from persid.studies.phasors import (
    FRAMES,
    LARGEST_STEP,
    Record,
    identify,
    load_steps,
    relative,
    ring_down,
    shown,
    to_shown,
)
from persid.studies.power_cells import Edges, Fit, Found, Load, Loads, Region, Step
from persid.studies.scores import cleared, scored, with_region
from persid.studies.tables import Study, protocol

REVISION = 2  # raised with every change of what is computed: parts of other revisions are not reused
GRID = Grid(CASE)
RECORDED, FORETOLD = (5, 7, 9), (4, 6, 8)  # buses of short circuits in the fit, and of those that it has not seen
AFTER = {"fit": 0.1, "new": 0.15}  # s, when they are cleared
IDENTIFIED, ALONE, KNOWN = "identified", "identified from load steps alone", "equations known"
OPENED = Condition(off=(5, 7))  # how the textbook clears its short circuit at bus 7
TIME_LIMIT = 240.0  # s for a verdict in a box
SEARCH_LIMIT = 900.0  # s for a region whose sides are sought, which ends before on any machine
WIDE, NARROW = 30.0, 15.0  # degrees to either side, of boxes
APART, TOGETHER = 1.0, 2.0  # Hz to either side: of frequencies between machines, of the whole grid
SWINGS = 20.0  # s for which a load goes up and down, and that a step is followed
EVER = 1e6  # s after which nothing is left of the start
RAYS = 37  # directions in the plane of angles in which stability is looked for


def run(parts: Parts, quick: bool = False, seeds: int | None = None) -> Study:
    """Run the study. With `quick`: short records, one region in a box, one short circuit. `seeds` is not used."""
    parts = parts.of(4 if quick else 12)
    fits = {label: _fit(parts, label, quick) for label in ((IDENTIFIED,) if quick else (IDENTIFIED, ALONE))}
    model = ps.PersidskiiModel.from_dict(fits[IDENTIFIED]["model"])
    fits[KNOWN] = parts.part(KNOWN, {"quick": quick}, lambda: scored(GRID, GRID.model(), *new_records(quick)))
    buses = (7,) if quick else (*FORETOLD, *RECORDED)
    regions = {IDENTIFIED: _clearing(parts, IDENTIFIED, model, buses, NORMAL, quick)}
    if not quick:
        regions[KNOWN] = _clearing(parts, KNOWN, GRID.model(), buses, NORMAL, quick)
        regions["line 5-7 opened"] = _clearing(parts, "line 5-7 opened", GRID.model(OPENED), (7,), OPENED, quick)
    found = Found(
        fits,
        regions,
        edges=None if quick else _edges(parts, regions[IDENTIFIED]),
        loads=_loads(parts, model),
        large={} if quick else ten_machines.fits(parts),
        steps={} if quick else parts.part("load steps", {"model": model.sha256}, partial(_steps, parts, model)),
    )
    return Study(
        name="power",
        title="Power: a grid of three machines, from synchrophasors to clearing times",
        protocol=protocol(__doc__),
        tables=pages.tables(found),
        drawings=pages.drawings(found),
        figures=pages.figures(found),
        remarks=pages.REMARKS,
        seconds=parts.total,
        quick=quick,
        versions=versions(),
    )


def records(quick: bool) -> tuple[list[Record], list[Record]]:
    """Return the records of the fit: load steps, and what follows short circuits."""
    random = np.random.default_rng(1)
    steps = [load_steps(GRID, 24.0 if quick else 60.0, random) for _ in range(1 if quick else 4)]
    return steps, [ring_down(GRID, bus, AFTER["fit"], 4.0 if quick else 10.0) for bus in RECORDED]


def new_records(quick: bool) -> tuple[list[Record], list[Record]]:
    """Return records that no fit has seen."""
    random = np.random.default_rng(2)
    steps = [load_steps(GRID, 20.0 if quick else 60.0, random) for _ in range(1 if quick else 2)]
    return steps, [ring_down(GRID, bus, AFTER["new"], 5.0) for bus in FORETOLD[: 1 if quick else None]]


def _fit(parts: Parts, label: str, quick: bool) -> Fit:
    """Return a model that was identified, with its scores on new records."""

    def compute() -> Fit:
        steps, rings = records(quick)
        model = identify(GRID, steps if label == ALONE else [*steps, *rings], np.random.default_rng(3))
        return scored(GRID, model, *new_records(quick))

    return parts.part(label, {"quick": quick, "frames": FRAMES, "damping": DAMPING}, compute)


def _clearing(
    parts: Parts, label: str, model: ps.PersidskiiModel, buses: Sequence[int], after: Condition, quick: bool
) -> Region:
    """Return a certified region of a model of the grid after a fault, and the clearing times that follow."""
    name = f"region, {label}"

    def compute() -> Region:
        between, rest = relative(model), GRID.rest[:4]
        domain = _box(rest, WIDE) if quick else "auto"
        verdict = ps.certify(
            between, operating_point=rest, domain=domain, time_limit=SEARCH_LIMIT, progress=parts.within(name)
        )
        found = parts.verdict(name, between, verdict)
        certificate = with_region(verdict)
        if certificate is None:
            return {"verdict": found, "faults": {}}
        return {"verdict": found, "faults": {str(bus): cleared(GRID, certificate, bus, after) for bus in buses}}

    return parts.part(
        name, {"model": model.sha256, "buses": list(buses), "limit": SEARCH_LIMIT, "quick": quick}, compute
    )


def _box(rest: Float[ndarray, " n"], angle: float) -> list[list[float]]:
    """Return a box about a state: angles to either side, and frequencies between machines and of the whole grid."""
    sides = np.array([angle, angle, APART, APART, TOGETHER][: len(rest)])
    return [[float(x - side), float(x + side)] for x, side in zip(rest, sides, strict=True)]


def _edges(parts: Parts, region: Region) -> Edges:
    """Return how far angles may be from rest, frequencies at 60 Hz: in a region, and in simulations of the grid."""

    def compute() -> Edges:
        certificate = ps.load_certificate(parts.folder / region["verdict"]["files"][1])
        rays = [np.array([np.cos(turn), np.sin(turn), 0, 0, 0]) for turn in np.linspace(0, 2 * np.pi, RAYS)]
        proved = [_reach(lambda x: bool(certificate.V(x[None, :4])[0] <= certificate.level), ray, 0.5) for ray in rays]
        simulated = [_reach(GRID.keeps_step, ray, 5.0) for ray in rays]
        return {"proved": np.round(proved, 2).tolist(), "simulated": np.round(simulated, 2).tolist()}

    return parts.part("edges", {"files": region["verdict"]["files"], "rays": RAYS}, compute)


def _reach(keeps: Callable[[ndarray], bool], ray: Float[ndarray, " 5"], step: float) -> Float[ndarray, " 2"]:
    """Return the angles at the last step along a ray from rest up to which all is kept."""
    size = step
    while keeps(GRID.rest + size * ray):
        size += step
    return np.asarray((GRID.rest + (size - step) * ray)[:2])


def _shown(model: ps.PersidskiiModel) -> ps.OutputModel:
    """Return a model with the outputs that an operator reads: angles in degrees, frequencies in Hz."""
    return ps.OutputModel(model, to_shown(GRID), outputs=[f"{name} shown" for name in shown(GRID)])


def _loads(parts: Parts, model: ps.PersidskiiModel) -> Loads:
    """Return how much each load may vary, in whatever way, by the certificate; and what the worst variations do."""
    name = "loads that vary"

    def compute() -> Loads:
        verdict = ps.certify(
            _shown(model), operating_point=GRID.rest, domain=_box(GRID.rest, NARROW), gains="each",
            time_limit=TIME_LIMIT, progress=parts.within(name),
        )  # fmt: skip
        found = parts.verdict(name, model, verdict)
        certificate = with_region(verdict)
        if certificate is None:
            return {"verdict": found, "proved": [], "loads": {}}
        proved = certificate.output_bound(certificate.operating_point, certificate.input_bound or 0.0, [EVER])[0]
        admitted = np.asarray(certificate.input_bounds).tolist()
        loads: dict[str, Load] = {
            load: {"admitted": size, "seen": _swung(k, size).tolist()}
            for k, (load, size) in enumerate(zip(CASE.loads, admitted, strict=True))
        }
        return {"verdict": found, "proved": proved.tolist(), "loads": loads}

    return parts.part(name, {"model": model.sha256, "limit": TIME_LIMIT}, compute)


def _swung(load: int, size: float) -> Float[ndarray, " 6"]:
    """Return how far outputs go from rest while a load switches by +-size (MW) in time with the grid's own swings."""
    eigenvalues = np.linalg.eigvals(GRID.model().jacobian(GRID.rest))
    peaks = np.zeros(len(shown(GRID)))
    for half in np.pi / eigenvalues.imag[eigenvalues.imag > 0]:
        x = GRID.rest
        for k in range(round(SWINGS / half)):
            shares = np.ones(len(CASE.loads))
            shares[load] += (-1) ** k * size / CASE.nominal[load]
            run = GRID.simulate(x, np.linspace(0, half, 21), Condition(tuple(shares.tolist())))
            peaks = np.maximum(peaks, np.abs((run - GRID.rest) @ to_shown(GRID).T).max(axis=0))
            x = run[-1]
    return peaks


def _steps(parts: Parts, model: ps.PersidskiiModel) -> dict[str, Step]:
    """Return for steps of every load whether the way to the new rest is certified, its bounds, and what happens."""
    found = {}
    for k, load in enumerate(CASE.loads):
        for share in (LARGEST_STEP, -LARGEST_STEP):
            name = f"load {load}, {share:+.0%}"
            found[name] = _step(parts, name, model, k, share)
    return found


def _step(parts: Parts, name: str, model: ps.PersidskiiModel, load: int, share: float) -> Step:
    u = np.zeros(len(CASE.loads))
    u[load] = share * CASE.nominal[load]
    start = ps.find_operating_point(model, near=GRID.rest)[0].x
    rest = ps.find_operating_point(model, u, near=GRID.rest)[0].x
    verdict = ps.certify(
        _shown(model), operating_point=rest, u_op=u, domain=_box(rest, NARROW), time_limit=TIME_LIMIT,
        progress=parts.within(name),
    )  # fmt: skip
    kept = parts.verdict(name, model, verdict)
    t = np.arange(0, SWINGS, 1 / FRAMES)
    shares = np.ones(len(CASE.loads))
    shares[load] += share
    x = GRID.simulate(GRID.rest, t, Condition(tuple(shares.tolist())))
    away = (x - rest) @ to_shown(GRID).T
    proved, certificate = None, with_region(verdict)
    if certificate is not None:
        with suppress(ps.PersidError):  # the old rest is not in the region about the new one
            proved = certificate.output_bound(start, 0.0, t[::6]).tolist()
    seen = np.abs(away).max(axis=0)
    return {"verdict": kept, "seen": seen.tolist(), "away": np.round(away[::6], 4).tolist(), "proved": proved}
