"""The verdict on a model fitted to inputs and outputs, from the multipliers of the fit: nothing has to be searched.

The fit carries P = I, densities M and multipliers T with which its matrix inequality holds, V = |z|^2 + 2 sum M_c
int w_c about any equilibrium. What is left is the rate: gains of outputs are sqrt(c gamma(kappa) / kappa), so kappa is
looked for between nothing and the largest for which the inequality holds.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from time import perf_counter

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid._dyadics import rounded
from persid.certificates.certificate import Certificate
from persid.certificates.outputs import refuse_steep_maps
from persid.certificates.stability import prove
from persid.errors import RejectedError, RoundingError
from persid.lyapunov.multipliers import Chosen, Lyapunov
from persid.lyapunov.operating_points import find_operating_point
from persid.lyapunov.sectors import unit_forms
from persid.lyapunov.shifted_model import Setting
from persid.models.outputs import OutputModel
from persid.models.stable_fit import StableFit
from persid.verdicts.certify import certify
from persid.verdicts.verdict import Attempt, Certified, Verdict

RATES = np.concatenate([np.linspace(1.0, 0.1, 19), np.geomspace(0.08, 1e-4, 12)])  # shares of the largest kappa
HALVINGS = 60  # of kappa, until the inequality holds
PROVED = 1 + 1e-6  # of a rate that is asked for: what is left to rounding
DENSITIES = (0.0, 1e-9, 1e-6)  # M below such a share of its largest is left out where the inequality needs it

Progress = Callable[[str], None]


def certify_fit(
    fit: StableFit,
    model: OutputModel,
    *,
    time_limit: float = 60.0,
    min_rate: float | None = None,
    progress: Progress | None = None,
) -> Verdict:
    """Return the verdict on a fit's model: from the fit's own multipliers, and from a search in the time that is left.

    Of the two certificates the one with the smaller gains of the outputs is kept, at a rate of at least `min_rate`
    (1/s) where there is one.

    Args:
        fit: what was fitted.  model: `OutputModel.from_fit(fit)`.
        time_limit: seconds for the search; with 0 there is none where the fit's own multipliers prove it.
        min_rate: a rate of the certificate that is wanted, in 1/s.
        progress: is called with a line of text at each step.

    Raises:
        ModelError: the output map has no Lipschitz constant.
    """
    refuse_steep_maps(model)
    began = perf_counter()
    own = _own(fit, model, min_rate or 0.0, progress or (lambda line: None))
    attempt = Attempt("the multipliers of the fit", _word(own), perf_counter() - began)
    if own is not None and time_limit <= 0:
        return Certified(own, (attempt,))
    searched = certify(model, time_limit=time_limit, progress=progress)
    attempts = (attempt, *searched.attempts)
    if own is None:
        return replace(searched, attempts=attempts)
    found = [own]
    if isinstance(searched, Certified) and isinstance(searched.certificate, Certificate):
        found.append(searched.certificate)
    return Certified(min(found, key=lambda certificate: _rank(certificate, model, min_rate or 0.0)), attempts)


def _word(certificate: Certificate | None) -> str:
    return "no certificate" if certificate is None else f"certified, {certificate.claim}"


def _rank(certificate: Certificate, model: OutputModel, min_rate: float) -> tuple[bool, float]:
    """Order certificates: those that are fast enough first, then by the gains of the outputs."""
    gains = certificate.output_gains
    if gains is None or certificate.rate is None:
        return True, np.inf
    return certificate.rate < min_rate, float(np.max(gains / _sizes(model)))


def _sizes(model: OutputModel) -> Float[ndarray, " l"]:
    """Return what is large for each output, so that gains in different units can be compared."""
    cov = np.eye(model.dynamics.n) if model.x_cov is None else model.x_cov
    spread = np.sqrt(np.einsum("li,ij,lj->l", model.C, cov, model.C))
    return np.where(spread > 0, spread, 1.0)


def _own(fit: StableFit, model: OutputModel, min_rate: float, progress: Progress) -> Certificate | None:
    """Return the certificate that the fit's own P, M and T prove, or None."""
    if fit.M is None or fit.T is None:
        return None
    progress("proving the fit's own multipliers")
    points = find_operating_point(model.dynamics)
    if not points:
        return None
    setting = Setting.of(model.dynamics, points[0])
    if not all(len(unit_forms(group.curve)) == 2 * len(group.channels) for group in setting.found):
        return None  # a neuron's slope is not proved to lie in [0, 1]
    hard = np.minimum(fit.M, 0.0)
    P = np.eye(model.dynamics.n) if fit.P is None else rounded(fit.metric + (fit.R.T * hard) @ fit.R)
    P = (P + P.T) / 2
    for share in DENSITIES:
        least = share * float(np.abs(fit.M).max(initial=0.0))
        M = np.where(least >= np.abs(fit.M), 0.0, fit.M)
        found = _paced(partial(_slowed, setting, P, M, fit.T, fit.kappa), fit, min_rate)
        if found is None:
            continue
        try:
            return prove(setting.model, found, setting.point, outputs=model)
        except (RejectedError, RoundingError) as error:
            progress(f"not proved: {error}")
    return None


def _chosen(setting: Setting, M: Float[ndarray, " q"], T: Float[ndarray, " q"]) -> tuple[Chosen, ...]:
    """Return the fit's multipliers, group by group.

    Neurons whose rows are multiples a r of one row r stand in one group: w_c and a r'z - w_c are its forms, and
    M int w_c of a r'z is that of the form with M a. A neuron without effect has no place, nor has its M or T.
    """
    found = []
    for group in setting.found:
        count = len(group.channels)
        forms = np.array(unit_forms(group.curve)).reshape(-1, 1 + count)
        channels = list(group.channels)
        per_row = M[channels] * [float(factor) for factor in group.curve.factors]
        mu = np.stack([np.maximum(per_row, 0.0), np.maximum(-per_row, 0.0)], 1).ravel()
        pairs = tuple((2 * j, 2 * j + 1, float(tau)) for j, tau in enumerate(rounded(T[channels])))
        found.append(Chosen(forms, rounded(mu), np.ones(2 * count), np.zeros(2 * count), pairs))
    return tuple(found)


def _slowed(
    setting: Setting, P: Float[ndarray, "n n"], M: Float[ndarray, " q"], T: Float[ndarray, " q"], own: float,
    kappa: float,
) -> Lyapunov:  # fmt: skip
    """Return the fit's proof at another kappa than its own kappa_0, where that is larger.

    Its inequality has kappa_0 w'M R z, M >= 0. Of that (kappa_0 - kappa) w'M (R z - w) goes to the products, T grows by
    (kappa_0 - kappa) M, and what is left, (kappa_0 - kappa) (z'P z + 2 w'M w), is not negative.
    """
    more = max(own - kappa, 0.0) * np.maximum(M, 0.0)
    return Lyapunov(setting.system, P, _chosen(setting, M, T + more), kappa)


def _paced(at: Callable[[float], Lyapunov], fit: StableFit, min_rate: float) -> Lyapunov | None:
    """Return it at the rate with the smallest gains of the outputs, at least `min_rate` where there is one so fast."""
    start = at(0.0)
    if not start.is_sound:
        return None
    fastest, asked = max(fit.kappa, 2 * float(-np.linalg.eigvals(fit.A).real.max()), 1e-12), 2 * PROVED * min_rate
    falling = sorted([*(fastest / 1.5**k for k in range(HALVINGS)), fit.kappa, asked], reverse=True)
    kappa = next((rate for rate in falling if 0 < rate <= fastest and at(rate).is_sound), None)
    if kappa is None:
        return start
    rates = [share * kappa for share in RATES] + [asked] * (0 < asked < kappa)
    tried = [at(float(rounded(np.array([rate]))[0])) for rate in rates]
    sound = [one for one in tried if one.is_sound and np.isfinite(one.gamma)]
    fast = [one for one in sound if one.kappa >= 2 * min_rate]
    if not sound:
        return start
    return min(fast, key=lambda one: one.gamma / one.kappa) if fast else max(sound, key=lambda one: one.kappa)
