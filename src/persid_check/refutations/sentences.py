"""The checker's own sentences on refutations and obstructions: what was proved, and the steps of the proof."""

from collections.abc import Sequence

from persid_check.reading import Ball
from persid_check.refutations.format import POSED, Obstruction, Refutation
from persid_check.subject import Subject
from persid_check.words import SHOWN, equilibrium, explained, model_named, state_names, vector


def _model(subject: Subject) -> str:
    words = model_named(subject.model, subject.sha256)
    return f"{words[0].upper()}{words[1:]}"


def infeasibility(claim: Obstruction) -> str:
    """Return the sentence of claim "infeasible"."""
    count = sum(len(forms) for forms in claim.forms)
    P = "P >= 0" if claim.full else "a diagonal P >= 0 (diagonal P only)"
    return (
        f"{_model(claim.subject)} has no certificate of claim iss or rate-and-gain with {P}, with Lyapunov densities of"
        f" the {count} forms in the file and with in-group products of these forms and y."
        " This does not refute stability."
    )


def infeasibility_steps(claim: Obstruction) -> tuple[str, ...]:
    """Return the proof of claim "infeasible" as steps."""
    return (
        f"1. X = L L' with L of {len(claim.L)} rows and {len(claim.L[0])} columns is semidefinite by construction.",
        "2. <F, X> > 0 was proved exactly for the generators of P, every mu, every pair of forms and every (y, form).",
        "3. A certificate would give Q < 0, so <Q, X> <= 0, with Q a sum of these generators: a contradiction.",
    )


def refutation(claim: Refutation) -> str:
    """Return the sentence of claim "refuted"."""
    if claim.kind in POSED:
        return explained(f"{_model(claim.subject)} is not well-posed: {_unposed(claim)}. {_UNSAID}")
    u = f"the constant input u = {vector(claim.u)}"
    places = " and ".join(vector(point.x) for point in claim.points)
    line = f"s = {vector((claim.number,))}, v = {vector(claim.vector)}"
    reason = {
        "two-equilibria": f"at {u} it rests both near {places}",
        "unstable-equilibrium": f"at {u} it has an unstable equilibrium near {places}",
        "unstable-linear-part": "the functions that act are bounded and its linear part grows exponentially",
        "marginal-direction": f"some constant input drives w'x to infinity, w = {vector(claim.vector)}",
        "cooperative-growth": f"at {u} it never returns from {vector(claim.vector)} to its equilibrium near {places}",
        "invariant-line": f"at {u} a solution from x_ref + s v never returns to x_ref, {line}",
    }[claim.kind]
    about = (
        "any point for any input"
        if claim.kind in ("unstable-linear-part", "marginal-direction")
        else f"any point for {u}"
    )
    return explained(f"{_model(claim.subject)} is not input-to-state stable about {about}: {reason}.")


def _unposed(claim: Refutation) -> str:
    """Why the equations do not tell what their variables are."""
    model = claim.subject.model
    names = ", ".join(state_names(model.states)[model.order :][:SHOWN])
    if claim.kind == "free-direction":
        along = f"v = {vector(claim.vector)} of {names}"
        return f"its equations do not change along {along}, so for no x and u have they exactly one solution"
    x, (one, two) = claim.points[0].x[: model.order], (vector(point.x[model.order :]) for point in claim.points)
    return f"at x = {vector(x)} and u = {vector(claim.u)} its equations are solved by {names} near {one} and near {two}"


_UNSAID = "So no sentence that speaks of exactly one solution for every x and u is true; instability is not claimed."


def refutation_steps(claim: Refutation) -> tuple[str, ...]:
    """Return the proof of claim "refuted" as steps."""
    steps = ["The model's hash agrees, and every function is continuous on R."]
    of = claim.subject.model.algebraic
    steps += [f"Proved: {equilibrium(point, '(x*, w*)' if of else 'x*')}." for point in _resting(claim)]
    special = (_WITNESS_OF_STEPS if claim.subject.model.is_discrete else {}) | (_WITNESS_OF_EQUATIONS if of else {})
    steps.append((_WITNESS | special)[claim.kind])
    return tuple(f"{i}. {step}" for i, step in enumerate(steps, start=1))


def _resting(claim: Refutation) -> Sequence[Ball]:
    """The places at which the model was proved to rest."""
    return () if claim.kind in POSED else claim.points


_WITNESS = {
    "two-equilibria": "The balls are disjoint in the states; under this input no point attracts both.",
    "unstable-equilibrium": "J'S + S J - 2 sigma S > 0 for every Jacobian J about the ball, sigma >= 0, and e'Se > 0:"
    " (x - x*)'S(x - x*) grows from arbitrarily near x*, so x* is unstable.",
    "unstable-linear-part": "A0'S + S A0 - 2 sigma S > 0, sigma >= 0, e'Se > 0, and every other term is bounded:"
    " from far out along e, x'Sx grows without bound.",
    "marginal-direction": "w'A0 = 0, w'B is not 0, every (w'a) f is bounded below: some constant input makes w'x grow.",
    "cooperative-growth": "F > 0 at the start, which lies above x*, and no off-diagonal slope is negative:"
    " {x >= start} is invariant and does not hold x*.",
    "invariant-line": "F(x_ref + s v, u) = g(s) v for all s exactly, and s g(s) >= 0 at the offset: on the line a"
    " solution never returns.",
    "two-solutions": "With the states at those of both centres exactly one solution of the equations lies in each ball;"
    " the balls are disjoint.",
    "free-direction": "Rows of A0 and arguments of channels in equations vanish along v, which is not 0.",
}
_WITNESS_OF_EQUATIONS = {
    "unstable-equilibrium": "2 (S dx)'(J_x d) + 2 sum (n'd)(J_w d) - 2 sigma dx'S dx > 0 for every Jacobian J about the"
    " ball, sigma >= 0, and e'Se > 0: near it each x has one w, and (x - x*)'S(x - x*) grows from arbitrarily near x*.",
}
_WITNESS_OF_STEPS = {
    "unstable-equilibrium": "J'S J - sigma S > 0 for every Jacobian J about the ball, sigma >= 1, and e'Se > 0:"
    " (x - x*)'S(x - x*) grows in each step from arbitrarily near x*, so x* is unstable.",
    "unstable-linear-part": "A0'S A0 - sigma S > 0, sigma >= 1, e'Se > 0, and every other term is bounded:"
    " from far out along e, x'Sx grows without bound.",
    "marginal-direction": "w'A0 = w', w'B is not 0, every (w'a) f is bounded below: some input makes w'x grow.",
}
