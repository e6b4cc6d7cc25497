"""What the power study computes, as its parts keep it. Angles in degrees, frequencies in Hz from 60, errors in mHz."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypedDict

from persid._files import Json
from persid.studies.cells import Rows, VerdictCell


class FreeRuns(TypedDict):
    """Free runs on records of one kind: errors of angles and frequencies, sizes of both, and the first run."""

    errors: list[float] | None  # None where a run falls out of step
    size: list[float]
    run: Rows
    true: Rows


class Fit(TypedDict):
    """A model, as its `to_dict` gives it, with its free runs by kind of record."""

    model: Json
    runs: dict[str, FreeRuns]


class Fault(TypedDict):
    """A short circuit: times to clear it (s), the largest angle at each, its path, and whether step is then kept."""

    critical: float
    certified: float | None
    angles: list[float | None]
    keeps_step: bool
    path: Rows


class Region(TypedDict):
    """The verdict about a region, with short circuits by bus."""

    verdict: VerdictCell
    faults: dict[str, Fault]


class Edges(TypedDict):
    """How far angles may be from rest, by proof and in simulations."""

    proved: Rows
    simulated: Rows


class Load(TypedDict):
    """A load that varies: the size (MW) that is admitted, and the largest deviations of outputs that were seen."""

    admitted: float
    seen: list[float]


class Loads(TypedDict):
    """The verdict on loads that vary, the proved bounds of outputs, and what was seen for each load."""

    verdict: VerdictCell
    proved: list[float]
    loads: dict[str, Load]


class Step(TypedDict):
    """A step of a load: the verdict about the new rest, deviations of outputs from it, and their proved bounds."""

    verdict: VerdictCell
    seen: list[float]
    away: Rows
    proved: Rows | None


@dataclass(frozen=True)
class Found:
    """All that the study computes: fits and regions by model, edges of the first region, loads, and steps by name.

    `large` has the fits of the grid of ten machines.
    """

    fits: Mapping[str, Fit]
    regions: Mapping[str, Region]
    edges: Edges | None
    loads: Loads
    steps: Mapping[str, Step]
    large: Mapping[str, Fit]
