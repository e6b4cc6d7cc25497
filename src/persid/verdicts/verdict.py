"""Verdicts: certified, refuted, or undecided with its reason, and how each was reached."""

from dataclasses import asdict, dataclass
from enum import Enum
from typing import NoReturn

from persid._files import Json
from persid._html import table
from persid._text import above, below
from persid.certificates.certificate import Certificate
from persid.certificates.margin import Margin
from persid.certificates.obstruction import Obstruction
from persid.certificates.witness import Witness
from persid.networks.certificate import NetworkCertificate, NetworkObstruction
from persid.verdicts.evidence import Evidence

RATED = "rate and gain"  # the attempt that seeks them
RATED_STATES = 100  # they are sought up to this many states, and on a device whatever their number
_REGIONAL = (
    "Certified: the model is input-to-state stable in a region around its operating point; from every start "
    "inside it and for small enough inputs the state stays inside, in the long run within a distance of the "
    "operating point that the inputs alone decide."
)
_GLOBAL = (
    "Certified: the model is input-to-state stable, globally; from every initial state and for every bounded input "
    "its state stays bounded, in the long run within a distance of the operating point that the inputs alone "
    "decide."
)
_PRACTICAL = (
    "Certified: the model is practically stable, globally; from every initial state and for every bounded input its "
    "state comes into a ball about x_ref, in the long run no farther from there than {} and what the inputs add. It is "
    "not said that it comes to rest."
)
_WITHOUT_INPUTS = "Certified: the model is globally stable; from every initial state it goes to its operating point."


class Reason(Enum):
    """Why a model stays undecided, as a full sentence."""

    INFEASIBLE = "It is proved that no certificate exists in the family of Lyapunov functions that was searched."
    NOT_FOUND = "The search found no Lyapunov function."
    ROUNDING = "A Lyapunov function was found in floating point, but its margin was lost in exact arithmetic."
    FORM = "A property of the functions that a proof needs could not be proved."
    STALLED = "The solver stalled before the sign of the margin was decided."
    TIME = "The time limit was reached before the sign of the margin was decided."
    MEMORY = "The matrices of the search need more memory than there is."
    INTERRUPTED = "The search was interrupted."
    OUTSIDE = "The model is outside the theory."


@dataclass(frozen=True)
class Attempt:
    """One attempt at a verdict: what was tried, how it ended, and the seconds it took."""

    what: str
    outcome: str
    seconds: float

    def to_dict(self) -> Json:
        """Return it as an object of JSON; `from_dict` is the way back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Json) -> "Attempt":
        """Return what `to_dict` was called on."""
        return cls(**data)


class _Verdict:
    """What the three verdicts share; a verdict is no truth value, since a refuted model would count as true."""

    attempts: tuple[Attempt, ...]

    def __bool__(self) -> NoReturn:
        raise TypeError("a verdict is not true or false; ask verdict.is_certified, or match its class")

    @property
    def headline(self) -> str:
        """The verdict as one sentence for a person who has never met the theory; evidence is no part of it."""
        return str(self)

    def _figures(self) -> list[tuple[str, str]]:
        return []

    def _repr_html_(self) -> str:
        tried = [(one.what, f"{one.outcome.replace('_', ' ')}, {one.seconds:.3g} s") for one in self.attempts]
        return table(type(self).__name__, (), [("verdict", self.headline), *self._figures(), *tried])

    @property
    def is_certified(self) -> bool:
        """Whether the model is certified."""
        return isinstance(self, Certified)

    @property
    def proof(self) -> Certificate | NetworkCertificate | Witness | Obstruction | NetworkObstruction | None:
        """What the checker has accepted: a certificate, a witness, or that no certificate of some family exists."""
        return None

    @property
    def seconds(self) -> float:
        """Time spent on all attempts, in s."""
        return sum(attempt.seconds for attempt in self.attempts)


@dataclass(frozen=True, eq=False)
class Certified(_Verdict):
    """The model is input-to-state stable: `certificate` is a proof that `persid_check` has accepted.

    `fastest` is another one, of the best rate that was proved: a smaller rate buys a smaller gain. None where
    `certificate` has that rate itself, or where none is proved.
    `margin` says of which plants near the model the same is proved; None where it was not sought, or not found.

    Examples:
        >>> verdict = ps.certify(ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]]))
        >>> isinstance(verdict, ps.Certified)
        True
    """

    certificate: Certificate | NetworkCertificate
    attempts: tuple[Attempt, ...] = ()
    fastest: Certificate | None = None
    margin: Margin | None = None

    def __str__(self) -> str:
        return f"Certified: {self.certificate.statement}"

    @property
    def best_rate(self) -> float | None:
        """The best proved rate in 1/s, that of `fastest` or of the certificate; None where there is none."""
        return self.certificate.rate if self.fastest is None else self.fastest.rate

    @property
    def proof(self) -> Certificate | NetworkCertificate:
        """The certificate."""
        return self.certificate

    @property
    def headline(self) -> str:
        """The verdict as one sentence for a person who has never met the theory."""
        proof = self.certificate
        if proof.scope == "regional":
            return _REGIONAL
        if isinstance(proof, Certificate) and proof.claim == "practical":
            return _PRACTICAL.format(above(proof.spread or 0.0))
        return _GLOBAL if proof.model.m or proof.counts_b else _WITHOUT_INPUTS

    def _figures(self) -> list[tuple[str, str]]:
        proof = self.certificate
        rate = [] if proof.rate is None else [("rate, 1/s", below(proof.rate))]
        gain = [] if proof.gain is None else [("gain", above(proof.gain))]
        best = [] if self.fastest is None else [("best proved rate, 1/s", below(self.best_rate or 0.0))]
        near = [] if self.margin is None else [("plants within, 1/s", below(self.margin.delta))]
        return [("claim", proof.claim), *rate, *best, *gain, *near]


@dataclass(frozen=True, eq=False)
class Refuted(_Verdict):
    """The model is not input-to-state stable: `witness` is a proof that `persid_check` has accepted.

    Of a model with algebraic variables it may say that their equations have several solutions: it is not well-posed.

    Examples:
        >>> verdict = ps.certify(ps.PersidskiiModel(A0=[[1.0]], B=[[1.0]]))
        >>> verdict.witness.kind
        'unstable-equilibrium'
    """

    witness: Witness
    attempts: tuple[Attempt, ...] = ()

    def __str__(self) -> str:
        return f"Refuted: {self.witness.sentence}"

    @property
    def proof(self) -> Witness:
        """The witness."""
        return self.witness


@dataclass(frozen=True, eq=False)
class Undecided(_Verdict):
    """Neither a proof nor a witness was found; `reason` is a full sentence, `detail` what it was about and what to try.

    `obstruction` proves the reason where it is INFEASIBLE; it does not refute stability. `evidence` tells what a few
    simulations did; it neither proves nor refutes anything.

    Examples:
        >>> model = ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])
        >>> verdict = ps.certify(model, time_limit=0)
        >>> verdict.reason.name
        'TIME'
    """

    reason: Reason
    detail: str = ""
    attempts: tuple[Attempt, ...] = ()
    obstruction: Obstruction | NetworkObstruction | None = None
    evidence: Evidence | None = None

    def to_dict(self) -> Json:
        """Return what was found as an object of JSON; an obstruction is a file of its own."""
        return {
            "verdict": "undecided",
            "reason": self.reason.name,
            "sentence": self.reason.value,
            "detail": self.detail,
            "evidence": self.evidence and self.evidence.to_dict(),
            "attempts": [attempt.to_dict() for attempt in self.attempts],
        }

    @classmethod
    def from_dict(cls, data: Json, obstruction: Obstruction | NetworkObstruction | None) -> "Undecided":
        """Return what `to_dict` was called on, with the obstruction that was read beside it.

        Raises:
            KeyError: a field is missing, or the reason is none that is known.
        """
        evidence, attempts = data["evidence"], tuple(map(Attempt.from_dict, data["attempts"]))
        seen = None if evidence is None else Evidence.from_dict(evidence)
        return cls(Reason[data["reason"]], data["detail"], attempts, obstruction, seen)

    def __str__(self) -> str:
        parts = (self.reason.value, self.detail, str(self.evidence or ""))
        return "Undecided: " + " ".join(part for part in parts if part)

    @property
    def proof(self) -> Obstruction | NetworkObstruction | None:
        """The obstruction, where there is one; it proves the reason and does not refute stability."""
        return self.obstruction

    @property
    def headline(self) -> str:
        """The verdict as one sentence; the evidence beside it is no part of it."""
        return f"Undecided: {self.reason.value} {self.detail}".rstrip()

    def _figures(self) -> list[tuple[str, str]]:
        return [("evidence", str(self.evidence))] if self.evidence else []


Verdict = Certified | Refuted | Undecided
