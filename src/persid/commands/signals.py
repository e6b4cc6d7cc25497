"""Inputs and times of a simulation from the words of the command line, and its result as CSV."""

import csv
import io
import re
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json, write_atomically
from persid.errors import DataError, ModelError
from persid.measurements.readers import read_csv
from persid.measurements.trajectories import Trajectories
from persid.models.descriptor import DescriptorModel
from persid.models.functions import scalar_function
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel

STEPS = 1000
MOST_SAMPLES = 10_000_000


def times_and_inputs(
    model: PersidskiiModel | DescriptorModel,
    signals: Sequence[str],
    table: Path | None,
    time: str | None,
    t_end: float | None,
    dt: float | None,
) -> tuple[Float[ndarray, " N"], Any]:
    """Return the output times in s, and the inputs as `PersidskiiModel.simulate` takes them.

    Raises:
        DataError: the words contradict each other, or the table cannot be used.
        ModelError: a signal is not an expression of t.
    """
    if signals and table is not None:
        raise DataError("--input and --inputs-csv were both given; give one of them")
    if table is not None:
        return _from_table(model, table, time, t_end, dt)
    if t_end is None:
        raise DataError("--t-end is missing: give the last time in s")
    if signals and len(signals) != model.m:
        raise DataError(
            f"{len(signals)} signals were given; the model has {model.m} inputs ({', '.join(model.inputs)}); "
            "repeat --input once for each, in this order"
        )
    return _grid(0.0, t_end, dt), _joined([signal(text) for text in signals]) if signals else None


def start(
    model: PersidskiiModel | OutputModel | DescriptorModel,
    x0: Sequence[float] | None,
    y_init: Path | None,
    time: str | None,
) -> Json:
    """Return where a simulation starts: x0, or of an output model the outputs of the first rows of a table.

    Raises:
        DataError: neither or both are given, the model has no outputs, or the table cannot be used.
    """
    outputs = getattr(model, "outputs", None)
    if (x0 is None) == (y_init is None):
        hint = "" if outputs is None else ", or --y-init, a file with the first measured outputs"
        raise DataError(
            f"--x0 is missing: give the initial state{hint}" if x0 is None else "give --x0 or --y-init, not both"
        )
    if y_init is None:
        return {"x0": x0}
    if outputs is None:
        raise DataError("--y-init goes with an output model; the states of this one are measured: give --x0")
    return {"y_init": read_csv(y_init, states=list(outputs), time=time, gap=np.inf)[0].x}


def signal(text: str) -> Callable[[float], float]:
    """Return the function of t (s) that an expression such as "0.5*sin(t)" means."""
    if re.search(r"\bx\b", text):
        raise ModelError(f"the signal {text!r} depends on x; write it as a function of t")
    try:
        f = scalar_function(re.sub(r"\bt\b", "x", text))
    except ModelError as error:
        raise ModelError(f"the signal {text!r} is not an expression of t: {error}") from None
    return lambda t: float(f.value(t))


def _joined(parts: Sequence[Callable[[float], float]]) -> Callable[[float], object]:
    return lambda t: np.array([part(t) for part in parts])


def _from_table(
    model: PersidskiiModel | DescriptorModel, table: Path, time: str | None, t_end: float | None, dt: float | None
) -> tuple[ndarray, ndarray]:
    """Hold each value of the table until the next one."""
    if not model.m:
        raise DataError("the model has no inputs; leave --inputs-csv out")
    run = read_csv(table, states=list(model.inputs), time=time, gap=np.inf)[0]
    last = float(run.t[-1]) if t_end is None else t_end
    t = run.t[run.t <= last] if dt is None else _grid(float(run.t[0]), last, dt)
    if len(t) < 2 or last > run.t[-1]:
        raise DataError(f"{table} covers t = {run.t[0]:g} ... {run.t[-1]:g} s; choose --t-end within")
    return t, run.x[np.searchsorted(run.t, t, side="right") - 1]


def _grid(start: float, end: float, dt: float | None) -> Float[ndarray, " N"]:
    step = (end - start) / STEPS if dt is None else dt
    if not (np.isfinite([end, step]).all() and end > start and 0 < step <= end - start):
        raise DataError(f"times from {start:g} to {end:g} s in steps of {step:g} s; --t-end and --dt must be positive")
    count = round((end - start) / step)
    if count > MOST_SAMPLES:
        raise DataError(f"{count} steps; at most {MOST_SAMPLES} are allowed, give a larger --dt")
    return start + step * np.arange(count + 1)


def write_csv(path: Path, data: Trajectories) -> None:
    """Write t, states and inputs of one run; every number reads back as the same binary64."""
    run, text = data[0], io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["t", *data.states, *data.inputs])
    writer.writerows(np.column_stack([run.t, run.x, run.u]).tolist())
    write_atomically(path, text.getvalue())
