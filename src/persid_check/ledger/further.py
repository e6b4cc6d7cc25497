"""What is said beside a claim where its hypotheses hold: further sentences (docs/ledger.md, section 7)."""

from fractions import Fraction

from persid_check.ledger.values import RISING, Curve, Form, Ledger, Output

_HALF, _ONE = Fraction(1, 2), Fraction(1)


def further(ledger: Ledger, kept: tuple[int, ...]) -> tuple[str, ...]:
    """Return the names of what holds beside the claim, whose matrix has these rows."""
    found = {
        "incremental": not ledger.deviations and forgets(ledger),
        "everywhere": not ledger.deviations and _knows_no_centre(ledger, kept),
        "members": holds_of_members(ledger, kept),
        "feedback": _has_feedback(ledger),
    }
    return tuple(name for name, holds in found.items() if holds)


def _used(ledger: Ledger) -> list[tuple[Curve, Form]]:
    """Return the forms of value facts and densities that count, with their curves."""
    found = []
    for fact in ledger.facts:
        if fact.tau and fact.kind == "value":
            curve = ledger.curves[ledger.points[fact.p].curve]
            found += [(curve, curve.forms[k]) for k in (fact.k, fact.l)]
    for point in ledger.points:
        curve = ledger.curves[point.curve]
        found += [(curve, curve.forms[k]) for k, mu in point.densities if mu]
    return found


def _only_values(ledger: Ledger) -> bool:
    return not ledger.inside and not ledger.identity and all(fact.kind == "value" for fact in ledger.facts if fact.tau)


def _has_feedback(ledger: Ledger) -> bool:
    """Section 7, feedback: outputs of a model alone that inputs move, with one gain for all its inputs."""
    if ledger.outputs is None or ledger.deviations or ledger.counts_b or not isinstance(ledger.gamma, Fraction):
        return False
    moved = any(is_moved(ledger, output) for output in ledger.outputs.listed)
    return ledger.claim == "rate-and-gain" and ledger.inputs > 0 and moved


def is_moved(ledger: Ledger, output: Output) -> bool:
    """Whether the gain that is proved of an output is more than 0."""
    return bool(output.steepness and ((output.constant and ledger.gamma) or any(output.direct)))


def forgets(ledger: Ledger) -> bool:
    """Whether the matrix is one of differences of two solutions: V = x'P x and nondecreasing forms."""
    if ledger.claim != "rate-and-gain" or not _only_values(ledger):
        return False
    no_density = not any(mu for point in ledger.points for _, mu in point.densities)
    return no_density and all(form.kind in RISING for _, form in _used(ledger))


def holds_of_members(ledger: Ledger, kept: tuple[int, ...]) -> bool:
    """Whether the claim is one about the equilibria of every model with coefficients within the deviations."""
    read = {i for deviation in ledger.deviations for row in deviation.C for i, value in row.items() if value}
    return bool(ledger.deviations) and not read & set(ledger.dropped) and _knows_no_centre(ledger, kept)


def _knows_no_centre(ledger: Ledger, kept: tuple[int, ...]) -> bool:
    """Whether nothing in the proof depends on the point."""
    n = ledger.model.order
    if ledger.claim not in ("iss", "rate-and-gain") or not _only_values(ledger) or len([i for i in kept if i < n]) < n:
        return False
    return all(form.kind in RISING and _keeps_bounds(curve, form) for curve, form in _used(ledger))


def _keeps_bounds(curve: Curve, form: Form) -> bool:
    """Whether the bounds of the integral hold about every centre: by monotony alone."""
    least = _ONE if any(form.l[1:]) or form.l[0] < 0 else _HALF
    if form.upper is not None and form.upper.c < least:
        return False
    return form.lower is None or curve.forms[form.lower[1]].kind in RISING
