"""certificates.tables."""

from typing import Any

from persid._html import table
from persid._text import above, below
from persid.models.tables import MOST_STATES


def of_certificate(certificate: Any) -> str:
    """Return what a certificate claims, in figures and in the checker's words."""
    rows = [("claim", certificate.claim), ("scope", certificate.scope)]
    if certificate.model.n <= MOST_STATES:
        rows.append(("operating point", ", ".join(f"{x:.5g}" for x in certificate.operating_point)))
    rows += [] if certificate.rate is None else [("rate, 1/s", below(certificate.rate))]
    left = getattr(certificate, "contraction", None)  # networks are certified in continuous time
    rows += [] if left is None else [("share left after a step", above(left))]
    rows += [] if certificate.gain is None else [("gain", above(certificate.gain))]
    outputs = getattr(certificate, "outputs", ())  # a network certificate bounds none
    if outputs:
        pairs = zip(outputs, certificate.output_gains, strict=True)
        rows += [(f"gain of {name}", above(gain)) for name, gain in pairs]
        loops = certificate.feedback_margins
        rows += (
            []
            if loops is None
            else [(f"feedback from {name} below", below(a)) for name, a in zip(outputs, loops, strict=True)]
        )
    return table("Certificate", (), [*rows, ("statement", certificate.statement)])
