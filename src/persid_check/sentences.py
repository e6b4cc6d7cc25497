"""The checker's own sentences: what was proved, and the steps of the proof. Nothing of the file's text is repeated."""

from __future__ import annotations

from collections.abc import Sequence
from decimal import ROUND_CEILING, ROUND_FLOOR, Context, Decimal
from fractions import Fraction

from persid_check.format import Infeasibility, Point, Refutation, Stability, Subject
from persid_check.setting import Setting

SHOWN = 12  # entries of a list that are printed


def decimal(value: Fraction, *, up: bool = True, digits: int = 6) -> str:
    """Return a decimal text of a number, rounded up or down, never to the nearest."""
    return f"{_quotient(value, up, digits):g}"


def root(value: Fraction, *, digits: int = 6) -> str:
    """Return a decimal upper bound of the square root."""
    context = Context(prec=digits + 6, rounding=ROUND_CEILING)
    bound = context.next_plus(context.sqrt(_quotient(value, True, digits + 6)))
    return f"{Context(prec=digits, rounding=ROUND_CEILING).plus(bound):g}"


def _quotient(value: Fraction, up: bool, digits: int) -> Decimal:
    context = Context(prec=digits, rounding=ROUND_CEILING if up else ROUND_FLOOR)
    return context.divide(Decimal(value.numerator), Decimal(value.denominator))


def _vector(values: Sequence[Fraction]) -> str:
    """A vector, cut short and said so."""
    return f"({marked(values[:SHOWN])}{', ...' if len(values) > SHOWN else ''})"


def counted(number: int, what: str) -> str:
    """Return a number of things in words: 1 input, 2 inputs."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def marked(values: Sequence[Fraction]) -> str:
    """Return numbers to six digits, marked by ~ where they are rounded: no direction of rounding would be safe."""
    shown = []
    for value in values:
        low, high = decimal(value, up=False), decimal(value)
        shown.append(low if low == high else f"~{low}")
    return ", ".join(shown)


def input_names(names: Sequence[str]) -> list[str]:
    """Return inputs' own names, quoted; u1, u2, … as they are, but never for another than the first, second, …."""
    return _own_names("u", names)


def state_names(names: Sequence[str]) -> list[str]:
    """Return states' own names, quoted; x1, x2, … as they are, but never for another than the first, second, …."""
    return _own_names("x", names)


def _own_names(letter: str, names: Sequence[str]) -> list[str]:
    return [name if name == f"{letter}{i}" else repr(name) for i, name in enumerate(names, start=1)]


def _model(subject: Subject) -> str:
    model = subject.model
    names = ", ".join(repr(name) for name in model.states[:SHOWN]) + (", ..." if model.n > SHOWN else "")
    states = "state" if model.n == 1 else "states"
    return f"The model with {states} {names} ({model.n}), {counted(model.m, 'input')} and SHA-256 {subject.sha256}"


def stability(claim: Stability, everywhere: bool, bounds: str | None = None) -> str:
    """Return the sentence of claims G, M, E and R; `bounds`, if given, stand in place of that of the state."""
    kind = "regionally input-to-state stable" if claim.subject.claim == "R" else "globally input-to-state stable"
    parts = [f"{_model(claim.subject)} is {kind} {_place(claim)}.", *_estimate(claim, bounds)]
    if everywhere:
        parts.append("The same holds, with the same numbers, about every equilibrium of every constant input.")
    return " ".join(parts)


def _place(claim: Stability) -> str:
    model, point = claim.subject.model, claim.point
    if point is not None:
        return f"about {_equilibrium(point)}"
    where = f"about x* = x_ref = {_vector(model.x_ref)} for u* = u_ref = {_vector(model.u_ref)}"
    if any(model.b):
        where += (
            ", with the constant b counted as one more input, b v, which in the model itself is held at v = 1 and not 0"
        )
    return where


def _equilibrium(point: Point) -> str:
    ball = f"= {_vector(point.x)} exactly"
    if point.radius:  # not rounded up: only in the ball itself is it proved to be the one
        ball = f"within {marked((point.radius,))} of {_vector(point.x)} in every state"
    return f"the one equilibrium x* {ball} for the constant input u* = {_vector(point.u)}"


def _estimate(claim: Stability, bounds: str | None) -> list[str]:
    if claim.subject.claim not in ("E", "R"):
        return []
    start = f"{root(1 / claim.p)} sqrt(V(x(0))) exp(-{decimal(claim.kappa / 2, up=False)} t)"
    bound = bounds or f"|x(t) - x*| <= {' + '.join([start, *_gains(claim)])} for all t >= 0"
    if claim.subject.claim == "E":
        return [f"{bound[0].upper()}{bound[1:]}."]
    sides = ", ".join(f"[{marked(side)}]" for side in claim.box[:SHOWN])
    sides += f", ... ({len(claim.box)} sides)" if len(claim.box) > SHOWN else ""
    shrunk = " less twice the ball's radius at each side" if claim.point is not None and claim.point.radius else ""
    return [
        f"The set of x in the box {sides}{shrunk} with V(x) <= {marked((claim.level,))} is invariant for"
        f" inputs with sup|u - u*| <= {decimal(claim.input_bound, up=False)}, and from every x(0) in it {bound}."
    ]


def _gains(claim: Stability) -> list[str]:
    """The parts of the estimate that inputs add: one for all of them, or one for each."""
    model, unit = claim.subject.model, claim.kappa * claim.p
    counts_b = claim.point is None and any(model.b)
    if not model.m + counts_b:
        return []
    if isinstance(claim.gamma, Fraction):
        return [f"{root(claim.gamma / unit)} {'sup|(u - u*, v)|' if counts_b else 'sup|u - u*|'}"]
    gains = [root(row[-1] / unit) for row in claim.gamma]
    names = [f"sup|{name} - {name}*|" for name in input_names(model.inputs)] + ["sup|v|"] * counts_b
    parts = [f"{gain} {name}" for gain, name in zip(gains, names, strict=True)]
    return parts if len(parts) <= SHOWN else [*parts[:SHOWN], f"... (a part for each of {len(parts)} inputs)"]


def stability_steps(
    claim: Stability, settings: Sequence[Setting], kept: Sequence[int], everywhere: bool, more: Sequence[str] = ()
) -> tuple[str, ...]:
    """Return the proof of claims G, M, E and R as steps."""
    name, model = claim.subject.claim, claim.subject.model
    steps = [f"The model's hash agrees; n = {model.n}, channels = {len(model.channels)}, inputs = {model.m}."]
    if claim.point is not None and claim.point.radius:
        steps.append(f"Krawczyk's operator proves exactly one equilibrium in the ball: {_equilibrium(claim.point)}.")
    elif claim.point is not None:
        steps.append("F(x*, u*) = 0 was evaluated exactly.")
    steps += [step for setting in settings for step in _group_steps(claim, setting)]
    if claim.dropped:
        steps.append(f"{len(claim.dropped)} entries of z are dropped; nothing touches them.")
    steps.append(f"Q, E and the input columns were assembled exactly; {len(kept)} entries of z are kept.")
    steps.append(_LOWER_BOUND[name])
    loss = "-Q - kappa W" if name in ("E", "R") else "-Q"
    inputs = model.m + (claim.point is None and any(model.b))
    joint = isinstance(claim.gamma, Fraction)
    corner = "gamma I" if joint else "Gamma"
    steps.append(
        f"[[{loss}, -E B], [-B'E', {corner}]] > 0 of size {len(kept) + inputs}: T M T' is strictly diagonally dominant."
    )
    theorem = _THEOREM[name]
    steps.append(theorem if joint else theorem.replace("gamma |u - u*|^2", "(u - u*)'Gamma (u - u*)"))
    if everywhere:
        steps.append("Every form that is used is nondecreasing on R, so all of it holds about every equilibrium.")
    steps += more
    return tuple(f"{i}. {step}" for i, step in enumerate(steps, start=1))


_LOWER_BOUND = {
    "G": "P > 0 was proved exactly, so V(x) >= t |x - x*|^2 for some t > 0.",
    "M": "P > 0 on the kept states was proved exactly; they and the rows of unbounded strict channels span R^n.",
    "E": "P - p I > 0 was proved exactly, so V(x) >= p |x - x*|^2.",
    "R": "P + sum mu d r r' - p I > 0, and V > level on every face of the box that is named, were proved.",
}
_THEOREM = {
    "G": "So V' <= -t |z|^2 + gamma |u - u*|^2 for some t > 0: V is an ISS-Lyapunov function.",
    "M": "So V' <= -t |z_K|^2 + gamma |u - u*|^2, and V and |z_K| are positive definite and proper: ISS.",
    "E": "So V <= z'W z and V' <= -kappa V + gamma |u - u*|^2: the estimate follows by integration.",
    "R": "So V' <= -kappa V + gamma |u - u*|^2 while x is in the box, which it cannot leave.",
}


def _group_steps(claim: Stability, setting: Setting) -> list[str]:
    used = setting.proof.used()
    if not used:
        return []
    model = claim.subject.model
    functions = ", ".join(_channel(model.channels[c].text, alpha) for c, alpha in setting.group.members)
    row = " + ".join(f"{marked((r,))} {model.states[i]!r}" for i, r in list(setting.group.row.items())[:SHOWN])
    row += " + ..." if len(setting.group.row) > SHOWN else ""
    where = "R" if setting.domain is None else f"[{marked(setting.domain)}]"
    shift = "" if setting.shift is None else f", shifted by y* {_ball(*setting.shift)}"
    forms = "; ".join(_form(setting, k) for k in used)
    return [f"Group {setting.index}, y = {row or '0'}, phi = (y, {functions}){shift}, proved on {where}: {forms}."]


def _ball(center: Fraction, radius: Fraction) -> str:
    return f"within {marked((radius,))} of {marked((center,))}" if radius else f"= {marked((center,))}"


def _channel(text: str, alpha: Fraction) -> str:
    return text if alpha == 1 else f"{text} at {marked((alpha,))} y"


def _form(setting: Setting, k: int) -> str:
    proof = setting.proof
    text = f"y l{k}'phi >= 0 for l{k} = {_vector(proof.forms[k])}"
    if proof.integral and proof.mu[k]:
        text += f" with integral <= c y l'phi, c = {decimal(proof.integral[k] or Fraction(0))}"
    if proof.quadratic and proof.mu[k] and proof.quadratic[k]:
        text += f" and >= d y^2 / 2, d = {decimal(proof.quadratic[k] or Fraction(0), up=False)}"
    return text


def infeasibility(claim: Infeasibility) -> str:
    """Return the sentence of claim "infeasible"."""
    count = sum(len(proof.forms) for proof in claim.groups)
    P = "P >= 0" if claim.full else "a diagonal P >= 0 (diagonal P only)"
    return (
        f"{_model(claim.subject)} has no certificate of claim iss or rate-and-gain with {P}, with Lyapunov densities of"
        f" the {count} forms in the file and with in-group products of these forms and y."
        " This does not refute stability."
    )


def infeasibility_steps(claim: Infeasibility) -> tuple[str, ...]:
    """Return the proof of claim "infeasible" as steps."""
    return (
        f"1. X = L L' with L of {len(claim.L)} rows and {len(claim.L[0])} columns is semidefinite by construction.",
        "2. <F, X> > 0 was proved exactly for the generators of P, every mu, every pair of forms and every (y, form).",
        "3. A certificate would give Q < 0, so <Q, X> <= 0, with Q a sum of these generators: a contradiction.",
    )


def refutation(claim: Refutation) -> str:
    """Return the sentence of claim "refuted"."""
    u = f"the constant input u = {_vector(claim.u)}"
    places = " and ".join(_vector(point.x) for point in claim.points)
    line = f"s = {_vector((claim.number,))}, v = {_vector(claim.vector)}"
    reason = {
        "two-equilibria": f"at {u} it rests both near {places}",
        "unstable-equilibrium": f"at {u} it has an unstable equilibrium near {places}",
        "unstable-linear-part": "the functions that act are bounded and its linear part grows exponentially",
        "marginal-direction": f"some constant input drives w'x to infinity, w = {_vector(claim.vector)}",
        "cooperative-growth": f"at {u} it never returns from {_vector(claim.vector)} to its equilibrium near {places}",
        "invariant-line": f"at {u} a solution from x_ref + s v never returns to x_ref, {line}",
    }[claim.kind]
    about = (
        "any point for any input"
        if claim.kind in ("unstable-linear-part", "marginal-direction")
        else f"any point for {u}"
    )
    return f"{_model(claim.subject)} is not input-to-state stable about {about}: {reason}."


def refutation_steps(claim: Refutation) -> tuple[str, ...]:
    """Return the proof of claim "refuted" as steps."""
    steps = ["The model's hash agrees, and every function is continuous on R."]
    steps += [f"Proved: {_equilibrium(point)}." for point in claim.points]
    steps.append((_WITNESS | (_WITNESS_OF_STEPS if claim.subject.model.is_discrete else {}))[claim.kind])
    return tuple(f"{i}. {step}" for i, step in enumerate(steps, start=1))


_WITNESS = {
    "two-equilibria": "The balls are disjoint; under this input no point attracts both.",
    "unstable-equilibrium": "J'S + S J - 2 sigma S > 0 for every Jacobian J about the ball, sigma >= 0, and e'Se > 0:"
    " (x - x*)'S(x - x*) grows from arbitrarily near x*, so x* is unstable.",
    "unstable-linear-part": "A0'S + S A0 - 2 sigma S > 0, sigma >= 0, e'Se > 0, and every other term is bounded:"
    " from far out along e, x'Sx grows without bound.",
    "marginal-direction": "w'A0 = 0, w'B is not 0, every (w'a) f is bounded below: some constant input makes w'x grow.",
    "cooperative-growth": "F > 0 at the start, which lies above x*, and no off-diagonal slope is negative:"
    " {x >= start} is invariant and does not hold x*.",
    "invariant-line": "F(x_ref + s v, u) = g(s) v for all s exactly, and s g(s) >= 0 at the offset: on the line a"
    " solution never returns.",
}
_WITNESS_OF_STEPS = {
    "unstable-equilibrium": "J'S J - sigma S > 0 for every Jacobian J about the ball, sigma >= 1, and e'Se > 0:"
    " (x - x*)'S(x - x*) grows in each step from arbitrarily near x*, so x* is unstable.",
    "unstable-linear-part": "A0'S A0 - sigma S > 0, sigma >= 1, e'Se > 0, and every other term is bounded:"
    " from far out along e, x'Sx grows without bound.",
    "marginal-direction": "w'A0 = w', w'B is not 0, every (w'a) f is bounded below: some input makes w'x grow.",
}
