"""Claims G, M, E and R: every hypothesis of the theorem is proved here, in the order of the specification."""

from collections.abc import Iterator
from fractions import Fraction

from flint import arb, arb_mat, ctx, fmpq, fmpq_mat

from persid_check.definite import is_positive_definite
from persid_check.equilibrium import has_unique_equilibrium
from persid_check.exact import Matrix, blocks, diagonal
from persid_check.results import Accepted, NotProvedError
from persid_check.search.prover import (
    prove_continuous,
    prove_integral_lower,
    prove_integral_unbounded,
    prove_integral_upper,
    prove_nondecreasing,
    prove_radially_unbounded,
    prove_sector_form,
    prove_strict_sector_form,
    prove_strictly_increasing,
)
from persid_check.search.side import Form, Shift
from persid_check.version_1 import output_sentences, sentences
from persid_check.version_1.conclusions import NOTHING, Conclusions, prove_incremental, prove_outputs
from persid_check.version_1.format import WORDS, Stability
from persid_check.version_1.inequality import (
    Inequality,
    assemble,
    density,
    gamma_matrix,
    input_columns,
    quadratic_form,
)
from persid_check.version_1.setting import Setting

MAX_REGIONAL = 200  # states: an inverse is enclosed
INVERSE_BITS = (192, 768, 3072)  # precisions of that enclosure, tried in this order


def prove_stability(claim: Stability, more: Conclusions = NOTHING) -> Accepted:
    """Return what is proved, or raise NotProvedError."""
    _signs(claim)
    _sizes(claim)
    _equilibrium(claim)
    settings = [_setting(claim, g) for g in range(len(claim.groups))]
    for setting in settings:
        _forms(setting, claim.subject.claim)
    matrices = assemble(claim)
    _dropped(claim, matrices)
    kept = [i for i in range(matrices.G.width) if i not in set(claim.dropped)]
    _lyapunov(claim, matrices, kept)
    _block(claim, matrices, kept)
    spanning = _span(claim, settings) if claim.subject.claim == "M" else []
    if claim.subject.claim == "R":
        _region(claim, matrices)
    everywhere = _holds_everywhere(claim, settings, spanning)
    if more.outputs is not None:
        prove_outputs(claim, more.outputs, lower_bound(claim, matrices) if claim.subject.claim == "R" else matrices.P)
    if more.incremental:
        prove_incremental(claim, everywhere)
    bounds = None if more.outputs is None else output_sentences.bounds(claim, more.outputs)
    statement = sentences.stability(claim, everywhere, bounds)
    if more.incremental:
        statement = f"{statement} {output_sentences.between(more)}"
    steps = sentences.stability_steps(claim, settings, kept, everywhere, output_sentences.steps(more))
    further = {"incremental": more.incremental, "everywhere": everywhere}
    names = tuple(name for name, holds in further.items() if holds)
    return Accepted(WORDS[claim.subject.claim], statement, steps, names)


def _sizes(claim: Stability) -> None:
    """The factors have the sizes of their matrices: so nothing is assembled that the file does not pay for in bytes."""
    n, entries = claim.subject.model.n, claim.subject.model.n + len(claim.subject.model.channels)
    states = n - sum(1 for entry in claim.dropped if entry < n)
    for name, size in (("P", states), ("Q", entries - len(claim.dropped) + input_columns(claim).width)):
        if len(claim.proof[name]) != size:
            raise NotProvedError(f"proof.{name}", f"{size} rows are needed, one for each row of its matrix")


def _signs(claim: Stability) -> None:
    """Multipliers are nonnegative; the constants of the estimates are positive."""
    for g, proof in enumerate(claim.groups):
        if any(mu < 0 for mu in proof.mu):
            raise NotProvedError(f"groups[{g}].mu", "a multiplier is negative")
        if any(tau < 0 for _, _, tau in proof.products):
            raise NotProvedError(f"groups[{g}].products", "a multiplier is negative")
    if isinstance(claim.gamma, Fraction) and claim.gamma <= 0:  # a matrix is proved positive with the block
        raise NotProvedError("gamma", "it must be positive")
    if claim.subject.claim in ("E", "R") and (claim.kappa <= 0 or claim.p <= 0):
        raise NotProvedError("kappa, p", "they must be positive")


def _equilibrium(claim: Stability) -> None:
    point, model = claim.point, claim.subject.model
    if point is None:
        if claim.subject.claim == "R" and any(model.b):
            raise NotProvedError("operating_point", "claim R needs an equilibrium, and b is not zero at the reference")
    elif not has_unique_equilibrium(model, point.x, point.radius, point.u):
        raise NotProvedError("operating_point", "no proof that exactly one equilibrium lies in the ball")


def _setting(claim: Stability, g: int) -> Setting:
    model, group = claim.subject.model, claim.subject.groups[g]
    curve = tuple((model.channels[c].program, alpha) for c, alpha in group.members)
    shift: Shift = None
    if claim.point is not None:
        center = sum((r * (claim.point.x[i] - model.x_ref[i]) for i, r in group.row.items()), Fraction(0))
        shift = (center, sum((abs(r) for r in group.row.values()), Fraction(0)) * claim.point.radius)
    domain = None
    if claim.subject.claim == "R":
        box = relative_box(claim)
        ends = [sorted((r * box[i][0], r * box[i][1])) for i, r in group.row.items()] or [[Fraction(-1), Fraction(1)]]
        domain = (sum((low for low, _ in ends), Fraction(0)), sum((high for _, high in ends), Fraction(0)))
    return Setting(g, group, claim.groups[g], curve, domain, shift)


def relative_box(claim: Stability) -> list[tuple[Fraction, Fraction]]:
    """Return a box inside X - x* for every x* in the ball; 0 lies in its interior."""
    model, point = claim.subject.model, claim.point
    center, radius = (model.x_ref, Fraction(0)) if point is None else (point.x, point.radius)
    box = [(lo - c + radius, hi - c - radius) for (lo, hi), c in zip(claim.box, center, strict=True)]
    if any(not lo < 0 < hi for lo, hi in box):
        raise NotProvedError("box", "the ball of the equilibrium does not lie in the interior of the box")
    return box


def _forms(setting: Setting, claim: str) -> None:
    """Every function is continuous; every form that is used is a sector form, with its constants."""
    curve, domain, shift, where = setting.curve, setting.domain, setting.shift, f"groups[{setting.index}]"
    if not prove_continuous(curve, domain, shift):
        raise NotProvedError(where, "no proof that its functions are continuous on the domain")
    for k in setting.proof.used():
        form = setting.proof.forms[k]
        if not prove_sector_form(curve, form, domain, shift):
            raise NotProvedError(f"{where}.forms[{k}]", "no proof that it is a sector form")
        if claim in ("E", "R") and setting.proof.mu[k]:
            _upper_constant(setting, k, f"{where}.integral[{k}]")
        if claim == "R" and setting.proof.mu[k]:
            _lower_constant(setting, k, f"{where}.quadratic[{k}]")


def _upper_constant(setting: Setting, k: int, where: str) -> None:
    c = setting.proof.integral[k]
    if c is None or c < 0:
        raise NotProvedError(where, "a form with mu > 0 needs a constant that is not negative")
    if not prove_integral_upper(setting.curve, setting.proof.forms[k], c, setting.domain, setting.shift):
        raise NotProvedError(where, "no proof of the upper bound of the integral")


def _lower_constant(setting: Setting, k: int, where: str) -> None:
    d = setting.proof.quadratic[k]
    if d is None or d < 0:
        raise NotProvedError(where, "a form with mu > 0 needs a constant that is not negative")
    if d and not prove_integral_lower(setting.curve, setting.proof.forms[k], d, setting.domain, setting.shift):
        raise NotProvedError(where, "no proof of the lower bound of the integral")


def _dropped(claim: Stability, matrices: Inequality) -> None:
    """An entry of z is dropped only where nothing touches it: no column of G, row of P, form, row of E or S."""
    n = claim.subject.model.n
    if claim.subject.claim != "M" and any(entry < n for entry in claim.dropped):
        raise NotProvedError("dropped", "a state is dropped; only claim M may do so")
    for entry in claim.dropped:
        if _column(matrices.G, entry):
            raise NotProvedError("dropped", f"column {entry} of G is not zero")
        if _touched(claim, entry) or (entry < n and _row(matrices.P, entry)):
            raise NotProvedError("dropped", f"a form or P touches entry {entry}")
        if any(_row(part, entry) for part in (matrices.E, matrices.S, matrices.Q, matrices.E * matrices.inputs)):
            raise NotProvedError("dropped", f"row {entry} of the inequality is not zero")
        if claim.subject.claim != "M" and _row(matrices.W, entry):
            raise NotProvedError("dropped", f"row {entry} of W is not zero")


def _touched(claim: Stability, entry: int) -> bool:
    n = claim.subject.model.n
    for group, proof in zip(claim.subject.groups, claim.groups, strict=True):
        forms = [proof.forms[k] for k in proof.used()]
        if entry < n and entry in group.row and any(form[0] for form in forms):
            return True
        places = [j for j, (c, _) in enumerate(group.members, start=1) if n + c == entry]
        if any(form[j] for j in places for form in forms):
            return True
    return False


def _row(part: Matrix, i: int) -> bool:
    return any(part.entries[i, j] != 0 for j in range(part.width))


def _column(part: Matrix, j: int) -> bool:
    return any(part.entries[i, j] != 0 for i in range(part.height))


def _lyapunov(claim: Stability, matrices: Inequality, kept: list[int]) -> None:
    """P > 0 on the kept states (G, M); P > p I (E); P + sum mu d r r' > p I (R)."""
    states = [i for i in kept if i < claim.subject.model.n]
    P = matrices.P.kept(states, states)
    if claim.subject.claim == "R":
        P = lower_bound(claim, matrices)
    if claim.subject.claim in ("E", "R"):
        P = P + diagonal([-claim.p] * len(states))
    if not is_positive_definite(P, claim.proof["P"]):
        raise NotProvedError("proof.P", "the lower bound of V is not proved positive definite")


def lower_bound(claim: Stability, matrices: Inequality) -> Matrix:
    """Return Pt = P + sum mu_k d_k r_g r_g', so that V >= x'Pt x on the box."""
    model, groups, states = claim.subject.model, claim.subject.groups, range(claim.subject.model.n)
    squares = []
    for proof, group in zip(claim.groups, groups, strict=True):
        total = sum((mu * d for mu, d in zip(proof.mu, proof.quadratic, strict=True) if mu and d), Fraction(0))
        size = 1 + len(group.members)
        squares.append([[total if i == j == 0 else Fraction(0) for j in range(size)] for i in range(size)])
    return matrices.P + quadratic_form(model, groups, squares).kept(states, states)


def _block(claim: Stability, matrices: Inequality, kept: list[int]) -> None:
    """[[-Q - kappa W, -E B], [., Gamma]] > 0 on the kept entries and all inputs."""
    negative = -matrices.Q
    if claim.kappa:
        negative = negative + -(diagonal([claim.kappa] * matrices.W.height) * matrices.W)
    inputs = range(matrices.inputs.width)
    corner = negative.kept(kept, kept)
    side = (-(matrices.E * matrices.inputs)).kept(kept, inputs)
    block = blocks([[corner, side], [side.T, gamma_matrix(claim)]])
    if not is_positive_definite(block, claim.proof["Q"]):
        raise NotProvedError("proof.Q", "the matrix inequality is not proved")


def _span(claim: Stability, settings: list[Setting]) -> list[Setting]:
    """Kept states and rows of channels with claim M's properties span the state space; return their groups."""
    n, dropped = claim.subject.model.n, set(claim.dropped)
    basis = [{i: Fraction(1)} for i in range(n) if i not in dropped]
    if len(basis) == n:
        return []
    spanning = [setting for setting in settings if _confines(setting, n, dropped)]
    rows = [*basis, *(setting.group.row for setting in spanning)]
    flat = [fmpq(v.numerator, v.denominator) for row in rows for v in (row.get(i, Fraction(0)) for i in range(n))]
    if fmpq_mat(len(rows), n, flat).rank() < n:
        raise NotProvedError("dropped", "kept states and rows of unbounded kept channels do not span the state space")
    return spanning


def _confines(setting: Setting, n: int, dropped: set[int]) -> bool:
    """Whether a kept channel of the group is strict and unbounded, and so is the group's integral in V."""
    size = len(setting.group.members)
    lam = tuple(density(setting.proof, size))
    curve, domain, shift = setting.curve, setting.domain, setting.shift
    if not (setting.group.row and any(lam) and prove_integral_unbounded(curve, lam, domain, shift)):
        return False
    return any(
        prove_strict_sector_form(curve, form, domain, shift) and prove_radially_unbounded(curve, form, domain, shift)
        for form in _axes(setting, n, dropped)
    )


def _axes(setting: Setting, n: int, dropped: set[int]) -> Iterator[Form]:
    size = len(setting.group.members)
    for j, (c, _) in enumerate(setting.group.members, start=1):
        if n + c not in dropped:
            yield tuple(Fraction(int(i == j)) for i in range(1 + size))


def _region(claim: Stability, matrices: Inequality) -> None:
    """V > c from h_i - 2r on: c (Pt^-1)_ii < (h_i - 2r)^2; and gamma ubar^2 <= kappa c.

    The box in x less 2r at each side, seen from any x* in the ball, lies in X and holds all |d_i| < h_i - 2r.
    """
    if claim.level <= 0 or claim.input_bound < 0:
        raise NotProvedError("level, input_bound", "the level is positive and the bound of the input not negative")
    if not _admits(claim):
        raise NotProvedError("input_bound", "gamma times its square is not proved to be at most kappa times the level")
    Pt = lower_bound(claim, matrices)
    if Pt.height > MAX_REGIONAL:
        raise NotProvedError("box", f"claim R is read for at most {MAX_REGIONAL} states")
    radius = Fraction(0) if claim.point is None else claim.point.radius
    depths = [min(-lo, hi) - 2 * radius for lo, hi in relative_box(claim)]
    shallow = next((i for i, depth in enumerate(depths) if depth <= 0), None)
    if shallow is not None:
        raise NotProvedError("box", f"it is too narrow about the ball of the equilibrium in coordinate {shallow}")
    outside = _reached(Pt, [claim.level / depth**2 for depth in depths])
    if outside is not None:
        raise NotProvedError("level", f"the set V <= level is not proved to keep off the faces of coordinate {outside}")


def _reached(Pt: Matrix, weights: list[Fraction]) -> int | None:
    """Return the first i for which weight_i (Pt^-1)_ii < 1 is not proved, by an enclosure of the inverse; else None."""
    first: int | None = 0
    for bits in INVERSE_BITS:
        with ctx.workprec(bits):
            try:
                inverse = arb_mat(Pt.flint).inv()
            except ZeroDivisionError:
                continue
            reach = [inverse[i, i] * arb(2) ** Pt.exponent * _ball(weight) for i, weight in enumerate(weights)]
            first = next((i for i, part in enumerate(reach) if not part < 1), None)
        if first is None or reach[first] >= 1:
            break
    return first


def _ball(value: Fraction) -> arb:
    return arb(fmpq(value.numerator, value.denominator))


def _admits(claim: Stability) -> bool:
    """gamma ubar^2 <= kappa c; the largest eigenvalue of Gamma > 0 is at most the 16th root of tr Gamma^16."""
    if isinstance(claim.gamma, Fraction):
        return claim.gamma * claim.input_bound**2 <= claim.kappa * claim.level
    power = gamma_matrix(claim)
    for _ in range(4):
        power = power * power
    trace = sum((power.entry(i, i) for i in range(power.height)), Fraction(0))
    return trace * claim.input_bound**32 <= (claim.kappa * claim.level) ** 16


def _holds_everywhere(claim: Stability, settings: list[Setting], spanning: list[Setting]) -> bool:
    """Whether the same numbers hold about every equilibrium of every constant input."""
    if claim.subject.claim == "R":
        return False
    return all(_monotone(setting, claim.subject.claim) for setting in settings) and all(
        _strictly_monotone(setting, claim.subject.model.n, set(claim.dropped)) for setting in spanning
    )


def _monotone(setting: Setting, claim: str) -> bool:
    for k in setting.proof.used():
        form = setting.proof.forms[k]
        if claim == "E" and setting.proof.mu[k]:
            c = setting.proof.integral[k]
            if c is None or c < (Fraction(1) if any(form[1:]) else Fraction(1, 2)):
                return False
        if not prove_nondecreasing(setting.curve, form):
            return False
    return True


def _strictly_monotone(setting: Setting, n: int, dropped: set[int]) -> bool:
    lam = tuple(density(setting.proof, len(setting.group.members)))
    return prove_strictly_increasing(setting.curve, lam) and any(
        prove_strictly_increasing(setting.curve, form) and prove_radially_unbounded(setting.curve, form)
        for form in _axes(setting, n, dropped)
    )
