"""What is asked of the certificate of a model of inputs and outputs: a rate of decay, and gains of the outputs."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy import ndarray

from persid.errors import DataError
from persid.identification.outputs.answer import Answer
from persid.verdicts.verdict import Verdict

WEIGHTS = (-6.0, 2.0)  # decimal logarithms of the ridge on B, C and D: no effect, and no gain
HALVINGS = 6  # of that range


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

    def met(self, answer: Answer, verdict_of: Callable[[Answer], Verdict]) -> Answer:
        """Return the answer, damped as little as its gains need; by halving the range of the ridge on B, C and D."""
        low, high = WEIGHTS
        best = answer
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            tried = answer.damped(10**middle)
            if tried.interrupted:
                return best
            if self.excess(verdict_of(tried)) <= 1:
                best, high = tried, middle
            else:
                low = middle
        return best
