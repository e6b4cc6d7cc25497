"""Claim "refuted": witnesses that the model is not ISS for the constant input u, whatever the point."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction

from persid_check.definite import is_positive_definite
from persid_check.enclosure import Interval, UndefinedError, constant, value
from persid_check.equilibrium import ball, flow, has_unique_equilibrium, jacobian
from persid_check.exact import Matrix, blocks, diagonal, matrix, zeros
from persid_check.expression import Program
from persid_check.flint_matrix import MAX_EXPONENT
from persid_check.model import Channel, Model
from persid_check.refutations import sentences
from persid_check.refutations.format import POSED, Refutation
from persid_check.results import NotProvedError
from persid_check.search.prover import prove_bounded, prove_bounded_below, prove_continuous, prove_nondecreasing
from persid_check.search.side import Curve

INFLATION = Fraction(1, 2**60)  # an unstable equilibrium is proved so on a neighbourhood of its ball, however small

_AXIS = (Fraction(0), Fraction(1))
Part = tuple[Program, Fraction]  # f(rho s)


def prove_refutation(claim: Refutation) -> tuple[str, tuple[str, ...]]:
    """Return the statement that is proved and the steps of its proof, or raise NotProvedError."""
    model = claim.subject.model
    if model.is_discrete and claim.kind not in _OF_STEPS:
        raise NotProvedError("witness.kind", "in discrete time it proves nothing: a sequence may jump over")
    if model.algebraic and claim.kind not in _OF_EQUATIONS:
        raise NotProvedError("witness.kind", "it reads rows as derivatives, and some of them are equations")
    if not model.algebraic and claim.kind in POSED:
        raise NotProvedError("witness.kind", "the model has no equations")
    for i, point in enumerate(claim.points):
        resting = _held(model, point.x) if claim.kind in POSED else model.resting
        if not has_unique_equilibrium(resting, point.x, point.radius, point.u):
            raise NotProvedError(f"witness.points[{i}]", "no proof that exactly one equilibrium lies in the ball")
    for c, channel in enumerate(model.channels):
        if not prove_continuous(_curve(channel)):
            raise NotProvedError(f"channel {c}", "no proof that its function is continuous on R")
    _KINDS[claim.kind](claim)
    return sentences.refutation(claim), sentences.refutation_steps(claim)


def _curve(channel: Channel) -> Curve:
    return ((channel.program, Fraction(1)),)


def _held(model: Model, x: Sequence[Fraction]) -> Model:
    """The model whose states stay at those of x: it rests where its equations hold there."""
    n, zero, places = model.order, (0.0,) * model.order, range(model.n)
    linear = blocks([[diagonal([1] * n), zeros(n, model.algebraic)], [model.linear.kept(places[n:], places)]])
    channels = tuple(replace(channel, column=(*zero, *channel.column[n:])) for channel in model.channels)
    B = (*[(0.0,) * model.m] * n, *model.B[n:])
    b = (*(model.x_ref[i] - x[i] for i in range(n)), *model.b[n:])
    return replace(model, linear=linear, channels=channels, B=B, b=b)


def _two_solutions(claim: Refutation) -> None:
    """Two balls, each with a solution of the equations at the same state, are disjoint in the algebraic variables."""
    one, two = claim.points
    n = claim.subject.model.order
    if one.x[:n] != two.x[:n]:
        raise NotProvedError("witness.points", "they have different states")
    if not any(abs(a - b) > one.radius + two.radius for a, b in zip(one.x[n:], two.x[n:], strict=True)):
        raise NotProvedError("witness.points", "the two solutions are not proved to differ")


def _free_direction(claim: Refutation) -> None:
    """Equations do not change along v != 0 of the algebraic variables, exactly."""
    model, v = claim.subject.model, claim.vector
    n = model.order
    if not any(v):
        raise NotProvedError("witness.direction", "it is zero")
    if any(_dot(v, row[n:]) for row in model.A0[n:]):
        raise NotProvedError("witness.direction", "the linear part of an equation changes along it")
    for c, channel in enumerate(model.channels):
        along = sum((r * v[i - n] for i, r in channel.row.items() if i >= n), Fraction(0))
        if along and any(channel.column[n:]):
            raise NotProvedError("witness.direction", f"the argument of channel {c}, in an equation, changes along it")


def _two_equilibria(claim: Refutation) -> None:
    """Two balls, each with an equilibrium at u, are disjoint in the states; algebraic variables do not count."""
    one, two = claim.points
    states = range(claim.subject.model.order)
    if not any(abs(one.x[i] - two.x[i]) > one.radius + two.radius for i in states):
        raise NotProvedError("witness.points", "the two balls are not proved disjoint in the states")


def _unstable_equilibrium(claim: Refutation) -> None:
    """x'Sx grows where it is positive, for every Jacobian about the ball: J'S + S J - 2 sigma S > 0; see `_grows`."""
    point = claim.points[0]
    size = 1 + max(abs(v) for v in point.x)
    try:
        J = jacobian(claim.subject.model, ball(point.x, point.radius + INFLATION * size))
    except UndefinedError:
        raise NotProvedError("witness.point", "the Jacobian is not enclosed about the ball") from None
    _grows(claim, J)


def _unstable_linear_part(claim: Refutation) -> None:
    """Every function with a nonzero column is bounded, and x' = A0 x, or x+ = A0 x, grows exponentially."""
    for c, channel in enumerate(claim.subject.model.channels):
        if any(channel.column) and not prove_bounded(_curve(channel), _AXIS):
            raise NotProvedError(f"channel {c}", "no proof that its function is bounded on R")
    _grows(claim, [[constant(a) for a in row] for row in claim.subject.model.A0])


def _grows(claim: Refutation, J: Sequence[Sequence[Interval]]) -> None:
    """S, sigma >= 0, e with e'Se > 0, and J'S + S J - 2 sigma S > 0 for every J in the intervals.

    In discrete time sigma >= 1, and J'S J - sigma S > 0. With algebraic variables J is of all rows, and Y J + J'Y' with
    Y' = (S, 0) and the multipliers of equations stands in place of S J + J'S.
    """
    n, sigma, e, steps = claim.subject.model.order, claim.number, claim.vector, claim.subject.model.is_discrete
    S = [[claim.S[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)]
    if sigma < steps:
        raise NotProvedError("witness.sigma", "it is less than 1" if steps else "it is negative")
    if not sum(e[i] * S[i][j] * e[j] for i in range(n) for j in range(n)) > 0:
        raise NotProvedError("witness.direction", "e'Se is not positive")
    lower = _lower_bound_of_step(S, sigma, J) if steps else _lower_bound(claim, S, J)
    if not is_positive_definite(lower, claim.factor):
        form = "J'S J - sigma S" if steps else "J'S + S J - 2 sigma S"
        raise NotProvedError("witness.T", f"{form} is not proved positive definite")


def _lower_bound(claim: Refutation, S: Sequence[Sequence[Fraction]], J: Sequence[Sequence[Interval]]) -> Matrix:
    """The middle of Y J + J'Y' - 2 sigma S over the intervals, less the row sums of the radii on its diagonal."""
    size, k = len(J), len(claim.multipliers)
    middle, radius = _middle_and_radius(J)
    padded = [[*row, *[Fraction(0)] * k] for row in S]
    Y = matrix([*padded, *claim.multipliers], size).T
    YJ, spread = Y * middle, _sizes(Y) * radius
    growth = diagonal([2 * claim.number] * size) * matrix([*padded, *[[Fraction(0)] * size] * k], size)
    return YJ + YJ.T + -growth + -_row_sums(spread + spread.T)


def _lower_bound_of_step(S: Sequence[Sequence[Fraction]], sigma: Fraction, J: Sequence[Sequence[Interval]]) -> Matrix:
    """Below J'S J - sigma S: with J = M + E, |E| <= R, it is M'S M - sigma S less R'|S M| + |S M|'R + R'|S| R."""
    n = len(S)
    middle, radius = _middle_and_radius(J)
    SM = matrix(S, n) * middle
    side = radius.T * _sizes(SM)
    spread = side + side.T + radius.T * _sizes(matrix(S, n)) * radius
    return middle.T * SM + -(diagonal([sigma] * n) * matrix(S, n)) + -_row_sums(spread)


def _middle_and_radius(J: Sequence[Sequence[Interval]]) -> tuple[Matrix, Matrix]:
    n, half = len(J), Fraction(1, 2)
    ends = [[(_exact(entry.lo), _exact(entry.hi)) for entry in row] for row in J]
    middle = matrix([[(lo + hi) * half for lo, hi in row] for row in ends], n)
    return middle, matrix([[(hi - lo) * half for lo, hi in row] for row in ends], n)


def _sizes(M: Matrix) -> Matrix:
    """The matrix of absolute values."""
    return matrix([[abs(M.entry(i, j)) for j in range(M.width)] for i in range(M.height)], M.width)


def _row_sums(M: Matrix) -> Matrix:
    """The diagonal matrix of the sums of rows."""
    return diagonal([sum((M.entry(i, j) for j in range(M.width)), Fraction(0)) for i in range(M.height)])


def _exact(number) -> Fraction:  # type: ignore[no-untyped-def]
    mantissa, exponent = number.man_exp()
    if abs(int(exponent)) > MAX_EXPONENT:
        raise NotProvedError("witness.point", "an entry of the Jacobian is too large or needs too many binary places")
    return Fraction(int(mantissa)) * Fraction(2) ** int(exponent)


def _marginal_direction(claim: Refutation) -> None:
    """w'A0 = 0, w'B != 0 and every (w'a_c) f_c bounded below: some constant input drives w'x to infinity.

    In discrete time w'A0 = w', so that w'(x+ - x) is what w'x' is here.
    """
    model, w = claim.subject.model.resting, claim.vector
    if any(_dot(w, [row[j] for row in model.A0]) for j in range(model.n)):
        raise NotProvedError("witness.direction", "w'A0 is not zero")
    if not any(_dot(w, [Fraction(row[k]) for row in model.B]) for k in range(model.m)):
        raise NotProvedError("witness.direction", "w'B is zero, and then no input drives w'x")
    for c, channel in enumerate(model.channels):
        factor = _dot(w, [Fraction(a) for a in channel.column])
        if factor and not prove_bounded_below(_curve(channel), (Fraction(0), factor)):
            raise NotProvedError(f"channel {c}", "no proof that (w'a) f is bounded from below")


def _dot(w: Sequence[Fraction], v: Sequence[Fraction]) -> Fraction:
    return sum((a * b for a, b in zip(w, v, strict=True) if a and b), Fraction(0))


def _cooperative_growth(claim: Refutation) -> None:
    """A start above the equilibrium, F > 0 there, off-diagonal slopes >= 0: the state never comes back."""
    point, start, model = claim.points[0], claim.vector, claim.subject.model
    lows = [s - x - point.radius for s, x in zip(start, point.x, strict=True)]
    if any(low < 0 for low in lows) or not any(low > 0 for low in lows):
        raise NotProvedError("witness.start", "it is not proved to lie above the equilibrium")
    if any(a < 0 for i, row in enumerate(model.A0) for j, a in enumerate(row) if i != j):
        raise NotProvedError("model.A0", "an entry off the diagonal is negative")
    for c, channel in enumerate(model.channels):
        if not any(channel.column):
            continue
        if not prove_nondecreasing(_curve(channel), _AXIS):
            raise NotProvedError(f"channel {c}", "no proof that its function is nondecreasing")
        if any(Fraction(a) * r < 0 for i, a in enumerate(channel.column) for j, r in channel.row.items() if i != j):
            raise NotProvedError(f"channel {c}", "a slope off the diagonal may be negative")
    try:
        F = flow(model, start, claim.u)
    except UndefinedError:
        raise NotProvedError("witness.start", "F is not enclosed there") from None
    if not all(f > 0 for f in F.entries()):
        raise NotProvedError("witness.start", "F is not proved positive there")


def _invariant_line(claim: Refutation) -> None:
    """F(x_ref + s v, u) = g(s) v for all s, exactly; g(0) = 0, and s0 g(s0) >= 0 at some s0 != 0."""
    model, v, s0 = claim.subject.model, claim.vector, claim.number
    place = next((i for i, entry in enumerate(v) if entry), None)
    if place is None or s0 == 0:
        raise NotProvedError("witness", "the direction and the offset must not be zero")
    inputs = [a - b for a, b in zip(claim.u, model.u_ref, strict=True)]
    rest = [_dot([Fraction(b) for b in row], inputs) + Fraction(b) for row, b in zip(model.B, model.b, strict=True)]
    if any(rest):
        raise NotProvedError("witness", "x_ref is not an equilibrium for u")
    parts = _along(model.channels, v)
    linear = [_dot(row, v) for row in model.A0]
    if any(
        column[i] * v[place] != column[place] * v[i] for column in (linear, *parts.values()) for i in range(model.n)
    ):
        raise NotProvedError("witness.direction", "the line is not proved invariant")
    try:
        if any(not value(program, constant(Fraction(0))).is_zero for program, _ in parts):
            raise NotProvedError("witness", "x_ref is not an equilibrium for u")
        g = constant(linear[place] / v[place] * s0)
        for (program, rho), column in parts.items():
            g = g + constant(column[place] / v[place]) * value(program, constant(rho * s0))
    except UndefinedError:
        raise NotProvedError("witness.offset", "g is not enclosed there") from None
    if not (constant(s0) * g).lo >= 0:
        raise NotProvedError("witness.offset", "s g(s) is not proved to be at least 0 there")


def _along(channels: Sequence[Channel], v: Sequence[Fraction]) -> Mapping[Part, list[Fraction]]:
    """Columns summed over the channels that are one function of s on the line: equal program and equal r'v."""
    parts: dict[Part, list[Fraction]] = {}
    for channel in channels:
        rho = sum((r * v[i] for i, r in channel.row.items()), Fraction(0))
        column = [Fraction(a) for a in channel.column]
        old = parts.get((channel.program, rho), [Fraction(0)] * len(column))
        parts[channel.program, rho] = [a + b for a, b in zip(old, column, strict=True)]
    return parts


_OF_EQUATIONS = ("two-equilibria", "unstable-equilibrium", *POSED)
_OF_STEPS = ("two-equilibria", "unstable-equilibrium", "unstable-linear-part", "marginal-direction")
_KINDS: dict[str, Callable[[Refutation], None]] = {
    "two-equilibria": _two_equilibria,
    "unstable-equilibrium": _unstable_equilibrium,
    "unstable-linear-part": _unstable_linear_part,
    "marginal-direction": _marginal_direction,
    "cooperative-growth": _cooperative_growth,
    "invariant-line": _invariant_line,
    "two-solutions": _two_solutions,
    "free-direction": _free_direction,
}
