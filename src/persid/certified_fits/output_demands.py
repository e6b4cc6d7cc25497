"""What is asked of the certificate of a model of inputs and outputs: a rate of decay, and gains of the outputs."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.models.stable_fit import StableFit
from persid.verdicts.verdict import Verdict

SAFE = 1 - 1e-9  # of the gain allowed, for what rounding adds


@dataclass(frozen=True, eq=False)
class Demand:
    """Ask for a rate (1/s), and for gains of the outputs in the unit of each per unit of the inputs, or for neither."""

    rate: float | None
    gains: Float[ndarray, " l"] | None

    @classmethod
    def of(cls, rate: float | int | None, gains: object, outputs: int) -> "Demand":
        """Read the options min_rate and max_output_gain.

        Raises:
            DataError: one is not positive, or there are more or fewer gains than outputs.
        """
        if rate is not None and not rate > 0:
            raise DataError(f"min_rate={rate:g} is not positive; give a rate in 1/s, or none")
        if gains is None:
            return cls(rate and float(rate), None)
        try:
            found = np.atleast_1d(np.asarray(gains, float))
        except (TypeError, ValueError):
            found = np.array([])
        if found.shape not in ((1,), (outputs,)) or not (found > 0).all():
            raise DataError(
                f"max_output_gain= is {gains}; give a positive number, or one for each of the outputs ({outputs})"
            )
        return cls(rate and float(rate), np.broadcast_to(found, outputs))

    def missed(self, verdict: Verdict, outputs: tuple[str, ...]) -> Iterator[str]:
        """Name what a verdict does not give."""
        certificate = getattr(verdict, "certificate", None)
        rate, gains = getattr(certificate, "rate", None), getattr(certificate, "output_gains", None)
        if self.rate is not None and not (rate or 0.0) >= self.rate:
            have = "none" if rate is None else f"{rate:.4g}"
            yield f"a rate of {self.rate:.4g} 1/s was asked for; certified is {have}"
        if self.gains is not None and not self.excess(verdict) <= 1:
            found = ["none"] * len(outputs) if gains is None else [f"{gain:.4g}" for gain in gains]
            pairs = (
                f"{name} {have} (asked {want:.4g})" for name, have, want in zip(outputs, found, self.gains, strict=True)
            )
            yield f"gains of outputs are larger than asked for: {', '.join(pairs)}"

    def excess(self, verdict: Verdict) -> float:
        """Return the largest share of a certified gain in what is allowed."""
        found = getattr(getattr(verdict, "certificate", None), "output_gains", None)
        return 0.0 if self.gains is None else np.inf if found is None else float((found / self.gains).max())

    def met(self, fit: StableFit, verdict: Verdict, share: float = SAFE) -> StableFit:
        """Return the fit with C and D of every output scaled to that share of the gain allowed; its mean stays.

        The gain of an output is linear in its rows of C and D, so that this is exact.
        """
        certificate = getattr(verdict, "certificate", None)
        if self.gains is None or certificate is None or certificate.output_gains is None:
            return fit
        scale = np.minimum(1.0, share * self.gains / certificate.output_gains)[:, None]
        d = fit.d + ((1 - scale) * fit.C) @ fit.x_mean
        return replace(fit, C=scale * fit.C, D=scale * fit.D, d=d)
