"""verdicts.verdict."""

from dataclasses import dataclass
from enum import Enum
from typing import NoReturn

from persid.certificates.certificate import Certificate
from persid.certificates.obstruction import Obstruction
from persid.certificates.witness import Witness
from persid.networks.certificate import NetworkCertificate, NetworkObstruction
from persid.verdicts.evidence import Evidence


class Reason(Enum):
    """Why a model stays undecided, as a full sentence."""

    INFEASIBLE = "It is proved that no certificate exists in the family of Lyapunov functions that was searched."
    NOT_FOUND = "The search found no Lyapunov function."
    ROUNDING = "A Lyapunov function was found in floating point, but its margin was lost in exact arithmetic."
    FORM = "A property of the functions that a proof needs could not be proved."
    STALLED = "The solver stalled before the sign of the margin was decided."
    TIME = "The time limit was reached before the sign of the margin was decided."
    INTERRUPTED = "The search was interrupted."
    OUTSIDE = "The model is outside the theory."


@dataclass(frozen=True)
class Attempt:
    """One attempt at a verdict: what was tried, how it ended, and the seconds it took."""

    what: str
    outcome: str
    seconds: float


class _Verdict:
    """What the three verdicts share; a verdict is no truth value, since a refuted model would count as true."""

    attempts: tuple[Attempt, ...]

    def __bool__(self) -> NoReturn:
        raise TypeError("a verdict is not true or false; ask verdict.is_certified, or match its class")

    def _repr_html_(self) -> str:
        from persid.verdicts.tables import of_verdict

        return of_verdict(self)

    @property
    def is_certified(self) -> bool:
        """Whether the model is certified."""
        return isinstance(self, Certified)

    @property
    def seconds(self) -> float:
        """Time spent on all attempts, in s."""
        return sum(attempt.seconds for attempt in self.attempts)


@dataclass(frozen=True, eq=False)
class Certified(_Verdict):
    """The model is input-to-state stable: `certificate` is a proof that `persid_check` has accepted."""

    certificate: Certificate | NetworkCertificate
    attempts: tuple[Attempt, ...] = ()

    def __str__(self) -> str:
        return f"Certified: {self.certificate.statement}"


@dataclass(frozen=True, eq=False)
class Refuted(_Verdict):
    """The model is not input-to-state stable: `witness` is a proof that `persid_check` has accepted."""

    witness: Witness
    attempts: tuple[Attempt, ...] = ()

    def __str__(self) -> str:
        return f"Refuted: {self.witness.sentence}"


@dataclass(frozen=True, eq=False)
class Undecided(_Verdict):
    """Neither a proof nor a witness was found; `reason` is a full sentence, `detail` what it was about and what to try.

    `obstruction` proves the reason where it is INFEASIBLE; it does not refute stability. `evidence` tells what a few
    simulations did; it neither proves nor refutes anything.
    """

    reason: Reason
    detail: str = ""
    attempts: tuple[Attempt, ...] = ()
    obstruction: Obstruction | NetworkObstruction | None = None
    evidence: Evidence | None = None

    def __str__(self) -> str:
        parts = (self.reason.value, self.detail, str(self.evidence or ""))
        return "Undecided: " + " ".join(part for part in parts if part)


Verdict = Certified | Refuted | Undecided
