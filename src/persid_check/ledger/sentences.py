"""The checker's own sentences on the ledger: what was proved, and the proof in the order of the specification."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from persid_check.ledger.further import forgets, is_moved
from persid_check.ledger.theorem import Proved
from persid_check.ledger.values import Algebraic, Curve, Deviation, Ledger, Output, Row
from persid_check.reading import Ball
from persid_check.words import (
    SHOWN,
    counted,
    decimal,
    equilibrium,
    explained,
    input_names,
    marked,
    model_named,
    root,
    state_names,
    vector,
)

_ZERO = Fraction(0)


def statement(ledger: Ledger, proved: Proved) -> str:
    """Return the sentences of a claim."""
    subject = model_named(ledger.model, ledger.sha256)
    if ledger.deviations:
        subject = f"every plant within the stated deviations of {subject}"
    first = f"{subject[0].upper()}{subject[1:]} is {_kind(ledger)} {_place(ledger)}."
    parts = [first, *_equations(ledger), *_estimate(ledger, proved)]
    if ledger.deviations:
        parts.append(_plants(ledger))
    if "members" in proved.further:
        parts += _members(ledger)
    if "everywhere" in proved.further:
        parts.append(
            "The same holds, with the same numbers, about every equilibrium of every constant input, of which each has"
            " exactly one."
        )
    if "incremental" in proved.further:
        parts.append(_between(ledger))
    return explained(" ".join(parts))


def _equations(ledger: Ledger) -> list[str]:
    """What is proved of the equations of a model with algebraic variables."""
    if not ledger.model.algebraic:
        return []
    names = ", ".join(_listed(state_names(ledger.model.states)[ledger.model.order :]))
    if ledger.claim == "region":
        return [f"Its equations are those of {names}."]
    return [f"For every x and u its equations have exactly one solution {names}, which depends on them continuously."]


def _listed(names: Sequence[str]) -> list[str]:
    """Names, cut short and said so."""
    return [*names[:SHOWN], *["..."] * (len(names) > SHOWN)]


def _between(ledger: Ledger, of: str = "") -> str:
    """What holds for any two solutions."""
    clock = _clock(ledger)
    other, start = (name.replace("x", "x~", 1) for name in (clock.now, clock.start))
    V = f"V({clock.start} - {start})"
    bound = f"|{clock.now} - {other}| <= {_start(ledger, V)}"
    bound += f" + {_gain(ledger, ledger.kappa * ledger.p, 'u~')} {clock.always}"
    if ledger.outputs is not None:
        bound = f"the same bounds hold with y~, u~ in place of y*, u* and {V} of V({clock.start})"
    return (
        f"For any two solutions x, x~{of} with inputs u, u~: {bound}, V(d) = d'P d."
        " For every constant input there is exactly one equilibrium, and every solution tends to it."
    )


def _kind(ledger: Ledger) -> str:
    """Stable, or practically so where something stays even without inputs."""
    spread = ledger.claim == "practical" or any(deviation.epsilon for deviation in ledger.deviations)
    regional, solved = ledger.claim == "region", ledger.model.algebraic > 0
    scope = "in a region" if regional else "globally"
    scope += ", with the solution of its equations that is named below," * (regional and solved)
    steps = " in discrete time" if ledger.model.is_discrete else ""
    return f"{scope} {'practically ' if spread else ''}input-to-state stable{steps}"


def _place(ledger: Ledger) -> str:
    model = ledger.model
    if ledger.ball is not None:
        return f"about {equilibrium(ledger.ball, _rest(ledger))}"
    at = model.x_ref if ledger.claim == "region" else model.x_ref[: model.order]
    name = "" if ledger.claim == "practical" else f"{_rest(ledger) if len(at) > model.order else 'x*'} = "
    where = f"about {name}x_ref = {vector(at)} for u* = u_ref = {vector(model.u_ref)}"
    return f"{where}, with the constant b counted as one more input that is held at 1" if ledger.counts_b else where


def _rest(ledger: Ledger) -> str:
    """The name of the operating point, in which the algebraic variables have their places, too."""
    names = [f"{name}*" for name in state_names(ledger.model.states)[ledger.model.order :]]
    return f"(x*, {', '.join(_listed(names))})" if names else "x*"


@dataclass(frozen=True)
class _Clock:
    """How a sentence speaks of time: the state now and at the start, "for all ...", what is left of V and of its root,
    and the left side of the equations.
    """

    now: str
    start: str
    always: str
    share: str
    root: str
    change: str


def _clock(ledger: Ledger) -> _Clock:
    """In discrete time V falls by 1 - kappa in a step, in continuous time by exp(-kappa t)."""
    kappa, dt = ledger.kappa, ledger.model.dt
    if dt is None:
        share, half = (f"exp(-{decimal(k, up=False)} t)" for k in (kappa, kappa / 2))
        return _Clock("x(t)", "x(0)", "for all t >= 0", share, half, "x'")
    always = f"for all steps k >= 0 of {_one(dt)} s"
    return _Clock("x_k", "x_0", always, f"{decimal(1 - kappa)}^k", f"{root(1 - kappa)}^k", "x_{k+1}")


def _start(ledger: Ledger, V: str | None = None) -> str:
    clock = _clock(ledger)
    return f"{root(1 / ledger.p)} sqrt({V or f'V({clock.start})'}) {clock.root}"


def _gain(ledger: Ledger, unit: Fraction, other: str = "u*") -> str:
    """The inputs' part of an estimate of the root of `unit` / kappa times V, for u compared to `other`."""
    parts = _of_inputs(ledger, 1 / unit, [_ZERO] * ledger.model.m, other)
    return " + ".join(parts) or "0"


def _spread(ledger: Ledger, unit: Fraction) -> str:
    sizes = [deviation.s * deviation.epsilon**2 for deviation in ledger.deviations if deviation.epsilon]
    return "".join(f" + {root(size / unit)}" for size in sizes)


def _estimate(ledger: Ledger, proved: Proved) -> list[str]:
    if ledger.claim == "iss":
        return []
    if ledger.claim == "practical":
        return [_finally(ledger, proved)]
    outputs = () if ledger.outputs is None else ledger.outputs.listed
    bound = _of_outputs(ledger, outputs) if outputs else _of_state(ledger)
    if ledger.claim == "rate-and-gain":
        first = f"{bound[0].upper()}{bound[1:]}."
        return [first, _feedback(ledger, outputs)] if "feedback" in proved.further else [first]
    return [_region(ledger, bound)]


def _region(ledger: Ledger, bound: str) -> str:
    """The set that is not left; with algebraic variables first which solution of the equations is meant."""
    own, others = ([side for side in ledger.sides if ledger.is_of_states(side[0]) == of] for of in (True, False))
    size = f"|u - u*| <= {decimal(ledger.input_bound, up=False)}"
    start = _clock(ledger).start
    within = " and ".join(filter(None, (_sides(ledger, own), f"V(x) <= {_one(ledger.level)}")))
    if not ledger.model.algebraic:
        return f"The set of x with {within} is invariant for inputs with {size}, and from every {start} in it {bound}."
    where = f" with {_sides(ledger, others)}" if others else ""
    return (
        f"For every x with {within} and every u with {size} they have exactly one solution{where}, which depends on x"
        " and u continuously. This one is meant, of others nothing is said: with it the set of these x is invariant for"
        f" such inputs, and from every {start} in it {bound}."
    )


def _sides(ledger: Ledger, found: Sequence[tuple[Row, Fraction, Fraction]]) -> str:
    """Strips in words, without those of a row of zeros: every x is in them."""
    return _several([_strip(ledger, row, lo, hi) for row, lo, hi in found if row], " and ", "strips")


def _several(parts: Sequence[str], between: str, what: str) -> str:
    """Parts of a sentence, cut short and said so."""
    more = f" and so on ({len(parts)} {what})" if len(parts) > SHOWN else ""
    return between.join(parts[:SHOWN]) + more


def _of_state(ledger: Ledger) -> str:
    unit = ledger.kappa * ledger.p
    clock, inputs = _clock(ledger), _gain(ledger, unit) + _spread(ledger, unit)
    return f"|{clock.now} - x*| <= {_start(ledger)} + {inputs} {clock.always}"


def _of_outputs(ledger: Ledger, outputs: Sequence[Output]) -> str:
    """The bound of every output."""
    parts = [_of_output(ledger, output) for output in outputs[:SHOWN]]
    parts += [f"... ({len(outputs)} outputs)"] * (len(outputs) > SHOWN)
    return f"the outputs keep to {'; '.join(parts)}; {_clock(ledger).always}, with y* for x* and u*"


def _of_output(ledger: Ledger, output: Output) -> str:
    """L (sqrt(c V) e^{-kappa t/2} + sqrt(c gamma/kappa) sup|u - u*| + ... + |D| sup|u - u*|)."""
    square, clock = output.steepness**2, _clock(ledger)
    c = square * output.constant
    terms = [f"{root(c)} sqrt(V({clock.start})) {clock.root}"]
    if ledger.inputs:
        terms += _of_inputs(ledger, c / ledger.kappa, [square * d * d for d in output.direct])
    spread = _spread(ledger, ledger.kappa / c) if c else ""
    return f"|{output.name!r} - y*| <= {' + '.join(terms)}{spread}"


def _feedback(ledger: Ledger, outputs: Sequence[Output]) -> str:
    """How strong an effect of one output on the inputs may be, in the largest value so far or in the mean square."""
    moved = [output for output in outputs if is_moved(ledger, output)]
    gains = [(output.name, Fraction(_output_gain(ledger, output))) for output in moved]
    limits = _several([f"{decimal(1 / gain, up=False)} for {name!r}" for name, gain in gains], ", ", "outputs")
    return (
        "Any feedback from one output y, u - u* = v + w with |w| <= a sup|y - y*| so far, leaves inputs and outputs"
        f" bounded for bounded v where a < {limits}, as long as the loop has a solution; the same in"
        " the mean square."
    )


def _output_gain(ledger: Ledger, output: Output) -> str:
    """Return a decimal upper bound of L (sqrt(c gamma/kappa) + |D|), one number gamma."""
    gamma = ledger.gamma if isinstance(ledger.gamma, Fraction) else _ZERO
    square = output.steepness**2
    through = square * sum((d * d for d in output.direct), _ZERO)
    return _sum(square * output.constant / ledger.kappa * gamma, through)


def _of_inputs(ledger: Ledger, c: Fraction, direct: Sequence[Fraction], other: str = "u*") -> list[str]:
    """The inputs' parts: of all together, or of each; `direct` are squares of what comes through directly."""
    gamma, through, counts_b = ledger.gamma, sum(direct, _ZERO), ledger.counts_b and other == "u*"
    if isinstance(gamma, Fraction) and not counts_b:
        return [f"{_sum(c * gamma, through)} sup|u - {other}|"]
    if isinstance(gamma, Fraction):
        part = f"{root(c * gamma)} sup|(u - u*, 1)|"
        return [part, f"{root(through)} sup|u - u*|"] if through else [part]
    names = input_names(ledger.model.inputs)
    sizes = [f"sup|{name} - {name}*|" if other == "u*" else f"sup|{name} difference|" for name in names]
    parts = zip(gamma, [*direct, _ZERO], [*sizes, *["1"] * counts_b], strict=False)
    return [f"{_sum(c * row[-1], d)} {size}" for row, d, size in parts]


def _sum(a: Fraction, b: Fraction) -> str:
    """Return a decimal upper bound of sqrt(a) + sqrt(b)."""
    return decimal(Fraction(root(a, digits=9)) + Fraction(root(b, digits=9))) if b else root(a)


def _strip(ledger: Ledger, row: Row, lo: Fraction, hi: Fraction) -> str:
    """One strip in words: a combination of deviations from the operating point, by the names of the states."""
    shown = _joined(row, _deviations(state_names(ledger.model.states)), lambda r: "" if r == 1 else _one(r))
    return f"{_one(lo)} <= {shown} <= {_one(hi)}"


def _deviations(names: Iterable[str]) -> list[str]:
    """What is said of names: how far they are from where they rest."""
    return [f"({name} - {name}*)" for name in names]


def _one(value: Fraction) -> str:
    return marked((value,))


def _finally(ledger: Ledger, proved: Proved) -> str:
    matrices, rest = proved.assembly, _ZERO
    rest += sum((deviation.s * deviation.epsilon**2 for deviation in ledger.deviations), _ZERO)
    rest += matrices.supply + ledger.kappa * matrices.above
    constant = (max(rest, _ZERO) / ledger.kappa + matrices.below) / ledger.p
    inputs, clock = _gain(ledger, ledger.kappa * ledger.p), _clock(ledger)
    return (
        f"|{clock.now} - x_ref|^2 <= {decimal(1 / ledger.p)} max(V({clock.start}), 0) {clock.share}"
        f" + ({inputs})^2 + {decimal(constant)} {clock.always}."
    )


def _plants(ledger: Ledger) -> str:
    """Name the plants that are meant; a bound by one number is rounded towards 0: each plant named is one of them."""
    shown = _several([_deviation(ledger, deviation) for deviation in ledger.deviations], " and of ", "deviations")
    return (
        f"Meant is every plant {_clock(ledger).change} = F(x, u) + g with g the sum of L w for {shown}."
        " That a plant obeys these bounds is assumed, not proved."
    )


def _members(ledger: Ledger) -> list[str]:
    """What holds of models with other coefficients, each about a place of rest of its own."""
    read = _listed(state_names(ledger.model.states))
    read += ["values of functions"] * bool(ledger.model.channels) + ["inputs"] * bool(ledger.model.m)
    first = (
        f"Of a model with other coefficients, g the sum of L (D zeta + e) with zeta = ({', '.join(read)}), constant D"
        " with |D zeta| <= |C zeta| for every zeta, and any constant e, more is proved: for every constant input it has"
        " exactly one equilibrium, and the same holds about it with the same numbers, without the constant part of |w|."
    )
    return [first, _between(ledger, " of one such model")] if forgets(ledger) else [first]


def _deviation(ledger: Ledger, deviation: Deviation) -> str:
    states, channels = state_names(ledger.model.states), [f"s{c + 1}" for c in range(len(ledger.model.channels))]
    names = _deviations([*states, *channels, *input_names(ledger.model.inputs)]) + ["1"] * ledger.counts_b
    columns = [_joined(row, [f"e({name})" for name in states], _one) for row in deviation.columns]
    lines = [_joined(row, names, _towards_0 if len(row) == 1 else _one) for row in deviation.C]
    some = [f"({', '.join(_listed(each))})" for each in (columns, lines)]
    bound = f"|{some[1]}|^2" if lines else "0"
    return f"L = {some[0]} and |w|^2 <= {bound} + {_towards_0(deviation.epsilon)}^2"


def _joined(row: Row, names: Sequence[str], written: Callable[[Fraction], str]) -> str:
    terms = [f"{written(r)} {names[i]}".lstrip() for i, r in list(row.items())[:SHOWN]]
    return (" + ".join(terms) or "0") + (" + ..." if len(row) > SHOWN else "")


def _towards_0(value: Fraction) -> str:
    return decimal(value, up=value < 0)


def steps(ledger: Ledger, proved: Proved) -> tuple[str, ...]:
    """Return the proof as short lines, in the order of the specification."""
    model, z = ledger.model, "z" if ledger.inside else "x"
    size = [counted(model.order, "state"), counted(len(model.channels), "channel"), counted(ledger.inputs, "input")]
    if model.algebraic:
        size.insert(1, counted(model.algebraic, "algebraic variable"))
    counts = Counter(fact.kind for fact in ledger.facts)
    known = "known a step later, too" if model.is_discrete else "locally Lipschitz"
    identity, inside = counted(len(ledger.identity), "product"), counted(len(ledger.inside), "value")
    integrals = counted(sum(len(point.densities) for point in ledger.points), "integral")
    lines = [
        f"1. The hash agrees; {', '.join(size)}.",
        f"1. {_how(ledger.ball)} proves exactly one equilibrium in the ball." * (ledger.ball is not None),
        *(line for i, curve in enumerate(ledger.curves) for line in _of_curve(i, curve)),
        *(f"3. {counted(counts[kind], 'fact')}, {words}." for kind, words in _FACTS.items() if counts[kind]),
        f"3. {identity} of entries, whose sum is zero as a polynomial (section 12)." * bool(ledger.identity),
        f"4. V = {z}'P {z} + {integrals}; V >= {z}'Pt {z}, Pt assembled exactly.",
        f"4. z is x and {inside} of functions, each {known}." * bool(ledger.inside),
        *_of_equations(ledger.algebraic),
        f"5. {len(ledger.dropped)} rows of M are exactly zero." * bool(ledger.dropped),
        f"6. M > 0 on the other {len(proved.kept)} entries: T M T' is strictly diagonally dominant.",
        f"6. Pt{' - p I' * bool(ledger.p)} > 0 in the same way.",
        "7. c >= C Pt^-1 C' (bound of section 6) for every output, and no output map is steeper than its L."
        * (ledger.outputs is not None),
        f"7. {(_OF_STEPS if model.is_discrete else _CONCLUSIONS)[ledger.claim]}",
    ]
    return tuple(line for line in lines if line)


def _how(ball: Ball | None) -> str:
    return "Krawczyk's operator" if ball is not None and ball.radius else "Exact evaluation"


def _of_curve(i: int, curve: Curve) -> Iterator[str]:
    functions = counted(len(curve.functions), "function")
    yield f"2. Curve {i}: {functions}, continuous; centre {_centre(curve.shift)}."
    for k, form in enumerate(curve.forms):
        pieces = counted(len(form.cuts) - 1, "piece")
        yield f"2. Curve {i}, form {k} = {vector(form.l)}: {form.kind}, {pieces}."


def _of_equations(said: Algebraic | None) -> Iterator[str]:
    if said is not None:
        products = counted(len(said.products), "product")
        yield f"11. The equations have one solution: a form of differences, {products}, is positive definite."
        if said.bounds:
            yield "11. Every row that reads an algebraic variable stays on its domain, or in its strip."


_FACTS = {
    "value": "products of two sector forms at one point",
    "one_signed": "products of two one-signed forms",
    "difference": "products of two nondecreasing forms of a difference of two points",
    "constant": "products of two forms with a constant",
    "slope": "products of two nondecreasing forms of a point's derivative along the solution",
    "step": "products of two forms of a point after a step, or of its difference from a point now",
}
_CONCLUSIONS = {
    "iss": "So V' <= -t |x|^2 + v'Gamma v + ...: V is an ISS-Lyapunov function.",
    "rate-and-gain": "So V' <= -kappa V + v'Gamma v + ..., and V >= p |x|^2: integrate.",
    "region": "The level stays off every face (bound of section 6), and its set is invariant for such inputs.",
    "practical": "So V' <= -kappa V + S, and p |x|^2 <= V + o_V: integrate.",
}
_OF_STEPS = {
    "iss": "So V(x+) - V(x) <= -t |x|^2 + v'Gamma v + ...: V is an ISS-Lyapunov function in discrete time.",
    "rate-and-gain": "So V(x+) <= (1 - kappa) V(x) + v'Gamma v + ..., and V >= p |x|^2: add up.",
    "region": "The level set lies inside every strip (bound of section 6), and V(x+) <= level from each of its points.",
    "practical": "So V(x+) <= (1 - kappa) V(x) + S, and p |x|^2 <= V: add up.",
}


def _centre(shift: tuple[Fraction, Fraction] | str | None) -> str:
    if isinstance(shift, tuple):
        return f"within {_one(shift[1])} of {_one(shift[0])}"
    return "0, nothing subtracted" if shift is None else "any"
