"""What a verdict says, in words for people and as one object for programs."""

import math
from dataclasses import asdict, dataclass

from persid._files import Json
from persid._text import above, below, pace
from persid.certificates.certificate import Certificate
from persid.certificates.margin import Margin
from persid.models.model import PersidskiiModel
from persid.verdicts.verdict import RATED, RATED_STATES, Certified, Reason, Refuted, Undecided, Verdict

LISTED_STATES = 1000  # the operating point of a larger model is not listed
NO_PLANT = (
    "It is about the model, not about the plant that was measured: how far the two agree is a question for the "
    "comparison with the measurements."
)
ASSUMED = (
    "That the plant that was measured is one of those certified with the model is not proved: what the data say about "
    "it is an estimate."
)


@dataclass(frozen=True)
class Summary:
    """A verdict in brief. `rate` in 1/s and `gain` (state units over input units) are those of the certificate.

    `best_rate` in 1/s is the best one that is proved, by this certificate or by another one with a larger gain.
    `output_gains` are those of the outputs of an output model, in their own units, in place of `gain`.
    `feedback_margins` are how strong an unmodelled feedback from each output may be, in its inverse units.
    `residual_margin` has the numbers of `Margin`: delta (1/s) of the plants that are certified too, largest, radius,
    resting, the width of each state, and the equations that are known.
    `evidence` is what simulations did where a verdict is undecided: runs, diverged, and x0 and time (s) of the first.
    """

    verdict: str
    claim: str | None = None
    scope: str | None = None
    operating_point: list[float] | None = None
    reason: str | None = None
    rate: float | None = None
    gain: float | None = None
    seconds: float = 0.0
    evidence: Json | None = None
    output_gains: dict[str, float] | None = None
    best_rate: float | None = None
    residual_margin: Json | None = None
    feedback_margins: dict[str, float | None] | None = None

    def to_dict(self) -> Json:
        """Return the object that `--json` prints; `from_dict` is the way back."""
        return asdict(self)

    @classmethod
    def from_dict(cls, data: Json) -> "Summary":
        """Return what `to_dict` was called on."""
        return cls(**data)


def summarize(verdict: Verdict) -> Summary:
    """Return the brief of a verdict of `persid.verdicts.certify`."""
    name = type(verdict).__name__.lower()
    seconds = round(math.fsum(attempt.seconds for attempt in verdict.attempts), 3)
    if isinstance(verdict, Certified):
        return _certified(name, verdict, seconds)
    evidence = verdict.evidence.to_dict() if isinstance(verdict, Undecided) and verdict.evidence else None
    return Summary(name, reason=str(verdict).partition(": ")[2], seconds=seconds, evidence=evidence)


def _certified(name: str, verdict: Certified, seconds: float) -> Summary:
    certificate, gains, loops = verdict.certificate, None, None
    if isinstance(certificate, Certificate) and certificate.output_gains is not None:
        gains = dict(zip(certificate.outputs, certificate.output_gains.tolist(), strict=True))
        loops = _feedback(certificate)
    large = certificate.model.n > LISTED_STATES
    return Summary(
        verdict=name,
        claim=certificate.claim,
        scope=certificate.scope,
        operating_point=None if large else [float(x) for x in certificate.operating_point],
        rate=certificate.rate,
        gain=certificate.gain,
        seconds=seconds,
        output_gains=gains,
        best_rate=verdict.best_rate,
        residual_margin=None if verdict.margin is None else margin_facts(verdict.margin),
        feedback_margins=loops,
    )


def _feedback(certificate: Certificate) -> dict[str, float | None] | None:
    """Return the feedback margins by the names of the outputs, None for one that inputs do not reach."""
    margins = certificate.feedback_margins
    if margins is None:
        return None
    limits = [a if math.isfinite(a) else None for a in margins.tolist()]
    return dict(zip(certificate.outputs, limits, strict=True))


def margin_facts(margin: Margin) -> Json:
    """Return the numbers of a residual margin, widths by the names of the states."""
    states = margin.certificate.model.states
    return {
        "delta": margin.delta, "largest": margin.largest, "radius": margin.radius, "resting": margin.resting,
        "width": dict(zip(states, margin.width.tolist(), strict=True)), "known": list(margin.known),
    }  # fmt: skip


def plants(margin: Margin, unit: str = "s", seconds: float = 1.0) -> tuple[str, str, str]:
    """Return in three clauses which plants are certified with a model, what no margin can exceed, and what is assumed.

    `unit` is a unit of time of so many `seconds`.
    """
    units = "in half widths of the data" if margin.certificate.model.domain is not None else "in the states' units"
    exact = f"; {', '.join(margin.known)} known exactly" if margin.known else ""
    delta, largest, radius, rests = (v * seconds for v in (margin.delta, margin.largest, margin.radius, margin.resting))
    shares = f"{100 * largest / radius:.0f} % of the complex stability radius {radius:.4g}"
    return (
        f"certified too: every plant x' = F(x, u) + g with |g| <= {below(delta)} 1/{unit} |x - x*| ({units}{exact})",
        f"largest number found {largest:.4g}, {shares}; beyond {rests:.4g} such a plant may rest elsewhere",
        "that yours is one of them is not proved",
    )


def in_the_long_run(verdict: Certified, unit: str = "s") -> str:
    """Return in one clause what a certificate says of every run, its numbers rounded outwards, rates per `unit`."""
    certificate = verdict.certificate
    start = "from every start in the certified region" if certificate.scope == "regional" else "from every start"
    if isinstance(certificate, Certificate) and certificate.claim == "practical":
        return f"{start} {_ball(certificate)}"
    if not certificate.model.m and not certificate.counts_b:
        speed = "" if certificate.rate is None else f", at {pace(certificate.rate, unit)} 1/{unit} at least"
        return f"{start} its state goes to x*{speed}"
    if certificate.gain is not None and not certificate.counts_b:
        limit = certificate.input_bound if isinstance(certificate, Certificate) else None
        sizes = "" if limit is None else f" while |u - u*| stays below {below(limit)}"
        size = f"at most {above(certificate.gain)} times the largest |u - u*|"
        return f"{start}{sizes}, after transients its distance from x* is {size}"
    return f"{start} and under every bounded input its state stays bounded"


def _ball(certificate: Certificate) -> str:
    """Return in words the ball about x_ref that a practical claim speaks of."""
    inputs = f" and {above(certificate.gain or 0.0)} times the largest |u - u_ref|" if certificate.model.m else ""
    return f"its state comes into a ball about x_ref of radius {above(certificate.spread or 0.0)}{inputs}"


def attempt_rows(verdict: Verdict) -> list[tuple[str, str, str]]:
    """Return every attempt of a verdict as a row: what was tried, how it ended, and its seconds."""
    return [(one.what, one.outcome, f"{one.seconds:.2f} s") for one in verdict.attempts]


_ABOUT_EQUATIONS = (
    "What is refuted is that the equations say, for all states and inputs, what the algebraic variables are: "
    'instability is not claimed, and near an equilibrium a region, domain="auto", may still be certified.'
)
_REFUTED = (
    "What is refuted is stability from all initial states: in a region around one of its equilibria the model may "
    "still be stable, and another fit to the same measurements may be stable everywhere."
)
_UNDECIDED = (
    "Undecided is not unstable: neither a proof nor a counterexample was found, and another fit, more time or another "
    "kind of proof may decide it."
)
_CONSTANT = (
    "The constant b counts as one more input: it does not say that the state settles at x_ref, only that it stays "
    "within a distance of x_ref that depends on b and on u - u_ref."
)
_BEYOND = (
    "It holds for the model beyond the range of the measurements too, where nothing has compared the model with the "
    "plant."
)
_OUTSIDE = "It says nothing about starts outside the region."


def limits(verdict: Verdict, model: PersidskiiModel) -> tuple[str, ...]:
    """Return what a verdict does not claim, one sentence each."""
    if isinstance(verdict, Refuted):
        return (_ABOUT_EQUATIONS if verdict.witness.is_about_equations else _REFUTED, NO_PLANT)
    if not isinstance(verdict, Certified):
        return (_UNDECIDED, NO_PLANT)
    certificate, why = verdict.certificate, unrated(verdict)
    unrated_by = f"It gives no number for how fast the start is forgotten or how strongly inputs act: {why}."
    said = {
        NO_PLANT: True,
        ASSUMED: verdict.margin is not None,
        _CONSTANT: certificate.counts_b,
        unrated_by: why is not None,
        _BEYOND: model.domain is not None and certificate.scope == "global",
        _OUTSIDE: certificate.scope == "regional",
    }
    return tuple(sentence for sentence, holds in said.items() if holds)


_UNRATED = {
    Reason.TIME: "the time limit was reached",
    Reason.OUTSIDE: "the linearisation at the operating point shows no exponential decay",
    Reason.ROUNDING: "the margin of the one that was found was lost in exact arithmetic",
    Reason.FORM: "a property of the functions that they need could not be proved",
    Reason.MEMORY: "their matrices need more memory than there is",
    Reason.STALLED: "the solver stalled while they were sought",
}


def unrated(verdict: Certified) -> str | None:
    """Return in one clause why a certificate gives neither rate nor gain; None where it gives them."""
    certificate = verdict.certificate
    if certificate.rate is not None:
        return None
    if isinstance(certificate, Certificate) and certificate.stated.drops_states:
        return "a state is dropped from the inequality, and a rate needs every state in it"
    outcome = next((one.outcome for one in reversed(verdict.attempts) if one.what == RATED), None)
    if outcome is not None:
        return _UNRATED.get(Reason.__members__.get(outcome.upper(), Reason.NOT_FOUND), "none were found")
    if certificate.model.n > RATED_STATES:
        return f"they are sought for up to {RATED_STATES} states, and the model has {certificate.model.n}"
    searched = any(one.what.startswith("global Lyapunov function") for one in verdict.attempts)
    return "no time was left to seek them" if searched else "none were asked for, or found"
