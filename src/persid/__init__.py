"""persid: from measurements of a nonlinear system to a generalized Persidskii model with a machine-checked proof."""

import sys
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from persid import plots as plots
    from persid.batches import Bootstrap as Bootstrap
    from persid.batches import Failed as Failed
    from persid.batches import bootstrap as bootstrap
    from persid.batches import certify_many as certify_many
    from persid.certificate import Certificate as Certificate
    from persid.certificate import load_certificate as load_certificate
    from persid.certify import Certified as Certified
    from persid.certify import Refuted as Refuted
    from persid.certify import Undecided as Undecided
    from persid.certify import certify as certify
    from persid.checking import check as check
    from persid.constrained import CertifiedIdentifier as CertifiedIdentifier
    from persid.equations import equations as equations
    from persid.equilibrium import OperatingPoint as OperatingPoint
    from persid.equilibrium import find_operating_point as find_operating_point
    from persid.errors import DataError as DataError
    from persid.errors import GeneratorError as GeneratorError
    from persid.errors import ModelError as ModelError
    from persid.errors import PersidError as PersidError
    from persid.errors import UnderdeterminedError as UnderdeterminedError
    from persid.identify import PersidskiiIdentifier as PersidskiiIdentifier
    from persid.model import PersidskiiModel as PersidskiiModel
    from persid.model import load_model as load_model
    from persid.network_proof import NetworkCertificate as NetworkCertificate
    from persid.obstruction import Obstruction as Obstruction
    from persid.readers import read_csv as read_csv
    from persid.readers import read_parquet as read_parquet
    from persid.recordings import Recordings as Recordings
    from persid.sindy import from_pysindy as from_pysindy
    from persid.surveys import open_recordings as open_recordings
    from persid.trajectories import Trajectories as Trajectories
    from persid.trajectories import Trajectory as Trajectory
    from persid.witness import Witness as Witness
    from persid_check import Accepted as Accepted
    from persid_check import Malformed as Malformed
    from persid_check import Rejected as Rejected

_HOMES = {
    "persid.batches": ("Bootstrap", "Failed", "bootstrap", "certify_many"),
    "persid.certificate": ("Certificate", "load_certificate"),
    "persid.certify": ("Certified", "Refuted", "Undecided", "certify"),
    "persid.checking": ("check",),
    "persid.constrained": ("CertifiedIdentifier",),
    "persid.equations": ("equations",),
    "persid.equilibrium": ("OperatingPoint", "find_operating_point"),
    "persid.errors": ("DataError", "GeneratorError", "ModelError", "PersidError", "UnderdeterminedError"),
    "persid.identify": ("PersidskiiIdentifier",),
    "persid.model": ("PersidskiiModel", "load_model"),
    "persid.network_proof": ("NetworkCertificate",),
    "persid.obstruction": ("Obstruction",),
    "persid.readers": ("read_csv", "read_parquet"),
    "persid.recordings": ("Recordings",),
    "persid.surveys": ("open_recordings",),
    "persid.sindy": ("from_pysindy",),
    "persid.trajectories": ("Trajectories", "Trajectory"),
    "persid.witness": ("Witness",),
    "persid_check": ("Accepted", "Malformed", "Rejected"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Accepted",
    "Bootstrap",
    "Certificate",
    "Certified",
    "CertifiedIdentifier",
    "DataError",
    "Failed",
    "GeneratorError",
    "Malformed",
    "ModelError",
    "NetworkCertificate",
    "Obstruction",
    "OperatingPoint",
    "PersidError",
    "PersidskiiIdentifier",
    "PersidskiiModel",
    "Recordings",
    "Refuted",
    "Rejected",
    "Trajectories",
    "Trajectory",
    "Undecided",
    "UnderdeterminedError",
    "Witness",
    "__version__",
    "bootstrap",
    "certify",
    "certify_many",
    "check",
    "equations",
    "find_operating_point",
    "from_pysindy",
    "load_certificate",
    "load_model",
    "open_recordings",
    "plots",
    "read_csv",
    "read_parquet",
]


def __getattr__(name: str) -> Any:
    """Load a public name when it is first asked for."""
    if name == "plots":
        return import_module("persid.plots")
    if name == "__version__":
        return _version()
    if name not in _HOME:
        raise AttributeError(f"module 'persid' has no attribute {name!r}")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)


def _version() -> str:
    from importlib import metadata

    try:
        return metadata.version("persid")
    except metadata.PackageNotFoundError:  # run from a source tree
        return "unknown"


class _Package(ModuleType):
    """Keeps `persid.certify` and `persid.equations` the functions, though submodules of these names are imported."""

    def __setattr__(self, name: str, value: Any) -> None:
        if not (isinstance(value, ModuleType) and name in _HOME):
            super().__setattr__(name, value)


sys.modules[__name__].__class__ = _Package
