"""Templates of the pages, and how they write numbers."""

import math
from pathlib import Path

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy import ndarray

from persid._text import above, below, pace
from persid.measurements.trajectory import Trajectory


def environment() -> Environment:
    """Return what renders a template of this room."""
    found = Environment(
        loader=PackageLoader("persid.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    found.filters |= {
        "below": below,
        "above": above,
        "per": pace,
        "figure": _number,
        "cell": _cell,
        "step": _median_step,
        "basename": lambda path: Path(path).name,
    }
    return found


def _number(number: float | None, digits: int = 4) -> str:
    if number is None:
        return "–"
    return f"{number:.{digits}g}" if math.isfinite(number) else ("not a number" if math.isnan(number) else "infinite")


def _cell(entry: object) -> str:
    """Return any entry of a record as text for a table."""
    if isinstance(entry, list | tuple):
        return ", ".join(_cell(part) for part in entry)
    if isinstance(entry, bool):
        return "yes" if entry else "no"
    if entry is None or (isinstance(entry, float) and not math.isfinite(entry)):
        return "–"
    return _number(float(entry), 3) if isinstance(entry, int | float) else str(entry)


def _median_step(run: Trajectory) -> float:
    steps: ndarray = np.diff(run.t)
    return float(np.median(steps))
