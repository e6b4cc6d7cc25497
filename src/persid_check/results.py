"""What a check answers: accepted, rejected or malformed; and the two exceptions that carry a refusal to the border."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Accepted:
    """The claim is proved. `statement` is the checker's own sentence of what was proved; `steps` explain the proof.

    `claim` is a word: "iss", "rate-and-gain", "region", "practical", "refuted", "infeasible", or for networks "L1" and
    "L1-infeasible". `further` names what holds beyond it: "incremental" (between any two solutions) and "everywhere"
    (about every equilibrium of every constant input, with the same numbers), "members" (the same of every model with
    coefficients within the deviations, about its own equilibria), "feedback" (how much of an output may come back to
    the inputs).

    Examples:
        >>> certificate = ps.certify(ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])).certificate
        >>> persid_check.check(certificate.data).claim == certificate.claim
        True
    """

    claim: str
    statement: str
    steps: tuple[str, ...] = ()
    further: tuple[str, ...] = ()


@dataclass(frozen=True)
class Rejected:
    """The file is well formed and its claim is not proved: `where` names the place, `why` the reason.

    Examples:
        >>> certificate = ps.certify(ps.PersidskiiModel(A0=[[-1.0]], B=[[1.0]])).certificate
        >>> forged = certificate.data.replace(b'"dropped": []', b'"dropped": [0]')
        >>> isinstance(persid_check.check(forged), persid_check.Accepted)
        False
    """

    where: str
    why: str


@dataclass(frozen=True)
class Malformed:
    """The file is not a certificate of the specified format: `where` names the place, `why` the reason.

    Examples:
        >>> persid_check.check(b"[]")
        Malformed(where='format', why='persid-certificate-2, or a known claim of an earlier format, is needed')
    """

    where: str
    why: str


Result = Accepted | Rejected | Malformed


class FormatError(ValueError):
    """Text or an object is not of the specified format; the message names the place."""

    def __init__(self, where: str, why: str) -> None:
        super().__init__(f"{where}: {why}")
        self.where, self.why = where, why


class NotProvedError(Exception):
    """A step of the proof fails; caught by `check`, which answers Rejected."""

    def __init__(self, where: str, why: str) -> None:
        super().__init__(f"{where}: {why}")
        self.where, self.why = where, why


def require(holds: object, where: str, why: str) -> None:
    """Refuse a proof of which a step does not hold.

    Raises:
        NotProvedError: it does not.
    """
    if not holds:
        raise NotProvedError(where, why)
