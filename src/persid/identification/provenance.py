"""Provenance: what a model file says of how the model was made; no proof reads it."""

import hashlib
from importlib import metadata

import numpy as np

from persid._files import Json
from persid.identification.diagnostics import FitReport
from persid.measurements.recordings import Measurements, Recordings


def _version() -> str:
    try:
        return metadata.version("persid")
    except metadata.PackageNotFoundError:  # run from a source tree
        return "unknown"


def _digest(data: Measurements) -> str:
    """Return a hash of the samples; of recordings, that of their chunks."""
    if isinstance(data, Recordings):
        return data.digest
    digest = hashlib.sha256()
    for run in data:
        for part in (run.t, run.x, run.u):
            digest.update(np.ascontiguousarray(part).data)
    return digest.hexdigest()


def provenance(data: Measurements, report: FitReport) -> Json:
    """Return the version, the hash of the data, and the figures of a fit."""
    figures = {"rows": report.rows, "ridge": report.ridge, "window": report.window}
    if report.free_run is not None:
        figures |= {"free_run_rmse": report.free_run.rmse, "free_run_r2": report.free_run.r2_mean}
    return {"persid": _version(), "method": report.method, "data_sha256": _digest(data), **figures}
