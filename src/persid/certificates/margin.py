"""The residual margin of a certified model: how wrong it may be, and the certificate of every plant so near to it."""

from dataclasses import dataclass, replace
from fractions import Fraction

from jaxtyping import Float
from numpy import ndarray

from persid.certificates.bounds import below
from persid.certificates.certificate import Certificate
from persid.certificates.stability import with_constant


@dataclass(frozen=True, eq=False)
class Margin:
    """Every plant x' = F(x, u) + g with |g / width| <= delta |(x - x*) / width| is certified by `certificate`.

    `largest` is the largest delta (1/s) that the search found. Two numbers bound every delta from above: `radius`, the
    complex stability radius of the linearisation, and `resting`, the least |F(x, u*)| / |x - x*| found, in the same
    units; beyond them such a plant may be unstable, or rest elsewhere. `width` (n,) has half the widths of the data, or
    1; g is 0 in the equations of the states `known`. That a plant obeys the bound is assumed, not proved.

    Examples:
        >>> verdict = ps.certify(ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]]))
        >>> 0.8 < verdict.margin.delta < verdict.margin.largest <= verdict.margin.radius
        True
    """

    largest: float
    radius: float
    resting: float
    width: Float[ndarray, " n"]
    known: tuple[str, ...]
    certificate: Certificate

    def with_constant(self, epsilon: float) -> "Margin":
        """Return the same for plants with |g / width|^2 <= delta^2 |(x - x*) / width|^2 + epsilon^2, epsilon in 1/s.

        Raises:
            RejectedError: the region is not invariant then: epsilon is too large.
        """
        return replace(self, certificate=with_constant(self.certificate, epsilon))

    @property
    def epsilon(self) -> float:
        """The epsilon (1/s) of the certificate, rounded down."""
        return below(self.certificate.stated.deviations[0].epsilon)

    @property
    def delta(self) -> float:
        """The delta (1/s) of the certificate, read off its exact numbers and rounded down."""
        (deviation,) = self.certificate.stated.deviations
        return below(min(Fraction(self.width[i]) * value for row in deviation.C for i, value in row.items()))
