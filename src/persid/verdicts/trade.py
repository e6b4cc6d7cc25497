"""Rate against gain: a few certificates to choose from, each with the smallest gain that is found at its rate."""

from typing import Unpack

import numpy as np

from persid.certificates.certificate import Certificate
from persid.errors import ModelError
from persid.models.model import PersidskiiModel
from persid.models.outputs import OutputModel
from persid.verdicts.certify import certify
from persid.verdicts.log import Progress
from persid.verdicts.options import Asked
from persid.verdicts.verdict import Certified

COUNT = 5


def rates_and_gains(
    model: PersidskiiModel | OutputModel,
    count: int = COUNT,
    *,
    progress: Progress | None = None,
    **question: Unpack[Asked],
) -> tuple[Certificate, ...]:
    """Return certificates of a model from the smallest gain to the best rate, both rising from one to the next.

    Slower rates than that of the smallest gain are left out: nothing is bought by them. Each is an accepted proof.

    Args:
        model: as for `certify`.
        count: how many rates are asked about, at least 2; those that bring nothing are left out.
        progress: is called with a line of text at each step.
        question: further arguments of `certify`, but for `rate`; the time limit is for each rate.

    Returns:
        The certificates, none where no rate is proved.

    Raises:
        ModelError: count is less than 2, or an argument does not fit the model.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])
        >>> curve = ps.rates_and_gains(model, count=3)
        >>> all(a.rate < b.rate and a.gain < b.gain for a, b in zip(curve, curve[1:]))
        True
    """
    if count < 2:
        raise ModelError(f"count is {count}; needed are 2 rates at least, the gentlest and the best")
    verdict = certify(model, progress=progress, **question)
    if not isinstance(verdict, Certified) or not isinstance(verdict.certificate, Certificate):
        return ()
    first, last = verdict.certificate, verdict.fastest
    if first.rate is None:
        return ()
    found = [first] if last is None or last.rate is None else [first, last]
    between = np.linspace(first.rate, found[-1].rate or 0.0, count)[1:-1] if len(found) == 2 else ()
    for rate in between:
        answer = certify(model, rate=float(rate), progress=progress, **question)
        if isinstance(answer, Certified) and isinstance(answer.certificate, Certificate):
            found.append(answer.certificate)
    return _worth_having(found)


def _worth_having(found: list[Certificate]) -> tuple[Certificate, ...]:
    """Return the certificates for which no other one has at least their rate and no larger gain, in order."""
    kept: list[Certificate] = []
    for each in sorted(found, key=lambda one: (-(one.rate or 0.0), _gain(one))):
        if not kept or _gain(each) < _gain(kept[-1]):
            kept.append(each)
    return tuple(reversed(kept))


def _gain(certificate: Certificate) -> float:
    """Return the gain, or the largest one of the outputs."""
    outputs = certificate.output_gains
    return float(outputs.max()) if outputs is not None else float(certificate.gain or 0.0)
