"""A bound of a free run's error from one-step residuals of measurements: no model of the plant is needed.

Where a certificate in discrete time holds between any two solutions, one step of the model brings two states nearer:
sqrt(V), V(d) = d'P d, falls to q sqrt(V) at least, q^2 = 1 - kappa. Measured states obey x_{k+1} = F(x_k, u_k) + e_k,
e_k the residual of a prediction one step ahead, whatever made it. So the free run x~ from x_0 has, with d = x - x~,

    sqrt(V(d_{k+1})) <= q sqrt(V(d_k)) + sqrt(V(e_k)),      d_0 = 0,      |d_i| <= sqrt((P^-1)_ii V(d)).
"""

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.certificates.certificate import Certificate
from persid.errors import PersidError
from persid.measurements.trajectory import Trajectory
from persid.models.recursion import refuse_other_steps


def free_run_bound(certificate: Certificate, run: Trajectory) -> Float[ndarray, "N n"]:
    """Bound |x_i - x~_i| in every step of a measured run, x~ the model's free run from its first state.

    It is computed in floating point from the measured samples and the contraction that is proved; nothing is assumed
    about what was measured. Samples are one step of the model apart (`PersidskiiIdentifier.seen` gives them so).

    Raises:
        PersidError: the certificate is not one in discrete time that holds between any two solutions.
        ModelError: the samples are not one step of the model apart.

    Examples:
        >>> model = ps.PersidskiiModel([[0.5]], [("tanh(x)", None, [[0.25]])], [[1.0]], time="discrete", dt=0.1)
        >>> run = model.simulate([1.0], 0.1 * np.arange(50))[0]
        >>> bool(ps.free_run_bound(ps.certify(model).certificate, run).max() < 1e-12)
        True
    """
    model, q = certificate.model, certificate.contraction
    if q is None or not certificate.is_incremental or model.dt is None:
        raise PersidError(
            'the certificate does not bound two solutions in discrete time; certify with claim="incremental"'
        )
    refuse_other_steps(run.t, model.dt)
    residuals = run.x[1:] - model.rhs(run.x[:-1], run.u[:-1])
    L = np.linalg.cholesky(certificate.P)  # V(e) = |L'e|^2
    sizes, distance = np.linalg.norm(residuals @ L, axis=1), np.zeros(len(run))
    for k, size in enumerate(sizes):
        distance[k + 1] = q * distance[k] + size
    return np.outer(distance, np.sqrt(np.diag(np.linalg.inv(certificate.P))))
