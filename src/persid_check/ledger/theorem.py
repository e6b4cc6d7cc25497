"""The theorem of the ledger: every hypothesis is proved here, in the order of the specification (docs/ledger.md)."""

from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction

from flint import nmod_mat

from persid_check.definite import Definite, Root, proof_of, proves
from persid_check.equilibrium import has_unique_equilibrium
from persid_check.exact import Matrix, diagonal, matrix, zeros
from persid_check.ledger.algebraic import prove_algebraic, prove_bounds
from persid_check.ledger.assembly import Assembly, assemble
from persid_check.ledger.further import further
from persid_check.ledger.identities import prove_identity
from persid_check.ledger.lemmas import Lemma, Product, discontinuous, vanishes
from persid_check.ledger.values import RISING, Curve, Fact, Form, Ledger, Map, Output, Point, Row
from persid_check.results import NotProvedError, require
from persid_check.work import spend

SQUARINGS = 4  # Gamma^16: its trace bounds the 16th power of the largest eigenvalue
BITS = 128  # of Gamma's trace, to which its entries are rounded before
COMPARED = 8  # instructions of two programs, in a step
PRIME = 2**61 - 1  # the rank modulo a prime is at most the rank
_ZERO, _HALF, _ONE = Fraction(0), Fraction(1, 2), Fraction(1)


@dataclass(frozen=True)
class Proved:
    """What was proved beside the claim: the names of further sentences, and the matrices."""

    further: tuple[str, ...]
    kept: tuple[int, ...]
    assembly: Assembly


def prove(ledger: Ledger) -> Proved:
    """Return what is proved, or raise NotProvedError."""
    _numbers(ledger)
    _equilibrium(ledger)
    for i, curve in enumerate(ledger.curves):
        _curve(f"curves[{i}]", curve)
    for p in range(len(ledger.points)):
        _point(ledger, p)
    _every_channel_stands(ledger)
    for i, fact in enumerate(ledger.facts):
        _fact(ledger, fact, f"facts: the {i + 1}th, {fact.kind}")
    for p, point in enumerate(ledger.points):
        _densities(ledger, p, point)
        _values(ledger, p, point)
    on_domain = any(ledger.curves[point.curve].domain for point in ledger.points)
    require(ledger.claim == "region" or not on_domain, "curves", "only claim region has functions on a domain")
    if ledger.model.algebraic or ledger.algebraic is not None:
        prove_algebraic(ledger, ledger.algebraic)
    prove_identity(ledger)
    matrices = assemble(ledger)
    kept = _rows_kept(ledger, matrices)
    require(proves(ledger.proof["M"], matrices.M.kept(kept, kept)), "proof.M", "the matrix inequality is not proved")
    _lyapunov(ledger, matrices, kept)
    _bounds(ledger, matrices)
    return Proved(further(ledger, kept), kept, matrices)


def _numbers(ledger: Ledger) -> None:
    """The constants have the signs that the claim needs."""
    rated, regional = ledger.claim != "iss", ledger.claim == "region"
    require(not rated or (ledger.kappa > 0 and ledger.p > 0), "kappa, p", "they must be positive")
    require(rated or not (ledger.kappa or ledger.p), "kappa, p", "claim iss has none: both are 0")
    positive = not isinstance(ledger.gamma, Fraction) or ledger.gamma > 0  # a matrix is proved positive with M
    require(positive, "gamma", "it must be positive")
    require(all(each.s > 0 for each in ledger.deviations), "deviations", "each multiplier s must be positive")
    bounded = ledger.level > 0 and ledger.input_bound >= 0
    require(bounded or not regional, "level, input_bound", "a level is positive, a bound is not negative")
    has_set = ledger.strips or ledger.level or ledger.input_bound
    require(regional or not has_set, "strips, level, input_bound", "only claim region has them")
    bounds_outputs = ledger.claim in ("rate-and-gain", "region")
    require(bounds_outputs or ledger.outputs is None, "outputs", "they need the claim rate-and-gain or region")
    if ledger.model.is_discrete:
        _discrete_numbers(ledger)


def _discrete_numbers(ledger: Ledger) -> None:
    """In discrete time V shrinks to a share 1 - kappa, and every state is kept (section 10)."""
    require(ledger.kappa < 1, "kappa", "in discrete time it is less than 1")
    drops = any(i < ledger.model.n for i in ledger.dropped) or ledger.spanning
    require(not drops, "dropped", "in discrete time no state is dropped")
    once = len({c for point in ledger.points for c in point.channels}) == sum(len(p.channels) for p in ledger.points)
    known = once or not ledger.inside or ledger.claim != "region"
    require(known, "points", "where a region reads values after a step each channel stands at one point")


def _equilibrium(ledger: Ledger) -> None:
    ball, where = ledger.ball, "operating_point"
    if ball is None:
        rests = ledger.claim != "region" or not any(ledger.model.b)
        require(rests, where, "a region needs an equilibrium, and b is not zero at the reference")
        return
    require(ledger.claim != "practical", where, "claim practical is about x_ref: null is needed")
    unique = has_unique_equilibrium(ledger.model.resting, ball.x, ball.radius, ball.u)
    require(unique, where, "no proof that exactly one equilibrium lies in the ball")


def _ends(curve: Curve) -> tuple[Fraction, Fraction] | None:
    """Return the ends of all arguments that a curve is looked at; None for all of R."""
    if curve.domain is None:
        return None
    middle, radius = curve.shift if isinstance(curve.shift, tuple) else (_ZERO, _ZERO)
    return middle - radius + curve.domain[0], middle + radius + curve.domain[1]


def _curve(where: str, curve: Curve) -> None:
    """Every function is continuous, and each form is what the file says, on the domain, for every possible centre."""
    domain = curve.domain
    require(domain is None or domain[0] < 0 < domain[1], f"{where}.domain", "0 must lie inside")
    require(curve.shift != "any" or domain is None, f"{where}.domain", "with any centre it is all of R")
    reason = discontinuous(curve.functions, curve.continuous, _ends(curve))
    require(not reason, f"{where}.continuous", f"no proof that the functions are continuous: {reason}")
    for k in range(len(curve.forms)):
        _form(f"{where}.forms[{k}]", curve, k)
    for j, product in enumerate(curve.products):
        plain, at = curve.shift is None and domain is None, f"{where}.products[{j}]"
        require(plain, at, "a product with a constant is not shifted, and on all of R")
        lemma = Product(curve.functions, (curve.forms[product.k].l, curve.forms[product.q].l), product.c)
        reason = lemma.unproved(product.cuts)
        require(not reason, at, f"it is not proved: {reason}")


def _form(where: str, curve: Curve, k: int) -> None:
    form, any_centre = curve.forms[k], curve.shift == "any"
    require(not any_centre or form.kind in RISING, where, "with any centre a form is nondecreasing or rising")
    reason = _lemma(curve, form, form.kind, allowance=form.offset).unproved(form.cuts, curve.domain)
    require(not reason, where, f"no proof that it is {form.kind}: {reason}")
    upper, at = form.upper, f"{where}.upper"
    if upper is not None and not _is_free(curve, k):
        if upper.cuts is None:
            raise NotProvedError(at, "such a bound needs cuts")
        require(not any_centre, at, "with any centre the bound is c >= 1, or 1/2 for a multiple of y")
        reason = _lemma(curve, form, "upper", c=upper.c, allowance=upper.e).unproved(upper.cuts, curve.domain)
        require(not reason, at, f"the bound of the integral is not proved: {reason}")
    if form.lower is not None:
        d, j = form.lower
        other = curve.forms[j]
        bounds = (form.l[0] - d, *form.l[1:]) == other.l and (curve.is_sector(j) or other.kind == "offset")
        bounds = bounds or (curve.squares[k] and other.kind in RISING and curve.is_sector(k))
        message = "form j must be l - d e_0, a sector form or one with an offset, or e_0 - d l, nondecreasing"
        require(bounds, f"{where}.lower", message)


def _lemma(curve: Curve, form: Form, kind: str, **numbers: Fraction) -> Lemma:
    centre = None
    if isinstance(curve.shift, tuple):
        center, radius = curve.shift
        centre = (center - radius, center + radius)
    return Lemma(curve.functions, form.l, kind, centre, **numbers)


def _is_free(curve: Curve, k: int) -> bool:
    """Whether a bound of the integral needs no proof: c >= 1 of a nondecreasing form, c >= 1/2 of a multiple of y."""
    form = curve.forms[k]
    upper = form.upper
    if upper is None or upper.cuts is not None:
        return False
    if not any(form.l[1:]) and form.l[0] >= 0 and upper.c >= _HALF:
        return True
    return form.kind in RISING and upper.c >= 1 and curve.resting[k]


def _point(ledger: Ledger, p: int) -> None:
    """The channels are the functions of the curve on multiples of the row; the centre is a possible one."""
    point, where = ledger.points[p], f"points[{p}]"
    curve = ledger.curves[point.curve]
    for c, (program, alpha) in zip(point.channels, curve.functions, strict=True):
        channel = ledger.model.channels[c]
        spend(len(channel.row) + len(program) // COMPARED)
        require(channel.program == program, where, f"channel {c} has another function")
        multiple = channel.row == {i: alpha * r for i, r in point.row.items()}
        require(multiple, where, f"the row of channel {c} is not the multiple of the point's row")
    shifted = (curve.shift is None) == (ledger.ball is None)
    require(shifted, where, "the curve is shifted exactly where there is an operating point")
    if isinstance(curve.shift, tuple):
        center, radius = ledger.centre(p)
        within = abs(center - curve.shift[0]) + radius <= curve.shift[1]
        require(within, where, "its centre is not within the curve's")


def _every_channel_stands(ledger: Ledger) -> None:
    standing = {c for point in ledger.points for c in point.channels}
    for c in range(len(ledger.model.channels)):
        require(c in standing, "points", f"channel {c} stands at no point, so it is not proved continuous")


def _fact(ledger: Ledger, fact: Fact, where: str) -> None:
    """The two rows have the sign that the kind of fact says."""
    points = ledger.points[fact.p], ledger.points[fact.q]
    curves = [ledger.curves[point.curve] for point in points]
    if fact.kind == "constant":  # proved with its curve, which is not shifted and on all of R
        require(ledger.claim == "practical", where, "constants belong to claim practical")
        return
    forms = curves[0].forms[fact.k], curves[1].forms[fact.l]
    rising, same = all(form.kind in RISING for form in forms), points[0].curve == points[1].curve
    timely = fact.kind != ("slope" if ledger.model.is_discrete else "step")
    require(timely, where, "slopes are facts in continuous time, steps in discrete time")
    if fact.kind in ("value", "step") and not fact.sign:
        sector = fact.p == fact.q and all(curves[0].is_sector(k) for k in (fact.k, fact.l))
        require(sector, where, "both forms must be sector forms, of one point")
    if fact.kind == "one_signed":
        require(all(form.kind == "one-signed" for form in forms), where, "both forms must be one-signed")
    if fact.kind == "slope":
        require(rising, where, "both forms must be nondecreasing")
    if fact.sign:
        require(same and rising, where, "two points of one curve and nondecreasing forms are needed")
    if fact.kind == "difference" or fact.sign > 0 or (fact.sign and fact.p != fact.q):
        _equal_centres(ledger, curves[0], fact, where)


def _equal_centres(ledger: Ledger, curve: Curve, fact: Fact, where: str) -> None:
    (first, radius), (second, other) = (ledger.centre(p) for p in (fact.p, fact.q))
    equal = first == second and not radius and not other
    require(equal, where, "the two points are not proved to have the same centre")
    if fact.sign > 0:
        require(curve.odd and not first, where, "a sum needs odd functions that are not shifted")
        symmetric = curve.domain is None or curve.domain[0] == -curve.domain[1]
        require(symmetric, where, "a sum needs a symmetric domain")


def _densities(ledger: Ledger, p: int, point: Point) -> None:
    """Each density has an integral that is not negative, or offsets in claim practical."""
    curve, offset = ledger.curves[point.curve], ledger.claim == "practical"
    for k in (k for k, mu in point.densities if mu):
        form, where = curve.forms[k], f"points[{p}].densities, form {k}"
        bounded = form.lower is not None or curve.is_sector(k) or form.kind == "offset"
        require(bounded, where, "a density is a sector form, or has an offset or a lower bound")
        rises = form.kind in RISING or not ledger.model.is_discrete
        require(rises, where, "in discrete time a density is nondecreasing")
        leaves = ledger.claim == "region" and ledger.model.is_discrete
        held = not leaves or form.lower is None or curve.forms[form.lower[1]].kind != "offset"
        require(held, where, "where a step may leave the domain no lower bound is by an offset form")
        below = form.offset if form.lower is None else curve.forms[form.lower[1]].offset
        above = _ZERO if form.upper is None else form.upper.e
        require(offset or not (below or above), where, "offsets belong to claim practical")


def _values(ledger: Ledger, p: int, point: Point) -> None:
    """Channels whose values P reads vanish at x*; in continuous time they are locally Lipschitz: they have slopes."""
    curve, slopes = ledger.curves[point.curve], not ledger.model.is_discrete
    for c, function in zip(point.channels, curve.functions, strict=True):
        if c in ledger.inside_at:
            where = f"P.channels, channel {c}"
            reason = discontinuous((function,), curve.continuous, _ends(curve), lipschitz=slopes)
            require(not reason, where, f"no proof that it is locally Lipschitz: {reason}")
            free = ledger.claim == "practical" or curve.shift is not None
            require(free or vanishes((function,), (_ZERO, _ONE)), where, "it is not 0 at the operating point")


def _rows_kept(ledger: Ledger, matrices: Assembly) -> tuple[int, ...]:
    """Every dropped entry has an exactly zero row in M; return the others, with v and w."""
    dropped = set(ledger.dropped)
    found = matrices.M.kept(ledger.dropped, range(matrices.M.width))
    if found.entries != zeros(*found.shape).entries:
        i = next(i for i, row in zip(ledger.dropped, found.flint.table(), strict=True) if any(row))
        raise NotProvedError("dropped", f"row {i} of M is not zero")
    return tuple(i for i in range(matrices.M.height) if i not in dropped)


def _lyapunov(ledger: Ledger, matrices: Assembly, kept: tuple[int, ...]) -> None:
    """Pt - p I > 0; where states are dropped, P > 0 on the others, and they span with growing forms of V."""
    n, P, Pt = ledger.model.order, matrices.P, matrices.Pt
    states = [i for i in kept if i < n]
    if len(states) < n:
        require(not ledger.inside, "dropped", "where states are dropped P is over the states alone")
        _spanning(ledger, states, P)
    else:
        require(not ledger.spanning, "spanning", "no state is dropped")
    values = list(range(n, Pt.height))
    lower = (Pt + diagonal([-ledger.p] * n + [0] * len(values))).kept(*[states + values] * 2)
    require(proves(ledger.proof["P"], lower), "proof.P", "the lower bound of V is not proved positive definite")


def _spanning(ledger: Ledger, states: list[int], P: Matrix) -> None:
    n, dropped = ledger.model.order, set(ledger.dropped)
    require(ledger.claim == "iss", "dropped", "a state is dropped; only claim iss may do so")
    clear = all(P.entries[i, j] == 0 for i in dropped if i < n for j in range(n))
    require(clear, "dropped", "P has an entry at a dropped state")
    densities = [ledger.curves[point.curve].forms[k] for point in ledger.points for k, mu in point.densities if mu]
    bounded = any(form.lower for form in densities)
    require(not bounded, "dropped", "where states are dropped no density has a lower bound")
    rows: list[Row] = [{i: _ONE} for i in states]
    rows += [_spanning_row(ledger, p, k, dropped) for p, k in ledger.spanning]
    flat = [_residue(row.get(i, _ZERO)) for row in rows for i in range(n)]
    spans = nmod_mat(len(rows), n, flat, PRIME).rank() == n
    require(spans, "spanning", "kept states and rows of growing forms do not span the state space")


def _residue(value: Fraction) -> int:
    """Return a dyadic number modulo the prime."""
    return value.numerator * pow(value.denominator, -1, PRIME) % PRIME


def _spanning_row(ledger: Ledger, p: int, k: int, dropped: set[int]) -> Row:
    """The row of a point where form k is growing, in V, and reads no dropped entry."""
    point = ledger.points[p]
    curve = ledger.curves[point.curve]
    form, n = curve.forms[k], ledger.model.n
    spend(len(point.densities) + len(form.l) + n)
    grows = form.kind == "growing" or (form.kind == "rising" and curve.resting[k])
    grows = grows and any(mu and density == k for density, mu in point.densities)
    require(grows, "spanning", f"form {k} of point {p} is not growing, or not in V")
    reads = {n + c for c, value in zip(point.channels, form.l[1:], strict=True) if value}
    reads |= set(point.row) if form.l[0] else set()
    require(not reads & dropped, "spanning", f"form {k} of point {p} reads a dropped entry")
    return point.row


def _bounds(ledger: Ledger, matrices: Assembly) -> None:
    """The region lies inside its strips and is invariant; outputs are bounded by V."""
    if ledger.claim != "region" and ledger.outputs is None:
        return
    factor = ledger.proof["V"]
    bounding = None if isinstance(factor, Root) else proof_of(matrices.Pt, factor)
    if bounding is None:
        raise NotProvedError("proof.V", "Pt is not proved positive definite")
    if ledger.claim == "region":
        _region(ledger, matrices, bounding)
    if ledger.outputs is not None:
        _outputs(ledger.outputs.listed, bounding)


def _outputs(outputs: Sequence[Output], bounding: Definite) -> None:
    """c_i is at least C_i Pt^-1 C_i', and L_i s + h_i and L_i s - h_i do not fall."""
    for i, (output, bound) in enumerate(zip(outputs, bounding.bounds([output.row for output in outputs]), strict=True)):
        bounded, where = bound <= output.constant, f"outputs.constants[{i}]"
        require(bounded, where, "c V >= (C (x - x*))^2 is not proved from the bound of V")
        reason = output.map and _steeper(output.map)
        require(not reason, f"outputs.lipschitz[{i}]", f"no proof that the map is nowhere steeper: {reason}")


def _steeper(map: Map) -> str | None:
    """Return where it is not proved that L s + h(s) and L s - h(s) are continuous and do not fall, or None."""
    functions = ((map.h, _ONE),)
    falls = (Lemma(functions, (map.L, sign), "nondecreasing").unproved(map.cuts, None) for sign in (_ONE, -_ONE))
    return discontinuous(functions, map.cuts, None) or next((reason for reason in falls if reason), None)


def _region(ledger: Ledger, matrices: Assembly, bounding: Definite) -> None:
    sides = [side for side in ledger.sides if ledger.is_of_states(side[0])]
    for (_, lo, hi), bound in zip(sides, bounding.bounds([row for row, *_ in sides]), strict=True):
        h = min(-lo, hi)
        require(h > 0, "strips", "each strip holds 0 inside")
        require(ledger.level * bound < h * h, "level", "the level set is not proved to stay off every face")
    supply = sum((deviation.s * deviation.epsilon**2 for deviation in ledger.deviations), _ZERO)
    room = ledger.kappa * ledger.level - supply
    invariant = room >= 0 and _largest(ledger, matrices) * ledger.input_bound**32 <= room**16
    require(invariant, "input_bound", "the region is not proved invariant for inputs of this size")
    if ledger.algebraic is not None:
        prove_bounds(ledger, ledger.algebraic, matrices)


def _largest(ledger: Ledger, matrices: Assembly) -> Fraction:
    """Return at least the 16th power of Gamma's largest eigenvalue."""
    if isinstance(ledger.gamma, Fraction):
        return ledger.gamma**16
    power = _rounded_up(matrices.gamma)
    for _ in range(SQUARINGS):
        power = power * power
    return sum((power.entry(i, i) for i in range(power.height)), _ZERO)


def _rounded_up(gamma: Matrix) -> Matrix:
    """Return a matrix of short numbers that is at least gamma >= 0, whose entries are at most its trace 2**b.

    Each entry is rounded down by less than h = 2**(b - BITS); the norm of what is lost is at most h times the size.
    """
    size = gamma.height
    trace = sum((gamma.entry(i, i) for i in range(size)), _ZERO)
    b = trace.numerator.bit_length() - trace.denominator.bit_length() + 1
    h = Fraction(2) ** (b - BITS)
    rows = [[h * (gamma.entry(i, j) // h + size * (i == j)) for j in range(size)] for i in range(size)]
    return matrix(rows, size)
