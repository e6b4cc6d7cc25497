"""The checker's own sentences for claim L1: what was proved, and the steps of the proof."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from persid_check.networks.claims import NetworkClaim, NetworkObstruction, NetworkSubject
from persid_check.networks.members import Members
from persid_check.words import SHOWN, counted, decimal, input_names, marked, state_names


def _model(subject: NetworkSubject) -> str:
    states, inputs = counted(subject.nodes.n, "state"), counted(len(subject.form["inputs"]), "input")
    return f"The model with {states}, {inputs} and SHA-256 {subject.sha256}"


def decrease(claim: NetworkClaim, gains: Sequence[Fraction], offset: bool) -> str:
    """Return the sentence of claim L1; `gains` are upper bounds of (|B|'w)_l, with `offset` the last one is of b."""
    about = "every equilibrium" if claim.every else "x* = x_ref for u* = u_ref"
    inputs = input_names(claim.subject.form["inputs"])
    names = [f"sup|{name} - {name}*|" for name in inputs] + ["sup|v|"] * offset
    terms = [f"{decimal(g / claim.kappa)} {name}" for g, name in list(zip(gains, names, strict=True))[:SHOWN] if g]
    terms += ["..."] if len(gains) > SHOWN else []
    bound = " + ".join([f"exp(-{decimal(claim.kappa, up=False)} t) V(x(0) - x*)", *terms])
    subject = _model(claim.subject)
    if claim.members is not None:
        subject = f"Every member of the stated set of models about {subject[0].lower()}{subject[1:]}"
    parts = [
        f"{subject} is globally input-to-state stable about {about}"
        + (", with the constant b counted as one more input, b v, which in the model itself is held at v = 1." * offset)
        + "." * (not offset),
        f"V(x(t) - x*) <= {bound} for all t >= 0, with V(x) = sum w_k |x_k|"
        f" and {decimal(claim.spread[0], up=False)} <= w_k <= {decimal(claim.spread[1])}.",
    ]
    if claim.every:
        parts.append(
            "For every constant input there is exactly one equilibrium, and any two solutions"
            f"{' of one member' * (claim.members is not None)} with inputs u and u* satisfy this estimate with the"
            " second one in place of x*."
        )
    if claim.members is not None:
        parts.append(_members(claim.members))
    return " ".join(parts)


def _members(members: Members) -> str:
    """Say which models are meant; the numbers of the ellipsoids are those of the file."""
    equations = ", ".join(state_names(members.model.states)[e.state] for e in members.ellipsoids[:SHOWN])
    more = ", ..." if len(members.ellipsoids) > SHOWN else ""
    return (
        f"A member has d'zeta + e more in the equations of {equations or 'no state'}{more}, zeta = (x,"
        f" values of functions, u), d constant with |d'zeta| <= |C zeta| for every zeta, C in the file, and any"
        " constant e; the equilibria are the member's own. That a plant is a member is assumed, not proved."
    )


def decrease_steps(claim: NetworkClaim, rays: Sequence[int], how: str) -> tuple[str, ...]:
    """Return the proof of claim L1 as steps; `rays` counts the generators of each kind's cone."""
    what = "nondecreasing on R" if claim.every else "a sector form on R"
    count = sum(len(kind.forms) for kind in claim.kinds)
    kinds = [
        f"Kind {t}: phi = (y{''.join(_function(text, a) for text, a in k.functions)}) has {len(k.forms)} forms and"
        f" {size} generators."
        for t, (k, size) in list(enumerate(zip(claim.kinds, rays, strict=True)))[:SHOWN]
    ]
    steps = [
        "The model's hash agrees, every function is continuous on R, every argument row is a positive multiple of one"
        f" unit vector; {claim.subject.nodes.entries} coupled pairs of nodes.",
        f"{count} forms of {len(claim.kinds)} kinds of nodes are each proved {what}.",
        *kinds,
        f"w_k sum_s v_s A_s[k,k] + sum_(i != k) w_i |sum_s v_s A_s[i,k]|{_OF_MEMBERS * (claim.members is not None)}"
        f" + kappa w_k v_0 <= 0 for every node k and every generator v of its cone, {how}.",
        "So D+V <= -kappa V + sum_l beta_l |u_l - u_l*|, beta = |B|'w"
        f"{_OF_INPUTS * (claim.members is not None)}: the estimate follows by integration (claim L1).",
    ]
    return tuple(f"{i}. {step}" for i, step in enumerate(steps, start=1))


_OF_MEMBERS, _OF_INPUTS = " + sum_i w_i |C_i E_k v|", ", and sum_i w_i |C_i e_l| more"


def _function(text: str, alpha: Fraction) -> str:
    return f", {text}" if alpha == 1 else f", {text} at {marked((alpha,))} y"


def no_weights(claim: NetworkObstruction) -> str:
    """Return the sentence of claim "L1-infeasible"."""
    return (
        f"{_model(claim.subject)} has no weights w > 0 and no rate kappa > 0 that satisfy claim L1 with the cones cut"
        " out by the forms in the file. Sharper forms or other Lyapunov functions are not excluded, and stability is"
        " not refuted."
    )


def no_weights_steps(claim: NetworkObstruction) -> tuple[str, ...]:
    """Return the proof of claim "L1-infeasible" as steps."""
    active = sum(1 for value in claim.z if value)
    return (
        "1. Every ray in the file lies in the cone of its node's forms, tested exactly.",
        f"2. M z >= 0 for a vector z >= 0 with {active} positive entries, M made of the rays that the nodes choose.",
        "3. Weights would give 0 <= w'Mz <= -kappa sum w_k v_0 z_k <= 0, one of the two strict: a contradiction.",
    )
