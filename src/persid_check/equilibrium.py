"""Operating points: exactly one equilibrium in a ball, by the Krawczyk operator in interval arithmetic."""

from collections.abc import Mapping, Sequence
from fractions import Fraction

from flint import arb, arb_mat

from persid_check.enclosure import Interval, UndefinedError, between, constant, enclose, value, value_and_slope
from persid_check.expression import work_of
from persid_check.model import Model
from persid_check.work import spend

PRODUCTS = 16  # of balls in a product of matrices, that a step counts for

Vector = Sequence[Fraction]


def has_unique_equilibrium(model: Model, x: Vector, radius: Fraction, u: Vector) -> bool:
    """Whether exactly one zero of F(., u) in |. - x|_inf <= radius is proved; radius 0 needs F(x, u) = 0 exactly."""
    if radius < 0:
        return False
    try:
        F = flow(model, [constant(v) for v in x], u)
        if radius == 0:
            return all(f.lo == 0 and f.hi == 0 for f in F)
        return _contracts(F, jacobian(model, ball(x, radius)), radius)
    except (UndefinedError, ZeroDivisionError):
        return False


def _contracts(F: Sequence[Interval], J: Sequence[Sequence[Interval]], radius: Fraction) -> bool:
    """-Y F(x) + (I - Y J) [-r, r] lies in the interior of [-r, r], for some Y (the inverse of the middle of J)."""
    n = len(F)
    spend(n**3 // PRODUCTS)
    middle = arb_mat(n, n, [entry.ball().mid() for row in J for entry in row])
    Y = arb_mat(n, n, [entry.mid() for entry in middle.inv().entries()])
    rest = arb_mat(n, n, [int(i == j) for i in range(n) for j in range(n)]) - Y * arb_mat(
        n, n, [entry.ball() for row in J for entry in row]
    )
    step = Y * arb_mat(n, 1, [f.ball() for f in F])
    limit = constant(radius).lo
    for i in range(n):
        reach = abs(step[i, 0]) + limit * sum((abs(rest[i, j]) for j in range(n)), arb(0))
        if not reach < limit:
            return False
    return True


def ball(x: Vector, radius: Fraction) -> list[Interval]:
    """Return the intervals x_i - radius .. x_i + radius."""
    return [between(v - radius, v + radius) for v in x]


def flow(model: Model, x: Sequence[Interval], u: Vector) -> list[Interval]:
    """Return an enclosure of F(x, u), for states in intervals and an exact input."""
    offset = [xi - constant(r) for xi, r in zip(x, model.x_ref, strict=True)]
    inputs = [constant(a - b) for a, b in zip(u, model.u_ref, strict=True)]
    total = [constant(Fraction(force)) for force in model.b]
    moved, acting = _not_zero(offset), _not_zero(inputs)  # products with zero are zero, exactly
    for i in range(model.n):
        for j, d in moved:
            total[i] = total[i] + constant(a) * d if (a := model.A0[i][j]) else total[i]
        for j, v in acting:
            total[i] = total[i] + constant(Fraction(b)) * v if (b := model.B[i][j]) else total[i]
    for channel in model.channels:
        spend(work_of(channel.program) + len(channel.row))
        f = value(channel.program, argument(channel.row, offset))
        for i, weight in enumerate(() if f.is_zero else channel.column):
            total[i] = total[i] + constant(Fraction(weight)) * f if weight else total[i]
    return total


def _not_zero(values: Sequence[Interval]) -> list[tuple[int, Interval]]:
    return [(j, v) for j, v in enumerate(values) if not v.is_zero]


def jacobian(model: Model, x: Sequence[Interval]) -> list[list[Interval]]:
    """Return an enclosure of dF/dx over a box (at kinks, of all limits of the derivative)."""
    offset = [xi - constant(r) for xi, r in zip(x, model.x_ref, strict=True)]
    n, size = model.n, len(model.channels)
    spend(n * n * size // PRODUCTS)
    slopes = arb_mat(size, n)
    for c, channel in enumerate(model.channels):
        y = argument(channel.row, offset)
        slope = value_and_slope(channel.program, y, constant(Fraction(1)))[1].ball()
        for j, r in channel.row.items():
            slopes[c, j] = constant(r).ball() * slope
    columns = arb_mat(n, size, [channel.column[i] for i in range(n) for channel in model.channels])
    J = arb_mat(n, n, [constant(a).ball() for row in model.A0 for a in row]) + columns * slopes
    return [[enclose(J[i, j]) for j in range(n)] for i in range(n)]


def argument(row: Mapping[int, Fraction], offset: Sequence[Interval]) -> Interval:
    """Return r'd, for offsets d in intervals."""
    total = constant(Fraction(0))
    for i, r in row.items():
        total = total + constant(r) * offset[i]
    return total
