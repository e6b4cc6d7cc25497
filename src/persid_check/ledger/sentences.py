"""The checker's own sentences on the ledger: what was proved, and the proof in the order of the specification."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction

from persid_check.ledger.theorem import Proved, strips
from persid_check.ledger.values import Deviation, Ledger, Row
from persid_check.sentences import SHOWN, counted, decimal, input_names, root, state_names

_ZERO = Fraction(0)


def statement(ledger: Ledger, proved: Proved) -> str:
    """Return the sentences of a claim."""
    model = ledger.model
    names = ", ".join(repr(name) for name in model.states[:SHOWN]) + (", ..." if model.n > SHOWN else "")
    subject = f"the model with states {names} ({model.n}), {counted(model.m, 'input')} and SHA-256 {ledger.sha256}"
    if ledger.deviations:
        subject = f"every plant within the stated deviations of {subject}"
    first = f"{subject[0].upper()}{subject[1:]} is {_kind(ledger)} {_place(ledger)}."
    parts = [first, *_estimate(ledger, proved)]
    if ledger.deviations:
        parts.append(_plants(ledger))
    parts += list(_outputs(ledger))
    if proved.everywhere:
        parts.append(
            "The same holds, with the same numbers, about every equilibrium of every constant input, of which each has"
            " exactly one."
        )
    if proved.incremental:
        parts.append(_incremental(ledger))
    return " ".join(parts)


def _incremental(ledger: Ledger) -> str:
    clock = _clock(ledger)
    other, start = (name.replace("x", "x~", 1) for name in (clock.now, clock.start))
    return (
        f"For any two solutions x, x~ with inputs u, u~: |{clock.now} - {other}| <="
        f" {_start(ledger, f'V({clock.start} - {start})')}"
        f" + {_gain(ledger, ledger.kappa * ledger.p, '|u - u~|')} {clock.always}, V(d) = d'P d."
        " For every constant input there is exactly one equilibrium, and every solution tends to it."
    )


def _kind(ledger: Ledger) -> str:
    """Stable, or practically so where something stays even without inputs."""
    spread = ledger.claim == "practical" or any(deviation.epsilon for deviation in ledger.deviations)
    scope = "in a region" if ledger.claim == "region" else "globally"
    steps = " in discrete time" if ledger.model.is_discrete else ""
    return f"{scope} {'practically ' if spread else ''}input-to-state stable{steps}"


def _numbers(values: Sequence[Fraction]) -> str:
    shown = []
    for value in values[:SHOWN]:
        low, high = decimal(value, up=False), decimal(value)
        shown.append(low if low == high else f"~{low}")
    return f"({', '.join(shown)}{', ...' if len(values) > SHOWN else ''})"


def _place(ledger: Ledger) -> str:
    ball, model = ledger.ball, ledger.model
    if ball is not None:
        where = f"= {_numbers(ball.x)} exactly"
        if ball.radius:  # not rounded up: only in the ball itself is it proved to be the one
            where = f"within {_marked(ball.radius)} of {_numbers(ball.x)} in every state"
        return f"about the one equilibrium x* {where} for the constant input u* = {_numbers(ball.u)}"
    name = "" if ledger.claim == "practical" else "x* = "
    where = f"about {name}x_ref = {_numbers(model.x_ref)} for u* = u_ref = {_numbers(model.u_ref)}"
    return f"{where}, with the constant b counted as one more input that is held at 1" if ledger.counts_b else where


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
    always = f"for all steps k >= 0 of {_marked(dt)} s"
    return _Clock("x_k", "x_0", always, f"{decimal(1 - kappa)}^k", f"{root(1 - kappa)}^k", "x_{k+1}")


def _start(ledger: Ledger, V: str | None = None) -> str:
    clock = _clock(ledger)
    return f"{root(1 / ledger.p)} sqrt({V or f'V({clock.start})'}) {clock.root}"


def _gain(ledger: Ledger, unit: Fraction, size: str | None = None) -> str:
    """The inputs' part of an estimate of the square root of `unit` / kappa times V."""
    whole = "|(u - u*, 1)|" if ledger.counts_b else "|u - u*|"
    if isinstance(ledger.gamma, Fraction):
        return f"{root(ledger.gamma / unit)} sup{size or whole}"
    inputs = input_names(ledger.model.inputs)
    names = [f"sup|{name} difference|" if size else f"sup|{name} - {name}*|" for name in inputs]
    names += ["1"] * (ledger.counts_b and size is None)
    parts = [f"{root(row[-1] / unit)} {name}" for row, name in zip(ledger.gamma, names, strict=False)]
    return " + ".join(parts) or "0"


def _spread(ledger: Ledger, unit: Fraction) -> str:
    sizes = [deviation.s * deviation.epsilon**2 for deviation in ledger.deviations if deviation.epsilon]
    return "".join(f" + {root(size / unit)}" for size in sizes)


def _estimate(ledger: Ledger, proved: Proved) -> list[str]:
    if ledger.claim == "iss":
        return []
    unit, clock = ledger.kappa * ledger.p, _clock(ledger)
    if ledger.claim == "practical":
        return [_finally(ledger, proved)]
    bound = f"|{clock.now} - x*| <= {_start(ledger)} + {_gain(ledger, unit)}{_spread(ledger, unit)} {clock.always}"
    if ledger.claim == "rate-and-gain":
        return [f"{bound}."]
    found = strips(ledger)
    sides = " and ".join(_strip(ledger, *strip) for strip in found[:SHOWN])
    sides += f" and so on ({len(found)} strips)" if len(found) > SHOWN else ""
    return [
        f"The set of x with {sides or 'no strip'} and V(x) <= {_marked(ledger.level)} is invariant for inputs"
        f" with |u - u*| <= {decimal(ledger.input_bound, up=False)}, and from every {clock.start} in it {bound}."
    ]


def _strip(ledger: Ledger, row: Row, lo: Fraction, hi: Fraction) -> str:
    """One strip in words; ends are rounded inwards, so that the set named lies in the set proved invariant."""
    more = " + ..." if len(row) > SHOWN else ""
    return f"{_marked(lo)} <= {_combined(row, state_names(ledger.model.states))}{more} <= {_marked(hi)}"


def _combined(row: Row, names: Sequence[str]) -> str:
    """A combination of deviations from the operating point, by the names of the states."""
    terms = [f"{'' if r == 1 else f'{_marked(r)} '}({names[i]} - {names[i]}*)" for i, r in list(row.items())[:SHOWN]]
    return " + ".join(terms) or "0"


def _marked(value: Fraction) -> str:
    low, high = decimal(value, up=False), decimal(value)
    return low if low == high else f"~{low}"


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
    shown = " and of ".join(_deviation(ledger, deviation) for deviation in ledger.deviations[:SHOWN])
    more = f" and so on ({len(ledger.deviations)} deviations)" if len(ledger.deviations) > SHOWN else ""
    return (
        f"Meant is every plant {_clock(ledger).change} = F(x, u) + g with g the sum of L w for {shown}{more}."
        " That a plant obeys these bounds is assumed, not proved."
    )


def _deviation(ledger: Ledger, deviation: Deviation) -> str:
    names = [*(f"({name} - {name}*)" for name in state_names(ledger.model.states))]
    names += [f"(s{c + 1} - s{c + 1}*)" for c in range(len(ledger.model.channels))]
    names += [f"({name} - {name}*)" for name in input_names(ledger.model.inputs)] + ["1"] * ledger.counts_b
    states = state_names(ledger.model.states)
    columns = [_sum(row, [f"e({name})" for name in states], _marked) for row in deviation.columns]
    lines = [_sum(row, names, _towards_0 if len(row) == 1 else _marked) for row in deviation.C]
    some = [f"({', '.join(each[:SHOWN])}{', ...' if len(each) > SHOWN else ''})" for each in (columns, lines)]
    bound = f"|{some[1]}|^2" if lines else "0"
    return f"L = {some[0]} and |w|^2 <= {bound} + {_towards_0(deviation.epsilon)}^2"


def _sum(row: Row, names: Sequence[str], written: Callable[[Fraction], str]) -> str:
    terms = [f"{written(r)} {names[i]}" for i, r in list(row.items())[:SHOWN]]
    return (" + ".join(terms) or "0") + (" + ..." if len(row) > SHOWN else "")


def _towards_0(value: Fraction) -> str:
    return decimal(value, up=value < 0)


def _outputs(ledger: Ledger) -> Iterator[str]:
    clock = _clock(ledger)
    for output in ledger.outputs[:SHOWN]:
        terms = _combined(output.row, state_names(ledger.model.states))
        direct = "".join(f" + {_marked(d)} (u{i + 1} - u{i + 1}*)" for i, d in enumerate(output.direct) if d)
        size = sum((abs(d) for d in output.direct), _ZERO)
        bound = output.bound
        start = f"{root(bound)} sqrt(V({clock.start})) {clock.root}"
        inputs = _gain(ledger, ledger.kappa / bound) if bound > 0 else "0"
        spread = _spread(ledger, ledger.kappa / bound) if bound > 0 else ""
        through = f" + {decimal(size)} sup|u - u*|" if size else ""
        there = "For these, " if ledger.claim == "region" else ""
        yield f"{there}|{terms}{direct}| <= {start} + {inputs}{spread}{through}."


def steps(ledger: Ledger, proved: Proved) -> tuple[str, ...]:
    """Return the proof as short lines, in the order of the specification."""
    model, lines = ledger.model, []
    size = (counted(model.n, "state"), counted(len(model.channels), "channel"), counted(ledger.inputs, "input"))
    lines.append(f"1. The hash agrees; {', '.join(size)}.")
    if ledger.ball is not None:
        how = "Krawczyk's operator" if ledger.ball.radius else "Exact evaluation"
        lines.append(f"1. {how} proves exactly one equilibrium in the ball.")
    for i, curve in enumerate(ledger.curves):
        functions = counted(len(curve.functions), "function")
        lines.append(f"2. Curve {i}: {functions}, continuous; centre {_centre(curve.shift)}.")
        for k, form in enumerate(curve.forms):
            pieces = counted(len(form.cuts) - 1, "piece")
            lines.append(f"2. Curve {i}, form {k} = {_numbers(form.l)}: {form.kind}, {pieces}.")
    counts = {kind: sum(1 for fact in ledger.facts if fact.kind == kind) for kind in _FACTS}
    lines += [f"3. {counted(counts[kind], 'fact')}, {words}." for kind, words in _FACTS.items() if counts[kind]]
    densities = sum(len(point.densities) for point in ledger.points)
    lines.append(f"4. V = x'P x + {counted(densities, 'integral')}; V >= x'Pt x, Pt assembled exactly.")
    if ledger.dropped:
        lines.append(f"5. {len(ledger.dropped)} rows of M are exactly zero.")
    lines.append(f"6. M > 0 on the other {len(proved.kept)} entries: T M T' is strictly diagonally dominant.")
    lines.append("6. Pt - p I > 0 in the same way." if ledger.p else "6. Pt > 0 in the same way.")
    lines.append(f"7. {(_OF_STEPS if model.is_discrete else _CONCLUSIONS)[ledger.claim]}")
    return tuple(lines)


_FACTS = {
    "value": "products of two sector forms at one point",
    "one_signed": "products of two one-signed forms",
    "difference": "products of two nondecreasing forms of a difference of two points",
    "constant": "products of two forms with a constant",
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
        return f"within {_marked(shift[1])} of {_marked(shift[0])}"
    return "0, nothing subtracted" if shift is None else "any"
