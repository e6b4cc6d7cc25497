"""Bounds of a model's outputs, added to the certificate of its dynamics; see docs/certificate-format.md, "Outputs"."""

from fractions import Fraction
from math import isfinite
from typing import Any

from flint import arb, ctx

from persid.certificates.certificate import Certificate
from persid.certificates.encoding import encode
from persid.errors import ModelError
from persid.lyapunov.sectors import steepest
from persid.models.outputs import OutputModel
from persid_check.claims import lower_bound
from persid_check.format import Stability, read_certificate
from persid_check.inequality import assemble
from persid_check.outputs import BITS, canonical_outputs, detached, least_constants, output_sha256

DIGITS = 53  # of a constant's mantissa


def with_outputs(certificate: Certificate, model: OutputModel) -> Certificate:
    """Return the certificate with a bound of every output; itself where its claim has no rate.

    Raises:
        RejectedError: the checker does not accept it: a map without a proved Lipschitz constant.
    """
    if certificate.rate is None:
        return certificate
    plain = detached(certificate.content)[0]
    claim = read_certificate(plain)
    form = canonical_outputs(model.to_dict(), model.dynamics.n, model.dynamics.m)
    maps = model.output_map
    block = {
        "sha256": output_sha256(model.to_dict()),
        **form,
        "constants": [_beyond(c) for c in _constants(claim, model)],
        "lipschitz": None if maps is None else [_above(Fraction(steepest(h.text))) for h in maps],
    }
    return Certificate.accept(encode(certificate.content | {"outputs": block}))


def refuse_steep_maps(model: OutputModel) -> None:
    """Refuse an output map whose slopes have no bound: then no bound of the state bounds the output.

    Raises:
        ModelError: there is one; it is named.
    """
    for name, h in zip(model.outputs, model.output_map or (), strict=False):
        if not isfinite(steepest(h.text)):
            raise ModelError(
                f"the output map {h.text} of {name} has no Lipschitz constant; certify its dynamics instead"
            )


def _constants(claim: Any, model: OutputModel) -> list[arb]:
    if not isinstance(claim, Stability):
        raise TypeError("not a certificate of stability")
    matrices = assemble(claim)
    below = lower_bound(claim, matrices) if claim.subject.claim == "R" else matrices.P
    return least_constants([tuple(Fraction(v) for v in row) for row in model.C.tolist()], below)


def _above(number: Fraction) -> list[int]:
    """Return the least dyadic [mantissa, exponent] of so many digits that is not smaller."""
    exponent, scaled = _scaled(number)
    return [-(-scaled.numerator // scaled.denominator), exponent]


def _beyond(ball: arb) -> list[int]:
    """Return the least dyadic of so many digits that is larger than every number of a ball."""
    with ctx.workprec(BITS[-1]):
        mantissa, power = ball.upper().man_exp()
    exponent, scaled = _scaled(Fraction(int(mantissa)) * Fraction(2) ** int(power))
    return [scaled.numerator // scaled.denominator + 1, exponent]


def _scaled(number: Fraction) -> tuple[int, Fraction]:
    """Return an exponent and the number over that power of two, which has so many digits; 0 counts as tiny."""
    exponent = number.numerator.bit_length() - number.denominator.bit_length() - DIGITS
    return exponent, number / Fraction(2) ** exponent
