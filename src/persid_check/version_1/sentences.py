"""The checker's own sentences: what was proved, and the steps of the proof. Nothing of the file's text is repeated."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

from persid_check.version_1.format import Stability
from persid_check.version_1.setting import Setting
from persid_check.words import SHOWN, decimal, equilibrium, explained, input_names, marked, model_named, root, vector


def _model(claim: Stability) -> str:
    words = model_named(claim.subject.model, claim.subject.sha256)
    return f"{words[0].upper()}{words[1:]}"


def stability(claim: Stability, everywhere: bool, bounds: str | None = None) -> str:
    """Return the sentence of claims G, M, E and R; `bounds`, if given, stand in place of that of the state."""
    kind = "regionally input-to-state stable" if claim.subject.claim == "R" else "globally input-to-state stable"
    parts = [f"{_model(claim)} is {kind} {_place(claim)}.", *_estimate(claim, bounds)]
    if everywhere:
        parts.append("The same holds, with the same numbers, about every equilibrium of every constant input.")
    return explained(" ".join(parts))


def _place(claim: Stability) -> str:
    model, point = claim.subject.model, claim.point
    if point is not None:
        return f"about {equilibrium(point)}"
    where = f"about x* = x_ref = {vector(model.x_ref)} for u* = u_ref = {vector(model.u_ref)}"
    if any(model.b):
        where += (
            ", with the constant b counted as one more input, b v, which in the model itself is held at v = 1 and not 0"
        )
    return where


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
        steps.append(f"Krawczyk's operator proves exactly one equilibrium in the ball: {equilibrium(claim.point)}.")
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
    text = f"y l{k}'phi >= 0 for l{k} = {vector(proof.forms[k])}"
    if proof.integral and proof.mu[k]:
        text += f" with integral <= c y l'phi, c = {decimal(proof.integral[k] or Fraction(0))}"
    if proof.quadratic and proof.mu[k] and proof.quadratic[k]:
        text += f" and >= d y^2 / 2, d = {decimal(proof.quadratic[k] or Fraction(0), up=False)}"
    return text
