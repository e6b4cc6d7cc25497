"""persid: from measurements of a nonlinear system to a generalized Persidskii model with a machine-checked proof."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from persid import plots as plots
    from persid.certificates.certificate import Certificate as Certificate
    from persid.certificates.foretold import free_run_bound as free_run_bound
    from persid.certificates.obstruction import Obstruction as Obstruction
    from persid.certificates.witness import Witness as Witness
    from persid.certified_fits.bootstrap import Bootstrap as Bootstrap
    from persid.certified_fits.bootstrap import bootstrap as bootstrap
    from persid.certified_fits.identifier import CertifiedIdentifier as CertifiedIdentifier
    from persid.certified_fits.outputs import OutputIdentifier as OutputIdentifier
    from persid.errors import DataError as DataError
    from persid.errors import GeneratorError as GeneratorError
    from persid.errors import ModelError as ModelError
    from persid.errors import PersidError as PersidError
    from persid.errors import RejectedError as RejectedError
    from persid.errors import UnderdeterminedError as UnderdeterminedError
    from persid.identification.advice import Advice as Advice
    from persid.identification.advice import Diagnosis as Diagnosis
    from persid.identification.advice import advise as advise
    from persid.identification.descriptors import DescriptorIdentifier as DescriptorIdentifier
    from persid.identification.identifier import PersidskiiIdentifier as PersidskiiIdentifier
    from persid.lyapunov.operating_points import OperatingPoint as OperatingPoint
    from persid.lyapunov.operating_points import find_operating_point as find_operating_point
    from persid.measurements.opening import open_recordings as open_recordings
    from persid.measurements.readers import read_csv as read_csv
    from persid.measurements.readers import read_measurements as read_measurements
    from persid.measurements.readers import read_parquet as read_parquet
    from persid.measurements.recordings import Recordings as Recordings
    from persid.measurements.trajectories import Trajectories as Trajectories
    from persid.measurements.trajectory import Trajectory as Trajectory
    from persid.models.descriptor import DescriptorModel as DescriptorModel
    from persid.models.equations import equations as equations
    from persid.models.exports.pysindy import from_pysindy as from_pysindy
    from persid.models.files import load_model as load_model
    from persid.models.lookup_tables import lookup_table as lookup_table
    from persid.models.model import PersidskiiModel as PersidskiiModel
    from persid.models.outputs import OutputModel as OutputModel
    from persid.models.products import products as products
    from persid.models.recurrent import from_rnn as from_rnn
    from persid.networks.certificate import NetworkCertificate as NetworkCertificate
    from persid.plants.margin import PlantMargin as PlantMargin
    from persid.plants.margin import plant_margin as plant_margin
    from persid.verdicts.batches import Failed as Failed
    from persid.verdicts.batches import certify_many as certify_many
    from persid.verdicts.certify import certify as certify
    from persid.verdicts.checking import check as check
    from persid.verdicts.checking import load_certificate as load_certificate
    from persid.verdicts.trade import rates_and_gains as rates_and_gains
    from persid.verdicts.verdict import Certified as Certified
    from persid.verdicts.verdict import Refuted as Refuted
    from persid.verdicts.verdict import Undecided as Undecided
    from persid_check import Accepted as Accepted
    from persid_check import Malformed as Malformed
    from persid_check import Rejected as Rejected

_HOMES = {
    "persid.verdicts.batches": ("Failed", "certify_many"),
    "persid.certified_fits.bootstrap": ("Bootstrap", "bootstrap"),
    "persid.certificates.certificate": ("Certificate",),
    "persid.verdicts.certify": ("certify",),
    "persid.verdicts.trade": ("rates_and_gains",),
    "persid.verdicts.verdict": ("Certified", "Refuted", "Undecided"),
    "persid.verdicts.checking": ("check", "load_certificate"),
    "persid.certified_fits.identifier": ("CertifiedIdentifier",),
    "persid.certified_fits.outputs": ("OutputIdentifier",),
    "persid.models.descriptor": ("DescriptorModel",),
    "persid.models.equations": ("equations",),
    "persid.lyapunov.operating_points": ("OperatingPoint", "find_operating_point"),
    "persid.errors": (
        "DataError",
        "GeneratorError",
        "ModelError",
        "PersidError",
        "RejectedError",
        "UnderdeterminedError",
    ),
    "persid.identification.advice": ("Advice", "Diagnosis", "advise"),
    "persid.identification.descriptors": ("DescriptorIdentifier",),
    "persid.identification.identifier": ("PersidskiiIdentifier",),
    "persid.models.files": ("load_model",),
    "persid.models.lookup_tables": ("lookup_table",),
    "persid.models.model": ("PersidskiiModel",),
    "persid.models.outputs": ("OutputModel",),
    "persid.models.products": ("products",),
    "persid.networks.certificate": ("NetworkCertificate",),
    "persid.plants.margin": ("PlantMargin", "plant_margin"),
    "persid.certificates.obstruction": ("Obstruction",),
    "persid.measurements.readers": ("read_csv", "read_measurements", "read_parquet"),
    "persid.measurements.recordings": ("Recordings",),
    "persid.measurements.opening": ("open_recordings",),
    "persid.models.exports.pysindy": ("from_pysindy",),
    "persid.models.recurrent": ("from_rnn",),
    "persid.certificates.foretold": ("free_run_bound",),
    "persid.measurements.trajectories": ("Trajectories",),
    "persid.measurements.trajectory": ("Trajectory",),
    "persid.certificates.witness": ("Witness",),
    "persid_check": ("Accepted", "Malformed", "Rejected"),
}
_HOME = {name: home for home, names in _HOMES.items() for name in names}

__all__ = [
    "Accepted",
    "Advice",
    "Bootstrap",
    "Certificate",
    "Certified",
    "CertifiedIdentifier",
    "DataError",
    "DescriptorIdentifier",
    "DescriptorModel",
    "Diagnosis",
    "Failed",
    "GeneratorError",
    "Malformed",
    "ModelError",
    "NetworkCertificate",
    "Obstruction",
    "OperatingPoint",
    "OutputIdentifier",
    "OutputModel",
    "PersidError",
    "PersidskiiIdentifier",
    "PersidskiiModel",
    "PlantMargin",
    "Recordings",
    "Refuted",
    "Rejected",
    "RejectedError",
    "Trajectories",
    "Trajectory",
    "Undecided",
    "UnderdeterminedError",
    "Witness",
    "__version__",
    "advise",
    "bootstrap",
    "certify",
    "certify_many",
    "check",
    "equations",
    "find_operating_point",
    "free_run_bound",
    "from_pysindy",
    "from_rnn",
    "load_certificate",
    "load_model",
    "lookup_table",
    "open_recordings",
    "plant_margin",
    "plots",
    "products",
    "rates_and_gains",
    "read_csv",
    "read_measurements",
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
