"""Operating points: exactly one equilibrium in a ball, by the Krawczyk operator in interval arithmetic."""

from collections.abc import Iterable, Mapping, Sequence
from fractions import Fraction
from itertools import chain

from flint import arb, arb_mat, fmpz_mat

from persid_check.enclosure import Interval, UndefinedError, between, constant, enclose, value, value_and_slope
from persid_check.expression import work_of
from persid_check.model import Model
from persid_check.work import spend

PRODUCTS = 16  # of balls in a product of matrices, that a step counts for

Vector = Sequence[Fraction]


def has_unique_equilibrium(model: Model, x: Vector, radius: Fraction, u: Vector) -> bool:
    """Whether exactly one zero of F(., u) in |. - x|_inf <= radius is proved; radius 0 needs F(x, u) = 0 exactly."""
    return first_radius(model, x, (radius,), u) is not None


def first_radius(model: Model, x: Vector, radii: Iterable[Fraction], u: Vector) -> Fraction | None:
    """Return the first of some radii with which that is proved, None where it is with none."""
    try:
        F = flow(model, x, u)
    except (UndefinedError, ZeroDivisionError):
        return None
    return next((radius for radius in radii if _is_unique(model, F, x, radius)), None)


def _is_unique(model: Model, F: arb_mat, x: Vector, radius: Fraction) -> bool:
    if radius <= 0:
        return radius == 0 and all(f == 0 for f in F.entries())
    try:
        return _contracts(F, jacobian_balls(model, ball(x, radius)), radius)
    except (UndefinedError, ZeroDivisionError):
        return False


def _contracts(F: arb_mat, J: arb_mat, radius: Fraction) -> bool:
    """-Y F(x) + (I - Y J) [-r, r] lies in the interior of [-r, r], for some Y: about the inverse of J."""
    n = F.nrows()
    spend(n**3 // PRODUCTS)
    one = arb_mat(fmpz_mat(n, n, [int(i == j) for i in range(n) for j in range(n)]))
    Y, limit = J.mid().solve(one, algorithm="approx").mid(), constant(radius).lo
    moved = (one - Y * J) * arb_mat(n, 1, [arb(0, limit)] * n) - Y * F
    return all(abs(entry) < limit for entry in moved.entries())


def ball(x: Vector, radius: Fraction) -> list[Interval]:
    """Return the intervals x_i - radius .. x_i + radius."""
    return [between(v - radius, v + radius) for v in x]


def flow(model: Model, x: Vector, u: Vector) -> arb_mat:
    """Return an enclosure of F(x, u), one column; of short numbers, where functions have short values, it is exact."""
    offset = [constant(v - r) for v, r in zip(x, model.x_ref, strict=True)]
    inputs = [constant(v - r) for v, r in zip(u, model.u_ref, strict=True)]
    found = []
    for channel in model.channels:
        spend(work_of(channel.program) + len(channel.row))
        found.append(value(channel.program, argument(channel.row, offset)))
    B = arb_mat(model.n, model.m, list(chain.from_iterable(model.B)))
    forced = arb_mat(model.n, 1, [constant(Fraction(force)).ball() for force in model.b])
    return _linear(model) * _column(offset) + _columns(model) * _column(found) + B * _column(inputs) + forced


def jacobian(model: Model, x: Sequence[Interval]) -> list[list[Interval]]:
    """Return an enclosure of dF/dx over a box (at kinks, of all limits of the derivative)."""
    return [[enclose(entry) for entry in row] for row in jacobian_balls(model, x).tolist()]


def jacobian_balls(model: Model, x: Sequence[Interval]) -> arb_mat:
    """Return the same as one matrix of balls."""
    offset = [xi - constant(r) for xi, r in zip(x, model.x_ref, strict=True)]
    n, size = model.n, len(model.channels)
    spend(n * n * size // PRODUCTS)
    slopes = arb_mat(size, n)
    for c, channel in enumerate(model.channels):
        y = argument(channel.row, offset)
        slope = value_and_slope(channel.program, y, constant(Fraction(1)))[1].ball()
        for j, r in channel.row.items():
            slopes[c, j] = constant(r).ball() * slope
    return _linear(model) + _columns(model) * slopes


def _linear(model: Model) -> arb_mat:
    return arb_mat(model.linear.flint) * arb(2) ** -model.linear.exponent


def _columns(model: Model) -> arb_mat:
    listed = [channel.column for channel in model.channels]
    return arb_mat(len(listed), model.n, list(chain.from_iterable(listed))).transpose()


def _column(values: Sequence[Interval]) -> arb_mat:
    return arb_mat(len(values), 1, [v.ball() for v in values])


def argument(row: Mapping[int, Fraction], offset: Sequence[Interval]) -> Interval:
    """Return r'd, for offsets d in intervals."""
    total = constant(Fraction(0))
    for i, r in row.items():
        total = total + constant(r) * offset[i]
    return total
