"""Failures: why an attempt found no certificate, in words that say what to try."""

from collections.abc import Sequence
from dataclasses import dataclass

from persid.certificates.obstruction import Obstruction
from persid.lyapunov.interior_point import Status
from persid.networks.certificate import NetworkObstruction
from persid.verdicts.verdict import Reason
from persid_check.model import MAX_CHANNELS, MAX_STATES


@dataclass(frozen=True, eq=False)
class Failure:
    """Why an attempt found no certificate."""

    reason: Reason
    detail: str
    obstruction: Obstruction | NetworkObstruction | None = None


LARGE = "It is a weighted l1 norm; for other Lyapunov functions a model of at most 400 states is needed."
TOO_LARGE = (
    f"The checker reads at most {MAX_STATES:,} states, as many inputs and {MAX_CHANNELS:,} functions of them in a "
    "dense model. A network of sparse matrices may be larger."
)
TRY = "Fit with more ridge or fewer functions, or ask for a regional claim."
NO_POINT = "No equilibrium at the nominal input was found and proved; name a state near it, or another input (u_op)."
UNDEFINED = (
    "It is not proved that {} is defined and continuous for all states, which a global claim needs; ask for a region"
    ' where it is: domain="auto", domain="data", or a box [[lo, hi], …].'
)
UNDEFINED_IN_BOX = "It is not proved that {} is defined and continuous in the whole box; give a smaller one."
NO_SLOPE = "A slope at the operating point is not finite, or not known in floating point."
SMALLER = "A smaller box about the operating point, or fewer functions, may allow one."
NO_GROWTH = (
    "V was found to fall everywhere, but not to grow without bound in every direction: there act functions that are "
    "bounded, or grow on one side only, and no linear part. A region in a box does not need that growth."
)
UNPROVED = "Without it the search finds nothing: {}. Simpler functions, or a smaller box, are easier to prove."
NOT_RISING = (
    "That a form rises was seen on samples and not proved, so nothing is said of the difference of two solutions."
)
NO_DECAY = "The linearisation at the operating point is not exponentially stable."
NOT_SOLVABLE = (
    "It is not proved that the equations have exactly one solution for every state and input. A slope of a loop that "
    "reaches 1 gives them several: change the algebraic part, or bound its functions' slopes."
)
NOT_SOLVABLE_IN_BOX = (
    "It is not proved that the equations have exactly one solution in the whole box for every state in it. A smaller "
    'box may allow it, or one that the search chooses: domain="auto".'
)
NO_REACH = (
    "It was not found how far arguments of functions that read algebraic variables go in the region; "
    "another rate, or functions with bounded slopes, may allow it."
)
MEMORY = "Ask where there is more of it, or of a model with fewer states or functions."
NOT_INSIDE = "No equilibrium at the nominal input was found and proved inside the box."
NO_MARGIN = (
    "The margin is zero or close to it. Where a fit left it small, a little more ridge usually decides it. Where the "
    "decay weakens far out, as with a spring without a linear part or damping by a power, it is zero for every such "
    'function: ask for a region, domain="auto".'
)
STOPPED = {  # why nothing was found where a solver stopped so
    Status.INFEASIBLE: Failure(Reason.NOT_FOUND, TRY),
    Status.STALLED: Failure(Reason.STALLED, NO_MARGIN),
    Status.TIME: Failure(Reason.TIME, "Give more time (time_limit)."),
}


def not_defined(missing: Sequence[str], text: str = UNDEFINED) -> Failure:
    """Return that functions are not proved to be defined and continuous; the first four are named."""
    return Failure(Reason.OUTSIDE, text.format("; ".join(missing[:4])))


def stopped(status: Status) -> Failure:
    """Return why nothing was found where a search ended so."""
    return STOPPED.get(status, STOPPED[Status.STALLED])
