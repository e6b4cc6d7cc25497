"""Sets of models: the largest multiple of ellipsoids of coefficients that is certified, each model where it rests."""

from dataclasses import replace
from functools import partial

import numpy as np

from persid.certificates.certificate import Certificate
from persid.errors import ModelError
from persid.lyapunov.deviations import Deviation
from persid.lyapunov.operating_points import OperatingPoint
from persid.lyapunov.rates import largest_rate
from persid.lyapunov.search import Outcome
from persid.lyapunov.shifted_model import Setting
from persid.models.model import PersidskiiModel
from persid.networks.certificate import NetworkCertificate
from persid.networks.members import prove_members
from persid.verdicts.log import Log
from persid.verdicts.margins import question_of, slow_rates, slowly
from persid.verdicts.searches import settled

MOST = 16.0  # multiples of the set above which none is sought
CLOSE = 1.04  # ratio of the bounds of rho at which bisection ends
SHARES = (0.9, 0.6)  # of the largest rho, at which a certificate is made
SECONDS = 60.0


def certified_members(
    certificate: Certificate | NetworkCertificate, rows: tuple[Deviation, ...], time_limit: float | int = SECONDS
) -> tuple[float, Certificate | NetworkCertificate] | None:
    """Return rho, and the certificate of every model within rho times the ellipsoids about a certified model.

    The search ends after `time_limit` s with what it has.

    It is one about each model's own equilibria, so V is made of nondecreasing forms alone, or is a weighted l1 norm.
    None where no multiple is found, and where the ellipsoids reach functions that the model does not use.
    """
    if not rows:
        return None
    log = Log(float(time_limit), lambda _: None)
    if isinstance(certificate, NetworkCertificate):
        return _of_network(certificate.model, rows, log)
    return _of_states(certificate, rows, log) or _of_network(certificate.model, rows, log)


def _of_network(
    model: PersidskiiModel, rows: tuple[Deviation, ...], log: Log
) -> tuple[float, NetworkCertificate] | None:
    """Return the same by claim L1."""

    def ask(rho: float, _: tuple[float, NetworkCertificate] | None) -> tuple[float, NetworkCertificate] | None:
        found = prove_members(model, _times(rows, rho))
        return None if found is None else (rho, found)

    best = largest_rate(ask, MOST, log.left, first=1 / MOST, fall=0.3, near=CLOSE)
    gentle = None if best is None or SHARES[0] * best[0] < 1 <= best[0] else ask(SHARES[0] * best[0], None)
    return gentle or best


def _of_states(certificate: Certificate, rows: tuple[Deviation, ...], log: Log) -> tuple[float, Certificate] | None:
    """Return the same by a V of quadratic forms and integrals, about a point that holds for all states."""
    setting = _setting(certificate)
    if setting is None:
        return None
    question = question_of(setting)

    def ask(rho: float, best: tuple[float, Outcome] | None) -> tuple[float, Outcome] | None:
        near = replace(question, deviations=_times(rows, rho))
        found = near.ask(0.0, None, None if best is None else best[1].families, log.left)
        return None if found is None else (rho, found)

    try:
        best = largest_rate(ask, MOST, log.left, first=1 / MOST, fall=0.3, near=CLOSE)
    except ModelError:
        return None
    largest = 0.0 if best is None else best[0]
    whole = (1.0,) if SHARES[0] * largest < 1 <= largest else ()
    for rho in (*whole, *(share * largest for share in SHARES if largest)):
        find = partial(slowly, rates=slow_rates(setting), deviations=_times(rows, rho), log=log)
        answer, setting = settled(setting, find, log)
        if isinstance(answer, Certificate) and "members" in answer.further:
            return rho, answer
    return None


def _times(rows: tuple[Deviation, ...], rho: float) -> tuple[Deviation, ...]:
    return tuple(row.times(rho) for row in rows)


def _setting(certificate: Certificate) -> Setting | None:
    """Return the setting of a global certificate with forms that know no centre; a rate takes c = 1 of each."""
    if certificate.claim not in ("iss", "rate-and-gain"):
        return None
    point = certificate.content["operating_point"]
    setting = Setting.of(certificate.model, None if point is None else OperatingPoint.from_dict(point)).monotone
    if not np.isfinite(setting.jacobian).all() or len(setting.system.states) < setting.model.n:
        return None
    return replace(setting, upper={curve: np.ones(len(forms)) for curve, forms in setting.pools.items()})
