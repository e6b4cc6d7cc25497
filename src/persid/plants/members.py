"""The models that data allow: ellipsoids of coefficients, and how large a multiple of them is certified.

Of equation i an estimate allows the coefficients theta + q + d, with d'Cov^-1 d <= quantile and q what errors of
integrals may have moved theta by. About the model's own coefficients, off by o, all of o + q + d lie in the ellipsoid

    |(o + q + d)'zeta|^2 <= zeta'S zeta for every zeta,   S = (t_1 + t_2 + t_3) (oo'/t_1 + qq'/t_2 + quantile Cov/t_3)

for all t > 0 (Cauchy's inequality). The mean of phi'S phi over the data is smallest where t_j is the root of that of
its part. The constant's coefficient does not count: a model of the set is certified about its own places of rest.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._files import Json
from persid.certificates.certificate import Certificate
from persid.lyapunov.deviations import Deviation
from persid.networks.certificate import NetworkCertificate
from persid.plants.alarms import Evidence
from persid.verdicts.members import certified_members


@dataclass(frozen=True, eq=False)
class CertifiedModels:
    """Every model within `rho` times the ellipsoids of coefficients that data allow, with the certificate of all.

    The ellipsoids lie about the certified model's coefficients and hold those of the confidence region of the data, so
    where rho is at least 1 every model that the data allow is certified, each about its own equilibria.
    """

    rho: float
    certificate: Certificate | NetworkCertificate

    def to_dict(self) -> Json:
        """Return the object that `--json` prints; the certificate is a file of its own."""
        return {"rho": self.rho, "claim": self.certificate.claim, "rate": self.certificate.rate}

    @classmethod
    def from_dict(cls, data: Json, certificate: Certificate | NetworkCertificate) -> "CertifiedModels":
        """Return what `to_dict` was called on, with the certificate that was read beside it."""
        return cls(data["rho"], certificate)

    def sentence(self, confidence: float) -> str:
        """Return what is certified of the models that data allow at a confidence."""
        at = f"the data allow at about {100 * confidence:.0f} %"
        which = f"Every model with coefficients that {at} is certified, and all within {self.rho:.3g} times that set"
        if self.rho < 1:
            which = f"Of the coefficients that {at} only those within {self.rho:.3g} times that set are certified"
        return f"{which}: each has exactly one equilibrium for each constant input, and is stable about it."


def certified_models(
    certificate: Certificate | NetworkCertificate, about: Evidence, phi: Float[ndarray, "N p"], time_limit: float | int
) -> CertifiedModels | None:
    """Return what is certified of the models that an estimate allows, phi at places of the data; in `time_limit` s.

    None where nothing is, as where the data leave a combination of coefficients open.
    """
    if not about.found.resolved.all():
        return None
    answer = certified_members(certificate, tuple(ellipsoids(about, phi)), time_limit)
    return None if answer is None else CertifiedModels(*answer)


def ellipsoids(about: Evidence, phi: Float[ndarray, "N p"]) -> list[Deviation]:
    """Return the ellipsoid of every equation that was estimated, about the model; the last column is the constant."""
    model, found = about.phi.model, about.found
    channels = model.channels
    off = found.theta[:-1] - np.vstack([channels.A0.T, channels.columns.T, model.B.T])
    quantile, size = found.quantile(about.confidence), (phi[:, :-1] ** 2).mean(axis=0)
    rows = []
    for i in np.flatnonzero(found.used.any(axis=0)):
        segments = [np.outer(v, v) for v in (off[:, i], about.quadrature[:-1, i])]
        parts = [*segments, quantile[i] * found.covariance[i][:-1, :-1]]
        t = np.sqrt([size @ np.diag(part) for part in parts])
        S = t.sum() * sum(part / share for part, share in zip(parts, t, strict=True) if share > 0)
        rows.append(Deviation.of_row(int(i), model.n, S))
    return rows
